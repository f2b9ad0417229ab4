// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/rest_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace forcegrid::simulator {
namespace {

constexpr int kMaxCellsPerAxis = 256;

// On which side of the line through vertices a and b the point is, seen from above. The answer is
// the same for both triangles of an edge, since it is always computed from the lower vertex number.
bool left_of(const std::vector<Eigen::Vector3d>& vertex_W, std::int32_t a, std::int32_t b,
             const Eigen::Vector3d& p_W) {
  const bool swapped = a > b;
  const Eigen::Vector3d& from_W = vertex_W[static_cast<std::size_t>(swapped ? b : a)];
  const Eigen::Vector3d& to_W = vertex_W[static_cast<std::size_t>(swapped ? a : b)];
  const double dx = to_W.x() - from_W.x();
  const double dy = to_W.y() - from_W.y();
  const double side = dx * (p_W.y() - from_W.y()) - dy * (p_W.x() - from_W.x());
  const bool left = side != 0.0 ? side > 0.0 : dy != 0.0 ? dy < 0.0 : dx > 0.0;
  return left != swapped;
}

double height_m(const Eigen::Vector3d& a_W, const Eigen::Vector3d& b_W, const Eigen::Vector3d& c_W,
                const Eigen::Vector3d& p_W) {
  const Eigen::Vector3d normal = (b_W - a_W).cross(c_W - a_W);
  const double height =
      a_W.z() - (normal.x() * (p_W.x() - a_W.x()) + normal.y() * (p_W.y() - a_W.y())) / normal.z();
  const auto [low, high] = std::minmax({a_W.z(), b_W.z(), c_W.z()});
  return std::clamp(height, low, high);  // a nearly vertical triangle
}

}  // namespace

RestSurface::RestSurface(const SpringMesh& mesh) : triangles_(mesh.triangles) {
  if (triangles_.empty()) {
    return;
  }
  vertex_W_ = mesh.rest_position_W;
  const auto corner = [this](const Triangle& triangle, std::size_t k) -> const Eigen::Vector3d& {
    return vertex_W_[static_cast<std::size_t>(triangle[k])];
  };
  low_W_ = corner(triangles_.front(), 0).head<2>().array();
  Eigen::Array2d high_W = low_W_;
  for (const Triangle& triangle : triangles_) {
    for (std::size_t k = 0; k < 3; ++k) {
      low_W_ = low_W_.min(corner(triangle, k).head<2>().array());
      high_W = high_W.max(corner(triangle, k).head<2>().array());
    }
  }
  const auto per_axis = static_cast<int>(std::sqrt(0.5 * static_cast<double>(triangles_.size())));
  cells_.setConstant(std::clamp(per_axis, 1, kMaxCellsPerAxis));
  cell_m_ = ((high_W - low_W_) / cells_.cast<double>()).max(1e-9);
  const auto visit_cells = [&](const Triangle& triangle, auto visit) {
    const Eigen::Array2d a = corner(triangle, 0).head<2>().array();
    const Eigen::Array2d b = corner(triangle, 1).head<2>().array();
    const Eigen::Array2d c = corner(triangle, 2).head<2>().array();
    const auto cell_of = [this](const Eigen::Array2d& at) -> Eigen::Array2i {
      return ((at - low_W_) / cell_m_).floor().cast<int>().max(0).min(cells_ - 1);
    };
    const Eigen::Array2i first = cell_of(a.min(b).min(c) - 1e-3 * cell_m_);
    const Eigen::Array2i last = cell_of(a.max(b).max(c) + 1e-3 * cell_m_);
    for (int y = first.y(); y <= last.y(); ++y) {
      for (int x = first.x(); x <= last.x(); ++x) {
        visit(static_cast<std::size_t>(x + cells_.x() * y));
      }
    }
  };
  cell_begin_.assign(static_cast<std::size_t>(cells_.prod()) + 1, 0);
  for (const Triangle& triangle : triangles_) {
    visit_cells(triangle, [this](std::size_t cell) { ++cell_begin_[cell + 1]; });
  }
  for (std::size_t cell = 0; cell + 1 < cell_begin_.size(); ++cell) {
    cell_begin_[cell + 1] += cell_begin_[cell];
  }
  cell_triangle_.resize(static_cast<std::size_t>(cell_begin_.back()));
  std::vector<std::int32_t> next(cell_begin_.begin(), cell_begin_.end() - 1);
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    visit_cells(triangles_[t], [&](std::size_t cell) {
      cell_triangle_[static_cast<std::size_t>(next[cell]++)] = static_cast<std::int32_t>(t);
    });
  }
}

