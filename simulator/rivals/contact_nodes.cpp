// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/contact_nodes.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/rivals/rest_model.h"

namespace forcegrid::simulator {

using Eigen::Vector3d;

ContactNodes make_contact_nodes(const SpringMesh& mesh, const ContactReach& reach) {
  check(mesh);
  check_positive(reach.patch_radius_m, "contact nodes: patch_radius_m");
  if (!(reach.reach_m > 0.0)) {
    throw Error("contact nodes: reach_m is " + std::to_string(reach.reach_m) + "; it must be > 0");
  }
  ContactNodes nodes;
  nodes.top_W = mesh.top_W;
  nodes.reach = reach;
  nodes.vertex = vertices_within(mesh, mesh.top_W, reach.reach_m + reach.patch_radius_m);
  if (nodes.vertex.empty()) {
    throw Error("contact nodes: no free vertex within " +
                std::to_string(reach.reach_m + reach.patch_radius_m) +
                " m of the object's top; use a larger grip or reach");
  }
  if (nodes.vertex.size() > kMostContactNodes) {
    throw Error("contact nodes: a tool can hold " + std::to_string(nodes.vertex.size()) +
                " vertices, and tables grow with their square; use a smaller reach_m, for at "
                "most " +
                std::to_string(kMostContactNodes));
  }
  for (const std::int32_t vertex : nodes.vertex) {
    nodes.rest_W.push_back(mesh.rest_position_W[static_cast<std::size_t>(vertex)]);
  }
  std::size_t most = 0;
  for (const Vector3d& centre_W : nodes.rest_W) {
    const auto near =
        std::count_if(nodes.rest_W.begin(), nodes.rest_W.end(), [&](const Vector3d& other_W) {
          return (other_W - centre_W).norm() <= 2.0 * reach.patch_radius_m;
        });
    most = std::max(most, static_cast<std::size_t>(near));
  }
  nodes.most_in_patch = most;
  return nodes;
}

RigidPatch::RigidPatch(const ContactNodes& nodes) {
  const std::size_t unknowns = 3 * nodes.most_in_patch;
  patch_.resize(nodes.most_in_patch);
  load_.resize(unknowns);
  factor_.resize(unknowns * (unknowns + 1) / 2);
}

std::size_t RigidPatch::memory_bytes() const noexcept {
  return sizeof *this + patch_.capacity() * sizeof(std::int32_t) +
         factor_.capacity() * sizeof(double) + load_.capacity() * sizeof(Vector3d);
}

bool RigidPatch::hold(const ContactNodes& nodes, const Eigen::MatrixXd& compliance_m_per_N,
                      const Vector3d& point_W) noexcept {
  count_ = 0;
  if (!((point_W - nodes.top_W).norm() <= nodes.reach.reach_m)) {
    return false;
  }
  for (std::size_t i = 0; i < nodes.rest_W.size(); ++i) {
    if ((nodes.rest_W[i] - point_W).norm() <= nodes.reach.patch_radius_m) {
      if (count_ == patch_.size()) {
        count_ = 0;
        return false;
      }
      patch_[count_++] = static_cast<std::int32_t>(i);
    }
  }
  if (count_ == 0 || !factorise(compliance_m_per_N)) {
    count_ = 0;
    return false;
  }
  solve();
  return true;
}

// G_pp = C C^T, C over G_pp's lower triangle.
bool RigidPatch::factorise(const Eigen::MatrixXd& compliance_m_per_N) noexcept {
  const std::size_t unknowns = 3 * count_;
  const auto column_of = [this](std::size_t k) {
    return static_cast<Eigen::Index>(3 * static_cast<std::size_t>(patch_[k / 3]) + k % 3);
  };
  for (std::size_t i = 0; i < unknowns; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = compliance_m_per_N(column_of(i), column_of(j));
      for (std::size_t k = 0; k < j; ++k) {
        sum -= factor(i, k) * factor(j, k);
      }
      if (i > j) {
        factor(i, j) = sum / factor(j, j);
      } else if (sum > 0.0) {
        factor(i, i) = std::sqrt(sum);
      } else {
        return false;
      }
    }
  }
  return true;
}

void RigidPatch::solve() noexcept {
  const std::size_t unknowns = 3 * count_;
  for (std::size_t i = 0; i < unknowns; ++i) {
    Vector3d row = Vector3d::Unit(static_cast<Eigen::Index>(i % 3));
    for (std::size_t k = 0; k < i; ++k) {
      row -= factor(i, k) * load_[k];
    }
    load_[i] = row / factor(i, i);
  }
  for (std::size_t i = unknowns; i-- > 0;) {
    Vector3d row = load_[i];
    for (std::size_t k = i + 1; k < unknowns; ++k) {
      row -= factor(k, i) * load_[k];
    }
    load_[i] = row / factor(i, i);
  }
}

}  // namespace forcegrid::simulator
