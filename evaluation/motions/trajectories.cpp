// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/trajectories.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "evaluation/motions/exploration.h"
#include "evaluation/motions/minimum_jerk.h"
#include "evaluation/objects/force_table.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;
constexpr double kTurn_rad = 2.0 * std::numbers::pi;

const Vector3d kContactPoint_W{0.0805, 0.0613, 0.0482};

constexpr double kChirpStart_Hz = 0.2;
constexpr double kChirpRise_Hz_per_s = 0.14;  // to 3 Hz in 20 s
constexpr double kChirpAmplitude_m = 0.010;
const Vector3d kObliqueAmplitude_W_m{0.0165, 0.004, 0.003};
constexpr double kObliqueHeight_m = 0.006;
constexpr double kQuickRise_s = 0.25;
constexpr double kSlowRise_s = 0.5;

constexpr int kRandomSines = 60;
constexpr double kRandomLowest_Hz = 0.08;
constexpr double kRandomHighest_Hz = 5.0;
constexpr double kRandomCorner_Hz = 1.2;
constexpr double kRandomRms_m[3] = {0.007, 0.007, 0.0055};
constexpr double kRandomLimit_m[3] = {0.016, 0.016, 0.011};
constexpr double kRandomHeight_m = 0.011;

constexpr double kPokeStart_s = 0.05;
constexpr double kPokePeriod_s = 0.8;
constexpr double kPokeRamp_s = 0.1;
constexpr double kPokeHold_s = 0.35;
constexpr double kPokeDuration_s = 16.0;
constexpr double kPokeTargets_W_m[8][3] = {
    {0.0, 0.0, 0.016},     {0.006, 0.0, 0.014},     {-0.008, 0.004, 0.015}, {0.0, 0.0, -0.005},
    {0.010, 0.010, 0.010}, {-0.004, -0.012, 0.016}, {0.003, 0.002, 0.018},  {-0.010, 0.004, 0.012}};

constexpr double kHoldHeight_m = 0.012;
constexpr double kTremorAmplitude_m[3] = {0.0002, 0.00025, 0.0003};
constexpr double kTremorFrequency_Hz[3] = {8.4, 9.6, 10.7};
constexpr double kHoldRise_s = 0.35;
constexpr double kDriftAmplitude_m[3] = {0.00064, 0.00064, 0.00043};
constexpr double kDriftFrequency_Hz[3] = {0.05, 0.07, 0.11};

constexpr double kTapPeriod_s = 0.8;
constexpr double kTapContact_s = 0.4;
constexpr double kTapShallowest_m = 0.0025;
constexpr double kTapDeepest_m = 0.0045;
constexpr double kTapSideways_m = 0.003;
constexpr double kTapScatter_m = 0.002;

constexpr double kGrabPeriod_s = 1.4;
constexpr double kGrabContact_s = 1.0;
constexpr double kGrabRise_s = 0.3;
constexpr int kGrabs = 14;
constexpr double kGrabScatter_m = 0.020;
constexpr double kGrabVariation = 0.3;

const Vector3d kCircleCentre_W_m{0.0, 0.0, 0.009};

double rise(double time_s, double constant_s) { return 1.0 - std::exp(-time_s / constant_s); }

double chirp_phase_rad(double time_s) {
  return kTurn_rad * (kChirpStart_Hz * time_s + 0.5 * kChirpRise_Hz_per_s * time_s * time_s);
}

Vector3d lissajous_W(double time_s) {
  const double phase_rad = kTurn_rad * time_s;
  return rise(time_s, kSlowRise_s) * Vector3d(0.014 * std::sin(0.53 * phase_rad),
                                              0.014 * std::sin(0.71 * phase_rad + 0.5),
                                              0.011 + 0.0105 * std::sin(0.97 * phase_rad - 1.4));
}

Vector3d poke_W(double time_s) {
  const double poke = std::floor(time_s / kPokePeriod_s);
  const double since_s = time_s - poke * kPokePeriod_s - kPokeStart_s;
  const double there = minimum_jerk(since_s / kPokeRamp_s) -
                       minimum_jerk((since_s - kPokeRamp_s - kPokeHold_s) / kPokeRamp_s);
  return there * Vector3d(kPokeTargets_W_m[static_cast<std::size_t>(std::fmod(poke, 8.0))]);
}

Vector3d hold_W(double time_s) {
  const double there = minimum_jerk(time_s / kHoldRise_s);
  Vector3d result(0.0, 0.0, kHoldHeight_m);
  for (int axis = 0; axis < 3; ++axis) {
    result[axis] +=
        kTremorAmplitude_m[axis] * std::sin(kTurn_rad * kTremorFrequency_Hz[axis] * time_s) +
        kDriftAmplitude_m[axis] * std::sin(kTurn_rad * kDriftFrequency_Hz[axis] * time_s);
  }
  return there * result;
}

