// SPDX-License-Identifier: Apache-2.0
// Compiled without contraction to fused multiply-adds (CMakeLists.txt), as lattice_block.cpp is.
#include "simulator/mesh/organ_surface.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/rest_surface.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

const std::string kOrgan = "organ: ";
constexpr int kFewestOnARing = 5;
constexpr int kFixedRings = 2;          // at each end, beside the pole
constexpr std::int64_t kPhases = 1024;  // a ring is turned by a multiple of its step / kPhases
constexpr int kMeridianSteps = 1 << 14;
constexpr double kClearOfTop = 0.4;  // of the longest semi-axis: no edge is left out within
// Independent random sequences from one seed.
constexpr std::uint64_t kTurnsOfRings = 0x1000000000ULL;
constexpr std::uint64_t kOrderOfEdges = 0x2000000000ULL;

using Edge = std::pair<std::int32_t, std::int32_t>;  // lower vertex first

Edge edge_of(std::int32_t a, std::int32_t b) { return {std::min(a, b), std::max(a, b)}; }

void check(const OrganOptions& options) {
  const auto require = [](bool good, const std::string& what, double value,
                          const std::string& remedy) {
    if (!good || !std::isfinite(value)) {
      throw Error(kOrgan + what + " is " + text::number_text(value) + "; " + remedy);
    }
  };
  const int vertices = options.vertex_count;
  require(vertices >= 200 && vertices <= 1'000'000, "vertex_count", vertices,
          "give 200 to 1000000");
  // At most a third of the vertices, so that pairs of edges at one vertex stay rare.
  const int fewest = 3 * vertices - 6 - vertices / 3;
  require(options.edge_count >= fewest && options.edge_count <= 6 * vertices - 12, "edge_count",
          options.edge_count,
          "give " + std::to_string(fewest) + " to " + std::to_string(6 * vertices - 12));
  for (int axis = 0; axis < 3; ++axis) {
    require(options.semi_axes_m[axis] > 0.0, std::string("semi_axes_m along ") + "xyz"[axis],
            options.semi_axes_m[axis], "it must be finite and > 0");
  }
  require(options.bend_m >= 0.0, "bend_m", options.bend_m, "it must be finite and >= 0");
  require(options.stiffness_N_per_m > 0.0, "stiffness_N_per_m", options.stiffness_N_per_m,
          "it must be finite and > 0");
  require(options.strut_factor > 0.0, "strut_factor", options.strut_factor,
          "it must be finite and > 0");
  require(options.random_spread >= 0.0 && options.random_spread < 1.0, "random_spread",
          options.random_spread, "it must be in [0, 1)");
  require(options.pre_strain >= 0.0, "pre_strain", options.pre_strain,
          "it must be finite and >= 0");
  require(options.home_stiffness_N_per_m >= 0.0, "home_stiffness_N_per_m",
          options.home_stiffness_N_per_m, "it must be finite and >= 0");
  if (!options.top_W.allFinite()) {
    throw Error(kOrgan + "top_W is not finite");
  }
}

double to_grid_m(double length_m) {
  return std::ldexp(std::nearbyint(std::ldexp(length_m, 30)), -30);
}

// Where the rings lie along the ellipsoid and how many vertices each has; poles not included.
struct Rings {
  std::vector<double> angle_rad;  // from the pole at +y
  std::vector<std::int64_t> count;
};

