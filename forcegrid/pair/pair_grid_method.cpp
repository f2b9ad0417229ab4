// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_grid_method.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {
namespace {

constexpr double kWholly = 1.0 - 1e-5;  // rounding of 64 weights in single precision

// @param times that the grid is sparser than the options say.
pair::PairGrid grid(const PairGridOptions& options, double times, int blocks) {
  RadialWeight weight;
  weight.influence_radius_m = times * options.radius_m;
  weight.unit_m = options.unit_m;
  return {times * options.spacing_m, weight, blocks};
}

}  // namespace

PairGridMethod::PairGridMethod(const PairGridOptions& options)
    : grids_{grid(options, 1.0, options.blocks),
             grid(options, kSparse, std::max(1, options.blocks / 4))} {}

std::size_t PairGridMethod::memory_bytes() const noexcept {
  return sizeof(*this) - sizeof(grids_) + grids_[0].memory_bytes() + grids_[1].memory_bytes();
}

void PairGridMethod::take_sample(const PairSample& sample) noexcept {
  if (!in_contact_ || !std::isfinite(sample.time_s) || !sample.positions_W.allFinite() ||
      !sample.forces_W.allFinite() || sample.time_s < newest_s_) {
    return;
  }
  newest_s_ = sample.time_s;
  const PairVector positions_m = sample.positions_W - points_W_;
  if (!grids_[0].contains(positions_m)) {
    ++counters_[1].value;
    return;
  }
  if (queued_ - next_ == kQueue) {
    ++next_;
    ++counters_[0].value;
  }
  queue_[queued_++ % kQueue] = {positions_m, sample.forces_W};
}

void PairGridMethod::contacts_made(std::uint32_t /*epoch*/, const PairVector& points_W) noexcept {
  known_ = true;
  in_contact_ = true;
  points_W_ = points_W;
  next_ = queued_;
  for (pair::PairGrid& each : grids_) {
    each.clear();
  }
}

void PairGridMethod::contacts_lost() noexcept {
  known_ = true;
  in_contact_ = false;
}

int PairGridMethod::work(int budget) noexcept {
  int done = 0;
  while (done < budget) {
    int looked_at = grids_[0].spread();
    if (looked_at == 0) {
      looked_at = grids_[1].spread();
    }
    if (looked_at == 0) {
      if (next_ == queued_ || !in_contact_) {
        break;
      }
      const Queued& next = queue_[next_++ % kQueue];
      grids_[0].begin(next.positions_m, next.forces_N);
      grids_[1].begin(next.positions_m, next.forces_N);
    }
    done += std::max(1, looked_at);
  }
  counters_[2].value = static_cast<std::uint64_t>(grids_[0].blocks_used());
  counters_[3].value = grids_[0].blocks_given_up();
  return done;
}

PairEstimate PairGridMethod::forces(double time_s, const PairVector& positions_W) const noexcept {
  PairEstimate estimate;
  const PairVector positions_m = positions_W - points_W_;
  if (!std::isfinite(time_s) || !positions_m.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
    return estimate;
  }
  if (!in_contact_) {
    estimate.status = known_ ? EstimateStatus::kOk : EstimateStatus::kUnknown;
    return estimate;
  }
  if (!grids_[0].contains(positions_m)) {
    estimate.status = EstimateStatus::kOutside;
    return estimate;
  }
  const pair::PairGrid::Reading dense = grids_[0].read(positions_m);
  double known = dense.known;
  estimate.forces_W = dense.force_N;
  if (known < kWholly) {
    const pair::PairGrid::Reading sparse = grids_[1].read(positions_m);
    estimate.forces_W += (1.0 - dense.known) * sparse.force_N;
    known += (1.0 - dense.known) * sparse.known;
  }
  estimate.status = known < kWholly ? EstimateStatus::kPartlyKnown : EstimateStatus::kOk;
  if (!(known > 0.0)) {
    estimate.status = EstimateStatus::kUnknown;
  }
  return estimate;
}

}  // namespace forcegrid
