// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "simulator/rivals/contact_nodes.h"
#include "simulator/rivals/model_method.h"

namespace forcegrid::simulator {

/// The object condensed to the vertices that a tool can hold.
struct CondensedTable {
  ContactNodes nodes;
  Eigen::MatrixXd stiffness_N_per_m;   ///< S = K_ss - K_si K_ii^-1 K_is
  Eigen::MatrixXd compliance_m_per_N;  ///< S^-1, explicit
};

/// Throws Error as make_contact_nodes() and condensed_stiffness_N_per_m().
std::shared_ptr<const CondensedTable> make_condensed_table(const SpringMesh& mesh,
                                                           const ContactReach& reach);

/// The object's interior condensed away: the same linear object, with the nodes of the surface as
/// its only unknowns and a dense stiffness S between them. At a contact, the patch p moves with the
/// tool and the other nodes follow without loads; the force is what the patch's rows of S give,
///
///   u = (S^-1)_sp f,   (S^-1)_pp f = 1     once per contact (RigidPatch): u_p = 1
///   F = J d,           J = -1^T S_p u      in every cycle, nine multiplications
///
/// Right where greens-functions is: both are the linear object, reached by other ways. It also has
/// the shape u of the nodes around the tool, at twice the memory. All vertices out of the tool's
/// reach are condensed, also those on the surface: no load ever acts on them.
/// Source: Bro-Nielsen and Cotin, Real-time volumetric deformable models for surgery simulation
/// using finite elements and condensation, Eurographics 1996: condensation, and the explicit
/// inverse of the condensed matrix.
/// Memory: 144 bytes times the nodes squared. Real-time: everything after construction; a contact
/// costs one product of S_p with three columns beside RigidPatch::hold().
class CondensationMethod final : public ModelMethod {
 public:
  explicit CondensationMethod(std::shared_ptr<const CondensedTable> table);

  const char* name() const noexcept override { return "condensation"; }
  /// The shared table included.
  std::size_t memory_bytes() const noexcept override;

 private:
  bool hold(const Eigen::Vector3d& point_W) noexcept override;
  [[nodiscard]] Eigen::Vector3d response_N(
      const Eigen::Vector3d& displacement_W) const noexcept override;

  std::shared_ptr<const CondensedTable> table_;
  RigidPatch patch_;
  std::vector<Eigen::Vector3d> shape_;                     // a row of u each
  Eigen::Matrix3d stiffness_W_ = Eigen::Matrix3d::Zero();  // J [N/m]
};

}  // namespace forcegrid::simulator
