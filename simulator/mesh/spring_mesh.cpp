// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/spring_mesh.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/tetrahedra.h"

namespace forcegrid::simulator {
namespace {

const std::string kWho = "spring mesh: ";
// Relative to the largest k l0: the rounding error of a balance, with margin.
constexpr double kBalanceTolerance = 1e-6;

std::string range_of(std::size_t count) { return "0.." + std::to_string(count - 1); }

bool outside(std::int32_t index, std::size_t count) {
  return index < 0 || static_cast<std::size_t>(index) >= count;
}

bool positive(double value) { return value > 0.0 && std::isfinite(value); }
bool not_negative(double value) { return value >= 0.0 && std::isfinite(value); }

void check_size(std::size_t size, std::size_t vertices, const char* name) {
  if (size != vertices) {
    throw Error(kWho + std::to_string(size) + " entries in '" + name + "' for " +
                std::to_string(vertices) + " vertices; give one per vertex");
  }
}

void check_vertices(const SpringMesh& mesh) {
  const std::size_t vertices = mesh.rest_position_W.size();
  if (vertices == 0 || (mesh.springs.empty() && mesh.tetrahedra.empty())) {
    throw Error(kWho + std::to_string(vertices) + " vertices and " +
                std::to_string(mesh.springs.size()) + " springs; give at least one of each");
  }
  check_size(mesh.fixed.size(), vertices, "fixed");
  if (!mesh.home_stiffness_N_per_m.empty()) {
    check_size(mesh.home_stiffness_N_per_m.size(), vertices, "home_stiffness_N_per_m");
  }
  if (!mesh.load_W_N.empty()) {
    check_size(mesh.load_W_N.size(), vertices, "load_W_N");
  }
  if (!mesh.mass_kg.empty()) {
    check_size(mesh.mass_kg.size(), vertices, "mass_kg");
  }
  if (!mesh.drag_Ns_per_m.empty()) {
    check_size(mesh.drag_Ns_per_m.size(), vertices, "drag_Ns_per_m");
  }
  const auto not_zero = [](auto value) { return value != 0; };
  if (std::none_of(mesh.fixed.begin(), mesh.fixed.end(), not_zero) &&
      std::none_of(mesh.home_stiffness_N_per_m.begin(), mesh.home_stiffness_N_per_m.end(),
                   not_zero)) {
    throw Error(kWho + "no vertex is fixed, so the object would float; fix some");
  }
  for (std::size_t i = 0; i < vertices; ++i) {
    const std::string name = "vertex " + std::to_string(i);
    if (!mesh.rest_position_W[i].allFinite()) {
      throw Error(kWho + "the position of " + name + " is not finite");
    }
    if (!mesh.load_W_N.empty() && !mesh.load_W_N[i].allFinite()) {
      throw Error(kWho + "the load of " + name + " is not finite");
    }
    if (!mesh.home_stiffness_N_per_m.empty() && !not_negative(mesh.home_stiffness_N_per_m[i])) {
      throw Error(kWho + "the home spring of " + name + " has a stiffness of " +
                  std::to_string(mesh.home_stiffness_N_per_m[i]) +
                  " N/m; it must be finite and >= 0");
    }
    if (!mesh.mass_kg.empty() && mesh.fixed[i] == 0 && !positive(mesh.mass_kg[i])) {
      throw Error(kWho + "free " + name + " has a mass of " + std::to_string(mesh.mass_kg[i]) +
                  " kg; it must be finite and > 0");
    }
    if (!mesh.drag_Ns_per_m.empty() && !not_negative(mesh.drag_Ns_per_m[i])) {
      throw Error(kWho + name + " has a drag of " + std::to_string(mesh.drag_Ns_per_m[i]) +
                  " Ns/m; it must be finite and >= 0");
    }
  }
}

void check_laws(const SpringMesh& mesh) {
  for (const SpringLaw& law : mesh.laws) {
    if (!not_negative(law.cubic_coefficient)) {
      throw Error(kWho + "cubic_coefficient is " + std::to_string(law.cubic_coefficient) +
                  "; it must be finite and >= 0");
    }
    if (!not_negative(law.exponent)) {
      throw Error(kWho + "exponent is " + std::to_string(law.exponent) +
                  "; it must be finite and >= 0");
    }
    if (!not_negative(law.retardation_time_s)) {
      throw Error(kWho + "retardation_time_s is " + std::to_string(law.retardation_time_s) +
                  "; it must be finite and >= 0");
    }
  }
}

void check_springs(const SpringMesh& mesh) {
  const std::size_t vertices = mesh.rest_position_W.size();
  std::vector<std::uint8_t> held(vertices, 0);
  for (std::size_t s = 0; s < mesh.springs.size(); ++s) {
    rt::checkpoint_at(s, mesh.springs.size());
    const Spring& spring = mesh.springs[s];
    const std::string name = kWho + "spring " + std::to_string(s);
    if (outside(spring.a, vertices) || outside(spring.b, vertices) || spring.a == spring.b) {
      throw Error(name + " joins vertices " + std::to_string(spring.a) + " and " +
                  std::to_string(spring.b) + "; name two different ones in " + range_of(vertices));
    }
    if (outside(spring.law, mesh.laws.size())) {
      throw Error(name + " has law " + std::to_string(spring.law) + " of " +
                  std::to_string(mesh.laws.size()) + "; name an existing one");
    }
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    if (!((mesh.rest_position_W[a] - mesh.rest_position_W[b]).norm() > 0.0)) {
      throw Error(name + " has no length; merge its two vertices");
    }
    if (!not_negative(spring.natural_length_m)) {
      throw Error(name + " has a natural length of " + std::to_string(spring.natural_length_m) +
                  " m; it must be finite and > 0, or 0 for its length at rest");
    }
    if (!positive(spring.stiffness_N_per_m)) {
      throw Error(name + " has a stiffness of " + std::to_string(spring.stiffness_N_per_m) +
                  " N/m; it must be finite and > 0");
    }
    held[a] = 1;
    held[b] = 1;
  }
  for (const Tetrahedron& element : mesh.tetrahedra) {
    for (const std::int32_t vertex : element.vertex) {
      held[static_cast<std::size_t>(vertex)] = 1;
    }
  }
  for (std::size_t i = 0; i < vertices; ++i) {
    if (held[i] == 0 && mesh.fixed[i] == 0) {
      throw Error(kWho + "free vertex " + std::to_string(i) +
                  " has no spring; join it to another or fix it");
    }
  }
}

void check_triangles(const SpringMesh& mesh) {
  const std::size_t vertices = mesh.rest_position_W.size();
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [a, b, c] = mesh.triangles[t];
    if (outside(a, vertices) || outside(b, vertices) || outside(c, vertices) || a == b || b == c ||
        c == a) {
      throw Error(kWho + "triangle " + std::to_string(t) + " has vertices " + std::to_string(a) +
                  ", " + std::to_string(b) + " and " + std::to_string(c) +
                  "; name three different ones in " + range_of(vertices));
    }
  }
  if (!mesh.top_W.allFinite()) {
    throw Error(kWho + "top_W is not finite");
  }
}

void check_balance(const SpringMesh& mesh) {
  const bool at_natural_lengths =
      std::all_of(mesh.springs.begin(), mesh.springs.end(),
                  [](const Spring& spring) { return spring.natural_length_m == 0.0; });
  if (at_natural_lengths && mesh.load_W_N.empty() && mesh.unstrained_W.empty()) {
    return;
  }
  const double largest_N = force_scale_N(mesh);
  const std::vector<Eigen::Vector3d> force_W = vertex_forces_W(mesh, mesh.rest_position_W);
  for (std::size_t i = 0; i < force_W.size(); ++i) {
    if (mesh.fixed[i] == 0 && !(force_W[i].norm() <= kBalanceTolerance * largest_N)) {
      throw Error(kWho + "at rest a force of " + std::to_string(force_W[i].norm()) +
                  " N is left on free vertex " + std::to_string(i) +
                  "; balance natural lengths and loads");
    }
  }
}

}  // namespace

