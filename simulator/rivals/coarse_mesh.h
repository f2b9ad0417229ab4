// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/direct_method.h"

namespace forcegrid::simulator {

/// A coarser mesh of an object and how a tool holds it.
struct CoarseObject {
  SpringMesh mesh;
  double patch_radius_m =
      0.0;  ///< that of the tool, or just large enough to hold the nearest vertex
};

/// Scales every force of `coarse` so that a tool at SpringMesh::top_W feels the same stiffness at
/// rest along z, the surface's normal there, as in `fine`.
/// @param patch_radius_m  of the tool's grip on `fine`; > 0.
/// Throws Error for a mesh that check() refuses, and where no vertex of `fine` can be held.
CoarseObject match_at_rest(const SpringMesh& fine, SpringMesh coarse, double patch_radius_m);

/// A much smaller mesh of the same object, solved in every servo cycle as DirectMethod does. Right
/// where the coarse object is the fine one: its stiffness under the tool agrees at rest along the
/// normal, because it was scaled to. Elsewhere, along other axes, and in large displacements the
/// two differ, by as much as the patch is small beside the coarse springs. Source: Burdea,
/// Patounakis, Popescu and Weiss, Virtual reality training for the diagnosis of prostate cancer,
/// VRAIS 1998: a coarser haptic mesh beside the graphic one. Cost, memory, real-time and threads:
/// as DirectMethod for the coarse mesh.
class CoarseMeshMethod final : public ForceMethod {
 public:
  /// @param grab_on_own_thread  see DirectOptions.
  /// Throws Error as DirectMethod.
  CoarseMeshMethod(const CoarseObject& object, bool grab_on_own_thread);

  const char* name() const noexcept override { return "coarse-mesh"; }
  std::size_t memory_bytes() const noexcept override;
  void take_sample(const Sample& sample) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  int work(int budget) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

 private:
  DirectMethod direct_;
};

}  // namespace forcegrid::simulator
