// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/condensation.h"

#include <Eigen/Cholesky>
#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/rivals/rest_model.h"

namespace forcegrid::simulator {

using Eigen::Index;
using Eigen::Vector3d;

std::shared_ptr<const CondensedTable> make_condensed_table(const SpringMesh& mesh,
                                                           const ContactReach& reach) {
  auto table = std::make_shared<CondensedTable>();
  table->nodes = make_contact_nodes(mesh, reach);
  table->stiffness_N_per_m = condensed_stiffness_N_per_m(mesh, table->nodes.vertex);
  const Index unknowns = table->stiffness_N_per_m.rows();
  const Eigen::LLT<Eigen::MatrixXd> factor(table->stiffness_N_per_m);
  table->compliance_m_per_N = factor.solve(Eigen::MatrixXd::Identity(unknowns, unknowns));
  if (factor.info() != Eigen::Success || !table->compliance_m_per_N.allFinite()) {
    throw Error(
        "condensation: the condensed stiffness is not positive definite, so the rest shape is no "
        "stable equilibrium; fix more vertices or give the object home springs");
  }
  return table;
}

CondensationMethod::CondensationMethod(std::shared_ptr<const CondensedTable> table)
    : table_(std::move(table)), patch_(table_->nodes) {
  shape_.resize(static_cast<std::size_t>(table_->stiffness_N_per_m.rows()));
}

std::size_t CondensationMethod::memory_bytes() const noexcept {
  const ContactNodes& nodes = table_->nodes;
  return sizeof *this - sizeof patch_ + patch_.memory_bytes() + sizeof *table_ +
         nodes.vertex.capacity() * sizeof(std::int32_t) +
         nodes.rest_W.capacity() * sizeof(Vector3d) + shape_.capacity() * sizeof(Vector3d) +
         2 * static_cast<std::size_t>(table_->stiffness_N_per_m.size()) * sizeof(double);
}

bool CondensationMethod::hold(const Vector3d& point_W) noexcept {
  const Eigen::MatrixXd& compliance_m_per_N = table_->compliance_m_per_N;
  const Eigen::MatrixXd& surface_N_per_m = table_->stiffness_N_per_m;
  if (!patch_.hold(table_->nodes, compliance_m_per_N, point_W)) {
    return false;
  }
  const auto unknown = [this](std::size_t k) {
    return 3 * static_cast<Index>(patch_.patch()[k / 3]) + static_cast<Index>(k % 3);
  };
  const std::size_t unknowns = 3 * patch_.patch().size();
  for (std::size_t i = 0; i < shape_.size(); ++i) {
    shape_[i].setZero();
    for (std::size_t k = 0; k < unknowns; ++k) {
      shape_[i] += compliance_m_per_N(unknown(k), static_cast<Index>(i)) * patch_.load_N_per_m(k);
    }
  }
  stiffness_W_.setZero();
  for (std::size_t k = 0; k < unknowns; ++k) {
    Vector3d force_N_per_m = Vector3d::Zero();
    for (std::size_t i = 0; i < shape_.size(); ++i) {
      force_N_per_m += surface_N_per_m(static_cast<Index>(i), unknown(k)) * shape_[i];
    }
    stiffness_W_.row(static_cast<Index>(k % 3)) -= force_N_per_m.transpose();
  }
  return true;
}

Vector3d CondensationMethod::response_N(const Vector3d& displacement_W) const noexcept {
  return stiffness_W_ * displacement_W;
}

}  // namespace forcegrid::simulator
