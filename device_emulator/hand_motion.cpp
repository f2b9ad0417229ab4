// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/hand_motion.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <utility>

namespace forcegrid::emulator {

namespace {

using Eigen::Vector3d;
constexpr double kTurn_rad = 2.0 * std::numbers::pi;

constexpr double kChirpStart_Hz = 0.2;
constexpr double kChirpEnd_Hz = 3.0;
constexpr double kChirpRise_s = 20.0;

constexpr double kFadeIn_s = 0.5;
constexpr double kLissajousAmplitude_m[3] = {0.014, 0.014, 0.0105};
constexpr double kLissajousFrequency_Hz[3] = {0.53, 0.71, 0.97};

constexpr int kRandomSines = 60;
constexpr double kRandomLowest_Hz = 0.08;
constexpr double kRandomHighest_Hz = 5.0;
constexpr double kRandomCorner_Hz = 1.2;
constexpr double kRandomRms_m[3] = {0.007, 0.007, 0.0055};
// Where tanh starts to bend the motion: within the +-21 mm by -6..+27 mm of the study's objects.
constexpr double kRandomLimit_m[3] = {0.018, 0.018, 0.012};

constexpr double kPokePeriod_s = 0.8;
constexpr double kPokeRamp_s = 0.1;
constexpr double kPokeHold_s = 0.35;
constexpr double kPokeNearest_m = 0.008;
constexpr double kPokeFarthest_m = 0.018;

constexpr double kHoldHeight_m = 0.012;
constexpr double kHoldRamp_s = 1.0;
constexpr double kTremorAmplitude_m[3] = {0.0002, 0.00025, 0.0003};
constexpr double kTremorFrequency_Hz[3] = {8.4, 9.6, 10.7};
constexpr double kDriftAmplitude_m = 0.001;
constexpr double kDriftFrequency_Hz[3] = {0.05, 0.07, 0.11};

constexpr double kStrokePeriod_s = 6.0;
constexpr double kStrokeDown_m = 0.003;
constexpr double kStrokeUp_m = 0.004;
constexpr double kStrokeWidth_m = 0.010;
constexpr double kStrokeRamp_s = 0.5;   // down at the start, up after the slides
constexpr double kStrokeSlide_s = 4.0;  // twice out and back, to either side
constexpr double kStrokeFrequency_Hz = 0.5;

struct Name {
  MotionKind kind;
  const char* name;
};
constexpr Name kNames[] = {{MotionKind::kChirp, "chirp"},   {MotionKind::kLissajous, "lissajous"},
                           {MotionKind::kRandom, "random"}, {MotionKind::kPoke, "poke"},
                           {MotionKind::kHold, "hold"},     {MotionKind::kStill, "still"},
                           {MotionKind::kStroke, "stroke"}};

}  // namespace

MotionKind parse_motion(std::string_view name) {
  std::string known;
  for (const Name& entry : kNames) {
    if (name == entry.name) {
      return entry.kind;
    }
    known += known.empty() ? "" : ", ";
    known += entry.name;
  }
  throw std::invalid_argument("motion '" + std::string(name) + "' is unknown; use one of " + known +
                              ", path:FILE");
}

const char* to_string(MotionKind kind) noexcept {
  if (kind == MotionKind::kPath) {
    return "path";  // needs a file, so parse_motion() does not know it
  }
  for (const Name& entry : kNames) {
    if (kind == entry.kind) {
      return entry.name;
    }
  }
  return "unknown";
}

double minimum_jerk(double fraction) noexcept {
  const double t = std::clamp(fraction, 0.0, 1.0);
  return t * t * t * (10.0 + t * (-15.0 + 6.0 * t));
}

double chirp_frequency_Hz(double time_s) noexcept {
  return kChirpStart_Hz +
         (kChirpEnd_Hz - kChirpStart_Hz) * std::clamp(time_s / kChirpRise_s, 0.0, 1.0);
}

HandMotion::HandMotion(MotionKind kind, double amplitude_m, std::uint64_t seed,
                       std::vector<PathPoint> path)
    : kind_(kind), amplitude_m_(amplitude_m), path_(std::move(path)) {
  if (!(amplitude_m >= 0.0) || !std::isfinite(amplitude_m)) {
    throw std::invalid_argument("motion amplitude " + std::to_string(amplitude_m) +
                                " m is impossible; give a finite length of at least 0");
  }
  if (kind == MotionKind::kPath && path_.size() < 2) {
    throw std::invalid_argument("motion path without a path; give path:FILE");
  }
  std::mt19937_64 random(seed);
  const auto uniform = [&random](double low, double high) {
    // Not std::uniform_real_distribution: its sequence differs between standard libraries.
    return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1.0p-53);
  };
  if (kind == MotionKind::kRandom) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      double power = 0.0;
      for (int i = 0; i < kRandomSines; ++i) {
        const double spacing_Hz = (kRandomHighest_Hz - kRandomLowest_Hz) / kRandomSines;
        const double frequency_Hz = kRandomLowest_Hz + spacing_Hz * (i + uniform(0.0, 1.0));
        const double ratio = frequency_Hz / kRandomCorner_Hz;
        const double amplitude = 1.0 / (1.0 + ratio * ratio);
        sines_[axis].push_back({amplitude, frequency_Hz, uniform(0.0, kTurn_rad)});
        power += 0.5 * amplitude * amplitude;
      }
      for (Sine& sine : sines_[axis]) {
        sine.amplitude_m *= kRandomRms_m[axis] / std::sqrt(power);
      }
    }
  }
  for (Vector3d& target_D : poke_targets_D_) {
    const double length_m = uniform(kPokeNearest_m, kPokeFarthest_m);
    const double azimuth_rad = uniform(0.0, kTurn_rad);
    const double sin_elevation = uniform(0.0, 1.0);  // uniform over the upper half sphere
    const double cos_elevation = std::sqrt(1.0 - sin_elevation * sin_elevation);
    target_D = length_m * Vector3d(cos_elevation * std::cos(azimuth_rad),
                                   cos_elevation * std::sin(azimuth_rad), sin_elevation);
  }
}