// Angles at equal distances along a mean meridian.
std::vector<double> ring_angles_rad(const OrganOptions& options) {
  const Eigen::Vector3d& half_m = options.semi_axes_m;
  const double across_m = std::sqrt(half_m.x() * half_m.z());
  std::vector<double> length_m(kMeridianSteps + 1, 0.0);
  double area_m2 = 0.0;
  const double step_rad = std::numbers::pi / kMeridianSteps;
  for (int i = 0; i < kMeridianSteps; ++i) {
    const double angle_rad = (i + 0.5) * step_rad;
    const double slope_m =
        std::hypot(half_m.y() * std::sin(angle_rad), across_m * std::cos(angle_rad));
    const auto at = static_cast<std::size_t>(i);
    length_m[at + 1] = length_m[at] + slope_m * step_rad;
    area_m2 += slope_m * step_rad * 2.0 * std::numbers::pi * across_m * std::sin(angle_rad);
  }
  // Equilateral triangles of this edge would cover the area.
  const double edge_m = std::sqrt(area_m2 / options.vertex_count * 2.0 / std::numbers::sqrt3);
  const auto intervals =
      static_cast<int>(std::lround(length_m.back() / (edge_m * 0.5 * std::numbers::sqrt3)));
  std::vector<double> angles_rad;
  for (int ring = 1; ring < intervals; ++ring) {
    const double wanted_m = length_m.back() * ring / intervals;
    const auto after = std::upper_bound(length_m.begin(), length_m.end(), wanted_m);
    const double within = (wanted_m - *(after - 1)) / (*after - *(after - 1));
    angles_rad.push_back((static_cast<double>(after - length_m.begin()) - 1.0 + within) * step_rad);
  }
  return angles_rad;
}

// Vertices per ring in proportion to its circumference, in all as many as requested: by bisection
// on the proportion, the rest by the largest remainders, in integers throughout.
Rings make_rings(const OrganOptions& options) {
  Rings rings{ring_angles_rad(options), {}};
  const std::size_t n = rings.angle_rad.size();
  std::vector<std::int64_t> weight(n);
  for (std::size_t i = 0; i < n; ++i) {
    weight[i] = std::llround(std::sin(rings.angle_rad[i]) * (1 << 20));
  }
  const auto counts_at = [&weight](std::int64_t proportion) {
    std::vector<std::int64_t> counts;
    for (const std::int64_t w : weight) {
      counts.push_back(std::max<std::int64_t>(kFewestOnARing, (w * proportion) >> 40));
    }
    return counts;
  };
  const std::int64_t wanted = options.vertex_count - 2;
  std::int64_t low = 0;
  std::int64_t high = std::int64_t{1} << 40;
  while (high - low > 1) {
    const std::int64_t middle = low + (high - low) / 2;
    const std::vector<std::int64_t> counts = counts_at(middle);
    (std::accumulate(counts.begin(), counts.end(), std::int64_t{0}) <= wanted ? low : high) =
        middle;
  }
  rings.count = counts_at(low);
  const std::int64_t left =
      wanted - std::accumulate(rings.count.begin(), rings.count.end(), std::int64_t{0});
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto remainder = [&](std::size_t i) {
    return (weight[i] * low) & ((std::int64_t{1} << 40) - 1);
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return remainder(a) > remainder(b); });
  for (std::size_t i = 0; i < static_cast<std::size_t>(left); ++i) {
    ++rings.count[order[i % n]];
  }
  return rings;
}

struct Surface {
  SpringMesh mesh;  // vertices, fixed, triangles
  std::vector<Edge> between_rings;
  std::map<Edge, std::array<std::int32_t, 2>> opposite;  // of every edge: its triangles' corners
};

class SurfaceBuilder {
 public:
  SurfaceBuilder(const OrganOptions& options, Rings rings)
      : options_(options), rings_(std::move(rings)) {
    std::int32_t first = 1;
    for (std::size_t i = 0; i < rings_.count.size(); ++i) {
      const double random = spring_random(options.seed + kTurnsOfRings, i);
      phase_.push_back(static_cast<std::int64_t>(0.5 * (random + 1.0) * kPhases));
      first_.push_back(first);
      first += static_cast<std::int32_t>(rings_.count[i]);
    }
    last_pole_ = first;
  }

  Surface build() {
    place_vertices();
    const std::size_t last = rings_.count.size() - 1;
    for (std::int64_t j = 0; j < rings_.count[0]; ++j) {
      add_triangle(0, vertex(0, j + 1), vertex(0, j));
    }
    for (std::size_t ring = 0; ring < last; ++ring) {
      join(ring);
    }
    for (std::int64_t j = 0; j < rings_.count[last]; ++j) {
      add_triangle(last_pole_, vertex(last, j), vertex(last, j + 1));
    }
    return std::move(surface_);
  }

