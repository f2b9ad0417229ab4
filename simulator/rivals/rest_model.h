// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// What can be computed of an object at rest before anybody touches it. All of it is linear: the
/// object with its tangent stiffness K at rest (tangent_stiffness_W). All of it throws Error for a
/// mesh that check() refuses, for a rest shape that is no stable equilibrium (K is not positive
/// definite), and for a vertex that is fixed or missing.
/// Real-time: no. Threads: any.

/// Most free vertices of an object whose K is factorised: beyond it the factor takes gigabytes.
inline constexpr std::size_t kMostFactorisedVertices = 20'000;

/// The free vertices within `radius_m` of `point_W` [m] at rest: those that ElasticObject::grab()
/// takes. In the mesh's order.
std::vector<std::int32_t> vertices_within(const SpringMesh& mesh, const Eigen::Vector3d& point_W,
                                          double radius_m);

/// [N/m] J = dF/dP at rest for a tool that holds `patch` rigidly,
///
///   J = -1^T (K_pp - K_pf K_ff^-1 K_fp) 1
///
/// p the patch, f the other free vertices, 1 a unit displacement of each patch vertex; K_ff^-1 by
/// conjugate gradients to a relative residual of 1e-10.
Eigen::Matrix3d rest_stiffness_W(const SpringMesh& mesh, const std::vector<std::int32_t>& patch);

/// [m/N] G = (K^-1)_nn for these vertices n, three rows and columns each: column 3 i + c is the
/// displacement of all of them under a unit load along axis c on vertex i, the rest of the surface
/// free of loads. One factorisation K = L D L^T, then a forward and a backward substitution for
/// each unit load, through those columns of L alone that can be reached from `nodes`.
/// Source: James and Pai, A unified treatment of elastostatic contact simulation for real time
/// haptics, Haptics-e 2(1), 2001: Green's functions of the free boundary.
/// Also throws Error for more than kMostFactorisedVertices free vertices.
Eigen::MatrixXd greens_functions_m_per_N(const SpringMesh& mesh,
                                         const std::vector<std::int32_t>& nodes);

/// [N/m] S = K_ss - K_si K_ii^-1 K_is for these vertices s, i all other free ones: the part of
/// L D L^T that is left for s when i has been eliminated first.
/// Source: Bro-Nielsen and Cotin, Real-time volumetric deformable models for surgery simulation
/// using finite elements and condensation, Eurographics 1996, section on condensation.
/// Also throws Error for more than kMostFactorisedVertices free vertices.
Eigen::MatrixXd condensed_stiffness_N_per_m(const SpringMesh& mesh,
                                            const std::vector<std::int32_t>& nodes);

}  // namespace forcegrid::simulator