Vector3d HandMotion::displacement_D(double time_s) const noexcept {
  if (!(time_s > 0.0)) {
    return Vector3d::Zero();
  }
  const double scale = amplitude_m_ / kNominalAmplitude_m;
  switch (kind_) {
    case MotionKind::kChirp:
      return chirp_D(time_s);
    case MotionKind::kLissajous:
      return scale * lissajous_D(time_s);
    case MotionKind::kRandom:
      return scale * random_D(time_s);
    case MotionKind::kPoke:
      return scale * poke_D(time_s);
    case MotionKind::kHold:
      return scale * hold_D(time_s);
    case MotionKind::kPath:
      return displacement_along(path_, time_s);
    case MotionKind::kStroke:
      return scale * stroke_D(time_s);
    case MotionKind::kStill:
      break;
  }
  return Vector3d::Zero();
}

Vector3d HandMotion::chirp_D(double time_s) const noexcept {
  const double rising_s = std::min(time_s, kChirpRise_s);
  const double slope_Hz_per_s = (kChirpEnd_Hz - kChirpStart_Hz) / kChirpRise_s;
  const double cycles = kChirpStart_Hz * rising_s + 0.5 * slope_Hz_per_s * rising_s * rising_s +
                        kChirpEnd_Hz * (time_s - rising_s);
  return {0.0, 0.0, amplitude_m_ * (1.0 - std::cos(kTurn_rad * cycles))};
}

Vector3d HandMotion::lissajous_D(double time_s) noexcept {
  const double fade = minimum_jerk(time_s / kFadeIn_s);
  return fade *
         Vector3d(
             kLissajousAmplitude_m[0] * std::sin(kTurn_rad * kLissajousFrequency_Hz[0] * time_s),
             kLissajousAmplitude_m[1] * std::sin(kTurn_rad * kLissajousFrequency_Hz[1] * time_s),
             kLissajousAmplitude_m[2] *
                 (1.0 - std::cos(kTurn_rad * kLissajousFrequency_Hz[2] * time_s)));
}

Vector3d HandMotion::random_D(double time_s) const noexcept {
  Vector3d sum = Vector3d::Zero();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double value_m = 0.0;
    for (const Sine& sine : sines_[axis]) {
      value_m +=
          sine.amplitude_m * std::sin(kTurn_rad * sine.frequency_Hz * time_s + sine.phase_rad);
    }
    sum[static_cast<Eigen::Index>(axis)] =
        kRandomLimit_m[axis] * std::tanh(value_m / kRandomLimit_m[axis]);
  }
  sum.z() += kRandomLimit_m[2];
  return minimum_jerk(time_s / kFadeIn_s) * sum;
}

Vector3d HandMotion::stroke_D(double time_s) noexcept {
  const double t = std::fmod(time_s, kStrokePeriod_s);
  const double from_m = time_s < kStrokePeriod_s ? 0.0 : kStrokeUp_m;
  const double slid_s = std::clamp(t - kStrokeRamp_s, 0.0, kStrokeSlide_s);
  const double down = minimum_jerk(t / kStrokeRamp_s);
  const double up = minimum_jerk((t - kStrokeRamp_s - kStrokeSlide_s) / kStrokeRamp_s);
  const double turns = kStrokeFrequency_Hz * slid_s;  // each out and back
  const double side = turns < 1.0 ? 1.0 : -1.0;
  return {0.0, 0.5 * side * kStrokeWidth_m * (1.0 - std::cos(kTurn_rad * turns)),
          from_m + down * (-kStrokeDown_m - from_m) + up * (kStrokeUp_m + kStrokeDown_m)};
}

Vector3d HandMotion::poke_D(double time_s) const noexcept {
  const double poke = std::floor(time_s / kPokePeriod_s);
  const double since_s = time_s - poke * kPokePeriod_s;
  const auto& target_D = poke_targets_D_[static_cast<std::size_t>(std::fmod(poke, 8.0))];
  return (minimum_jerk(since_s / kPokeRamp_s) -
          minimum_jerk((since_s - kPokeRamp_s - kPokeHold_s) / kPokeRamp_s)) *
         target_D;
}

Vector3d HandMotion::hold_D(double time_s) noexcept {
  const double fade = minimum_jerk((time_s - kHoldRamp_s) / kFadeIn_s);
  Vector3d result(0.0, 0.0, kHoldHeight_m * minimum_jerk(time_s / kHoldRamp_s));
  for (int axis = 0; axis < 3; ++axis) {
    result[axis] +=
        fade *
        (kTremorAmplitude_m[axis] * std::sin(kTurn_rad * kTremorFrequency_Hz[axis] * time_s) +
         kDriftAmplitude_m * std::sin(kTurn_rad * kDriftFrequency_Hz[axis] * time_s));
  }
  return result;
}

}  // namespace forcegrid::emulator