 private:
  std::int32_t vertex(std::size_t ring, std::int64_t j) const {
    return first_[ring] + static_cast<std::int32_t>(j % rings_.count[ring]);
  }

  void place(double angle_rad, double turn) {
    const Eigen::Vector3d& half_m = options_.semi_axes_m;
    const double along = std::cos(angle_rad);
    const double across = std::sin(angle_rad);
    const double around_rad = 2.0 * std::numbers::pi * turn;
    surface_.mesh.rest_position_W.emplace_back(
        to_grid_m(half_m.x() * across * std::cos(around_rad)), to_grid_m(half_m.y() * along),
        to_grid_m(half_m.z() * across * std::sin(around_rad) - options_.bend_m * along * along));
  }

  void place_vertices() {
    place(0.0, 0.0);
    surface_.mesh.fixed.push_back(1);
    const std::size_t n = rings_.count.size();
    for (std::size_t i = 0; i < n; ++i) {
      const bool fixed = i < kFixedRings || i + kFixedRings >= n;
      for (std::int64_t j = 0; j < rings_.count[i]; ++j) {
        place(rings_.angle_rad[i], static_cast<double>(kPhases * j + phase_[i]) /
                                       static_cast<double>(kPhases * rings_.count[i]));
        surface_.mesh.fixed.push_back(fixed ? 1 : 0);
      }
    }
    place(std::numbers::pi, 0.0);
    surface_.mesh.fixed.push_back(1);
  }

  void add_triangle(std::int32_t a, std::int32_t b, std::int32_t c) {
    surface_.mesh.triangles.push_back({a, b, c});
    for (const auto& [from, to, corner] : {std::array{a, b, c}, {b, c, a}, {c, a, b}}) {
      const auto [at, first] = surface_.opposite.try_emplace(edge_of(from, to));
      at->second[first ? 0 : 1] = corner;
    }
  }

  // Joins the ring to the next one with triangles. Of the two possible next edges, takes the one
  // that turns less.
  void join(std::size_t ring) {
    const std::size_t next = ring + 1;
    const std::int64_t n = rings_.count[ring];
    const std::int64_t m = rings_.count[next];
    std::int64_t j = 0;
    std::int64_t l = 0;
    while (j < n || l < m) {
      surface_.between_rings.push_back(edge_of(vertex(ring, j), vertex(next, l)));
      const std::int64_t upper = (kPhases * (j + 1) + phase_[ring]) * m;
      const std::int64_t lower = (kPhases * (l + 1) + phase_[next]) * n;
      if (l >= m || (j < n && upper <= lower)) {
        add_triangle(vertex(ring, j), vertex(ring, j + 1), vertex(next, l));
        ++j;
      } else {
        add_triangle(vertex(ring, j), vertex(next, l + 1), vertex(next, l));
        ++l;
      }
    }
  }

  const OrganOptions& options_;
  Rings rings_;
  std::vector<std::int64_t> phase_;
  std::vector<std::int32_t> first_;
  std::int32_t last_pole_ = 0;
  Surface surface_;
};

std::vector<Edge> shuffled(std::vector<Edge> edges, std::uint64_t seed) {
  std::vector<std::pair<double, Edge>> keyed;
  for (const Edge& edge : edges) {
    keyed.emplace_back(spring_random(seed + kOrderOfEdges, keyed.size()), edge);
  }
  std::sort(keyed.begin(), keyed.end());
  std::transform(keyed.begin(), keyed.end(), edges.begin(),
                 [](const auto& each) { return each.second; });
  return edges;
}

