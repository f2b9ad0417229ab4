// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>

#include "forcegrid/kriging/constraint_fit.h"
#include "forcegrid/kriging/kriging_field.h"

namespace forcegrid::kriging {

/// Looks for one-sided constraints that explain a sample that surprised the field, in pieces.
///
/// First it refines the present constraints, then again from other curvatures: a plane may have no
/// descent path to a ball. If they do not explain all samples, it compares, by k1 alone, planes and
/// balls against the innovation and planes across the lattice directions near it, with surfaces
/// between the samples sorted along them, and refines the best of each kind. The best of these is
/// accepted if it gains 15 nats over the refined present constraints. With two in use it must
/// replace one. A force that falls short along its own direction means an object that gives way (a
/// cut, relaxation) and is not explained.
/// Cost: a piece is about a Newton step of a constraint, the first ones up to four of them (a
/// wall cannot wait), or two where the simulator has not converged; a search that finds the first
/// wall among 32 samples has 3 or 4, one in vain up to some 100. Real-time: nothing allocates,
/// locks or throws. Threads: one.
class ConstraintSearch {
 public:
  /// Begins with a surprising sample, whose rows must be the fit's last ones, and the fit's present
  /// constraints.
  /// @param error_N the part of the sample's force that the field did not predict.
  void begin(const Observation& observation, const Eigen::Vector3d& error_N) noexcept;
  /// Does one piece. Rows and data of the fit must be the same in all pieces. When it is over, the
  /// fit's constraints are those that explain the sample or, if none do, arbitrary: restore them.
  /// @returns whether there is more to do.
  bool step(ConstraintFit& fit) noexcept;
  /// Whether the search that is over has found an explanation.
  bool found() const noexcept { return found_; }

 private:
  using Shapes = ConstraintFit::Shapes;
  using Columns = ConstraintFit::Columns;
  using Column = ConstraintFit::Column;
  using Weights = ConstraintFit::Weights;
  enum class Stage : std::uint8_t {
    kBegins,
    kRefining,       ///< constraint `at_` of the present ones
    kRefiningAnew,   ///< the same from curvature `start_`
    kComparing,      ///< surfaces of kind `kind_` for new constraints
    kRefiningFound,  ///< constraint `at_` with the new one number `tried_`
    kOver,
  };
  struct Weighed {
    UnilateralConstraint constraint;
    double nats = 0.0;
  };
  // What a piece costs, as cost() of triangular solves with three right-hand sides. A wall cannot
  // wait: a search has some larger pieces, fewer where most were in vain.
  static constexpr int kPiece = 200'000;
  static constexpr int kSwiftPiece = 600'000;
  static constexpr int kSwiftestPiece = 750'000;
  static constexpr int kUnfinishedPiece = 300'000;
  static constexpr int kMostInVain = 6;
  /// Of one solve, and what belongs to it.
  static int cost(int rows) noexcept { return rows * (rows + 200); }

  int piece() const noexcept;
  void go_on(ConstraintFit& fit) noexcept;
  void end(bool found) noexcept;
  void begin_anew(ConstraintFit& fit) noexcept;
  void go_on_anew(ConstraintFit& fit) noexcept;
  void begin_comparing(ConstraintFit& fit) noexcept;
  void begin_replacing(ConstraintFit& fit) noexcept;
  void compare(ConstraintFit& fit) noexcept;
  void begin_refining_found(ConstraintFit& fit) noexcept;
  void judge_found(ConstraintFit& fit) noexcept;
  void weigh(const ConstraintFit& fit, std::span<const UnilateralConstraint> shapes) noexcept;
  void weigh_behind(const ConstraintFit& fit, const UnilateralConstraint& through, int gaps,
                    std::span<const double> parts) noexcept;
  void keep_weighed() noexcept;

  Observation observation_;
  Eigen::Vector3d error_N_ = Eigen::Vector3d::Zero();
  Stage stage_ = Stage::kOver;
  bool found_ = false;
  int pieces_ = 0;   ///< of this search
  int in_vain_ = 0;  ///< searches, less those that were not
  int done_ = 0;     ///< of this piece

  int at_ = 0;
  int start_ = 0;
  UnilateralConstraint before_, best_start_;
  double best_start_nats_ = 0.0;

  Shapes refined_, others_, best_;  ///< the present ones; those that stay; the best so far
  int refined_count_ = 0;
  int others_count_ = 0;
  int best_count_ = 0;
  double best_nats_ = 0.0;
  int replaced_ = 0;
  int kind_ = 0;
  Weighed weighed_;  ///< the best of this kind
  std::array<UnilateralConstraint, 3> new_;
  int new_count_ = 0;
  int tried_ = 0;

  std::array<double, ConstraintFit::kMaxSamples> depth_m_;  ///< of samples, beyond a kind's plane
  Columns trial_;
};

}  // namespace forcegrid::kriging