bool RestSurface::column_meets(const Triangle& triangle,
                               const Eigen::Vector3d& position_W) const noexcept {
  const bool ab = left_of(vertex_W_, triangle[0], triangle[1], position_W);
  const bool bc = left_of(vertex_W_, triangle[1], triangle[2], position_W);
  const bool ca = left_of(vertex_W_, triangle[2], triangle[0], position_W);
  return ab == bc && bc == ca;
}

RestSurface::Vertical RestSurface::look(const Eigen::Vector3d& position_W) const noexcept {
  Vertical result;
  const Eigen::Array2d at = (position_W.head<2>().array() - low_W_) / cell_m_;
  if (triangles_.empty() || !(at >= 0.0).all() || !(at <= cells_.cast<double>()).all()) {
    return result;
  }
  const Eigen::Array2i cell = at.floor().cast<int>().min(cells_ - 1);
  const auto index = static_cast<std::size_t>(cell.x() + cells_.x() * cell.y());
  for (std::int32_t k = cell_begin_[index]; k < cell_begin_[index + 1]; ++k) {
    const Triangle& triangle =
        triangles_[static_cast<std::size_t>(cell_triangle_[static_cast<std::size_t>(k)])];
    if (!column_meets(triangle, position_W)) {
      continue;
    }
    const double height = height_m(vertex_W_[static_cast<std::size_t>(triangle[0])],
                                   vertex_W_[static_cast<std::size_t>(triangle[1])],
                                   vertex_W_[static_cast<std::size_t>(triangle[2])], position_W);
    const double below_m = position_W.z() - height;
    if (below_m <= 0.0) {
      result.inside = !result.inside;
    } else if (!result.below_m || below_m < *result.below_m) {
      result.below_m = below_m;
    }
  }
  return result;
}

std::optional<Eigen::Vector3d> RestSurface::first_hit(
    const Eigen::Vector3d& from_W, const Eigen::Vector3d& path_W) const noexcept {
  // Moeller and Trumbore, Fast, minimum storage ray-triangle intersection (1997); from outside
  // only.
  double first = 1.0;
  bool found = false;
  for (const Triangle& triangle : triangles_) {
    const Eigen::Vector3d& a_W = vertex_W_[static_cast<std::size_t>(triangle[0])];
    const Eigen::Vector3d ab = vertex_W_[static_cast<std::size_t>(triangle[1])] - a_W;
    const Eigen::Vector3d ac = vertex_W_[static_cast<std::size_t>(triangle[2])] - a_W;
    const Eigen::Vector3d p = path_W.cross(ac);
    const double determinant = ab.dot(p);
    if (!(determinant > 0.0)) {
      continue;
    }
    const Eigen::Vector3d to_from = from_W - a_W;
    const double u = to_from.dot(p);
    const Eigen::Vector3d q = to_from.cross(ab);
    const double v = path_W.dot(q);
    if (u < 0.0 || v < 0.0 || u + v > determinant) {
      continue;
    }
    const double along = ac.dot(q) / determinant;
    if (along >= 0.0 && along <= first) {
      first = along;
      found = true;
    }
  }
  return found ? std::optional<Eigen::Vector3d>(from_W + first * path_W) : std::nullopt;
}

}  // namespace forcegrid::simulator