double natural_length_m(const SpringMesh& mesh, const Spring& spring) {
  return spring.natural_length_m > 0.0 ? spring.natural_length_m
                                       : (mesh.rest_position_W[static_cast<std::size_t>(spring.a)] -
                                          mesh.rest_position_W[static_cast<std::size_t>(spring.b)])
                                             .norm();
}

std::vector<Eigen::Vector3d> vertex_forces_W(const SpringMesh& mesh,
                                             const std::vector<Eigen::Vector3d>& position_W) {
  std::vector<Eigen::Vector3d> force_W = mesh.load_W_N;
  force_W.resize(position_W.size(), Eigen::Vector3d::Zero());
  for (std::size_t i = 0; i < mesh.home_stiffness_N_per_m.size(); ++i) {
    force_W[i] -= mesh.home_stiffness_N_per_m[i] * (position_W[i] - mesh.rest_position_W[i]);
  }
  for (const Spring& spring : mesh.springs) {
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    const SpringLaw& law = mesh.laws[static_cast<std::size_t>(spring.law)];
    const double l0_m = natural_length_m(mesh, spring);
    const Eigen::Vector3d d_m = position_W[b] - position_W[a];
    const double strain = d_m.norm() / l0_m - 1.0;
    const double g = law.exponent > 0.0 ? std::sinh(law.exponent * strain) / law.exponent : strain;
    const double tension_N =
        spring.stiffness_N_per_m * l0_m * (g + law.cubic_coefficient * strain * strain * strain);
    const Eigen::Vector3d pull_N = tension_N * d_m.normalized();
    force_W[a] += pull_N;
    force_W[b] -= pull_N;
  }
  add_element_forces_W(mesh, position_W, force_W);
  return force_W;
}

