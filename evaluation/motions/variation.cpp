// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/variation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "evaluation/motions/minimum_jerk.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

constexpr double kFullTurn_rad = 2.0 * std::numbers::pi;
constexpr double kStiffnessVariation = 0.3;
constexpr double kTurnVariation_rad = 0.6;
constexpr double kShortLength_m = 0.015;
constexpr double kLongLength_m = 0.020;
constexpr double kPlaceSpacing_m = 0.020;
constexpr double kScatter_m = 0.004;
constexpr double kRise_s = 0.25;
constexpr double kApproach_s = 0.3;
constexpr double kApproachSpeed_m_per_s = 0.050;
constexpr double kExpectedWithin_s = 0.3;
constexpr double kFurthestSideways_m = 0.020;
constexpr double kMotionBegins_s = 2.0;  // where `random` has its full amplitude
constexpr double kWindows_s[] = {1.0 / 15.0, 0.25, 0.5};

}  // namespace

VariedObject::VariedObject(const ForceTable& table, std::uint64_t seed) : table_(table) {
  SeededNumbers numbers(seed);
  for (double& phase : phase_rad_) {
    phase = numbers.uniform(0.0, kFullTurn_rad);
  }
}

double VariedObject::stiffness_factor(const Vector3d& point_W) const noexcept {
  const Vector3d c = point_W - first_contact_point_W();
  return 1.0 + kStiffnessVariation * std::sin(c.x() / kShortLength_m + phase_rad_[0]) *
                   std::cos(c.y() / kLongLength_m + phase_rad_[1]);
}

double VariedObject::turn_rad(const Vector3d& point_W) const noexcept {
  const Vector3d c = point_W - first_contact_point_W();
  return kTurnVariation_rad * std::sin(c.x() / kLongLength_m + phase_rad_[2]) *
         std::cos(c.y() / kShortLength_m + phase_rad_[3]);
}

ForceTable::Value VariedObject::at(const Vector3d& point_W, const Vector3d& displacement_W) const {
  const double angle_rad = turn_rad(point_W);
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn(0, 0) = turn(1, 1) = std::cos(angle_rad);
  turn(1, 0) = std::sin(angle_rad);
  turn(0, 1) = -turn(1, 0);
  const double factor = stiffness_factor(point_W);
  const ForceTable::Value value = table_.at(turn.transpose() * displacement_W);
  return {factor * (turn * value.force_W), factor * (turn * value.stiffness_W * turn.transpose())};
}

Visits::Visits(std::uint64_t seed) : motion_("random", seed) {
  SeededNumbers numbers(seed);
  for (int contact = 0; contact < kTours * kPlaces * kContactsAPlace; ++contact) {
    const int place = contact / kContactsAPlace % kPlaces;
    const int row = place / 3;
    const int column = row % 2 == 0 ? place % 3 : 2 - place % 3;  // back and forth
    ContactSpan span;
    span.begin_s = contact * (kContact_s + kAir_s) + kAir_s;
    span.end_s = span.begin_s + kContact_s;
    span.point_W = first_contact_point_W() +
                   Vector3d(kPlaceSpacing_m * (column - 1), kPlaceSpacing_m * (row - 1), 0.0);
    span.point_W.x() += numbers.uniform(-kScatter_m, kScatter_m);
    span.point_W.y() += numbers.uniform(-kScatter_m, kScatter_m);
    contacts_.push_back(span);
  }
}

double Visits::duration_s() const noexcept { return contacts_.back().end_s; }

std::size_t Visits::contact_from(double time_s, bool& begun) const noexcept {
  const double period_s = kContact_s + kAir_s;
  const double period = std::floor(std::max(0.0, time_s) / period_s);
  const std::size_t contact = std::min(static_cast<std::size_t>(period), contacts_.size() - 1);
  begun = time_s >= contacts_[contact].begin_s;
  return contact;
}

