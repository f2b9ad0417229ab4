// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/twist_motions.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "evaluation/files/error.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr std::size_t kAxes = 6;
constexpr int kSines = 12;
constexpr double kLowest_Hz = 0.1;
constexpr double kHighest_Hz = 3.0;
constexpr double kRandomTurn_rad = 0.25;
constexpr double kRandomWay_m = 0.004;

double swelling(double time_s) { return 1.0 - std::exp(-time_s / 0.25); }

double sine(double frequency_Hz, double time_s) { return std::sin(kTwoPi * frequency_Hz * time_s); }

Quaterniond turn_by(const Vector3d& theta_W_rad) {
  const double angle_rad = theta_W_rad.norm();
  return angle_rad > 0.0 ? Quaterniond(AngleAxisd(angle_rad, theta_W_rad / angle_rad))
                         : Quaterniond::Identity();
}

// Uniform in [0, 1), the same on every machine.
double uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11U) * 0x1.0p-53; }

}  // namespace

const std::vector<std::string>& twist_motion_names() {
  static const std::vector<std::string> names = {"twist", "wring", "tilt", "random"};
  return names;
}

TwistMotion::TwistMotion(const std::string& name, std::uint64_t seed) : name_(name) {
  const std::vector<std::string>& known = twist_motion_names();
  if (std::find(known.begin(), known.end(), name) == known.end()) {
    std::string list;
    for (const std::string& each : known) {
      list += (list.empty() ? "" : ", ") + each;
    }
    throw ChartError("motion '" + name + "' is unknown; write one of: " + list);
  }
  if (name != "random") {
    return;
  }
  std::mt19937_64 random(seed);
  for (std::size_t axis = 0; axis < kAxes; ++axis) {
    std::vector<Sine> sines;
    double squares = 0.0;
    for (int k = 0; k < kSines; ++k) {
      const double f_Hz = kLowest_Hz + (kHighest_Hz - kLowest_Hz) * (k + uniform(random)) / kSines;
      sines.push_back({f_Hz, kTwoPi * uniform(random), 1.0 / (1.0 + f_Hz * f_Hz)});
      squares += 0.5 * sines.back().amplitude * sines.back().amplitude;
    }
    for (Sine& each : sines) {
      each.amplitude /= std::sqrt(squares);
    }
    sines_.push_back(std::move(sines));
  }
}

double TwistMotion::sines(std::size_t axis, double time_s) const {
  double sum = 0.0;
  for (const Sine& each : sines_[axis]) {
    sum += each.amplitude * std::sin(kTwoPi * each.frequency_Hz * time_s + each.phase_rad);
  }
  return sum;
}

TwistPose TwistMotion::pose(double time_s) const {
  const double size = swelling(time_s);
  Vector3d way_W_m;
  Vector3d theta_W_rad;
  if (name_ == "twist") {
    way_W_m = {0.0, 0.0, 0.005};
    const double phase_rad = kTwoPi * (0.2 * time_s + 0.1 * time_s * time_s);
    theta_W_rad = {0.0, 0.0, 0.5 * std::sin(phase_rad)};
  } else if (name_ == "wring") {
    way_W_m = {0.0, 0.0, 0.004 * (1.0 - std::cos(kTwoPi * 0.45 * time_s))};
    theta_W_rad = {0.0, 0.0, 0.6 * sine(0.7, time_s)};
  } else if (name_ == "tilt") {
    way_W_m = {0.0, 0.0, -0.003};
    theta_W_rad = {0.25 * sine(0.83, time_s), 0.4 * sine(0.6, time_s), 0.0};
  } else {
    way_W_m = kRandomWay_m * Vector3d(sines(0, time_s), sines(1, time_s), sines(2, time_s));
    way_W_m.z() += 0.005;
    theta_W_rad = kRandomTurn_rad * Vector3d(sines(3, time_s), sines(4, time_s), sines(5, time_s));
  }
  return {size * way_W_m, turn_by(size * theta_W_rad)};
}

}  // namespace forcegrid::evaluation
