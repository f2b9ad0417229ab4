// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/grid_factory.h"

#include <cmath>
#include <stdexcept>
#include <string>

#include "forcegrid/grid/adaptive_grid.h"
#include "forcegrid/grid/grid_instances.h"
#include "forcegrid/grid/grid_storage.h"
#include "forcegrid/grid/request_planner.h"
#include "forcegrid/grid/spreading_grid.h"

namespace forcegrid {
namespace {

constexpr double kMaxBytes = 4.0 * 1024 * 1024 * 1024;
// A pool holds four fills, or more if that is cheap.
constexpr double kCheapPoolBytes = 64.0 * 1024 * 1024;
constexpr double kUsualPoolBytes = 256.0 * 1024 * 1024;
constexpr double kMaxNeighbours = 1 << 24;
constexpr std::size_t kMaxCellsOfRequest = std::size_t{1} << 17;
// Beyond this, single precision can't distinguish the weight's terms.
constexpr double kMaxUnits = 1e6;

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument("grid: " + what); }

const char* name_of(GridMethodKind kind) {
  switch (kind) {
    case GridMethodKind::kSilent:
      return "forcegrid";
    case GridMethodKind::kRequest:
      return "forcegrid+request";
    case GridMethodKind::kTangent:
      return "forcegrid-tangent";
    case GridMethodKind::kMls:
      return "forcegrid-mls";
  }
  refuse("no such kind of method");
}

WeightKind usual_weight(GridMethodKind kind) {
  switch (kind) {
    case GridMethodKind::kTangent:
      return WeightKind::kInverse6;
    case GridMethodKind::kMls:
      return WeightKind::kInverse4;
    default:
      return WeightKind::kPaper;
  }
}

std::string mebibytes(double bytes) {
  return std::to_string(std::llround(bytes / (1024.0 * 1024.0))) + " MiB";
}

// Blocks that one sample can reach, and the one of its cell's lowest corner.
std::size_t blocks_of_a_fill(const GridGeometry& geometry, double radius_m) {
  const Eigen::Vector3i vertices = geometry.cells.array() + 1;
  const Eigen::Array3i reach =
      fill_reach(geometry, radius_m, std::numeric_limits<int>::max()).array();
  const Eigen::Array3i along = (2 * reach / kBlockVertices + 2)
                                   .min((vertices.array() + kBlockVertices - 1) / kBlockVertices);
  return along.cast<std::size_t>().prod() + 1;
}

template <typename Segment>
std::size_t choose_pool(const GridPlan& plan, int wanted) {
  const Eigen::Vector3i vertices = plan.geometry.cells.array() + 1;
  const std::size_t all = BlockStorage<Segment>::block_count(vertices);
  const std::size_t needed =
      std::min(blocks_of_a_fill(plan.geometry, plan.weighting.influence_radius_m), all);
  std::size_t pool = static_cast<std::size_t>(wanted);
  if (wanted == 0) {
    const double block_bytes =
        0.5 * BlockStorage<Segment>::bytes_for({1, 1, 1}, plan.counting(), 1);
    const auto cheap = static_cast<std::size_t>(kCheapPoolBytes / block_bytes);
    const auto affordable = static_cast<std::size_t>(kUsualPoolBytes / block_bytes);
    pool = std::max(std::min(std::max(cheap, 4 * needed), affordable), needed);
  } else if (pool < needed) {
    refuse("a pool of " + std::to_string(pool) + " blocks does not hold the " +
           std::to_string(needed) +
           " that one sample can reach; use a larger pool, a smaller r or fewer cells");
  }
  pool = std::min(pool, all);
  const double bytes = BlockStorage<Segment>::bytes_for(vertices, plan.counting(), pool);
  if (bytes > kMaxBytes) {
    refuse("block storage would take " + mebibytes(bytes) + ", at most " + mebibytes(kMaxBytes) +
           "; use a smaller r, a smaller pool or fewer cells");
  }
  return pool;
}

template <typename Segment>
void check_dense_size(const GridGeometry& geometry, bool counting, const std::string& remedy) {
  const double bytes = DenseStorage<Segment>::bytes_for(geometry.cells.array() + 1, counting);
  if (bytes > kMaxBytes) {
    refuse(std::to_string(geometry.vertex_count()) + " vertices take " + mebibytes(bytes) +
           " in dense storage, at most " + mebibytes(kMaxBytes) + "; use " + remedy);
  }
}

}  // namespace

void GridGeometry::check() const {
  if (!min_W.allFinite() || !max_W.allFinite()) {
    refuse("the box must be finite");
  }
  if ((max_W.array() <= min_W.array()).any()) {
    refuse("each upper corner coordinate must exceed the lower one");
  }
  if ((cells.array() < 1).any() || (cells.array() > 4096).any()) {
    refuse("cells must be 1 to 4096 per axis");
  }
}

