// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "forcegrid/core/force_method.h"
#include "simulator/solver/two_rates_object.h"

namespace forcegrid::simulator {

struct TwoRatesMethodOptions {
  double patch_radius_m = 0.012;  ///< of the tool's grip; > 0
  /// Vertices solved in every servo cycle; > 0.
  int most_vertices = 2500;
};

/// The simulator at two rates as a force method: the region around the tool is solved in every
/// servo cycle, the whole object once per sample, and the region is then corrected
/// (TwoRatesObject). It stands for methods that are adaptive in space and time: fine and often
/// where the tool is, coarse and seldom elsewhere. Refinement by levels of the mesh and
/// large-strain finite elements, which the source has, are not in it.
///
///   F(P) = F(P_o) + J (P - P_o)     with P_o the position last observed
///
/// For recordings: work() solves the whole object in the caller's thread, and contact_made() solves
/// for the grip. `forcegrid simulate --solver two_rates` has a thread for both.
/// Right wherever the object itself is known and a second processor is free.
/// Source: for the idea, Debunne, Desbrun, Cani and Barr, Dynamic real-time deformations using
/// space and time adaptive sampling, SIGGRAPH 2001; for what is done, TwoRatesObject. Real-time:
/// observe() and force() as TwoRatesObject::move_to(); the rest is not.
class TwoRatesMethod final : public ForceMethod {
 public:
  /// Throws Error for a mesh that check() refuses or options out of range.
  TwoRatesMethod(const SpringMesh& mesh, const TwoRatesMethodOptions& options);

  const char* name() const noexcept override { return "two-rates"; }
  /// Both copies of the object included.
  std::size_t memory_bytes() const noexcept override;
  void take_sample(const Sample& sample) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  /// Solves the whole object if the last observe() asked for it; counts as no work.
  int work(int budget) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

 private:
  enum class Contact { kNeverHeard, kFree, kHeld };

  TwoRatesMethodOptions options_;
  TwoRatesObject object_;
  Contact contact_ = Contact::kNeverHeard;
  bool solved_ = false;  // equilibrium_ belongs to this contact
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d observed_W_ = Eigen::Vector3d::Zero();
  Equilibrium equilibrium_;
};

}  // namespace forcegrid::simulator
