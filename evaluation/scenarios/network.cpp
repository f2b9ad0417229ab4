// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/network.h"

#include <algorithm>
#include <cmath>

#include "evaluation/scenarios/touched_object.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

// A tick that differs from a servo instant only by rounding belongs to it.
constexpr double kSameInstant_s = 1e-9;
// So that the random numbers of requests, samples and network differ.
constexpr std::uint64_t kNoiseStream = 0x6E6F697365U;
constexpr std::uint64_t kNetworkStream = 0x6E6574U;
constexpr std::uint64_t kRequestStream = 0x726571U;

// Least force in ObjectEffect's relative residual.
constexpr double kLeastForce_N = 0.05;

void add_noise(Sample& sample, double noise_N, SeededNumbers& numbers) {
  if (noise_N > 0.0) {
    for (int axis = 0; axis < 3; ++axis) {
      sample.force_W[axis] += noise_N * numbers.normal();
    }
  }
}

// A simulator that corrects a share of its last answer's error per tick, and reports the rest as
// residual.
void solve_partly(Sample& sample, double share, Sample& solved) {
  if (share >= 1.0) {
    return;
  }
  const Vector3d true_N = sample.force_W;
  const Vector3d before_N =
      sample.contact_epoch == solved.contact_epoch ? solved.force_W : Vector3d::Zero().eval();
  sample.force_W = before_N + share * (true_N - before_N);
  sample.relative_residual =
      (true_N - sample.force_W).norm() / std::max(sample.force_W.norm(), kLeastForce_N);
  sample.converged = false;
  solved = sample;
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
                 const SceneExtras& extras) {
  Trace trace;
  const TouchedObject object(trajectory, table, extras, servo_rate_Hz);
  const double period_s = 1.0 / servo_rate_Hz;
  const auto instants =
      static_cast<std::size_t>(std::ceil(trajectory.duration_s() * servo_rate_Hz - 1e-6));
  int contact = -1;
  for (std::size_t i = 0; i < instants; ++i) {
    ServoInstant instant;
    instant.time_s = static_cast<double>(i) * period_s;
    instant.position_W = trajectory.position_W(instant.time_s);
    instant.force_W = object.answer_on_path(instant.time_s, instant.position_W).force_W;
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
  Sample solved;  // the simulator's last answer
  for (std::size_t k = 0;; ++k) {
    const double tick_s = static_cast<double>(k) * simulator_period_s;
    const auto at = static_cast<std::size_t>(std::ceil((tick_s - kSameInstant_s) * servo_rate_Hz));
    if (at >= instants) {
      break;
    }
    const ServoInstant& instant = trace.servo[at];
    DeliveredSample delivered;
    delivered.sample = object.answer_on_path(instant.time_s, instant.position_W);
    solve_partly(delivered.sample, extras.effect.solved_share, solved);
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
                           const NetworkCondition& condition, double servo_rate_Hz,
                           std::uint64_t seed, const SceneExtras& extras) {
  JudgeOptions options;
  options.stiffness_to_method = condition.stiffness;
  options.requests_per_s = condition.requests_per_s;
  if (condition.requests_per_s > 0.0) {
    options.request_delay_s = 1.0 / condition.requests_per_s;
    options.answer = [noise_N = condition.noise_N,
                      object = TouchedObject(trajectory, table, extras, servo_rate_Hz),
                      noise = SeededNumbers(seed ^ kRequestStream)](
                         double time_s, const Vector3d& position_W) mutable {
      Sample sample = object.answer(time_s, object.reached_W(time_s, position_W));
      sample.from_query = true;
      add_noise(sample, noise_N, noise);
      return sample;
    };
  }
  return options;
}

}  // namespace forcegrid::evaluation
