#include "forcegrid/force_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace forcegrid {
namespace {

using Array4f = Eigen::Array4f;
using Array8f = Eigen::Array<float, 8, 1>;
constexpr std::size_t kLanes = 8;
constexpr std::size_t kMaxVertices = std::size_t{1} << 27;
constexpr std::size_t kMaxNeighbours = std::size_t{1} << 24;

}  // namespace

void GridGeometry::check() const {
  if (!min_W.allFinite() || !max_W.allFinite()) {
    throw std::invalid_argument("grid: the box must be finite");
  }
  if ((max_W.array() <= min_W.array()).any()) {
    throw std::invalid_argument("grid: each upper corner coordinate must exceed the lower one");
  }
  if ((cells.array() < 1).any() || (cells.array() > 4096).any()) {
    throw std::invalid_argument("grid: cells must be 1 to 4096 an axis");
  }
  if (vertex_count() > kMaxVertices) {
    throw std::invalid_argument("grid: " + std::to_string(vertex_count()) +
                                " vertices; the dense grid holds at most " +
                                std::to_string(kMaxVertices));
  }
}

std::size_t GridGeometry::vertex_count() const noexcept {
  const auto size = (cells.array() + 1).cast<std::size_t>();
  return size.x() * size.y() * size.z();
}

std::size_t GridGeometry::cell_count() const noexcept {
  const auto size = cells.array().cast<std::size_t>();
  return size.x() * size.y() * size.z();
}

double CandleLight::weight(double distance_m) const noexcept {
  if (!(distance_m <= influence_radius_m)) {
    return 0.0;
  }
  const double d = distance_m / unit_m;
  const double r = influence_radius_m / unit_m;
  return 1.0 / (1.0 + d * d) - d / (r * (1.0 + r * r));
}

ForceGrid::ForceGrid(const GridGeometry& geometry, const CandleLight& candle_light)
    : geometry_(geometry), candle_light_(candle_light) {
  geometry_.check();
  const double r = candle_light_.influence_radius_m;
  if (!(r > 0.0) || !std::isfinite(r)) {
    throw std::invalid_argument("grid: the influence radius r must be positive and finite");
  }
  if (!(candle_light_.unit_m > 0.0) || !std::isfinite(candle_light_.unit_m)) {
    throw std::invalid_argument("grid: the weight's unit of length must be positive and finite");
  }
  row_ = geometry_.cells.z() + 1;
  slab_ = row_ * (geometry_.cells.y() + 1);
  row_bytes_ = static_cast<std::size_t>(row_) * sizeof(Vertex);
  slab_bytes_ = static_cast<std::size_t>(slab_) * sizeof(Vertex);
  spacing_m_ = geometry_.spacing_m();
  inverse_spacing_per_m_ = spacing_m_.cwiseInverse();
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    min_[a] = geometry_.min_W[axis];
    inverse_[a] = inverse_spacing_per_m_[axis];
    last_[a] = static_cast<float>(geometry_.cells[axis]);
  }
  last_[3] = 1.0F;  // the fourth lane, always zero, counts as inside
  data_.assign(geometry_.vertex_count(), kEmpty);

  // A sample lies within half a cell of its nearest vertex, so a vertex within r of the sample is
  // within r plus half a diagonal of that vertex. Neighbours beyond the grid's own size never are.
  const double reach_m = r + 0.5 * spacing_m_.norm();
  reach_vertices_ = (reach_m * inverse_spacing_per_m_).array().floor().cast<int>();
  reach_vertices_ = reach_vertices_.cwiseMin(geometry_.cells);
  const auto reach = (2 * reach_vertices_.array() + 1).cast<std::size_t>();
  if (reach.prod() > kMaxNeighbours) {
    throw std::invalid_argument("grid: a fill would reach over " + std::to_string(reach.prod()) +
                                " vertices, more than " + std::to_string(kMaxNeighbours) +
                                "; use a smaller r or fewer cells");
  }
  struct Candidate {
    double distance2_m2;
    Neighbour neighbour;
  };
  std::vector<Candidate> candidates;
  for (int i = -reach_vertices_.x(); i <= reach_vertices_.x(); ++i) {
    for (int j = -reach_vertices_.y(); j <= reach_vertices_.y(); ++j) {
      for (int k = -reach_vertices_.z(); k <= reach_vertices_.z(); ++k) {
        const double d2 = Eigen::Vector3d(i, j, k).cwiseProduct(spacing_m_).squaredNorm();
        if (d2 <= reach_m * reach_m) {
          candidates.push_back({d2,
                                {static_cast<std::int16_t>(i), static_cast<std::int16_t>(j),
                                 static_cast<std::int16_t>(k), 0}});
        }
      }
    }
  }
  // Equally distant neighbours in storage order: neighbours in memory then follow each other.
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.distance2_m2 < b.distance2_m2; });
  neighbour_count_ = candidates.size();
  const std::size_t padded = (neighbour_count_ + kLanes - 1) / kLanes * kLanes;
  for (const Candidate& candidate : candidates) {
    const Neighbour& n = candidate.neighbour;
    neighbours_.push_back(n);
    neighbour_offset_.push_back(n.di * slab_ + n.dj * row_ + n.dk);
    neighbour_x_m_.push_back(static_cast<float>(n.di * spacing_m_.x()));
    neighbour_y_m_.push_back(static_cast<float>(n.dj * spacing_m_.y()));
    neighbour_z_m_.push_back(static_cast<float>(n.dk * spacing_m_.z()));
  }
  const float far_away_m = static_cast<float>(4.0 * reach_m);
  for (std::size_t i = neighbour_count_; i < padded; ++i) {
    neighbours_.push_back({0, 0, 0, 0});
    neighbour_offset_.push_back(0);
    neighbour_x_m_.push_back(far_away_m);
    neighbour_y_m_.push_back(far_away_m);
    neighbour_z_m_.push_back(far_away_m);
  }
}

