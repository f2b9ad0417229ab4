// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/vertex_masses.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/mesh/tetrahedra.h"
#include "text/text.h"

namespace forcegrid::simulator {

std::vector<double> vertex_masses_kg(const SpringMesh& mesh, double mass_kg) {
  if (!mesh.tetrahedra.empty()) {
    std::vector<double> masses_kg = element_masses_kg(mesh);
    const double sum_kg = std::accumulate(masses_kg.begin(), masses_kg.end(), 0.0);
    for (double& each : masses_kg) {
      each *= mass_kg / sum_kg;
    }
    return masses_kg;
  }
  std::vector<double> share(mesh.rest_position_W.size(), 0.0);
  double sum = 0.0;
  for (const Spring& spring : mesh.springs) {
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    const double length_m = (mesh.rest_position_W[a] - mesh.rest_position_W[b]).norm();
    share[a] += 0.5 * length_m;
    share[b] += 0.5 * length_m;
    sum += length_m;
  }
  for (double& each : share) {
    each *= mass_kg / sum;
  }
  return share;
}

void give_dynamics(SpringMesh& mesh, const ObjectDynamics& dynamics) {
  const auto require = [](bool fine, const char* name, double value, const char* range) {
    if (!fine || !std::isfinite(value)) {
      throw Error(std::string("dynamics: ") + name + " is " + text::number_text(value) +
                  "; it must be finite and " + range);
    }
  };
  require(dynamics.mass_kg > 0.0, "mass_kg", dynamics.mass_kg, "> 0");
  require(dynamics.retardation_time_s >= 0.0, "retardation_time_s", dynamics.retardation_time_s,
          ">= 0");
  require(dynamics.mass_damping_per_s >= 0.0, "mass_damping_per_s", dynamics.mass_damping_per_s,
          ">= 0");
  mesh.mass_kg = vertex_masses_kg(mesh, dynamics.mass_kg);
  for (SpringLaw& law : mesh.laws) {
    law.retardation_time_s = dynamics.retardation_time_s;
  }
  for (ElementMaterial& material : mesh.materials) {
    material.retardation_time_s = dynamics.retardation_time_s;
  }
  mesh.drag_Ns_per_m.assign(mesh.mass_kg.size(), 0.0);
  for (std::size_t i = 0; i < mesh.mass_kg.size(); ++i) {
    mesh.drag_Ns_per_m[i] = dynamics.mass_damping_per_s * mesh.mass_kg[i];
    if (!mesh.home_stiffness_N_per_m.empty()) {
      mesh.drag_Ns_per_m[i] += dynamics.retardation_time_s * mesh.home_stiffness_N_per_m[i];
    }
  }
}

MeshDynamics dynamics_of(const SpringMesh& mesh) noexcept {
  if (mesh.mass_kg.empty()) {
    return MeshDynamics::kNone;
  }
  const bool damped =
      std::any_of(mesh.laws.begin(), mesh.laws.end(),
                  [](const SpringLaw& law) { return law.retardation_time_s > 0.0; }) ||
      std::any_of(
          mesh.materials.begin(), mesh.materials.end(),
          [](const ElementMaterial& material) { return material.retardation_time_s > 0.0; }) ||
      std::any_of(mesh.drag_Ns_per_m.begin(), mesh.drag_Ns_per_m.end(),
                  [](double drag) { return drag > 0.0; });
  return damped ? MeshDynamics::kDamped : MeshDynamics::kMasses;
}

}  // namespace forcegrid::simulator
