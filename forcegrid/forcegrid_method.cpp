#include "forcegrid/forcegrid_method.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace forcegrid {

ForcegridMethod::ForcegridMethod(const MethodOptions& options)
    : grids_{ForceGrid(options.grid, {options.influence_radius(), options.unit_m}),
             ForceGrid(options.grid, {options.influence_radius(), options.unit_m})},
      samples_per_cell_(options.samples_per_cell),
      spare_cleared_to_(options.grid.vertex_count()) {
  if (samples_per_cell_ < 0 || samples_per_cell_ > 65535) {
    throw std::invalid_argument("grid: the threshold s is " + std::to_string(samples_per_cell_) +
                                "; use 0 (all samples) to 65535");
  }
  for (auto& counts : samples_in_cell_) {
    counts.assign(samples_per_cell_ == 0 ? 0 : options.grid.cell_count(), 0);
  }
}

std::size_t ForcegridMethod::memory_bytes() const noexcept {
  std::size_t bytes = sizeof(*this) - sizeof(grids_);
  for (std::size_t i = 0; i < grids_.size(); ++i) {
    bytes += sizeof(grids_[i]) + grids_[i].allocated_bytes() +
             samples_in_cell_[i].size() * sizeof(samples_in_cell_[i][0]);
  }
  return bytes;
}

void ForcegridMethod::take_sample(const Sample& sample) noexcept {
  if (!in_contact_ || !std::isfinite(sample.time_s)) {
    return;
  }
  ForceGrid& grid = grids_[active_];
  ForceGrid::Fill fill;
  if (!grid.begin_fill(sample.position_W, sample.force_W, fill)) {
    ++samples_outside_;
    return;
  }
  if (samples_per_cell_ > 0) {
    std::uint16_t& count = samples_in_cell_[active_][grid.cell_index(sample.position_W)];
    if (count >= samples_per_cell_) {
      ++samples_over_threshold_;
      return;
    }
    ++count;
  }
  if (queue_size_ == kQueueLength) {
    ++fills_cut_short_;
    queue_head_ = (queue_head_ + 1) % kQueueLength;
    --queue_size_;
  }
  queue_[(queue_head_ + queue_size_) % kQueueLength] = fill;
  ++queue_size_;
}

void ForcegridMethod::contact_made(std::uint32_t /*epoch*/,
                                   const Eigen::Vector3d& /*point_W*/) noexcept {
  start_clean_grid();
  in_contact_ = true;
  contact_state_known_ = true;
}

void ForcegridMethod::contact_lost() noexcept {
  in_contact_ = false;
  contact_state_known_ = true;
  queue_size_ = 0;
}

void ForcegridMethod::start_clean_grid() noexcept {
  queue_size_ = 0;
  const std::size_t all = grids_[active_].geometry().vertex_count();
  if (!active_is_clean_) {
    return;  // the grid before the last contact is still being cleared, and this contact waits too
  }
  active_is_clean_ = spare_cleared_to_ == all;
  active_ = 1 - active_;
  if (active_is_clean_) {
    spare_cleared_to_ = 0;
  }
}

int ForcegridMethod::work(int budget) noexcept {
  int done = 0;
  const std::size_t all = grids_[active_].geometry().vertex_count();
  const auto clear_some = [&](std::size_t grid) {
    const auto count = std::min(static_cast<std::size_t>(budget - done), all - spare_cleared_to_);
    grids_[grid].clear(spare_cleared_to_, spare_cleared_to_ + count);
    auto& cells = samples_in_cell_[grid];
    // Cells are fewer than vertices, so clearing the same index range keeps pace with them.
    const auto first = std::min(spare_cleared_to_, cells.size());
    const auto last = std::min(spare_cleared_to_ + count, cells.size());
    std::fill(cells.begin() + static_cast<std::ptrdiff_t>(first),
              cells.begin() + static_cast<std::ptrdiff_t>(last), std::uint16_t{0});
    spare_cleared_to_ += count;
    done += static_cast<int>(count);
  };
  if (!active_is_clean_) {
    clear_some(active_);
    if (spare_cleared_to_ < all) {
      return done;
    }
    active_is_clean_ = true;
    spare_cleared_to_ = 0;  // the other grid held the contact before
  }
  while (queue_size_ > 0 && done < budget) {
    ForceGrid::Fill& fill = queue_[queue_head_];
    done += grids_[active_].continue_fill(fill, budget - done);
    if (grids_[active_].finished(fill)) {
      queue_head_ = (queue_head_ + 1) % kQueueLength;
      --queue_size_;
    }
  }
  if (done < budget) {
    clear_some(1 - active_);
  }
  return done;
}

ForceEstimate ForcegridMethod::force(double time_s,
                                     const Eigen::Vector3d& position_W) const noexcept {
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
  if (!active_is_clean_) {
    return ForceEstimate{};
  }
  return grids_[active_].sample(position_W);
}

}  // namespace forcegrid
