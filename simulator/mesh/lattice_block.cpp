// SPDX-License-Identifier: Apache-2.0
// Compiled without contraction to fused multiply-adds (CMakeLists.txt): the mesh must not depend on
// the processor.
#include "simulator/mesh/lattice_block.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

constexpr int kMaxVerticesPerAxis = 1000;
constexpr std::int64_t kMaxVertices = 20'000'000;

void check(const LatticeBlockOptions& options) {
  const std::string who = "lattice block: ";
  std::int64_t vertices = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const char name = "xyz"[axis];
    const int count = options.vertex_count[static_cast<std::size_t>(axis)];
    if (count < 2 || count > kMaxVerticesPerAxis) {
      throw Error(who + std::to_string(count) + " vertices along " + name + "; give 2 to " +
                  std::to_string(kMaxVerticesPerAxis));
    }
    vertices *= count;
    if (!(options.size_m[axis] > 0.0) || !std::isfinite(options.size_m[axis])) {
      throw Error(who + "size along " + name + " is " + std::to_string(options.size_m[axis]) +
                  " m; it must be finite and > 0");
    }
  }
  if (vertices > kMaxVertices) {
    throw Error(who + std::to_string(vertices) + " vertices; give at most " +
                std::to_string(kMaxVertices));
  }
  if (!options.top_centre_W.allFinite()) {
    throw Error(who + "top_centre_W is not finite");
  }
  check_positive(options.stiffness_N_per_m, who + "stiffness_N_per_m");
  check_positive(options.diagonal_factor, who + "diagonal_factor");
  if (!(options.random_spread >= 0.0 && options.random_spread < 1.0)) {
    throw Error(who + "random_spread is " + std::to_string(options.random_spread) +
                "; it must be in [0, 1)");
  }
}

// Two triangles per lattice face on all six sides, counterclockwise seen from outside.
void add_surface(const std::array<int, 3>& count, SpringMesh& mesh) {
  const std::array<int, 3> stride{1, count[0], count[0] * count[1]};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = (axis + 1) % 3;
    const std::size_t v = (axis + 2) % 3;
    for (const bool far : {false, true}) {
      const int first = far ? (count[axis] - 1) * stride[axis] : 0;
      for (int j = 0; j + 1 < count[v]; ++j) {
        for (int i = 0; i + 1 < count[u]; ++i) {
          const int a = first + i * stride[u] + j * stride[v];
          const int b = a + stride[u];
          const int c = b + stride[v];
          const int d = a + stride[v];
          // u, v and the axis are right-handed.
          mesh.triangles.push_back(far ? std::array{a, b, c} : std::array{a, c, b});
          mesh.triangles.push_back(far ? std::array{a, c, d} : std::array{a, d, c});
        }
      }
    }
  }
}

}  // namespace

double spring_random(std::uint64_t seed, std::uint64_t index) noexcept {
  std::uint64_t z = seed + (index + 1) * 0x9E3779B97F4A7C15ULL;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  z ^= z >> 31;
  return std::ldexp(static_cast<double>(z >> 11), -52) - 1.0;
}

SpringMesh make_lattice_block(const LatticeBlockOptions& options) {
  check(options);
  const auto [nx, ny, nz] = options.vertex_count;
  const Eigen::Vector3d spacing_m(options.size_m.x() / (nx - 1), options.size_m.y() / (ny - 1),
                                  options.size_m.z() / (nz - 1));
  SpringMesh mesh;
  mesh.laws = {options.law};
  mesh.top_W = options.top_centre_W;

  const auto number = [nx = nx, ny = ny](int i, int j, int l) { return i + nx * (j + ny * l); };
  const auto vertices =
      static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny) * static_cast<std::size_t>(nz);
  mesh.rest_position_W.reserve(vertices);
  mesh.fixed.reserve(vertices);
  const auto layers = 2 * static_cast<std::size_t>(nz);  // of vertices, then of their springs
  for (int l = 0; l < nz; ++l) {
    rt::checkpoint(static_cast<std::size_t>(l), layers);
    for (int j = 0; j < ny; ++j) {
      for (int i = 0; i < nx; ++i) {
        const Eigen::Vector3d from_top_centre_W((i - 0.5 * (nx - 1)) * spacing_m.x(),
                                                (j - 0.5 * (ny - 1)) * spacing_m.y(),
                                                (l - (nz - 1)) * spacing_m.z());
        mesh.rest_position_W.push_back(options.top_centre_W + from_top_centre_W);
        mesh.fixed.push_back(l == 0 ? 1 : 0);
      }
    }
  }

  const auto join = [&mesh, &options](int a, int b, double factor) {
    const double random = spring_random(options.seed, mesh.springs.size());
    const double k = options.stiffness_N_per_m * factor * (1.0 + options.random_spread * random);
    mesh.springs.push_back({std::min(a, b), std::max(a, b), k});
  };
  for (int l = 0; l < nz; ++l) {
    rt::checkpoint(static_cast<std::size_t>(nz + l), layers);
    for (int j = 0; j < ny; ++j) {
      for (int i = 0; i < nx; ++i) {
        const bool x = i + 1 < nx;
        const bool y = j + 1 < ny;
        const bool z = l + 1 < nz;
        const int here = number(i, j, l);
        if (x) {
          join(here, number(i + 1, j, l), 1.0);
        }
        if (y) {
          join(here, number(i, j + 1, l), 1.0);
        }
        if (z) {
          join(here, number(i, j, l + 1), 1.0);
        }
        const double diagonal = options.diagonal_factor;
        if (x && y) {
          join(here, number(i + 1, j + 1, l), diagonal);
          join(number(i + 1, j, l), number(i, j + 1, l), diagonal);
        }
        if (x && z) {
          join(here, number(i + 1, j, l + 1), diagonal);
          join(number(i + 1, j, l), number(i, j, l + 1), diagonal);
        }
        if (y && z) {
          join(here, number(i, j + 1, l + 1), diagonal);
          join(number(i, j + 1, l), number(i, j, l + 1), diagonal);
        }
      }
    }
  }
  add_surface(options.vertex_count, mesh);
  simulator::check(mesh);
  return mesh;
}

}  // namespace forcegrid::simulator
