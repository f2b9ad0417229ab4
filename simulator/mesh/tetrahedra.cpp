// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/tetrahedra.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const std::string kElementsWho = "elements: ";
// Of the product of three edges: below this an element's shape is rounding.
constexpr double kSmallestRelativeVolume = 1e-9;

std::size_t index(std::int32_t vertex) { return static_cast<std::size_t>(vertex); }

void check_material(const ElementMaterial& material, std::size_t number) {
  const auto require = [number](bool fine, const char* name, double value, const char* range) {
    if (!fine || !std::isfinite(value)) {
      throw Error(kElementsWho + name + " of material " + std::to_string(number) + " is " +
                  text::number_text(value) + "; it must be finite and " + range);
    }
  };
  require(material.youngs_modulus_Pa > 0.0, "youngs_modulus_Pa", material.youngs_modulus_Pa, "> 0");
  require(material.poissons_ratio > -1.0 && material.poissons_ratio < 0.5, "poissons_ratio",
          material.poissons_ratio, "above -1 and below 0.5");
  require(material.density_kg_per_m3 > 0.0, "density_kg_per_m3", material.density_kg_per_m3, "> 0");
  require(material.retardation_time_s >= 0.0, "retardation_time_s", material.retardation_time_s,
          ">= 0");
}

}  // namespace

const std::vector<Vector3d>& unstrained_W(const SpringMesh& mesh) noexcept {
  return mesh.unstrained_W.empty() ? mesh.rest_position_W : mesh.unstrained_W;
}

ElementShape element_shape(const std::vector<Vector3d>& unstrained_m,
                           const Tetrahedron& element) noexcept {
  const auto at = [&](std::size_t k) -> const Vector3d& {
    return unstrained_m[index(element.vertex[k])];
  };
  Matrix3d edges_m;
  for (int k = 0; k < 3; ++k) {
    edges_m.col(k) = at(static_cast<std::size_t>(k) + 1) - at(0);
  }
  const Matrix3d inverse_per_m = edges_m.inverse();
  ElementShape shape;
  shape.volume_m3 = std::abs(edges_m.determinant()) / 6.0;
  shape.gradient_per_m[0].setZero();
  for (int k = 0; k < 3; ++k) {
    const auto corner = static_cast<std::size_t>(k) + 1;
    shape.gradient_per_m[corner] = inverse_per_m.row(k);
    shape.gradient_per_m[0] -= shape.gradient_per_m[corner];
  }
  return shape;
}

Matrix3d deformation_gradient(const ElementShape& shape, const Tetrahedron& element,
                              const std::vector<Vector3d>& position_m) noexcept {
  const Vector3d& first_m = position_m[index(element.vertex[0])];
  Matrix3d f = Matrix3d::Zero();
  for (std::size_t a = 1; a < 4; ++a) {
    f += (position_m[index(element.vertex[a])] - first_m) * shape.gradient_per_m[a].transpose();
  }
  return f;
}

void add_element_forces_W(const SpringMesh& mesh, const std::vector<Vector3d>& position_W,
                          std::vector<Vector3d>& force_W) {
  for (const Tetrahedron& element : mesh.tetrahedra) {
    const ElementShape shape = element_shape(unstrained_W(mesh), element);
    const Matrix3d stress = stress_Pa(mesh.materials[index(element.material)],
                                      deformation_gradient(shape, element, position_W));
    for (std::size_t a = 0; a < 4; ++a) {
      force_W[index(element.vertex[a])] -= shape.volume_m3 * stress * shape.gradient_per_m[a];
    }
  }
}

Eigen::Matrix<double, 12, 12> element_stiffness_W(const ElementShape& shape,
                                                  const ElementMaterial& material,
                                                  const Matrix3d& f) noexcept {
  // How F's nine numbers follow the four corners'.
  Eigen::Matrix<double, 9, 12> follows = Eigen::Matrix<double, 9, 12>::Zero();
  for (int a = 0; a < 4; ++a) {
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        follows(c + 3 * d, 3 * a + c) = shape.gradient_per_m[static_cast<std::size_t>(a)][d];
      }
    }
  }
  return shape.volume_m3 * follows.transpose() * stress_slope_Pa(material, f) * follows;
}

