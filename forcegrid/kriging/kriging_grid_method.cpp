// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_grid_method.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {
namespace {

// A vertex keeps the number of its fit in a float: 24 bits.
constexpr std::uint32_t kFitMask = 0xffffffU;

double spacing_m(const MethodOptions& options) {
  return options.vertex_spacing_m.value_or(KrigingGridMethod::kSpacing_m);
}

// How many fits ago; their numbers wrap after kFitMask.
std::uint32_t fits_since(std::uint32_t then, std::uint32_t now) noexcept {
  return (now - then) & kFitMask;
}

}  // namespace

Eigen::Vector3i KrigingGridMethod::cells(const MethodOptions& options) noexcept {
  const Eigen::Vector3d size_m = 2.0 * (options.grid.max_W - options.grid.min_W);
  return (size_m / spacing_m(options)).array().ceil().cast<int>();
}

KrigingGridMethod::KrigingGridMethod(const MethodOptions& options)
    : kriging_(KrigingMethod::Kind::kStore, options),
      grid_(-0.5 * spacing_m(options) * cells(options).cast<double>(), cells(options),
            spacing_m(options),
            static_cast<std::size_t>(options.pool_blocks > 0 ? options.pool_blocks : kPoolBlocks)) {
  const int reach = static_cast<int>(kReach_m / spacing_m(options));
  for (int x = -reach; x <= reach; ++x) {
    for (int y = -reach; y <= reach; ++y) {
      for (int z = -reach; z <= reach; ++z) {
        const Eigen::Vector3i step(x, y, z);
        if (step.cast<double>().norm() * spacing_m(options) <= kReach_m) {
          around_.push_back(step);
        }
      }
    }
  }
  std::stable_sort(around_.begin(), around_.end(),
                   [](const Eigen::Vector3i& a, const Eigen::Vector3i& b) {
                     return a.squaredNorm() < b.squaredNorm();
                   });
  next_around_ = around_.size();
  kriging_.ask_on_lattice(grid_.position_m(Eigen::Vector3i::Zero()), grid_.spacing_m());
}

std::size_t KrigingGridMethod::memory_bytes() const noexcept {
  return sizeof(*this) - sizeof(kriging_) + kriging_.memory_bytes() + grid_.bytes() +
         around_.capacity() * sizeof(Eigen::Vector3i);
}

int KrigingGridMethod::work(int budget) noexcept {
  const int done = kriging_.work(budget);
  return done < budget ? done + fill(budget - done) : done;
}

bool KrigingGridMethod::worth_writing(const PosteriorVertex& vertex,
                                      double nearest_m) const noexcept {
  if (nearest_m > KrigingMethod::kFade_m) {
    return false;
  }
  return vertex.known < 0.0F || nearest_m <= kFurther * static_cast<double>(vertex.nearest_m) ||
         fits_since(static_cast<std::uint32_t>(vertex.written), fit_) >
             fits_since(static_cast<std::uint32_t>(kriging_.surprised_fit()) & kFitMask, fit_);
}

int KrigingGridMethod::fill(int budget) noexcept {
  const Eigen::Vector3d* origin_W = kriging_.origin_W();
  const kriging::Field& field = kriging_.field();
  if (origin_W == nullptr || field.sample_count() == 0) {
    return 0;
  }
  const Eigen::Vector3d tool_m = kriging_.soon_W() - *origin_W;
  if (!grid_.inside(tool_m)) {
    return 0;  // the field itself answers there
  }
  const Eigen::Vector3i centre = grid_.nearest_vertex(tool_m);
  const std::uint32_t fit = static_cast<std::uint32_t>(kriging_.fits()) & kFitMask;
  if (fit != fit_ || centre != centre_) {
    fit_ = fit;
    centre_ = centre;
    next_around_ = 0;
  }
  int done = 0;
  while (next_around_ < around_.size() && done < budget) {
    const Eigen::Vector3i at = centre_ + around_[next_around_++];
    ++done;
    if (!grid_.has(at)) {
      continue;
    }
    const PosteriorVertex& vertex = grid_.vertex(at);
    if (vertex.known > 0.0F && vertex.written == static_cast<float>(fit_)) {
      continue;
    }
    done += kVertexUnits - 1;
    const Eigen::Vector3d at_m = grid_.position_m(at);
    const kriging::Reading reading = field.read(at_m, kriging::History::Zero());
    const double nearest_m = std::sqrt(reading.nearest_m2);
    if (!worth_writing(vertex, nearest_m)) {
      continue;
    }
    const Eigen::Matrix3d j = field.stiffness_N_per_m(at_m, kriging::History::Zero());
    if (reading.force_N.allFinite() && j.allFinite()) {
      grid_.write(at, {reading.force_N, j, nearest_m}, fit_);
    }
  }
  recycled_.value = grid_.recycled();
  return done;
}

std::size_t KrigingGridMethod::storage_blocks(std::span<StorageBlock> blocks) const noexcept {
  const Eigen::Vector3d* origin_W = kriging_.origin_W();
  return origin_W != nullptr ? grid_.storage_blocks(*origin_W, blocks) : 0;
}

ForceEstimate KrigingGridMethod::force(double time_s,
                                       const Eigen::Vector3d& position_W) const noexcept {
  const Eigen::Vector3d* origin_W = kriging_.origin_W();
  if (origin_W != nullptr && std::isfinite(time_s)) {
    const PosteriorGrid::Reading reading = grid_.read(position_W - *origin_W);
    if (reading.known) {
      ForceEstimate estimate;
      estimate.force_W = reading.force_N;
      kriging_.add_uncertainty(position_W, estimate);
      return estimate;
    }
  }
  ForceEstimate estimate = kriging_.force(time_s, position_W);
  if (origin_W != nullptr && estimate.status == EstimateStatus::kOk) {
    estimate.status = EstimateStatus::kPartlyKnown;
  }
  return estimate;
}

}  // namespace forcegrid
