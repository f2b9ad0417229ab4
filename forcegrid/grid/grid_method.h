// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <utility>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/storage_blocks.h"
#include "forcegrid/grid/grid_plan.h"
#include "forcegrid/grid/request_planner.h"

namespace forcegrid {

/// The methods that keep a grid, on any of the grids:
///
/// `forcegrid`, the paper's silent method: each sample spreads over the vertices within r, and the
/// force is interpolated between vertices. Needs: force. Fails where averaging does: it
/// under-renders stiffness, needs retraced paths, and remembers the near-zero forces of the first
/// touch. Source: forcegrid paper, sections 4 and 5.
///
/// `forcegrid+request`: in addition it asks for the force at centres of cells around the tool, see
/// RequestPlanner; answers spread and count like samples. Needs: force, requests. Source: forcegrid
/// paper, section 5, request method.
///
/// `forcegrid-tangent`, a first-order grid: a sample spreads F + J (v - P) in place of F, so affine
/// fields are reproduced exactly. Needs: force and stiffness. Fails when the object changes: a grid
/// does not forget.
///
/// `forcegrid-mls`: see MlsGrid. Needs: force. Fails on strongly curved fields, since its kernel is
/// as wide as the samples' reach.
///
/// Cost: a query reads 8 vertices (64 and 8 in tricubic reading; forcegrid-mls solves eight 3 x 3
/// systems); a sample updates the vertices within r, split over cycles by the budget given to
/// work(). Memory: see the grid's storage.
/// Real-time: only the constructor allocates; nothing locks or throws. Threads: one.
template <typename Grid>
class GridMethod final : public ForceMethod, public StorageBlocks {
 public:
  GridMethod(const GridPlan& plan, Grid&& grid) noexcept
      : name_(plan.name),
        needs_{
            .stiffness = plan.stiffness, .requests = plan.requests, .can_request = plan.requests},
        samples_per_cell_(plan.samples_per_cell),
        counting_(plan.counting()),
        grid_(std::move(grid)),
        planner_(grid_.geometry(), plan.requests ? plan.weighting.influence_radius_m : 0.0) {}

  bool allocated() const noexcept { return grid_.allocated() && planner_.allocated(); }

  const char* name() const noexcept override { return name_; }
  MethodNeeds needs() const noexcept override { return needs_; }
  std::size_t memory_bytes() const noexcept override {
    return sizeof(*this) + grid_.bytes() + planner_.bytes();
  }
  std::span<const NamedCounter> counters() const noexcept override { return counters_; }

  /// Queues the sample for work(). Late samples are used: order does not matter to a grid. If the
  /// queue is full (8 unfinished samples), the oldest is cut short and counted. Samples outside the
  /// grid, and those that are not finite or lack a stiffness that the method needs, are counted and
  /// left out.
  void take_sample(const Sample& sample) noexcept override {
    if (!in_contact_) {
      return;
    }
    if (!usable(sample)) {
      ++counters_[kUnusable].value;
      return;
    }
    if (!grid_.inside(sample.position_W)) {
      ++counters_[kOutside].value;
      return;
    }
    if (queue_size_ == kQueueLength) {
      ++counters_[kCutShort].value;
      drop_oldest();
    }
    Waiting& waiting = queue_[(queue_head_ + queue_size_) % kQueueLength];
    waiting = {grid_.begin_fill(sample, needs_.stiffness), grid_.cell(sample.position_W),
               sample.from_query};
    ++queue_size_;
  }

  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override {
    static_cast<void>(time_s);
    if constexpr (kFollows) {
      grid_.follow(position_W);
    } else {
      static_cast<void>(position_W);
    }
  }

  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override {
    static_cast<void>(epoch);
    clear_queue();
    planner_.forget_requests();
    grid_.restart();
    if constexpr (kFollows) {
      grid_.follow(point_W);
    } else {
      static_cast<void>(point_W);
    }
    in_contact_ = true;
    contact_state_known_ = true;
  }

  void contact_lost() noexcept override {
    in_contact_ = false;
    contact_state_known_ = true;
    clear_queue();
  }

  /// `budget` counts vertices; fills come first, then what prepares for later contacts.
  int work(int budget) noexcept override {
    int done = 0;
    while (done < budget) {
      if (!grid_.ready()) {
        done += grid_.tidy(budget - done);
      } else if (filling_) {
        done += continue_filling(budget - done);
      } else if (const int units = prepare(budget - done, false); units > 0) {
        done += units;
      } else if (queue_size_ > 0) {
        ++done;
        start_filling();
      } else if (const int more = prepare(budget - done, true); more > 0) {
        done += more;
      } else if (const int tidied = grid_.tidy(budget - done); tidied > 0) {
        done += tidied;
      } else {
        break;
      }
    }
    counters_[kRecycled].value = grid_.recycled();
    return done;
  }

