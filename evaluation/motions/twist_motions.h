// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

namespace forcegrid::evaluation {

/// Where a tool that holds an object is, since it took hold.
struct TwistPose {
  Eigen::Vector3d displacement_W = Eigen::Vector3d::Zero();    ///< [m]
  Eigen::Quaterniond turn_W = Eigen::Quaterniond::Identity();  ///< about the tool's position
};

/// Motion of a hand that turns what it holds, t in seconds from 0 on. Each begins at rest in the
/// pose of the grasp and has reached its size after about a second (1 - exp(-t / 0.25 s)).
///
///   twist   lifts by 5 mm and turns about the tool's axis z by 0.5 rad sin phi, phi = 2 pi (0.2 t
///           + 0.1 t^2): 0.2 to 1.4 Hz in 6 s
///   wring   to and fro about z by 0.6 rad at 0.7 Hz while pulling up by 8 mm at 0.45 Hz
///   tilt    leans about y by 0.4 rad at 0.6 Hz and about x by 0.25 rad at 0.83 Hz while pushing
///           3 mm down
///   random  12 sines per axis, seeded, 0.1 to 3 Hz, amplitude 1 / (1 + (f / 1 Hz)^2): rotation
///           vector of 0.25 rad and displacement of 4 mm RMS along each axis, 5 mm up
///
/// Threads: const after construction.
class TwistMotion {
 public:
  static constexpr double kDuration_s = 6.0;

  /// @throws ChartError for an unknown name, listing the known ones.
  explicit TwistMotion(const std::string& name, std::uint64_t seed = 1);

  const std::string& name() const noexcept { return name_; }
  [[nodiscard]] TwistPose pose(double time_s) const;

 private:
  struct Sine {
    double frequency_Hz = 0.0;
    double phase_rad = 0.0;
    double amplitude = 0.0;
  };
  [[nodiscard]] double sines(std::size_t axis, double time_s) const;

  std::string name_;
  std::vector<std::vector<Sine>> sines_;  ///< six axes, each of RMS 1; of `random` alone
};

/// Their names, in the order above.
const std::vector<std::string>& twist_motion_names();

}  // namespace forcegrid::evaluation
