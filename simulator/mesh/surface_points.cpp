// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/surface_points.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace forcegrid::simulator {
namespace {

constexpr int kMostParts = 32;  // of an edge

using Triangle = std::array<std::int32_t, 3>;
using Edge = std::pair<std::int32_t, std::int32_t>;

Edge edge_of(const Triangle& triangle, std::size_t k) {
  const auto [low, high] = std::minmax(triangle[k], triangle[(k + 1) % 3]);
  return {low, high};
}

class Builder {
 public:
  Builder(const SpringMesh& mesh, double spacing_m) : mesh_(mesh), spacing_m_(spacing_m) {
    at_vertex_.assign(mesh.rest_position_W.size(), -1);
  }

  SurfacePoints build() {
    for (const Triangle& triangle : mesh_.triangles) {
      points_.begin.push_back(static_cast<std::int32_t>(points_.of.size()));
      for (std::size_t k = 0; k < 3; ++k) {
        add_corner(triangle[k]);
        add_edge(edge_of(triangle, k));
      }
      add_face(triangle);
    }
    points_.begin.push_back(static_cast<std::int32_t>(points_.of.size()));
    return std::move(points_);
  }

 private:
  int parts(const Edge& edge) const {
    const double length_m = (mesh_.rest_position_W[static_cast<std::size_t>(edge.first)] -
                             mesh_.rest_position_W[static_cast<std::size_t>(edge.second)])
                                .norm();
    return static_cast<int>(std::clamp(std::ceil(length_m / spacing_m_), 1.0, double{kMostParts}));
  }

  bool fixed(std::int32_t vertex) const {
    return mesh_.fixed[static_cast<std::size_t>(vertex)] != 0;
  }

  // The number of a new point, or -1 if it can't move.
  std::int32_t add(const SurfacePoint& point) {
    if (fixed(point.vertex[0]) && fixed(point.vertex[1]) && fixed(point.vertex[2])) {
      return -1;
    }
    points_.point.push_back(point);
    return static_cast<std::int32_t>(points_.point.size()) - 1;
  }

  void belongs(std::int32_t point) {
    if (point >= 0) {
      points_.of.push_back(point);
    }
  }

  void add_corner(std::int32_t vertex) {
    std::int32_t& known = at_vertex_[static_cast<std::size_t>(vertex)];
    if (known < 0) {
      known = add({{vertex, vertex, vertex}, {1.0, 0.0, 0.0}});
    }
    belongs(known);
  }

  void add_edge(const Edge& edge) {
    const auto [at, is_new] = on_edge_.try_emplace(edge);
    if (is_new) {
      const int n = parts(edge);
      for (int i = 1; i < n; ++i) {
        const double along = static_cast<double>(i) / n;
        at->second.push_back(
            add({{edge.first, edge.second, edge.first}, {1.0 - along, along, 0.0}}));
      }
    }
    for (const std::int32_t point : at->second) {
      belongs(point);
    }
  }

  void add_face(const Triangle& triangle) {
    int n = 1;
    for (std::size_t k = 0; k < 3; ++k) {
      n = std::max(n, parts(edge_of(triangle, k)));
    }
    for (int i = 1; i < n; ++i) {
      for (int j = 1; i + j < n; ++j) {
        const double u = static_cast<double>(i) / n;
        const double v = static_cast<double>(j) / n;
        belongs(add({triangle, {1.0 - u - v, u, v}}));
      }
    }
  }

  const SpringMesh& mesh_;
  double spacing_m_;
  SurfacePoints points_;
  std::vector<std::int32_t> at_vertex_;
  std::map<Edge, std::vector<std::int32_t>> on_edge_;
};

}  // namespace

SurfacePoints make_surface_points(const SpringMesh& mesh, double spacing_m) {
  return Builder(mesh, spacing_m).build();
}

}  // namespace forcegrid::simulator