Vector3d Visits::held_W(double time_s, const ContactSpan& span) const noexcept {
  const double since_s = time_s - span.begin_s;
  const double longest_s = motion_.duration_s() - kMotionBegins_s - kContact_s;
  const double motion_s = kMotionBegins_s + std::fmod(span.begin_s, longest_s) + since_s;
  Vector3d d = motion_.position_W(motion_s) - first_contact_point_W();
  const double sideways_m = d.head<2>().norm();
  if (sideways_m > 0.0) {
    d.head<2>() *= kFurthestSideways_m / sideways_m * std::tanh(sideways_m / kFurthestSideways_m);
  }
  return span.point_W + (1.0 - std::exp(-since_s / kRise_s)) * d;
}

Vector3d Visits::position_W(double time_s) const noexcept {
  bool begun = false;
  const std::size_t contact = contact_from(time_s, begun);
  const ContactSpan& span = contacts_[contact];
  if (begun) {
    return held_W(time_s, span);
  }
  const double until_s = span.begin_s - time_s;
  if (until_s <= kApproach_s) {
    return span.point_W + Vector3d(0.0, 0.0, kApproachSpeed_m_per_s * until_s);
  }
  Vector3d above_W = span.point_W + Vector3d(0.0, 0.0, kApproachSpeed_m_per_s * kApproach_s);
  if (contact == 0) {
    return above_W;
  }
  const ContactSpan& before = contacts_[contact - 1];
  const Vector3d released_W = held_W(before.end_s, before);
  const double fraction = (time_s - before.end_s) / (kAir_s - kApproach_s);
  return released_W + minimum_jerk(fraction) * (above_W - released_W);
}

std::optional<Vector3d> Visits::expected_point_W(const Vector3d& position_W,
                                                 const Vector3d& velocity_W) const noexcept {
  const double height_m = position_W.z() - first_contact_point_W().z();
  if (!(velocity_W.z() < 0.0) || height_m < 0.0 || height_m > -velocity_W.z() * kExpectedWithin_s) {
    return std::nullopt;
  }
  return Vector3d(position_W - height_m / velocity_W.z() * velocity_W);
}

namespace {

// Sums of squared errors in the windows of one group of contacts.
struct Pool {
  double sum_N2[4] = {};
  double count[4] = {};

  void add(double since_s, double error_N2) {
    for (int w = 0; w < 3; ++w) {
      if (since_s < kWindows_s[w]) {
        sum_N2[w] += error_N2;
        count[w] += 1.0;
      }
    }
    if (since_s >= kWindows_s[2]) {
      sum_N2[3] += error_N2;
      count[3] += 1.0;
    }
  }
  ContactErrors percent_of(double reference_rms_N) const {
    const auto percent = [&](int w) {
      return 100.0 * std::sqrt(sum_N2[w] / count[w]) / reference_rms_N;
    };
    return {percent(0), percent(1), percent(2), percent(3)};
  }
};

}  // namespace

