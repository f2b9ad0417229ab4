// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "device_emulator/recorded_path.h"

namespace forcegrid::emulator {

/// What the operator does once the tool has touched the object.
enum class MotionKind : std::uint8_t {
  kChirp,      ///< z = A (1 - cos phi), 0.2 to 3 Hz over 20 s, then 3 Hz; the paper's experiment
  kLissajous,  ///< 0.53, 0.71, 0.97 Hz along x, y, z; 14 mm, 14 mm, 10.5 mm
  kRandom,     ///< 60 sines per axis, 0.08 to 5 Hz, RMS 7, 7, 5.5 mm, limited by tanh
  kPoke,       ///< 100 ms out to one of 8 targets within 18 mm, 0.35 s there, back; every 0.8 s
  kHold,       ///< 12 mm up, then tremor (8.4 to 10.7 Hz, 0.2 to 0.3 mm) and a slow 1 mm drift
  kStill,      ///< none
  kStroke,     ///< 3 mm down, to and fro by 10 mm along y, 4 mm up; again every 6 s
  kPath,       ///< a recorded path
};

#pragma GCC visibility push(default)
/// @throws std::invalid_argument listing the known names.
MotionKind parse_motion(std::string_view name);
const char* to_string(MotionKind kind) noexcept;
#pragma GCC visibility pop

/// Displacement of the hand's target over time, from zero. All motions except a recorded path are
/// continuous in position and speed. All of these except the stroke never go below their start
/// along z (pulling only). Source: the motions of the method study that the accuracy figures refer
/// to. Real-time: displacement_D() neither allocates, locks nor throws; up to 180 sines. Threads:
/// const after construction.
class HandMotion {
 public:
  static constexpr double kNominalAmplitude_m = 0.010;

  /// @param amplitude_m A of the chirp; the other motions scale by amplitude_m / 10 mm.
  /// @param seed for `random` (phases, frequencies) and `poke` (targets).
  /// @param path of kPath only: at least two points; its length is as recorded.
  /// @throws std::invalid_argument for an impossible amplitude, or a kPath without a path.
  HandMotion(MotionKind kind, double amplitude_m, std::uint64_t seed,
             std::vector<PathPoint> path = {});

  /// [m] frame D, at `time_s` [s] since the motion began; zero before.
  [[nodiscard]] Eigen::Vector3d displacement_D(double time_s) const noexcept;

 private:
  struct Sine {
    double amplitude_m;
    double frequency_Hz;
    double phase_rad;
  };

  Eigen::Vector3d chirp_D(double time_s) const noexcept;
  static Eigen::Vector3d lissajous_D(double time_s) noexcept;
  Eigen::Vector3d random_D(double time_s) const noexcept;
  Eigen::Vector3d poke_D(double time_s) const noexcept;
  static Eigen::Vector3d stroke_D(double time_s) noexcept;
  static Eigen::Vector3d hold_D(double time_s) noexcept;

  MotionKind kind_;
  double amplitude_m_;
  std::array<std::vector<Sine>, 3> sines_;
  std::array<Eigen::Vector3d, 8> poke_targets_D_;
  std::vector<PathPoint> path_;
};

/// Minimum-jerk blend from 0 at t <= 0 to 1 at t >= 1: 10 t^3 - 15 t^4 + 6 t^5.
/// Source: Flash and Hogan, J. Neuroscience 5(7), 1985.
double minimum_jerk(double fraction) noexcept;

/// Frequency [Hz] of the chirp `time_s` [s] after its start.
double chirp_frequency_Hz(double time_s) noexcept;

}  // namespace forcegrid::emulator