// The edges to leave out, so that `count` fewer remain.
std::set<Edge> edges_to_leave_out(const OrganOptions& options, const Surface& surface, int count) {
  const SpringMesh& mesh = surface.mesh;
  const double clear_m = kClearOfTop * options.semi_axes_m.maxCoeff();
  const auto allowed = [&](std::int32_t vertex) {
    const auto at = static_cast<std::size_t>(vertex);
    return mesh.fixed[at] == 0 && (mesh.rest_position_W[at] - mesh.top_W).norm() > clear_m;
  };
  const std::vector<Edge> order = shuffled(surface.between_rings, options.seed);
  std::vector<int> left_out_at(mesh.rest_position_W.size(), 0);
  std::set<Edge> left_out;
  for (int most_at_a_vertex = 0; most_at_a_vertex < 2; ++most_at_a_vertex) {
    for (const Edge& edge : order) {
      int& at_a = left_out_at[static_cast<std::size_t>(edge.first)];
      int& at_b = left_out_at[static_cast<std::size_t>(edge.second)];
      if (static_cast<int>(left_out.size()) < count && allowed(edge.first) &&
          allowed(edge.second) && std::max(at_a, at_b) <= most_at_a_vertex &&
          left_out.insert(edge).second) {
        ++at_a;
        ++at_b;
      }
    }
  }
  if (static_cast<int>(left_out.size()) < count) {
    throw Error(kOrgan + "edge_count is " + std::to_string(options.edge_count) + ", but only " +
                std::to_string(left_out.size()) + " edges can be left out; give at least " +
                std::to_string(3 * options.vertex_count - 6 - static_cast<int>(left_out.size())));
  }
  return left_out;
}

std::vector<Edge> struts(const OrganOptions& options, const Surface& surface, int count) {
  std::vector<Edge> all;
  for (const auto& [edge, corners] : surface.opposite) {
    const Edge strut = edge_of(corners[0], corners[1]);
    if (!surface.opposite.contains(strut)) {
      all.push_back(strut);
    }
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  if (static_cast<int>(all.size()) < count) {
    throw Error(kOrgan + "edge_count is " + std::to_string(options.edge_count) +
                ", but there is room for " + std::to_string(all.size()) + " struts; give at most " +
                std::to_string(3 * options.vertex_count - 6 + static_cast<int>(all.size())));
  }
  all = shuffled(std::move(all), options.seed);
  all.resize(static_cast<std::size_t>(count));
  return all;
}

void add_springs(const OrganOptions& options, const std::vector<Edge>& edges, double factor,
                 SpringMesh& mesh) {
  for (const Edge& edge : edges) {
    const double random = spring_random(options.seed, mesh.springs.size());
    mesh.springs.push_back(
        {edge.first, edge.second,
         options.stiffness_N_per_m * factor * (1.0 + options.random_spread * random)});
  }
}

// Moves the surface so that its point above the origin lies at top_W.
void move_to_top(const Eigen::Vector3d& top_W, SpringMesh& mesh) {
  const Eigen::Vector3d above_W(0.0, 0.0, 2.0);
  const double height_m = above_W.z() - RestSurface(mesh).look(above_W).below_m.value();
  for (Eigen::Vector3d& position_W : mesh.rest_position_W) {
    position_W += top_W - Eigen::Vector3d(0.0, 0.0, to_grid_m(height_m));
  }
  mesh.top_W = top_W;
}

}  // namespace

SpringMesh make_organ_surface(const OrganOptions& options) {
  check(options);
  Surface surface = SurfaceBuilder(options, make_rings(options)).build();
  SpringMesh& mesh = surface.mesh;
  move_to_top(options.top_W, mesh);
  mesh.laws = {options.law};
  std::vector<Edge> edges;
  for (const auto& [edge, corners] : surface.opposite) {
    edges.push_back(edge);
  }
  const int more = options.edge_count - static_cast<int>(edges.size());
  if (more < 0) {
    const std::set<Edge> left_out = edges_to_leave_out(options, surface, -more);
    std::erase_if(edges, [&left_out](const Edge& edge) { return left_out.contains(edge); });
  }
  add_springs(options, edges, 1.0, mesh);
  if (more > 0) {
    add_springs(options, struts(options, surface, more), options.strut_factor, mesh);
  }
  tighten(mesh, options.pre_strain, options.home_stiffness_N_per_m);
  simulator::check(mesh);
  return mesh;
}

}  // namespace forcegrid::simulator
