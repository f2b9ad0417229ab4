// SPDX-License-Identifier: Apache-2.0
#include "cli/run/reference_forces.h"

#include "simulator/mesh/scene.h"
#include "simulator/mesh/vertex_masses.h"
#include "simulator/reference/dynamic_reference.h"

namespace forcegrid::cli {
namespace {

bool moves_by_itself(const simulator::Scene& scene, const std::string& solver) {
  return solver == "dynamic" || (solver == "auto" && simulator::dynamics_of(scene.mesh) ==
                                                         simulator::MeshDynamics::kDamped);
}

}  // namespace

bool moves_by_itself(const std::string& scene, const std::string& solver) {
  return moves_by_itself(simulator::make_scene(scene), solver);
}

simulator::ReferenceSolution solve_reference_forces(const std::string& solver,
                                                    const std::vector<Eigen::Vector3d>& positions_W,
                                                    const std::vector<double>& times_s,
                                                    const simulator::ReferenceOptions& options) {
  const simulator::Scene scene = simulator::make_scene(options.scene);
  return moves_by_itself(scene, solver)
             ? simulator::simulate_dynamic_reference(scene, positions_W, times_s, options)
             : simulator::simulate_reference(positions_W, options);
}

}  // namespace forcegrid::cli