Vector3d circle_W(double time_s) {
  const double phase_rad = kTurn_rad * time_s / Trajectory::kLoopPeriod_s;
  const double tilted = std::numbers::sqrt2 / 2.0;
  const Vector3d on_circle =
      kCircleCentre_W_m + Trajectory::kLoopRadius_m * Vector3d(std::cos(phase_rad),
                                                               tilted * std::sin(phase_rad),
                                                               tilted * std::sin(phase_rad));
  return minimum_jerk(time_s) * on_circle;
}

}  // namespace

const Vector3d& first_contact_point_W() noexcept { return kContactPoint_W; }

double SeededNumbers::uniform(double low, double high) noexcept {
  state_ += 0x9E3779B97F4A7C15U;
  std::uint64_t z = state_;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
  z ^= z >> 31;
  return low + (high - low) * (static_cast<double>(z >> 11) * 0x1.0p-53);
}

double SeededNumbers::normal() noexcept {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform(0.0, 1.0)));
  return radius * std::cos(uniform(0.0, kTurn_rad));
}

const std::vector<std::pair<std::string, Trajectory::Kind>>& Trajectory::kinds() {
  static const std::vector<std::pair<std::string, Kind>> all{{"chirp", Kind::kChirp},
                                                             {"chirp_oblique", Kind::kChirpOblique},
                                                             {"lissajous", Kind::kLissajous},
                                                             {"random", Kind::kRandom},
                                                             {"poke", Kind::kPoke},
                                                             {"hold", Kind::kHold},
                                                             {"tapping", Kind::kTapping},
                                                             {"regrab", Kind::kRegrab},
                                                             {"regrab_varied", Kind::kRegrabVaried},
                                                             {"circle", Kind::kCircle},
                                                             {"exploration", Kind::kExploration}};
  return all;
}

const std::vector<std::string>& trajectory_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const auto& [name, kind] : Trajectory::kinds()) {
      all.push_back(name);
    }
    return all;
  }();
  return names;
}

Trajectory::Trajectory(const std::string& name, std::uint64_t seed) : name_(name) {
  const auto found = std::find_if(kinds().begin(), kinds().end(),
                                  [&name](const auto& each) { return each.first == name; });
  if (found == kinds().end()) {
    std::string known;
    for (const std::string& each : trajectory_names()) {
      known += (known.empty() ? "" : ", ") + each;
    }
    throw ChartError("trajectory '" + name + "' is not known; known trajectories: " + known);
  }
  kind_ = found->second;
  SeededNumbers numbers(seed);
  if (kind_ == Kind::kRandom || kind_ == Kind::kRegrab || kind_ == Kind::kRegrabVaried ||
      kind_ == Kind::kExploration) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      double power = 0.0;
      for (int i = 0; i < kRandomSines; ++i) {
        const double spacing_Hz = (kRandomHighest_Hz - kRandomLowest_Hz) / kRandomSines;
        const double frequency_Hz = kRandomLowest_Hz + spacing_Hz * (i + numbers.uniform(0.0, 1.0));
        const double ratio = frequency_Hz / kRandomCorner_Hz;
        const double amplitude = 1.0 / (1.0 + ratio * ratio);
        sines_[axis].push_back({amplitude, frequency_Hz, numbers.uniform(0.0, kTurn_rad)});
        power += 0.5 * amplitude * amplitude;
      }
      for (Sine& sine : sines_[axis]) {
        sine.amplitude_m *= kRandomRms_m[axis] / std::sqrt(power);
      }
    }
  }
  if (kind_ == Kind::kPoke) {
    duration_s_ = kPokeDuration_s;
  }
  if (kind_ == Kind::kExploration) {
    duration_s_ = kExploration_s;
  }
  if (kind_ == Kind::kTapping) {
    for (double begin_s = 0.0; begin_s < duration_s_; begin_s += kTapPeriod_s) {
      const Vector3d scatter_W(numbers.uniform(-kTapScatter_m, kTapScatter_m),
                               numbers.uniform(-kTapScatter_m, kTapScatter_m), 0.0);
      const double direction_rad = numbers.uniform(0.0, kTurn_rad);
      taps_.push_back(
          {numbers.uniform(kTapShallowest_m, kTapDeepest_m),
           kTapSideways_m * Vector3d(std::cos(direction_rad), std::sin(direction_rad), 0.0)});
      contacts_.push_back({begin_s, begin_s + kTapContact_s, kContactPoint_W + scatter_W});
    }
  } else if (kind_ == Kind::kRegrab || kind_ == Kind::kRegrabVaried) {
    for (int grab = 0; grab < kGrabs; ++grab) {
      const double begin_s = grab * kGrabPeriod_s;
      ContactSpan span{begin_s, begin_s + kGrabContact_s, kContactPoint_W};
      const Vector3d scatter_W(numbers.uniform(-kGrabScatter_m, kGrabScatter_m),
                               numbers.uniform(-kGrabScatter_m, kGrabScatter_m), 0.0);
      const double factor = 1.0 + numbers.uniform(-kGrabVariation, kGrabVariation);
      if (grab > 0) {
        span.point_W += scatter_W;
        span.force_factor = kind_ == Kind::kRegrabVaried ? factor : 1.0;
      }
      contacts_.push_back(span);
    }
  } else {
    contacts_.push_back({0.0, duration_s_ + kGrabPeriod_s, kContactPoint_W});
  }
}