  bool plan_request(double time_s, const Eigen::Vector3d& position_W,
                    Eigen::Vector3d& wanted_W) noexcept override {
    static_cast<void>(time_s);
    if (!needs_.requests || !in_contact_ || !grid_.ready() || !grid_.inside(position_W)) {
      return false;
    }
    const int enough = samples_per_cell_ > 0 ? samples_per_cell_ : std::numeric_limits<int>::max();
    return planner_.plan(
        position_W, grid_.cell(position_W),
        [this](const Eigen::Vector3i& cell) { return int{grid_.samples_in(cell)}; }, enough,
        wanted_W);
  }

  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override {
    if (!std::isfinite(time_s) || !position_W.allFinite()) {
      ForceEstimate not_finite;
      not_finite.status = EstimateStatus::kNotFinite;
      return not_finite;
    }
    if (!in_contact_) {
      ForceEstimate free;
      free.status = contact_state_known_ ? EstimateStatus::kOk : EstimateStatus::kUnknown;
      return free;
    }
    if (!grid_.ready()) {
      return ForceEstimate{};
    }
    return grid_.read(position_W);
  }

  /// With storage=blocks those of the pool, with storage=adaptive those of the cube; else none.
  std::size_t storage_blocks(std::span<StorageBlock> blocks) const noexcept override {
    return grid_.storage_blocks(blocks);
  }

  const Grid& grid() const noexcept { return grid_; }

 private:
  static constexpr std::size_t kQueueLength = 8;
  /// Larger numbers would overflow sums in single precision.
  static constexpr double kLargest = 1e18;
  static constexpr bool kFollows = requires(Grid & grid) { grid.prepare(1); };
  enum Counter : std::size_t { kCutShort, kOverThreshold, kOutside, kUnusable, kRecycled };

  struct Waiting {
    typename Grid::Fill fill;
    Eigen::Vector3i cell = Eigen::Vector3i::Zero();
    bool from_query = false;
  };

  bool usable(const Sample& sample) const noexcept {
    return std::isfinite(sample.time_s) && sample.position_W.allFinite() &&
           (sample.force_W.array().abs() <= kLargest).all() &&
           (!needs_.stiffness ||
            (sample.has_stiffness && (sample.stiffness_W.array().abs() <= kLargest).all()));
  }
  void drop_oldest() noexcept {
    queue_head_ = (queue_head_ + 1) % kQueueLength;
    --queue_size_;
    filling_ = false;
  }
  void clear_queue() noexcept {
    queue_size_ = 0;
    filling_ = false;
  }
  // Starts to fill in the oldest sample, unless its cell has enough of them.
  void start_filling() noexcept {
    const Waiting& oldest = queue_[queue_head_];
    if (counting_) {
      if (oldest.from_query) {
        planner_.answered(oldest.cell);
      }
      if (samples_per_cell_ > 0 && grid_.samples_in(oldest.cell) >= samples_per_cell_) {
        ++counters_[kOverThreshold].value;
        drop_oldest();
        return;
      }
      grid_.count_sample_in(oldest.cell);
    }
    filling_ = true;
  }
  int continue_filling(int budget) noexcept {
    typename Grid::Fill& fill = queue_[queue_head_].fill;
    int done = grid_.continue_fill(fill, budget);
    if (grid_.finished(fill)) {
      drop_oldest();
      // One block of the cube that follows the tool after each sample, so that neither starves.
      done += prepare(1, true);
    }
    return done;
  }
  // Continues a block that is half made, and begins another if it may.
  int prepare(int budget, bool begin) noexcept {
    if constexpr (kFollows) {
      return begin || grid_.preparing() ? grid_.prepare(budget) : 0;
    } else {
      static_cast<void>(budget);
      static_cast<void>(begin);
      return 0;
    }
  }

  const char* name_;
  MethodNeeds needs_;
  int samples_per_cell_;
  bool counting_;
  Grid grid_;
  RequestPlanner planner_;
  bool in_contact_ = false;
  bool contact_state_known_ = false;
  bool filling_ = false;  ///< the oldest sample in the queue is partly in the grid
  std::array<Waiting, kQueueLength> queue_;
  std::size_t queue_head_ = 0;
  std::size_t queue_size_ = 0;
  std::array<NamedCounter, 5> counters_{{{"fills_cut_short"},
                                         {"samples_over_threshold"},
                                         {"samples_outside"},
                                         {"samples_unusable"},
                                         {"blocks_recycled"}}};
};

/// A method on `grid`, or null when it or the grid did not get its memory.
template <typename Grid>
std::unique_ptr<ForceMethod> allocated_method(const GridPlan& plan, Grid&& grid) noexcept {
  std::unique_ptr<GridMethod<Grid>> method(new (std::nothrow)
                                               GridMethod<Grid>(plan, std::forward<Grid>(grid)));
  if (method != nullptr && !method->allocated()) {
    method.reset();
  }
  return method;
}

}  // namespace forcegrid
