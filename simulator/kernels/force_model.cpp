// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/force_model.h"

#include "simulator/kernels/element_forces.h"
#include "simulator/kernels/spring_forces.h"

namespace forcegrid::simulator {

template <typename Real>
std::vector<std::unique_ptr<ForceModel<Real>>> make_force_models(const SpringMesh& mesh) {
  std::vector<std::unique_ptr<ForceModel<Real>>> models;
  if (!mesh.springs.empty()) {
    models.push_back(std::make_unique<SpringForces<Real>>(mesh));
  }
  if (!mesh.tetrahedra.empty()) {
    models.push_back(std::make_unique<ElementForces<Real>>(mesh));
  }
  return models;
}

template std::vector<std::unique_ptr<ForceModel<float>>> make_force_models(const SpringMesh&);
template std::vector<std::unique_ptr<ForceModel<double>>> make_force_models(const SpringMesh&);

}  // namespace forcegrid::simulator
