// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "forcegrid/core/force_method.h"

namespace forcegrid::testing {

/// An elastic object in closed form: twelve springs with cubic hardening between the tool and
/// anchors around it, at rest where the tool is grabbed. Conservative by construction.
///
///   F(d) = sum_s -k_s g_s(|d - a_s| - |a_s|) (d - a_s)/|d - a_s| ,   g(e) = e + c e^3
class AnchoredSprings {
 public:
  explicit AnchoredSprings(unsigned seed, double scale = 1.0) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (Spring& s : springs_) {
      Eigen::Vector3d direction(uniform(random), uniform(random), uniform(random));
      s.anchor_m = (0.10 + 0.02 * uniform(random)) * direction.normalized();
      s.stiffness_N_per_m = scale * (75.0 + 30.0 * uniform(random));
    }
  }

  Eigen::Vector3d force_N(const Eigen::Vector3d& d_m) const {
    Eigen::Vector3d force = Eigen::Vector3d::Zero();
    for (const Spring& s : springs_) {
      const Eigen::Vector3d from_anchor = d_m - s.anchor_m;
      const double length_m = from_anchor.norm();
      const double extension_m = length_m - s.anchor_m.norm();
      force -= s.stiffness_N_per_m * (extension_m + kCubic_per_m2 * std::pow(extension_m, 3)) /
               length_m * from_anchor;
    }
    return force;
  }

  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& d_m) const {
    Eigen::Matrix3d j;
    constexpr double kStep_m = 1e-5;
    for (int a = 0; a < 3; ++a) {
      const Eigen::Vector3d step = kStep_m * Eigen::Vector3d::Unit(a);
      j.col(a) = (force_N(d_m + step) - force_N(d_m - step)) / (2.0 * kStep_m);
    }
    return j;
  }

 private:
  static constexpr double kCubic_per_m2 = 2000.0;
  struct Spring {
    Eigen::Vector3d anchor_m;
    double stiffness_N_per_m;
  };
  std::array<Spring, 12> springs_;
};

/// A seeded motion of a hand: 20 sines per axis from 0.1 to 3 Hz, 6 mm RMS, from rest at zero.
class HandMotion {
 public:
  explicit HandMotion(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> phase(0.0, 2.0 * std::numbers::pi);
    for (auto& axis : phase_rad_) {
      for (double& p : axis) {
        p = phase(random);
      }
    }
  }

  Eigen::Vector3d position_m(double time_s) const {
    Eigen::Vector3d d = Eigen::Vector3d::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t i = 0; i < 20; ++i) {
        const double f_Hz = 0.1 + 0.145 * static_cast<double>(i);
        const double amplitude_m = 0.004 / (1.0 + std::pow(f_Hz / 0.9, 2));
        d[static_cast<int>(axis)] +=
            amplitude_m * std::sin(2.0 * std::numbers::pi * f_Hz * time_s + phase_rad_[axis][i]);
      }
    }
    return d * (1.0 - std::exp(-time_s / 0.3));
  }

 private:
  std::array<std::array<double, 20>, 3> phase_rad_;
};

}  // namespace forcegrid::testing
