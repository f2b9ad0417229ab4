#include "evaluation/network.h"

#include <algorithm>
#include <cmath>

#include "evaluation/exploration.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

// A tick that falls on a servo instant but for rounding belongs to it.
constexpr double kSameInstant_s = 1e-9;
// So that noise of requests, noise of samples and the network's dice differ.
constexpr std::uint64_t kNoiseStream = 0x6E6F697365U;
constexpr std::uint64_t kNetworkStream = 0x6E6574U;
constexpr std::uint64_t kRequestStream = 0x726571U;

// What object and walls answer to a tool at `position_W` at `time_s`.
Sample answer(const Trajectory& trajectory, const ForceTable& table, const std::vector<Wall>& walls,
              double time_s, const Vector3d& position_W) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = position_W;
  sample.has_stiffness = true;
  const std::vector<ContactSpan>& contacts = trajectory.contacts();
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    // The epoch counts beginnings and ends, the first contact being 1.
    sample.contact_epoch += time_s >= contacts[i].begin_s ? 1 : 0;
    sample.contact_epoch += time_s >= contacts[i].end_s ? 1 : 0;
  }
  const int contact = trajectory.contact_at(time_s);
  if (contact >= 0) {
    const ContactSpan& span = contacts[static_cast<std::size_t>(contact)];
    sample.contact_point_W = span.point_W;
    const Vector3d displacement_W = position_W - span.point_W;
    const ForceTable::Value value = trajectory.is_exploration()
                                        ? large_object(table, displacement_W)
                                        : table.at(displacement_W);
    sample.force_W = span.force_factor * value.force_W;
    sample.stiffness_W = span.force_factor * value.stiffness_W;
    for (const Wall& wall : walls) {
      const Wall::Value pushed = wall.at(position_W - first_contact_point_W());
      sample.force_W += pushed.force_W;
      sample.stiffness_W += pushed.stiffness_W;
    }
  }
  return sample;
}

void add_noise(Sample& sample, double noise_N, SeededNumbers& numbers) {
  if (noise_N > 0.0) {
    for (int axis = 0; axis < 3; ++axis) {
      sample.force_W[axis] += noise_N * numbers.normal();
    }
  }
}

}  // namespace

const std::vector<NetworkCondition>& network_conditions() {
  static const std::vector<NetworkCondition> all = [] {
    std::vector<NetworkCondition> list;
    list.push_back({.name = "ideal"});
    list.push_back({.name = "stiffness", .stiffness = true});
    for (NetworkCondition condition : std::vector<NetworkCondition>{
             {.name = "delay100", .delay_s = 0.1},
             {.name = "lossy", .delay_s = 0.02, .jitter_s = 0.02, .loss = 0.2},
             {.name = "noise10", .noise_N = 0.01},
             {.name = "rate10", .simulator_rate_Hz = 10.0},
             {.name = "rate60", .simulator_rate_Hz = 60.0}}) {
      list.push_back(condition);
      condition.name += "+stiffness";
      condition.stiffness = true;
      list.push_back(condition);
    }
    for (const double rate : {30.0, 60.0, 120.0}) {
      list.push_back(
          {.name = "requests" + std::to_string(static_cast<int>(rate)), .requests_per_s = rate});
    }
    return list;
  }();
  return all;
}

const NetworkCondition& network_condition(const std::string& name) {
  std::string known;
  for (const NetworkCondition& condition : network_conditions()) {
    if (condition.name == name) {
      return condition;
    }
    known += (known.empty() ? "" : ", ") + condition.name;
  }
  throw ChartError("condition '" + name + "' is not known; known conditions: " + known);
}

Trace make_trace(const Trajectory& trajectory, const ForceTable& table,
                 const NetworkCondition& condition, double servo_rate_Hz, std::uint64_t seed,
                 const std::vector<Wall>& walls) {
  Trace trace;
  const double period_s = 1.0 / servo_rate_Hz;
  const auto instants =
      static_cast<std::size_t>(std::ceil(trajectory.duration_s() * servo_rate_Hz - 1e-6));
  int contact = -1;
  for (std::size_t i = 0; i < instants; ++i) {
    ServoInstant instant;
    instant.time_s = static_cast<double>(i) * period_s;
    instant.position_W = trajectory.position_W(instant.time_s);
    instant.force_W = answer(trajectory, table, walls, instant.time_s, instant.position_W).force_W;
    const int now = trajectory.contact_at(instant.time_s);
    if (contact >= 0 && now != contact) {
      trace.events.push_back({instant.time_s, false, Vector3d::Zero()});
    }
    if (now >= 0 && now != contact) {
      trace.events.push_back(
          {instant.time_s, true, trajectory.contacts()[static_cast<std::size_t>(now)].point_W});
    }
    contact = now;
    trace.servo.push_back(instant);
  }

  SeededNumbers noise(seed ^ kNoiseStream);
  SeededNumbers network(seed ^ kNetworkStream);
  const double simulator_period_s = 1.0 / condition.simulator_rate_Hz;
  for (std::size_t k = 0;; ++k) {
    const double tick_s = static_cast<double>(k) * simulator_period_s;
    const auto at = static_cast<std::size_t>(std::ceil((tick_s - kSameInstant_s) * servo_rate_Hz));
    if (at >= instants) {
      break;
    }
    const ServoInstant& instant = trace.servo[at];
    DeliveredSample delivered;
    delivered.sample = answer(trajectory, table, walls, instant.time_s, instant.position_W);
    add_noise(delivered.sample, condition.noise_N, noise);
    const double jitter_s = condition.jitter_s * network.uniform(0.0, 1.0);
    const bool lost = network.uniform(0.0, 1.0) < condition.loss;
    delivered.delivered_s = tick_s + simulator_period_s + condition.delay_s + jitter_s;
    if (!lost && delivered.delivered_s <= trace.servo.back().time_s) {
      trace.samples.push_back(delivered);
    }
  }
  std::stable_sort(trace.samples.begin(), trace.samples.end(),
                   [](const DeliveredSample& a, const DeliveredSample& b) {
                     return a.delivered_s < b.delivered_s;
                   });
  return trace;
}

JudgeOptions judge_options(const Trajectory& trajectory, const ForceTable& table,
                           const NetworkCondition& condition, std::uint64_t seed,
                           const std::vector<Wall>& walls) {
  JudgeOptions options;
  options.stiffness_to_method = condition.stiffness;
  options.requests_per_s = condition.requests_per_s;
  if (condition.requests_per_s > 0.0) {
    options.request_delay_s = 1.0 / condition.requests_per_s;
    options.answer = [&trajectory, &table, walls, noise_N = condition.noise_N,
                      noise = SeededNumbers(seed ^ kRequestStream)](
                         double time_s, const Vector3d& position_W) mutable {
      Vector3d reached_W = position_W;
      const int contact = trajectory.contact_at(time_s);
      if (contact >= 0 && !trajectory.is_exploration()) {
        const Vector3d& point_W = trajectory.contacts()[static_cast<std::size_t>(contact)].point_W;
        reached_W = point_W + table.clamped(position_W - point_W);
      }
      Sample sample = answer(trajectory, table, walls, time_s, reached_W);
      sample.from_query = true;
      add_noise(sample, noise_N, noise);
      return sample;
    };
  }
  return options;
}

}  // namespace forcegrid::evaluation