ForceEstimate ForceGrid::sample_with_status(const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  if (!position_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
    return estimate;
  }
  const Eigen::Array3d u = (position_W - geometry_.min_W).cwiseProduct(inverse_spacing_per_m_);
  if (!((u >= 0.0).all() && (u <= geometry_.cells.cast<double>().array()).all())) {
    estimate.status = EstimateStatus::kOutside;
    return estimate;
  }
  const Eigen::Array3i cell = u.cast<int>().min(geometry_.cells.array() - 1);
  const Eigen::Array3d t = u - cell.cast<double>();
  int known = 0;
  int unknown = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Array3i step(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    const double share = (step > 0).select(t, 1.0 - t).prod();
    if (share == 0.0) {
      continue;
    }
    const Eigen::Array3i at = cell + step;
    const Vertex& v = data_[vertex_index(at.x(), at.y(), at.z())];
    if (v.weight < 0.0F) {
      ++unknown;
      continue;
    }
    ++known;
    estimate.force_W += share * Eigen::Vector3d(v.force_W[0], v.force_W[1], v.force_W[2]);
  }
  if (known > 0) {
    estimate.status = unknown == 0 ? EstimateStatus::kOk : EstimateStatus::kPartlyKnown;
  }
  return estimate;
}

bool ForceGrid::begin_fill(const Eigen::Vector3d& position_W, const Eigen::Vector3d& force_W,
                           Fill& fill) const noexcept {
  constexpr double kLargest = std::numeric_limits<float>::max();
  const Eigen::Array3d u = (position_W - geometry_.min_W).cwiseProduct(inverse_spacing_per_m_);
  if (!((u >= 0.0).all() && (u <= geometry_.cells.cast<double>().array()).all()) ||
      !(force_W.array().abs() <= kLargest).all()) {
    return false;
  }
  const Eigen::Array3d nearest = (u + 0.5).floor();
  fill.nearest_vertex = nearest.cast<int>();
  fill.from_nearest_vertex_m = ((u - nearest) * spacing_m_.array()).cast<float>();
  fill.force_W = force_W.cast<float>();
  fill.next = 0;
  fill.whole_sphere_inside =
      ((fill.nearest_vertex - reach_vertices_).array() >= 0).all() &&
      ((fill.nearest_vertex + reach_vertices_).array() <= geometry_.cells.array()).all();
  return true;
}

int ForceGrid::continue_fill(Fill& fill, int budget) noexcept {
  const std::size_t first = fill.next;
  const std::size_t wanted = static_cast<std::size_t>(std::max(budget, 0));
  const std::size_t last = std::min(first + wanted, neighbour_count_);
  if (fill.whole_sphere_inside) {
    for (; fill.next < last; fill.next += kLanes) {
      update_eight<false>(fill, fill.next);
    }
  } else {
    for (; fill.next < last; fill.next += kLanes) {
      update_eight<true>(fill, fill.next);
    }
  }
  return static_cast<int>(std::min(fill.next, neighbour_count_) - first);
}