VisitsVerdict judge_visits(ForceMethod& method, const ForceTable& table,
                           const VisitsOptions& options) {
  const VariedObject object(table, options.seed);
  const Visits visits(options.seed);
  const auto answer = [&object](double time_s, const Vector3d& position_W,
                                const Vector3d& point_W) {
    const ForceTable::Value value = object.at(point_W, position_W - point_W);
    Sample sample;
    sample.time_s = time_s;
    sample.position_W = position_W;
    sample.force_W = value.force_W;
    sample.has_stiffness = true;
    sample.stiffness_W = value.stiffness_W;
    sample.contact_point_W = point_W;
    return sample;
  };

  Trace trace;
  std::vector<double> since_s;  // of each servo instant; below zero: in the air
  const auto instants =
      static_cast<std::size_t>(std::ceil(visits.duration_s() * options.servo_rate_Hz - 1e-6));
  double next_sample_s = 0.0;
  bool was_held = false;
  for (std::size_t i = 0; i < instants; ++i) {
    ServoInstant instant;
    instant.time_s = static_cast<double>(i) / options.servo_rate_Hz;
    instant.position_W = visits.position_W(instant.time_s);
    bool held = false;
    const ContactSpan& span = visits.contacts()[visits.contact_from(instant.time_s, held)];
    if (held != was_held) {
      trace.events.push_back(
          {instant.time_s, held, held ? span.point_W : Vector3d(Vector3d::Zero())});
      was_held = held;
    }
    since_s.push_back(held ? instant.time_s - span.begin_s : -1.0);
    Sample sample;
    if (held) {
      sample = answer(instant.time_s, instant.position_W, span.point_W);
      instant.force_W = sample.force_W;
    }
    if (instant.time_s >= next_sample_s - 1e-9) {
      const double delivered_s = next_sample_s + 1.0 / options.simulator_rate_Hz;
      if (held) {
        trace.samples.push_back({sample, std::max(delivered_s, instant.time_s)});
      }
      next_sample_s += 1.0 / options.simulator_rate_Hz;
    }
    trace.servo.push_back(instant);
  }

  JudgeOptions judging;
  judging.keep_forces = true;
  judging.stiffness_to_method = options.stiffness;
  judging.requests_per_s = options.requests_per_s;
  if (options.requests_per_s > 0.0) {
    judging.request_delay_s = 1.0 / options.requests_per_s;
    judging.expect = [&visits](const Vector3d& position_W, const Vector3d& velocity_W) {
      return visits.expected_point_W(position_W, velocity_W);
    };
    const auto reached = [&table](const Vector3d& position_W, const Vector3d& point_W) {
      // Within the table for every rotation of the place.
      Vector3d d = position_W - point_W;
      const double sideways_m = d.head<2>().norm();
      d.head<2>() *= std::min(1.0, kFurthestSideways_m / std::max(sideways_m, 1e-9));
      return Vector3d(point_W + table.clamped(d));
    };
    judging.answer = [&visits, answer, reached](double time_s, const Vector3d& position_W) {
      bool held = false;
      const Vector3d& point_W = visits.contacts()[visits.contact_from(time_s, held)].point_W;
      return answer(time_s, reached(position_W, point_W), point_W);
    };
    judging.answer_before_contact = [answer, reached](double time_s, const Vector3d& position_W,
                                                      const Vector3d& point_W) {
      return answer(time_s, reached(position_W, point_W), point_W);
    };
  }
  Verdict verdict = judge(method, trace, judging);

  Pool first, unknown, first_tour, returns, second_tour;
  double reference_N2 = 0.0;
  double reference_count = 0.0;
  for (std::size_t i = 0; i < instants; ++i) {
    if (since_s[i] < 0.0) {
      continue;
    }
    bool held = false;
    const int contact = static_cast<int>(visits.contact_from(trace.servo[i].time_s, held));
    const bool at_a_new_place = contact % Visits::kContactsAPlace == 0;
    const bool again = contact >= Visits::kPlaces * Visits::kContactsAPlace;
    reference_N2 += trace.servo[i].force_W.squaredNorm();
    reference_count += 1.0;
    const double error_N2 = (verdict.forces_W[i] - trace.servo[i].force_W).squaredNorm();
    if (contact == 0) {
      first.add(since_s[i], error_N2);
    } else if (!again) {
      first_tour.add(since_s[i], error_N2);
      if (at_a_new_place) {
        unknown.add(since_s[i], error_N2);
      }
    } else {
      second_tour.add(since_s[i], error_N2);
      if (at_a_new_place) {
        returns.add(since_s[i], error_N2);
      }
    }
  }
  VisitsVerdict result;
  const double reference_rms_N = std::sqrt(reference_N2 / reference_count);
  result.errors.first_contact = first.percent_of(reference_rms_N);
  result.errors.unknown_places = unknown.percent_of(reference_rms_N);
  result.errors.first_tour = first_tour.percent_of(reference_rms_N);
  result.errors.returns = returns.percent_of(reference_rms_N);
  result.errors.second_tour = second_tour.percent_of(reference_rms_N);
  verdict.forces_W.clear();
  result.verdict = std::move(verdict);
  return result;
}

}  // namespace forcegrid::evaluation