double force_scale_N(const SpringMesh& mesh) {
  double largest_N = 0.0;
  for (const Spring& spring : mesh.springs) {
    largest_N = std::max(largest_N, spring.stiffness_N_per_m * natural_length_m(mesh, spring));
  }
  for (const Tetrahedron& element : mesh.tetrahedra) {
    const double edge_m = std::cbrt(element_shape(unstrained_W(mesh), element).volume_m3);
    largest_N =
        std::max(largest_N,
                 edge_m * edge_m *
                     mesh.materials[static_cast<std::size_t>(element.material)].youngs_modulus_Pa);
  }
  return largest_N;
}

void scale_forces(SpringMesh& mesh, double factor) {
  for (Spring& spring : mesh.springs) {
    spring.stiffness_N_per_m *= factor;
  }
  for (ElementMaterial& material : mesh.materials) {
    material.youngs_modulus_Pa *= factor;
  }
  for (double& stiffness_N_per_m : mesh.home_stiffness_N_per_m) {
    stiffness_N_per_m *= factor;
  }
  for (Eigen::Vector3d& load_N : mesh.load_W_N) {
    load_N *= factor;
  }
  for (double& drag_Ns_per_m : mesh.drag_Ns_per_m) {
    drag_Ns_per_m *= factor;
  }
}

void tighten(SpringMesh& mesh, double pre_strain, double home_stiffness_N_per_m) {
  if (home_stiffness_N_per_m > 0.0) {
    mesh.home_stiffness_N_per_m.assign(mesh.rest_position_W.size(), home_stiffness_N_per_m);
  }
  if (!(pre_strain > 0.0)) {
    return;
  }
  for (Spring& spring : mesh.springs) {
    spring.natural_length_m = (mesh.rest_position_W[static_cast<std::size_t>(spring.a)] -
                               mesh.rest_position_W[static_cast<std::size_t>(spring.b)])
                                  .norm() /
                              (1.0 + pre_strain);
  }
  mesh.load_W_N = vertex_forces_W(mesh, mesh.rest_position_W);
  for (std::size_t i = 0; i < mesh.load_W_N.size(); ++i) {
    mesh.load_W_N[i] *= mesh.fixed[i] == 0 ? -1.0 : 0.0;
  }
}

void append(const SpringMesh& object, SpringMesh& mesh) {
  if (mesh.rest_position_W.empty()) {
    mesh = object;
    return;
  }
  const auto first_vertex = static_cast<std::int32_t>(mesh.rest_position_W.size());
  const auto first_law = static_cast<std::int32_t>(mesh.laws.size());
  const auto join = [](auto& all, const auto& more) {
    all.insert(all.end(), more.begin(), more.end());
  };
  // An array that only one of the two meshes has is filled up with zeros for the other.
  const auto join_optional = [&](auto& all, const auto& more, const auto& zero) {
    if (all.empty() && more.empty()) {
      return;
    }
    all.resize(mesh.rest_position_W.size(), zero);
    join(all, more);
    all.resize(mesh.rest_position_W.size() + object.rest_position_W.size(), zero);
  };
  join_optional(mesh.home_stiffness_N_per_m, object.home_stiffness_N_per_m, 0.0);
  join_optional(mesh.load_W_N, object.load_W_N, Eigen::Vector3d(Eigen::Vector3d::Zero()));
  join_optional(mesh.mass_kg, object.mass_kg, 0.0);
  join_optional(mesh.drag_Ns_per_m, object.drag_Ns_per_m, 0.0);
  if (!mesh.unstrained_W.empty() || !object.unstrained_W.empty()) {
    mesh.unstrained_W = unstrained_W(mesh);
    join(mesh.unstrained_W, unstrained_W(object));
  }
  const auto first_material = static_cast<std::int32_t>(mesh.materials.size());
  join(mesh.rest_position_W, object.rest_position_W);
  join(mesh.materials, object.materials);
  join(mesh.fixed, object.fixed);
  join(mesh.laws, object.laws);
  for (Spring spring : object.springs) {
    spring.a += first_vertex;
    spring.b += first_vertex;
    spring.law += first_law;
    mesh.springs.push_back(spring);
  }
  for (Tetrahedron element : object.tetrahedra) {
    for (std::int32_t& vertex : element.vertex) {
      vertex += first_vertex;
    }
    element.material += first_material;
    mesh.tetrahedra.push_back(element);
  }
  for (const auto& [a, b, c] : object.triangles) {
    mesh.triangles.push_back({a + first_vertex, b + first_vertex, c + first_vertex});
  }
}

void check(const SpringMesh& mesh) {
  check_vertices(mesh);
  check_laws(mesh);
  check_elements(mesh);
  check_springs(mesh);
  check_triangles(mesh);
  check_balance(mesh);
}

}  // namespace forcegrid::simulator