double element_volume_m3(const SpringMesh& mesh) {
  double sum_m3 = 0.0;
  for (const Tetrahedron& element : mesh.tetrahedra) {
    sum_m3 += element_shape(unstrained_W(mesh), element).volume_m3;
  }
  return sum_m3;
}

double element_quality(const std::array<Vector3d, 4>& corner_m) noexcept {
  const Vector3d a = corner_m[1] - corner_m[0];
  const Vector3d b = corner_m[2] - corner_m[0];
  const Vector3d c = corner_m[3] - corner_m[0];
  const double six_volumes = std::abs(a.dot(b.cross(c)));
  const double twice_surface =
      b.cross(c).norm() + c.cross(a).norm() + a.cross(b).norm() + (b - a).cross(c - a).norm();
  const double twelve_volumes_radius =
      (a.squaredNorm() * b.cross(c) + b.squaredNorm() * c.cross(a) + c.squaredNorm() * a.cross(b))
          .norm();
  // Inscribed: 3 V / (surface / 1); circumscribed: the last one over 12 V.
  return twelve_volumes_radius > 0.0 && twice_surface > 0.0
             ? 3.0 * (six_volumes / twice_surface) * (2.0 * six_volumes / twelve_volumes_radius)
             : 0.0;
}

std::vector<double> element_masses_kg(const SpringMesh& mesh) {
  std::vector<double> masses_kg(mesh.rest_position_W.size(), 0.0);
  for (const Tetrahedron& element : mesh.tetrahedra) {
    const double quarter_kg = 0.25 * mesh.materials[index(element.material)].density_kg_per_m3 *
                              element_shape(unstrained_W(mesh), element).volume_m3;
    for (const std::int32_t vertex : element.vertex) {
      masses_kg[index(vertex)] += quarter_kg;
    }
  }
  return masses_kg;
}

void refuse_elements(const SpringMesh& mesh, const std::string& who, const std::string& remedy) {
  if (!mesh.tetrahedra.empty()) {
    throw Error(who + "it knows springs only, and the scene has finite elements; " + remedy);
  }
}

void check_elements(const SpringMesh& mesh) {
  const std::size_t vertices = mesh.rest_position_W.size();
  for (std::size_t m = 0; m < mesh.materials.size(); ++m) {
    check_material(mesh.materials[m], m);
  }
  if (!mesh.unstrained_W.empty() && mesh.unstrained_W.size() != vertices) {
    throw Error(kElementsWho + std::to_string(mesh.unstrained_W.size()) +
                " entries in 'unstrained_W' for " + std::to_string(vertices) +
                " vertices; give one per vertex");
  }
  for (std::size_t e = 0; e < mesh.tetrahedra.size(); ++e) {
    rt::checkpoint_at(e, mesh.tetrahedra.size());
    const Tetrahedron& element = mesh.tetrahedra[e];
    const std::string name = kElementsWho + "tetrahedron " + std::to_string(e);
    std::array<std::int32_t, 4> sorted = element.vertex;
    std::sort(sorted.begin(), sorted.end());
    if (sorted.front() < 0 || index(sorted.back()) >= vertices ||
        std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
      throw Error(name + " needs four different vertices in 0.." + std::to_string(vertices - 1));
    }
    if (element.material < 0 || index(element.material) >= mesh.materials.size()) {
      throw Error(name + " has material " + std::to_string(element.material) + " of " +
                  std::to_string(mesh.materials.size()) + "; name an existing one");
    }
    const auto at = [&](std::size_t k) -> const Vector3d& {
      return unstrained_W(mesh)[index(element.vertex[k])];
    };
    const Vector3d a = at(1) - at(0);
    const Vector3d b = at(2) - at(0);
    const Vector3d c = at(3) - at(0);
    if (!(std::abs(a.dot(b.cross(c))) > kSmallestRelativeVolume * a.norm() * b.norm() * c.norm())) {
      throw Error(name + " has no volume; remesh");
    }
  }
}

}  // namespace forcegrid::simulator