GridPlan plan_grid(GridMethodKind kind, const MethodOptions& options) {
  options.grid.check();
  GridPlan plan;
  plan.name = name_of(kind);
  plan.geometry = options.grid;
  plan.weighting.influence_radius_m = options.influence_radius();
  plan.weighting.unit_m = options.unit_m;
  plan.weighting.kind = options.weight.value_or(usual_weight(kind));
  plan.weighting.mean_spacing_m = std::cbrt(options.grid.spacing_m().prod());
  plan.interpolation = options.interpolation;
  plan.samples_per_cell = options.samples_per_cell;
  plan.requests = kind == GridMethodKind::kRequest;
  plan.stiffness = kind == GridMethodKind::kTangent;
  plan.ridge = options.ridge.value_or(plan.ridge);

  const double r = plan.weighting.influence_radius_m;
  if (!(r > 0.0) || !std::isfinite(r)) {
    refuse("the influence radius r must be positive and finite");
  }
  if (!(plan.weighting.unit_m > 0.0) || !std::isfinite(plan.weighting.unit_m) ||
      r / plan.weighting.unit_m > kMaxUnits) {
    refuse("the weight's unit of length must be finite and above a millionth of r");
  }
  if (plan.samples_per_cell < 0 || plan.samples_per_cell > 65535) {
    refuse("the threshold s is " + std::to_string(plan.samples_per_cell) +
           "; use 0 (all samples) to 65535");
  }
  const bool mls = kind == GridMethodKind::kMls;
  const bool adaptive = options.storage == GridStorage::kAdaptive;
  if (mls && plan.interpolation == Interpolation::kTricubic) {
    refuse(
        "forcegrid-mls is read trilinearly: a tricubic read would be 64 fits; use more cells, or "
        "read=tricubic with another method");
  }
  if (mls && adaptive) {
    refuse(
        "forcegrid-mls keeps moments about each vertex, which an adaptive grid can't interpolate "
        "for the vertices that come into its cube; use storage=dense or storage=blocks");
  }
  if (mls && (!(plan.ridge > 0.0) || !std::isfinite(plan.ridge))) {
    refuse("the ridge of forcegrid-mls must be positive and finite");
  }
  const GridGeometry& filled =
      adaptive ? AdaptiveGrid::sparse_geometry(plan.geometry) : plan.geometry;
  const double neighbours =
      (2.0 * fill_reach(filled, r, std::numeric_limits<int>::max()).cast<double>().array() + 1.0)
          .prod();
  if (neighbours > kMaxNeighbours) {
    refuse("a fill would reach over " + std::to_string(std::llround(neighbours)) +
           " vertices, more than " + std::to_string(std::llround(kMaxNeighbours)) +
           "; use a smaller r or fewer cells");
  }
  if (plan.requests && RequestPlanner::cells_within(filled, r) > kMaxCellsOfRequest) {
    refuse("a request would choose from more than " + std::to_string(kMaxCellsOfRequest) +
           " cells within r, too many for a servo cycle; use a smaller r or fewer cells");
  }
  switch (options.storage) {
    case GridStorage::kDense:
      if (mls) {
        check_dense_size<MomentSegment>(filled, plan.counting(), "storage=blocks or fewer cells");
      } else {
        check_dense_size<ForceSegment>(filled, plan.counting(), "storage=blocks or fewer cells");
      }
      break;
    case GridStorage::kBlocks:
      plan.pool_blocks = mls ? choose_pool<MomentSegment>(plan, options.pool_blocks)
                             : choose_pool<ForceSegment>(plan, options.pool_blocks);
      break;
    case GridStorage::kAdaptive:
      check_dense_size<ForceSegment>(filled, plan.counting(), "fewer cells");
      break;
  }
  return plan;
}

std::unique_ptr<ForceMethod> make_grid_method(GridMethodKind kind, const MethodOptions& options) {
  const GridPlan plan = plan_grid(kind, options);
  const bool mls = kind == GridMethodKind::kMls;
  std::unique_ptr<ForceMethod> method;
  switch (options.storage) {
    case GridStorage::kDense:
      method = mls ? make_dense_mls_grid(plan) : make_dense_force_grid(plan);
      break;
    case GridStorage::kBlocks:
      method = mls ? make_block_mls_grid(plan) : make_block_force_grid(plan);
      break;
    case GridStorage::kAdaptive:
      method = make_adaptive_force_grid(plan);
      break;
  }
  if (method == nullptr) {
    throw std::runtime_error(std::string(plan.name) +
                             ": not enough memory for its grid; use fewer cells, or storage=blocks "
                             "with a smaller pool");
  }
  return method;
}

}  // namespace forcegrid
