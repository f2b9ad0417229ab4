// SPDX-License-Identifier: Apache-2.0
#include "stability/slow_simulator.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace forcegrid::stability {
namespace {

constexpr double kConverged = 0.6;
constexpr double kPause_s = 0.2;
constexpr double kJump_s = 0.5;
constexpr double kSkew = 0.01;
constexpr double kBias_N = 0.1;
constexpr double kOneIn = 0.05;
constexpr double kOutlier_N = 2.0;
// So that the random numbers of requests differ from those of the samples along the path.
constexpr std::uint64_t kRequestStream = 0x726571U;

}  // namespace

SlowSimulator::SlowSimulator(const evaluation::NetworkCondition& network, SimulatorFault fault,
                             std::uint64_t seed)
    : network_(network), fault_(fault), numbers_(seed), request_numbers_(seed ^ kRequestStream) {
  if (!(network.simulator_rate_Hz > 0.0) || !(network.loss >= 0.0 && network.loss <= 1.0) ||
      !(network.delay_s >= 0.0) || !(network.jitter_s >= 0.0)) {
    throw std::invalid_argument(
        "simulator: the rate must be above 0 Hz, loss within 0..1, delay and jitter at least 0");
  }
}

void SlowSimulator::publish(std::int64_t now_ns, const Eigen::Vector3d& position_W,
                            const Eigen::Vector3d& velocity_W, const VirtualObject& object) {
  const double period_ns = 1e9 / network_.simulator_rate_Hz;
  const auto tick_ns = [&](std::int64_t tick) {
    return static_cast<std::int64_t>(std::llround(static_cast<double>(tick) * period_ns));
  };
  if (tick_ns(tick_) > now_ns) {
    return;
  }
  // The next cycle answers all ticks since the previous one.
  const std::int64_t due_ns = tick_ns(tick_);
  while (tick_ns(tick_) <= now_ns) {
    ++tick_;
  }
  const VirtualObject::Value value = object.at(position_W);
  ticked_ = true;
  contact_ = object.contact();
  expect_touch(position_W, velocity_W, object);
  Answer answer;
  answer.in_contact = contact_.in_contact;
  answer.expected_W = expected_W_;
  answer.sample.time_s = 1e-9 * static_cast<double>(now_ns);
  answer.sample.position_W = position_W;
  answer.sample.force_W = value.force_W;
  answer.sample.has_stiffness = network_.stiffness;
  if (network_.stiffness) {
    answer.sample.stiffness_W = value.stiffness_W;
  }
  answer.sample.contact_epoch = contact_.epoch;
  answer.sample.contact_point_W = contact_.point_W;
  add_noise(answer.sample, numbers_);
  if (!spoil(answer.sample.time_s, answer)) {
    return;
  }
  const double late_s = network_.delay_s + network_.jitter_s * numbers_.uniform(0.0, 1.0);
  answer.arrives_ns = due_ns + static_cast<std::int64_t>(std::llround(period_ns + 1e9 * late_s));
  if (numbers_.uniform(0.0, 1.0) < network_.loss) {
    ++lost_;
    return;
  }
  send(answer);
}

void SlowSimulator::expect_touch(const Eigen::Vector3d& position_W,
                                 const Eigen::Vector3d& velocity_W, const VirtualObject& object) {
  const std::optional<Eigen::Vector3d> touch_W =
      contact_.in_contact ? std::nullopt
                          : object.expected_touch_W(position_W, velocity_W, kExpectedWithin_s);
  if (!touch_W || !expected_W_ || (*touch_W - *expected_W_).norm() > kExpectedApart_m) {
    expected_W_ = touch_W;
  }
}

bool SlowSimulator::ask(std::int64_t now_ns, const Eigen::Vector3d& wanted_W,
                        const VirtualObject& object) {
  if (!(network_.requests_per_s > 0.0) || !ticked_ || !(contact_.in_contact || expected_W_)) {
    return false;
  }
  const Eigen::Vector3d point_W = contact_.in_contact ? contact_.point_W : *expected_W_;
  const VirtualObject::Value value = object.touched_at(point_W, wanted_W);
  Answer answer;
  answer.in_contact = contact_.in_contact;
  Sample& sample = answer.sample;
  sample.time_s = 1e-9 * static_cast<double>(now_ns);
  sample.position_W = wanted_W;
  sample.force_W = value.force_W;
  sample.has_stiffness = network_.stiffness;
  if (network_.stiffness) {
    sample.stiffness_W = value.stiffness_W;
  }
  sample.contact_epoch = contact_.epoch;
  sample.contact_point_W = point_W;
  sample.from_query = true;
  sample.before_contact = !contact_.in_contact;
  add_noise(sample, request_numbers_);
  const double late_s = 1.0 / network_.requests_per_s + network_.delay_s +
                        network_.jitter_s * request_numbers_.uniform(0.0, 1.0);
  answer.arrives_ns = now_ns + std::llround(1e9 * late_s);
  if (request_numbers_.uniform(0.0, 1.0) >= network_.loss) {
    send(answer);
  }
  return true;
}

void SlowSimulator::add_noise(Sample& sample, evaluation::SeededNumbers& numbers) const {
  for (Eigen::Index i = 0; i < 3 && network_.noise_N > 0.0; ++i) {
    sample.force_W[i] += network_.noise_N * numbers.normal();
  }
}

void SlowSimulator::send(const Answer& answer) {
  const auto place = std::upper_bound(
      under_way_.begin(), under_way_.end(), answer.arrives_ns,
      [](std::int64_t time_ns, const Answer& each) { return time_ns < each.arrives_ns; });
  under_way_.insert(place, answer);
}

bool SlowSimulator::spoil(double now_s, Answer& answer) {
  Sample& sample = answer.sample;
  switch (fault_) {
    case SimulatorFault::kNone:
      return true;
    case SimulatorFault::kUnconverged:
      unconverged_W_N_ += kConverged * (sample.force_W - unconverged_W_N_);
      sample.force_W = unconverged_W_N_;
      sample.converged = false;
      return true;
    case SimulatorFault::kRestarts:
      sample.contact_epoch += static_cast<std::uint32_t>(now_s);
      [[fallthrough]];
    case SimulatorFault::kPauses:
      return now_s < 1.0 || now_s - std::floor(now_s) >= kPause_s;
    case SimulatorFault::kClockJump:
      sample.time_s -= now_s >= 2.0 && now_s < 4.0 ? kJump_s : 0.0;
      return true;
    case SimulatorFault::kClockSkew:
      sample.time_s *= 1.0 + kSkew;
      return true;
    case SimulatorFault::kBias:
      sample.force_W.x() += kBias_N;
      return true;
    case SimulatorFault::kOutliers:
      if (numbers_.uniform(0.0, 1.0) < kOneIn) {
        for (Eigen::Index i = 0; i < 3; ++i) {
          sample.force_W[i] += numbers_.uniform(-kOutlier_N, kOutlier_N);
        }
      }
      return true;
    case SimulatorFault::kNotFinite:
      if (numbers_.uniform(0.0, 1.0) < kOneIn) {
        sample.force_W.setConstant(std::nan(""));
      }
      return true;
  }
  return true;
}

std::optional<SlowSimulator::Answer> SlowSimulator::receive(std::int64_t now_ns) {
  if (under_way_.empty() || under_way_.front().arrives_ns > now_ns) {
    return std::nullopt;
  }
  const Answer answer = under_way_.front();
  under_way_.erase(under_way_.begin());
  return answer;
}

}  // namespace forcegrid::stability