template <bool kChecked>
void ForceGrid::update_eight(const Fill& fill, std::size_t first) noexcept {
  using Map8 = Eigen::Map<const Array8f>;
  const Array8f distance2 =
      (Map8(&neighbour_x_m_[first]) - fill.from_nearest_vertex_m.x()).square() +
      (Map8(&neighbour_y_m_[first]) - fill.from_nearest_vertex_m.y()).square() +
      (Map8(&neighbour_z_m_[first]) - fill.from_nearest_vertex_m.z()).square();
  const auto inverse_unit = static_cast<float>(1.0 / candle_light_.unit_m);
  const double r = candle_light_.influence_radius_m / candle_light_.unit_m;
  const auto slope = static_cast<float>(1.0 / (r * (1.0 + r * r)));
  const Array8f d = distance2.sqrt() * inverse_unit;
  // Negative beyond r, where the two terms cross: those vertices are left alone.
  const Array8f added = (d * d + 1.0F).inverse() - d * slope;

  const Fill& f = fill;
  Vertex* const centre =
      &data_[vertex_index(f.nearest_vertex.x(), f.nearest_vertex.y(), f.nearest_vertex.z())];
  Vertex* vertex[kLanes];
  Array8f old_weight;
  bool use[kLanes];
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    use[lane] = added[static_cast<Eigen::Index>(lane)] > 0.0F;
    if constexpr (kChecked) {
      const Neighbour& n = neighbours_[first + lane];
      const Eigen::Array3i at = f.nearest_vertex.array() + Eigen::Array3i(n.di, n.dj, n.dk);
      use[lane] = use[lane] && (at >= 0).all() && (at <= geometry_.cells.array()).all();
    }
    vertex[lane] = use[lane] ? centre + neighbour_offset_[first + lane] : centre;
    old_weight[static_cast<Eigen::Index>(lane)] = std::max(vertex[lane]->weight, 0.0F);
  }
  const Array8f new_weight = old_weight + added;
  const Array8f share = added / new_weight;
  const Array4f force(f.force_W.x(), f.force_W.y(), f.force_W.z(), 0.0F);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    if (use[lane]) {
      Eigen::Map<Array4f, Eigen::Aligned16> value(vertex[lane]->force_W);
      value += share[static_cast<Eigen::Index>(lane)] * (force - value);
      vertex[lane]->weight = new_weight[static_cast<Eigen::Index>(lane)];
    }
  }
}

std::size_t ForceGrid::allocated_bytes() const noexcept {
  return data_.size() * sizeof(Vertex) + neighbours_.size() * sizeof(Neighbour) +
         neighbour_offset_.size() * sizeof(neighbour_offset_[0]) +
         (neighbour_x_m_.size() + neighbour_y_m_.size() + neighbour_z_m_.size()) * sizeof(float);
}

void ForceGrid::clear(std::size_t first, std::size_t last) noexcept {
  std::fill(data_.begin() + static_cast<std::ptrdiff_t>(first),
            data_.begin() + static_cast<std::ptrdiff_t>(std::min(last, data_.size())), kEmpty);
}

Eigen::Vector4f ForceGrid::vertex(int i, int j, int k) const noexcept {
  const Vertex& v = data_[vertex_index(i, j, k)];
  return {v.force_W[0], v.force_W[1], v.force_W[2], std::max(v.weight, 0.0F)};
}

std::size_t ForceGrid::cell_index(const Eigen::Vector3d& position_W) const noexcept {
  const Eigen::Array3d u = (position_W - geometry_.min_W).cwiseProduct(inverse_spacing_per_m_);
  const Eigen::Array3i cell = u.cast<int>().max(0).min(geometry_.cells.array() - 1);
  return (static_cast<std::size_t>(cell.x()) * static_cast<std::size_t>(geometry_.cells.y()) +
          static_cast<std::size_t>(cell.y())) *
             static_cast<std::size_t>(geometry_.cells.z()) +
         static_cast<std::size_t>(cell.z());
}

}  // namespace forcegrid
