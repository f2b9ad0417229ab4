// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/greens_functions.h"

#include <utility>

#include "simulator/rivals/rest_model.h"

namespace forcegrid::simulator {

std::shared_ptr<const GreensTable> make_greens_table(const SpringMesh& mesh,
                                                     const ContactReach& reach) {
  auto table = std::make_shared<GreensTable>();
  table->nodes = make_contact_nodes(mesh, reach);
  table->compliance_m_per_N = greens_functions_m_per_N(mesh, table->nodes.vertex);
  return table;
}

GreensFunctionsMethod::GreensFunctionsMethod(std::shared_ptr<const GreensTable> table)
    : table_(std::move(table)), patch_(table_->nodes) {}

std::size_t GreensFunctionsMethod::memory_bytes() const noexcept {
  const ContactNodes& nodes = table_->nodes;
  return sizeof *this - sizeof patch_ + patch_.memory_bytes() + sizeof *table_ +
         nodes.vertex.capacity() * sizeof(std::int32_t) +
         nodes.rest_W.capacity() * sizeof(Eigen::Vector3d) +
         static_cast<std::size_t>(table_->compliance_m_per_N.size()) * sizeof(double);
}

bool GreensFunctionsMethod::hold(const Eigen::Vector3d& point_W) noexcept {
  if (!patch_.hold(table_->nodes, table_->compliance_m_per_N, point_W)) {
    return false;
  }
  stiffness_W_.setZero();
  for (std::size_t k = 0; k < 3 * patch_.patch().size(); ++k) {
    stiffness_W_.row(static_cast<Eigen::Index>(k % 3)) -= patch_.load_N_per_m(k).transpose();
  }
  return true;
}

Eigen::Vector3d GreensFunctionsMethod::response_N(
    const Eigen::Vector3d& displacement_W) const noexcept {
  return stiffness_W_ * displacement_W;
}

}  // namespace forcegrid::simulator
