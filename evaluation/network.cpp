// SPDX-License-Identifier: Apache-2.0
#include "evaluation/network.h"

#include <algorithm>
#include <cmath>

#include "evaluation/exploration.h"

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

// Force of object and walls on a tool that follows a trajectory.
class TouchedObject {
 public:
  TouchedObject(const Trajectory& trajectory, const ForceTable& table, const SceneExtras& extras,
                double servo_rate_Hz)
      : trajectory_(trajectory), table_(table), extras_(extras), servo_rate_Hz_(servo_rate_Hz) {
    slid_at_first_N_ = extras.effect.slide_W_m.isZero()
                           ? Vector3d(Vector3d::Zero())
                           : untouched(-extras.effect.slid_W_m(0.0)).force_W;
    if (!extras.effect.relaxations.empty()) {
      remember_path();
    }
  }

  // On a tool at rest at `position_W`.
  Sample answer(double time_s, const Vector3d& position_W) const {
    Sample sample = elastic(time_s, position_W);
    const int contact = trajectory_.contact_at(time_s);
    if (contact >= 0 && !lags_N_.empty()) {
      const auto instant = static_cast<std::size_t>(std::lround(time_s * servo_rate_Hz_));
      sample.force_W -= lags_N_[std::min(instant, lags_N_.size() - 1)];
    }
    return sample;
  }

  // Where a tool that wants to be at `position_W` gets to: the nearest position that the table
  // covers.
  Vector3d reached_W(double time_s, const Vector3d& position_W) const {
    const int contact = trajectory_.contact_at(time_s);
    if (contact < 0) {
      return position_W;
    }
    const Vector3d origin_W = trajectory_.contacts()[static_cast<std::size_t>(contact)].point_W +
                              extras_.effect.slid_W_m(time_s);
    const Vector3d displacement_W = position_W - origin_W;
    return origin_W + (trajectory_.is_exploration()
                           ? clamped_to_large_object(table_, displacement_W)
                           : table_.clamped(displacement_W));
  }

  // On the moving tool.
  Sample answer_on_path(double time_s, const Vector3d& position_W) const {
    Sample sample = answer(time_s, position_W);
    if (trajectory_.contact_at(time_s) >= 0) {
      sample.force_W -= extras_.effect.viscosity_Ns_per_m * velocity_W(time_s);
    }
    return sample;
  }

 private:
  // The object of the scene's table, before any effect.
  ForceTable::Value untouched(const Vector3d& displacement_W) const {
    return trajectory_.is_exploration() ? large_object(table_, displacement_W)
                                        : table_.at(displacement_W);
  }

  Sample elastic(double time_s, const Vector3d& position_W) const {
    Sample sample;
    sample.time_s = time_s;
    sample.position_W = position_W;
    sample.has_stiffness = true;
    const std::vector<ContactSpan>& contacts = trajectory_.contacts();
    for (std::size_t i = 0; i < contacts.size(); ++i) {
      // The epoch counts beginnings and ends; the first contact is 1.
      sample.contact_epoch += time_s >= contacts[i].begin_s ? 1 : 0;
      sample.contact_epoch += time_s >= contacts[i].end_s ? 1 : 0;
    }
    const int contact = trajectory_.contact_at(time_s);
    if (contact < 0) {
      return sample;
    }
    const ContactSpan& span = contacts[static_cast<std::size_t>(contact)];
    sample.contact_point_W = span.point_W;
    const Vector3d displacement_W = position_W - span.point_W - extras_.effect.slid_W_m(time_s);
    const ForceTable::Value value = untouched(displacement_W);
    const double factor = span.force_factor * extras_.effect.cut_factor(time_s);
    sample.force_W = factor * (value.force_W - slid_at_first_N_);
    sample.stiffness_W = factor * value.stiffness_W;
    for (const Wall& wall : extras_.walls) {
      const Wall::Value pushed = wall.at(position_W - first_contact_point_W());
      sample.force_W += pushed.force_W;
      sample.stiffness_W += pushed.stiffness_W;
    }
    return sample;
  }

  Vector3d velocity_W(double time_s) const noexcept {
    const double step_s = 0.5 / servo_rate_Hz_;
    const double before_s = std::max(0.0, time_s - step_s);
    const double after_s = std::min(trajectory_.duration_s(), time_s + step_s);
    return (trajectory_.position_W(after_s) - trajectory_.position_W(before_s)) /
           (after_s - before_s);
  }

  // sum_j g_j L_j at each servo instant; the force is assumed linear in between.
  void remember_path() {
    const std::vector<ObjectEffect::Relaxation>& relaxations = extras_.effect.relaxations;
    const auto instants =
        static_cast<std::size_t>(std::ceil(trajectory_.duration_s() * servo_rate_Hz_ - 1e-6));
    const double dt_s = 1.0 / servo_rate_Hz_;
    std::vector<Vector3d> lags_N(relaxations.size(), Vector3d::Zero());
    Vector3d before_N = Vector3d::Zero();
    int contact = -1;
    for (std::size_t i = 0; i < instants; ++i) {
      const double time_s = static_cast<double>(i) * dt_s;
      const int now = trajectory_.contact_at(time_s);
      const Vector3d force_N = elastic(time_s, trajectory_.position_W(time_s)).force_W;
      Vector3d sum_N = Vector3d::Zero();
      for (std::size_t j = 0; j < relaxations.size(); ++j) {
        const double x = dt_s / relaxations[j].time_s;
        const double kept = std::exp(-x);
        if (now != contact) {
          lags_N[j].setZero();
        } else {
          const Vector3d rise_N = (force_N - before_N) / x;
          lags_N[j] = kept * (lags_N[j] - before_N + rise_N) + force_N - rise_N;
        }
        sum_N += relaxations[j].share * lags_N[j];
      }
      contact = now;
      before_N = force_N;
      lags_N_.push_back(sum_N);
    }
  }

  const Trajectory& trajectory_;
  const ForceTable& table_;
  SceneExtras extras_;
  double servo_rate_Hz_;
  Vector3d slid_at_first_N_ = Vector3d::Zero();
  std::vector<Vector3d> lags_N_;
};

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
