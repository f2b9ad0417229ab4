// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "simulator/kernels/spring_kernels.h"
#include "simulator/kernels/vertex_forces.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A mesh's springs in the kernels' form: sorted by their lower vertex and padded.
template <typename Real>
struct SpringTable {
  kernels::SpringRows rows;
  std::vector<kernels::SpringConstants<Real>> constants;
  bool exponential = false;               ///< some spring has an exponent
  std::size_t springs = 0;                ///< without the padding
  std::vector<std::int32_t> mesh_spring;  ///< the mesh's number of each, without the padding
};

/// `mesh` must have passed check().
template <typename Real>
SpringTable<Real> make_spring_table(const SpringMesh& mesh);

extern template SpringTable<float> make_spring_table(const SpringMesh&);
extern template SpringTable<double> make_spring_table(const SpringMesh&);

/// Renumbers the springs' ends, order[n] becoming n, and sorts them by their lower vertex again.
template <typename Real>
void renumber_springs(const std::vector<std::int32_t>& order, kernels::SpringRows& rows,
                      std::vector<kernels::SpringConstants<Real>>& constants);

extern template void renumber_springs(const std::vector<std::int32_t>&, kernels::SpringRows&,
                                      std::vector<kernels::SpringConstants<float>>&);
extern template void renumber_springs(const std::vector<std::int32_t>&, kernels::SpringRows&,
                                      std::vector<kernels::SpringConstants<double>>&);

/// Home springs and loads, one per vertex; empty if only springs pull.
/// @param rest_m  the vertices' rest positions from the solver's own origin.
std::vector<kernels::VertexForce> make_vertex_forces(const SpringMesh& mesh,
                                                     const std::vector<Eigen::Vector3d>& rest_m);

}  // namespace forcegrid::simulator