bool Trajectory::is_static() const noexcept {
  return kind_ != Kind::kTapping && kind_ != Kind::kRegrab && kind_ != Kind::kRegrabVaried &&
         kind_ != Kind::kCircle && kind_ != Kind::kExploration;
}

int Trajectory::contact_at(double time_s) const noexcept {
  for (std::size_t i = 0; i < contacts_.size(); ++i) {
    if (time_s >= contacts_[i].begin_s && time_s < contacts_[i].end_s) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

Vector3d Trajectory::position_W(double time_s) const noexcept {
  switch (kind_) {
    case Kind::kTapping:
      return tapping_W(time_s);
    case Kind::kRegrab:
    case Kind::kRegrabVaried:
      return regrab_W(time_s);
    default:
      return kContactPoint_W + displacement_W(time_s);
  }
}

Vector3d Trajectory::displacement_W(double time_s) const noexcept {
  switch (kind_) {
    case Kind::kChirp:
      return {0.0, 0.0, kChirpAmplitude_m * (1.0 - std::cos(chirp_phase_rad(time_s)))};
    case Kind::kChirpOblique:
      return std::sin(chirp_phase_rad(time_s)) * kObliqueAmplitude_W_m +
             Vector3d(0.0, 0.0, kObliqueHeight_m * rise(time_s, kQuickRise_s));
    case Kind::kLissajous:
      return lissajous_W(time_s);
    case Kind::kRandom:
      return rise(time_s, kSlowRise_s) * random_W(time_s);
    case Kind::kPoke:
      return poke_W(time_s);
    case Kind::kHold:
      return hold_W(time_s);
    case Kind::kCircle:
      return circle_W(time_s);
    case Kind::kExploration:
      return exploration_centre_W_m(time_s) + rise(time_s, kSlowRise_s) * random_W(time_s);
    default:
      return Vector3d::Zero();
  }
}

Vector3d Trajectory::random_W(double time_s) const noexcept {
  Vector3d sum(0.0, 0.0, kRandomHeight_m);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double value_m = 0.0;
    for (const Sine& sine : sines_[axis]) {
      value_m +=
          sine.amplitude_m * std::sin(kTurn_rad * sine.frequency_Hz * time_s + sine.phase_rad);
    }
    sum[static_cast<Eigen::Index>(axis)] +=
        kRandomLimit_m[axis] * std::tanh(value_m / kRandomLimit_m[axis]);
  }
  return sum;
}

Vector3d Trajectory::tapping_W(double time_s) const noexcept {
  const std::size_t last = contacts_.size() - 1;
  const std::size_t tap =
      std::min(static_cast<std::size_t>(std::max(0.0, time_s / kTapPeriod_s)), last);
  const double since_s = time_s - contacts_[tap].begin_s;
  if (since_s < kTapContact_s) {
    const double push = std::sin(0.5 * kTurn_rad * since_s / kTapContact_s);
    return contacts_[tap].point_W + push * taps_[tap].sideways_W_m +
           Vector3d(0.0, 0.0, -push * taps_[tap].depth_m);
  }
  const double fraction = (since_s - kTapContact_s) / (kTapPeriod_s - kTapContact_s);
  const Vector3d& next_W = contacts_[std::min(tap + 1, last)].point_W;
  return contacts_[tap].point_W + minimum_jerk(fraction) * (next_W - contacts_[tap].point_W) +
         Vector3d(0.0, 0.0, taps_[tap].depth_m * std::sin(0.5 * kTurn_rad * fraction));
}

Vector3d Trajectory::regrab_W(double time_s) const noexcept {
  const std::size_t last = contacts_.size() - 1;
  const std::size_t grab =
      std::min(static_cast<std::size_t>(std::max(0.0, time_s / kGrabPeriod_s)), last);
  const ContactSpan& span = contacts_[grab];
  const double since_s = time_s - span.begin_s;
  if (since_s < kGrabContact_s) {
    return span.point_W + minimum_jerk(since_s / kGrabRise_s) * random_W(time_s);
  }
  const Vector3d released_W = span.point_W + random_W(span.end_s);
  const double fraction = (since_s - kGrabContact_s) / (kGrabPeriod_s - kGrabContact_s);
  const Vector3d& next_W = contacts_[std::min(grab + 1, last)].point_W;
  return released_W + minimum_jerk(fraction) * (next_W - released_W);
}

}  // namespace forcegrid::evaluation
