#pragma once

#include <array>
#include <vector>

#include "forcegrid/force_grid.h"
#include "forcegrid/force_method.h"
#include "forcegrid/method_options.h"

namespace forcegrid {

/// The paper's forcegrid with its silent method: each sample spreads over the vertices within r,
/// and the force is read by trilinear interpolation.
///
/// Needs: force. Cost: a query is 8 vertex reads; a sample is vertices_per_fill() updates, split
/// over cycles by the budget given to work(). Memory: two grids of 16 bytes a vertex (a contact
/// starts on a clean one while the other is being cleared) and 2 bytes a cell.
/// Fails where averaging does: it under-renders stiffness, needs retraced paths, and remembers the
/// near-zero forces of the first touch. Source: forcegrid paper, sections 4 and 5.
class ForcegridMethod final : public ForceMethod {
 public:
  /// Uses grid, influence_radius_m, unit_m and samples_per_cell.
  /// @throws std::invalid_argument for options that are not usable.
  explicit ForcegridMethod(const MethodOptions& options);

  const char* name() const noexcept override { return "forcegrid"; }
  std::size_t memory_bytes() const noexcept override;
  /// Queues the sample for work(). Late samples are used: a grid does not mind the order. Queue
  /// full (8 unfinished samples): the oldest is cut short and counted.
  void take_sample(const Sample& sample) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  /// `budget` counts vertices; fills come first, clearing the spare grid after.
  int work(int budget) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

  const ForceGrid& grid() const noexcept { return grids_[active_]; }
  std::uint64_t fills_cut_short() const noexcept { return fills_cut_short_; }
  std::uint64_t samples_over_threshold() const noexcept { return samples_over_threshold_; }
  std::uint64_t samples_outside() const noexcept { return samples_outside_; }

 private:
  static constexpr std::size_t kQueueLength = 8;
  void start_clean_grid() noexcept;

  std::array<ForceGrid, 2> grids_;
  std::array<std::vector<std::uint16_t>, 2> samples_in_cell_;
  int samples_per_cell_;
  std::size_t active_ = 0;
  std::size_t spare_cleared_to_ = 0;  ///< vertices of the spare grid that are clean
  bool active_is_clean_ = true;       ///< false while the active grid still waits to be cleared
  bool in_contact_ = false;
  bool contact_state_known_ = false;
  std::array<ForceGrid::Fill, kQueueLength> queue_;
  std::size_t queue_head_ = 0;
  std::size_t queue_size_ = 0;
  std::uint64_t fills_cut_short_ = 0;
  std::uint64_t samples_over_threshold_ = 0;
  std::uint64_t samples_outside_ = 0;
};

}  // namespace forcegrid
