// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace forcegrid::paper {

/// The paper's timing paragraph on this machine: a grid of 50 x 50 x 50 vertices, r a sixth of the
/// workspace. Values are medians of many repetitions.
struct Timing {
  double influence_radius_m = 0.0;
  /// Vertices within r of a sample in the middle of the workspace, by counting.
  std::size_t vertices_within_r = 0;
  double query_ns = 0.0;             ///< localization and interpolation in a filled grid
  double fill_us = 0.0;              ///< to take in a sample and spread it over these vertices
  double vertex_ns = 0.0;            ///< fill_us per vertex
  double vertices_per_cycle = 0.0;   ///< in the rest of a cycle of 2 ms after a query
  double vertices_per_answer = 0.0;  ///< in all cycles between two answers of the simulator
  double bare_read_ns = 0.0;         ///< baseline: eight loads and their weighted sum
  std::size_t memory_bytes = 0;      ///< of the method, including grid and tables
};

/// Takes about 0.2 s.
/// Real-time: no. Threads: any, but nothing else should run.
Timing measure_timing();

/// Counts the vertices of a regular grid within `radius_m` of a point, given relative to the lowest
/// corner in x, y and z.
/// @param cells along x, y, z; @param extent_m of the workspace along x, y, z.
std::size_t count_vertices_within(const double (&point_m)[3], double radius_m,
                                  const int (&cells)[3], const double (&extent_m)[3]);

}  // namespace forcegrid::paper
