// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace forcegrid::evaluation {

/// The tool holds the object from `begin_s` to before `end_s`; its displacement is measured from
/// `point_W`.
struct ContactSpan {
  double begin_s = 0.0;
  double end_s = 0.0;
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();  ///< [m]
  double force_factor = 1.0;  ///< stiffness of this place relative to the scene's object
};

/// Motion of a tool: one of those below, with t in seconds from 0 on and P = point + d(t) in the
/// workspace frame W; z is the surface's outward normal (pulling).
///
///   chirp          d_z = 10 mm (1 - cos phi), phi = 2 pi (0.2 t + 0.07 t^2): 0.2 to 3 Hz in 20 s;
///                  the paper's experiment
///   chirp_oblique  d = (16.5, 4, 3) mm sin phi + (0, 0, 6) mm (1 - exp(-t / 0.25 s))
///   lissajous      0.53, 0.71, 0.97 Hz along x, y, z: (14 sin, 14 sin(.. + 0.5),
///                  11 + 10.5 sin(.. - 1.4)) mm, times 1 - exp(-t / 0.5 s)
///   random         60 sines per axis, seeded, 0.08 to 5 Hz, amplitude 1 / (1 + (f / 1.2 Hz)^2),
///                  RMS 7, 7, 5.5 mm, bent by tanh to within 16, 16, 11 mm, z around 11 mm, times
///                  1 - exp(-t / 0.5 s)
///   poke           minimum jerk out in 100 ms to 8 targets in turn (5 to 20 mm, one of them a
///                  push of 5 mm), 0.35 s there, back; one every 0.8 s, the first at 0.05 s
///   hold           12 mm up, minimum jerk in 0.35 s, with a tremor of 0.2, 0.25, 0.3 mm at 8.4,
///                  9.6, 10.7 Hz and a drift of 0.64, 0.64, 0.43 mm at 0.05, 0.07, 0.11 Hz
///   tapping        0.4 s in contact, 0.4 s in the air: pushes 2.5 to 4.5 mm deep and 3 mm
///                  sideways, half a sine each, at places scattered by +-2 mm, seeded; the force is
///                  continuous when contact is made and lost
///   regrab         14 times: 1 s in contact, moving as `random` does, let go, 0.4 s through the
///                  air to another place within +-20 mm; the object is the same everywhere
///   regrab_varied  the same, each place stiffer or softer by up to 30 %, seeded
///   circle         8 mm around (0, 0, 9) mm at 0.8 Hz, in a plane tilted by 45 degrees about x,
///                  reached in the first second: for the work around a closed loop
///   exploration    as `random` does, around the centres of nine tiles in turn, each visited twice
///                  for 13 s, on a large object made of the scene's (exploration.h)
///
/// The first six are the static trajectories: one contact that lasts from 0 to the end.
/// Source: the method study that the accuracy figures refer to. It describes tapping, regrab and
/// circle only in words; their details were chosen here.
/// Threads: const after construction.
class Trajectory {
 public:
  /// @throws ChartError for an unknown name, listing the known ones.
  explicit Trajectory(const std::string& name, std::uint64_t seed = 1);

  const std::string& name() const noexcept { return name_; }
  double duration_s() const noexcept { return duration_s_; }
  bool is_static() const noexcept;
  bool is_closed_loop() const noexcept { return kind_ == Kind::kCircle; }
  bool is_exploration() const noexcept { return kind_ == Kind::kExploration; }

  /// [m] at `time_s` in 0..duration_s().
  Eigen::Vector3d position_W(double time_s) const noexcept;

  /// In order of time, without overlap.
  const std::vector<ContactSpan>& contacts() const noexcept { return contacts_; }
  /// The index in contacts() of the contact at `time_s`, or -1 in the air.
  int contact_at(double time_s) const noexcept;

  /// [s] Period of `circle`, and the beginning of its first whole turn.
  static constexpr double kLoopPeriod_s = 1.25;
  static constexpr double kFirstLoop_s = 1.25;
  static constexpr double kLoopRadius_m = 0.008;

 private:
  enum class Kind {
    kChirp,
    kChirpOblique,
    kLissajous,
    kRandom,
    kPoke,
    kHold,
    kTapping,
    kRegrab,
    kRegrabVaried,
    kCircle,
    kExploration
  };
  struct Sine {
    double amplitude_m;
    double frequency_Hz;
    double phase_rad;
  };
  struct Tap {
    double depth_m;
    Eigen::Vector3d sideways_W_m;
  };

  Eigen::Vector3d displacement_W(double time_s) const noexcept;
  Eigen::Vector3d random_W(double time_s) const noexcept;
  Eigen::Vector3d tapping_W(double time_s) const noexcept;
  Eigen::Vector3d regrab_W(double time_s) const noexcept;

  static const std::vector<std::pair<std::string, Kind>>& kinds();
  friend const std::vector<std::string>& trajectory_names();

  std::string name_;
  Kind kind_ = Kind::kChirp;
  double duration_s_ = 20.0;
  std::array<std::vector<Sine>, 3> sines_;
  std::vector<Tap> taps_;
  std::vector<ContactSpan> contacts_;
};

/// The names that Trajectory takes, in the order of its documentation.
const std::vector<std::string>& trajectory_names();

/// [m] First contact point, in a workspace of 0.16 x 0.12 x 0.12 m.
const Eigen::Vector3d& first_contact_point_W() noexcept;

/// Random numbers that are the same on every platform and with every standard library.
class SeededNumbers {
 public:
  explicit SeededNumbers(std::uint64_t seed) noexcept : state_(seed) {}
  double uniform(double low, double high) noexcept;  ///< in [low, high)
  double normal() noexcept;                          ///< mean 0, variance 1 (Box and Muller)

 private:
  std::uint64_t state_;  // of SplitMix64
};

}  // namespace forcegrid::evaluation
