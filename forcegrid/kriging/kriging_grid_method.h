// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "forcegrid/core/storage_blocks.h"
#include "forcegrid/kriging/kriging_method.h"
#include "forcegrid/kriging/posterior_grid.h"

namespace forcegrid {

/// `forcegrid-kriging`: the paper's grid, filled by `kriging-store` and read in constant time.
///
///   F(P) = sum_v w_v [F_v + 1/2 J_v (P - v)],   v the eight vertices around P, w trilinear
///
/// with the posterior force F_v and stiffness J_v of the field at each vertex (PosteriorGrid),
/// relative to the contact point. After each fit the vertices within kReach_m of the tool are
/// written, the nearest first: those that hold nothing yet; those for which the field has a sample
/// at most kFurther times as far away as the nearest one when they were last written; and those
/// written before the last surprise.
///
/// force(): if all eight vertices are written, the grid's force, with status and uncertainty as
/// KrigingMethod gives them. Elsewhere the field's own force, at most kPartlyKnown; kUnknown where
/// the field does not know it either.
///
/// Requests: at vertices along the predicted motion and beside the tool, the one with the largest
/// posterior deviation first, see kriging::FieldRequests.
///
/// Needs: force. Options used: those of kriging-store; vertex_spacing_m (h, 4 mm), pool_blocks (96,
/// 2.3 MB). Positions relative to the contact point may be as far away as the workspace
/// (MethodOptions::grid) is wide; beyond that the field itself answers.
/// Cost: a query reads eight vertices of 48 bytes, whatever the field's size; a fit costs
/// kriging-store's and some 120 vertices at h = 4 mm, in pieces of one. Memory: docs/kriging.md.
/// Failure: as kriging-store; with less work done than a fit needs, the grid is late.
/// Source: docs/kriging.md; forcegrid paper, sections 4 and 5, for grid and requests.
/// Real-time: as ForceMethod.
class KrigingGridMethod final : public ForceMethod, public StorageBlocks {
 public:
  static constexpr double kReach_m = 0.012;
  static constexpr double kFurther = 1.25;
  static constexpr double kSpacing_m = 0.004;
  static constexpr int kPoolBlocks = 96;
  /// Cells per axis that the grid may have at most; the factory refuses more.
  static constexpr int kMostCells = 1024;
  static constexpr double kLeastSpacing_m = 0.002;  ///< the factory refuses less
  /// Blocks that may be written between two fits; the pool must hold them.
  static constexpr int blocks_of_a_fill(double spacing_m) noexcept {
    const int along = static_cast<int>(2.0 * kReach_m / (spacing_m * kBlockVertices)) + 2;
    return along * along * along;
  }

  /// @param options must be usable: make_force_method() checks.
  explicit KrigingGridMethod(const MethodOptions& options);

  /// Cells per axis for these options: twice the workspace, whatever the contact point.
  static Eigen::Vector3i cells(const MethodOptions& options) noexcept;

  bool allocated() const noexcept { return kriging_.allocated() && grid_.allocated(); }
  const char* name() const noexcept override { return "forcegrid-kriging"; }
  MethodNeeds needs() const noexcept override { return kriging_.needs(); }
  std::size_t memory_bytes() const noexcept override;
  std::span<const NamedCounter> counters() const noexcept override { return {&recycled_, 1}; }
  void take_sample(const Sample& sample) noexcept override { kriging_.take_sample(sample); }
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override {
    kriging_.observe(time_s, position_W);
  }
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override {
    kriging_.contact_made(epoch, point_W);
  }
  void contact_lost() noexcept override { kriging_.contact_lost(); }
  /// The field's work comes first; then a vertex counts as kVertexUnits.
  int work(int budget) noexcept override;
  bool plan_request(double time_s, const Eigen::Vector3d& position_W,
                    Eigen::Vector3d& wanted_W) noexcept override {
    return kriging_.plan_request(time_s, position_W, wanted_W);
  }
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

  /// None until the first contact point is known: the grid is relative to it.
  std::size_t storage_blocks(std::span<StorageBlock> blocks) const noexcept override;

  static constexpr int kVertexUnits = 32;

  const KrigingMethod& kriging() const noexcept { return kriging_; }
  const PosteriorGrid& grid() const noexcept { return grid_; }

 private:
  int fill(int budget) noexcept;
  bool worth_writing(const PosteriorVertex& vertex, double nearest_m) const noexcept;

  KrigingMethod kriging_;
  PosteriorGrid grid_;
  std::vector<Eigen::Vector3i> around_;  ///< vertices within kReach_m of one, the nearest first
  std::size_t next_around_;
  std::uint32_t fit_ = 0;  ///< the one being written
  Eigen::Vector3i centre_ = Eigen::Vector3i::Zero();
  NamedCounter recycled_{"blocks_recycled", 0};
};

}  // namespace forcegrid
