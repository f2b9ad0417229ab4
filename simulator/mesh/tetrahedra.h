// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A linear tetrahedron without strain.
struct ElementShape {
  /// [1/m] Gradients of its four hat functions; they sum to zero. The deformation gradient is
  /// F = sum x_a g_a^T.
  std::array<Eigen::Vector3d, 4> gradient_per_m;
  double volume_m3 = 0.0;  ///< positive whatever the order of its vertices
};

/// Where the elements of a mesh are without strain [m].
const std::vector<Eigen::Vector3d>& unstrained_W(const SpringMesh& mesh) noexcept;

/// Of an element with a volume.
ElementShape element_shape(const std::vector<Eigen::Vector3d>& unstrained_m,
                           const Tetrahedron& element) noexcept;

/// F of an element at `position_m`.
Eigen::Matrix3d deformation_gradient(const ElementShape& shape, const Tetrahedron& element,
                                     const std::vector<Eigen::Vector3d>& position_m) noexcept;

/// [N] The elements' forces on the vertices, added to `force_W`: f_a = -V (dPsi/dF) g_a.
void add_element_forces_W(const SpringMesh& mesh, const std::vector<Eigen::Vector3d>& position_W,
                          std::vector<Eigen::Vector3d>& force_W);

/// [N/m] -df/dx of one element's four vertices: the exact Hessian of its energy.
Eigen::Matrix<double, 12, 12> element_stiffness_W(const ElementShape& shape,
                                                  const ElementMaterial& material,
                                                  const Eigen::Matrix3d& f) noexcept;

/// [m^3] of all elements without strain.
double element_volume_m3(const SpringMesh& mesh);

/// How well a tetrahedron is shaped: 3 times the radius of its inscribed sphere over that of its
/// circumscribed one. 1 for a regular one, 0 for a flat one.
double element_quality(const std::array<Eigen::Vector3d, 4>& corner_m) noexcept;

/// [kg] One mass per vertex: a quarter of each element's, lumped at its corners.
std::vector<double> element_masses_kg(const SpringMesh& mesh);

/// Throws Error if the mesh has elements, for what knows springs only. @param who  begins the
/// message, "solver reduced: "; @param remedy  ends it, "leave --solver out".
void refuse_elements(const SpringMesh& mesh, const std::string& who, const std::string& remedy);

/// Throws Error for elements that name a missing vertex or material or the same vertex twice, an
/// element without volume, or a material out of range.
void check_elements(const SpringMesh& mesh);

}  // namespace forcegrid::simulator
