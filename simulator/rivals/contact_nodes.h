// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// Which contacts are prepared for.
struct ContactReach {
  double patch_radius_m = 0.012;  ///< of the tool's grip; > 0
  /// [m] The tool touches within this distance of SpringMesh::top_W; > 0. Infinity: anywhere, with
  /// tables for the whole object.
  double reach_m = 0.010;
};

/// Most nodes of a table: 3,000 squared, times nine and eight bytes, are 650 MB.
inline constexpr std::size_t kMostContactNodes = 3'000;

/// The vertices that a tool can hold: the free ones within reach and patch radius of the top, those
/// below the surface included, because the patch is a ball.
struct ContactNodes {
  std::vector<std::int32_t> vertex;     ///< in the mesh's numbering
  std::vector<Eigen::Vector3d> rest_W;  ///< [m] of each
  Eigen::Vector3d top_W = Eigen::Vector3d::Zero();
  ContactReach reach;
  /// No patch has more: all of it lies within twice the patch radius of each of its nodes.
  std::size_t most_in_patch = 0;
};

/// Throws Error for a mesh that check() refuses, a reach out of range, no node, or more than
/// kMostContactNodes.
ContactNodes make_contact_nodes(const SpringMesh& mesh, const ContactReach& reach);

/// The loads that move a patch rigidly while every other node is free of loads: the capacitance
/// problem of a contact. With G the compliance of the nodes and p those in the patch,
///
///   f = G_pp^-1 1     [N/m] three columns, one per axis of the displacement
///
/// by Cholesky's method in place: some 200,000 multiplications for a patch of 36.
/// Source: James and Pai (2001), section on the capacitance matrix.
/// Real-time: hold() neither allocates nor throws; bounded by ContactNodes::most_in_patch cubed.
class RigidPatch {
 public:
  explicit RigidPatch(const ContactNodes& nodes);

  /// @param nodes  those of the constructor. @param compliance_m_per_N  three rows and columns
  /// each.
  /// @returns false if `point_W` [m] is out of reach, no node is near it, or G_pp is not positive
  ///          definite.
  bool hold(const ContactNodes& nodes, const Eigen::MatrixXd& compliance_m_per_N,
            const Eigen::Vector3d& point_W) noexcept;

  /// Indices into ContactNodes::vertex.
  std::span<const std::int32_t> patch() const noexcept { return {patch_.data(), count_}; }
  /// f on unknown `k` of the patch, of 3 patch().size().
  Eigen::Vector3d load_N_per_m(std::size_t k) const noexcept { return load_[k]; }
  std::size_t memory_bytes() const noexcept;

 private:
  double& factor(std::size_t row, std::size_t column) noexcept {
    return factor_[row * (row + 1) / 2 + column];
  }
  bool factorise(const Eigen::MatrixXd& compliance_m_per_N) noexcept;
  void solve() noexcept;

  std::vector<std::int32_t> patch_;
  std::size_t count_ = 0;
  std::vector<double> factor_;         // the lower triangle, row by row
  std::vector<Eigen::Vector3d> load_;  // a row of f each
};

}  // namespace forcegrid::simulator
