// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::stability {

/// An object that two tools hold, elastic and without memory of their paths: its forces are the
/// gradient of one energy over both displacements. Threads: one.
class PairObject {
 public:
  PairObject() = default;
  virtual ~PairObject() = default;
  PairObject(const PairObject&) = delete;
  PairObject& operator=(const PairObject&) = delete;

  /// [N] On both tools. @param displacements_m of both from where they touched.
  virtual PairVector forces_N(const PairVector& displacements_m) = 0;
  /// [N/m] dF_i/dP_j where forces_N() was asked last; nothing where that isn't known.
  virtual std::optional<PairMatrix> stiffness_N_per_m() const = 0;
};

/// Makes an object of the stiffness K that a tool feels at rest while the other one stands still.
using PairObjectMaker = std::function<std::unique_ptr<PairObject>(double stiffness_N_per_m)>;

/// Three springs in closed form: a hardening one from each tool to the ground and one between them,
/// the same in every direction. With d_i the tools' displacements,
///
///   F_1 = -s(|d_1|) d_1 - c s(|d_1 - d_2|) (d_1 - d_2),   s(r) = K' (1 + (r/a)^2)
///
/// and F_2 likewise; c = kBetween. K' is chosen so that K = K' (1 + c). When both move against each
/// other a tool feels K' (1 + 2c), when they move together K'.
class SpringPair final : public PairObject {
 public:
  static constexpr double kBetween = 0.5;
  static constexpr double kHardens_m = 0.020;

  /// @param stiffness_N_per_m K. @param hardens_m a; infinite: linear springs.
  explicit SpringPair(double stiffness_N_per_m, double hardens_m = kHardens_m)
      : spring_N_per_m_(stiffness_N_per_m / (1.0 + kBetween)),
        hardening_per_m2_(1.0 / (hardens_m * hardens_m)) {}

  PairVector forces_N(const PairVector& displacements_m) override {
    at_m_ = displacements_m;
    const Eigen::Vector3d first = at_m_.head<3>();
    const Eigen::Vector3d second = at_m_.tail<3>();
    const Eigen::Vector3d between_N = kBetween * pull_N(first - second);
    PairVector forces;
    forces << pull_N(first) + between_N, pull_N(second) - between_N;
    return forces;
  }

  std::optional<PairMatrix> stiffness_N_per_m() const override {
    const Eigen::Vector3d first = at_m_.head<3>();
    const Eigen::Vector3d second = at_m_.tail<3>();
    const Eigen::Matrix3d between = kBetween * gradient_N_per_m(first - second);
    PairMatrix stiffness;
    stiffness << gradient_N_per_m(first) + between, -between,  //
        -between, gradient_N_per_m(second) + between;
    return stiffness;
  }

 private:
  Eigen::Vector3d pull_N(const Eigen::Vector3d& d_m) const {
    return -spring_N_per_m_ * (1.0 + hardening_per_m2_ * d_m.squaredNorm()) * d_m;
  }
  Eigen::Matrix3d gradient_N_per_m(const Eigen::Vector3d& d_m) const {
    return -spring_N_per_m_ *
           ((1.0 + hardening_per_m2_ * d_m.squaredNorm()) * Eigen::Matrix3d::Identity() +
            2.0 * hardening_per_m2_ * d_m * d_m.transpose());
  }

  double spring_N_per_m_;
  double hardening_per_m2_;
  PairVector at_m_ = PairVector::Zero();
};

/// The name of SpringPair in a list of objects.
inline constexpr char kSprings[] = "springs";

/// Makes the objects of this name: kSprings, or a scene of 'simulate', solved under both tools
/// (evaluation::SolvedPair<float>) as a simulator of the servo's rate would solve it. Each tool
/// holds the scene's patch where evaluation::PairMotion touches, and all forces are scaled so that
/// K is the stiffness along the normal, z, of the first tool. An equilibrium in springs does not
/// depend on their scale.
/// @throws simulator::Error for a scene that can't be made or whose tool slides or turns. The maker
/// throws evaluation::ChartError for one that is not held at both points.
PairObjectMaker pair_object_of(const std::string& name);

}  // namespace forcegrid::stability
