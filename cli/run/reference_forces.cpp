// SPDX-License-Identifier: Apache-2.0
#include "cli/run/reference_forces.h"

#include "simulator/mesh/scene.h"
#include "simulator/mesh/vertex_masses.h"
#include "simulator/reference/dynamic_reference.h"
#include "simulator/solver/solver_kind.h"

namespace forcegrid::cli {
namespace {

bool object_moves(const simulator::Scene& scene, const std::string& solver) {
  const auto asked = simulator::parse_solver(solver);
  return asked ? *asked == simulator::SolverKind::kDynamic
               : simulator::dynamics_of(scene.mesh) == simulator::MeshDynamics::kDamped;
}

}  // namespace

bool moves_by_itself(const std::string& scene, const std::string& solver) {
  return object_moves(simulator::make_scene(scene), solver);
}

simulator::ReferenceSolution solve_reference_forces(const std::string& solver,
                                                    const std::vector<Eigen::Vector3d>& positions_W,
                                                    const std::vector<double>& times_s,
                                                    const simulator::ReferenceOptions& options) {
  const simulator::Scene scene = simulator::make_scene(options.scene);
  return object_moves(scene, solver)
             ? simulator::simulate_dynamic_reference(scene, positions_W, times_s, options)
             : simulator::simulate_reference(positions_W, options);
}

}  // namespace forcegrid::cli
