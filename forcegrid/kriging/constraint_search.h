// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "forcegrid/kriging/constraint_fit.h"
#include "forcegrid/kriging/kriging_field.h"

namespace forcegrid::kriging {

/// Looks for one-sided constraints that explain a sample that surprised the field.
///
/// It compares, by k1 alone, planes and balls against the innovation and planes across the lattice
/// directions near it, with surfaces between the samples sorted along them, and refines the best of
/// each kind. The best of these is accepted if it gains 15 nats over the refined present
/// constraints. With two in use it must replace one. A force that falls short along its own
/// direction means an object that gives way (a cut, relaxation) and is not explained.
/// Cost: some 200 triangular solves. Real-time: nothing allocates, locks or throws. Threads: one.
class ConstraintSearch {
 public:
  /// @param fit of the field's rows, of which the surprising sample's are the last. Its constraints
  ///   afterwards are those that explain the sample or, if none do, arbitrary: restore them then.
  /// @param error_N the part of the sample's force that the field did not predict.
  bool explain(ConstraintFit& fit, const Observation& observation,
               const Eigen::Vector3d& error_N) noexcept;

 private:
  using Shapes = ConstraintFit::Shapes;
  using Columns = ConstraintFit::Columns;
  using Column = ConstraintFit::Column;
  using Weights = ConstraintFit::Weights;
  using Found = std::array<UnilateralConstraint, 3>;
  struct Candidate {
    UnilateralConstraint constraint;
    double nats = 0.0;
  };

  bool refine_known(ConstraintFit& fit) const noexcept;
  void weigh(const ConstraintFit& fit, std::span<const UnilateralConstraint> shapes,
             Candidate& best) noexcept;
  void weigh_behind(const ConstraintFit& fit, const UnilateralConstraint& through, int gaps,
                    std::span<const double> parts, Candidate& best) noexcept;
  int search(ConstraintFit& fit, const Observation& observation, const Eigen::Vector3d& error_N,
             Found& found) noexcept;

  Columns trial_;
};

}  // namespace forcegrid::kriging
