// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>

#include "simulator/rivals/contact_nodes.h"
#include "simulator/rivals/model_method.h"

namespace forcegrid::simulator {

/// Green's functions of the vertices that a tool can hold.
struct GreensTable {
  ContactNodes nodes;
  Eigen::MatrixXd compliance_m_per_N;  ///< G, three rows and columns per node
};

/// Throws Error as make_contact_nodes() and greens_functions_m_per_N().
std::shared_ptr<const GreensTable> make_greens_table(const SpringMesh& mesh,
                                                     const ContactReach& reach);

/// Green's functions of the linear elastostatic object. The boundary at rest is free of loads; a
/// contact changes the condition of the few nodes p that it holds from "no load" to "moves with the
/// tool", a low-rank update of the boundary value problem:
///
///   1^T f d = -F,   G_pp f = 1      once per contact (RigidPatch)
///   F = J d,        J = -1^T f      in every cycle, nine multiplications
///
/// The force of the object with its tangent stiffness at rest, exactly. Right for small
/// displacements of any object and for linear ones; a hardening spring or a large turn of the
/// object's parts is not in it. The contact may be anywhere within the reach.
/// Source: James and Pai, A unified treatment of elastostatic contact simulation for real time
/// haptics, Haptics-e 2(1), 2001.
/// Memory: 72 bytes times the nodes squared. Real-time: everything after construction.
class GreensFunctionsMethod final : public ModelMethod {
 public:
  explicit GreensFunctionsMethod(std::shared_ptr<const GreensTable> table);

  const char* name() const noexcept override { return "greens-functions"; }
  /// The shared table included.
  std::size_t memory_bytes() const noexcept override;

 private:
  bool hold(const Eigen::Vector3d& point_W) noexcept override;
  [[nodiscard]] Eigen::Vector3d response_N(
      const Eigen::Vector3d& displacement_W) const noexcept override;

  std::shared_ptr<const GreensTable> table_;
  RigidPatch patch_;
  Eigen::Matrix3d stiffness_W_ = Eigen::Matrix3d::Zero();  // J [N/m]
};

}  // namespace forcegrid::simulator
