// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "forcegrid/core/force_method.h"

namespace forcegrid {
#pragma GCC visibility push(default)

/// A quantity of two tools: x, y, z of the first, then of the second, each in W.
using PairVector = Eigen::Matrix<double, 6, 1>;
/// How a PairVector of forces changes with one of positions.
using PairMatrix = Eigen::Matrix<double, 6, 6>;

/// One answer of a simulator whose object two tools hold: the forces that it exerts on both with
/// both where they are. W is the workspace frame; metres, newtons, seconds of the servo's clock.
struct PairSample {
  double time_s = 0.0;  ///< when the tools were at `positions_W`
  PairVector positions_W = PairVector::Zero();
  PairVector forces_W = PairVector::Zero();
  bool has_stiffness = false;
  /// dF_i/dP_j [N/m]: each tool's own in the blocks on the diagonal, the other tool's effect
  /// beside.
  PairMatrix stiffness_W = PairMatrix::Zero();
  std::uint32_t contact_epoch = 0;  ///< a new number when either tool touches anew
  PairVector contact_points_W = PairVector::Zero();
  double relative_residual = 0.0;
  bool converged = true;
};

/// A method's answer for one position of both tools.
struct PairEstimate {
  PairVector forces_W = PairVector::Zero();  ///< [N] of a tool about which nothing is known: zero
  /// The worse one of the tools', in the order of EstimateStatus.
  EstimateStatus status = EstimateStatus::kUnknown;
};

/// Bridges slow forces to a fast loop, as ForceMethod does, for two tools on one object:
///
///   (F_1, F_2) = F(P_1, P_2) = -dU/d(P_1, P_2)
///
/// with one energy U over the positions of both, so that what one tool's sample says of the object
/// helps the other one, and each follows the other's motion at the servo rate.
///
/// What the caller guarantees and what a method must ensure is as for ForceMethod: one thread; no
/// allocation, lock, exception or I/O after construction; bounded work in every call; forces() is
/// const and consistent between any two calls. Both servo loops' positions must be known to the
/// caller, so it is for loops in one process.
class PairForceMethod {
 public:
  virtual ~PairForceMethod() = default;

  /// Static text, e.g. "kriging-6d"; of uncoupled methods that of the method of each tool.
  virtual const char* name() const noexcept = 0;

  /// Bytes that it holds, itself included; fixed from construction on.
  virtual std::size_t memory_bytes() const noexcept = 0;

  /// Takes one sample, or keeps it for work(). Samples that are not finite, or older than the
  /// newest taken, are ignored.
  virtual void take_sample(const PairSample& sample) noexcept = 0;

  /// Both tools hold the object from now on, in a new contact epoch.
  /// @param points_W [m] where each touched.
  virtual void contacts_made(std::uint32_t epoch, const PairVector& points_W) noexcept = 0;
  /// A tool came off the object: the forces are zero until the next contacts_made().
  virtual void contacts_lost() noexcept = 0;

  /// Does pending work worth at most `budget` units, as ForceMethod::work().
  /// @returns the units done; less than `budget` when nothing is left to do.
  virtual int work(int budget) noexcept = 0;

  /// The tools' positions [m], once per servo cycle, before forces().
  virtual void observe(double time_s, const PairVector& positions_W) noexcept {
    static_cast<void>(time_s);
    static_cast<void>(positions_W);
  }

  /// The forces at `positions_W` [m] and time `time_s`.
  [[nodiscard]] virtual PairEstimate forces(double time_s,
                                            const PairVector& positions_W) const noexcept = 0;

  /// The method's counters; their names and order never change.
  virtual std::span<const NamedCounter> counters() const noexcept { return {}; }
};

#pragma GCC visibility pop
}  // namespace forcegrid
