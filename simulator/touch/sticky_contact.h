// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>

#include "contact/surface_tree.h"
#include "contact/tool_shape.h"
#include "simulator/mesh/rest_surface.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

struct ContactOptions {
  /// [m] Vertices within this distance of the contact point are held; > 0.
  double patch_radius_m = 0.012;
  /// [m] A tool that moves down touches when it is this far above the surface; >= 0.
  double approach_distance_m = 0.2e-3;
  /// The tool's shape, which decides when it touches; nothing: a point. In either case the tool
  /// holds the vertices around its tip.
  std::optional<contact::ToolShape> tool;
};

/// Decides when the tool touches the object; from then on it sticks. The patch around the contact
/// point moves rigidly with the tool, relative to the tool's position at the touch, so that the
/// force starts at zero.
///
/// A point touches when it is inside the object's surface at rest (SpringMesh::triangles), or at
/// most approach_distance_m above it and lower than at the position before; and when a free vertex
/// lies within patch_radius_m. A tool with a shape touches when it overlaps the surface, or is as
/// near to it and moving down. The contact holds until release(). A tool whose first position is
/// inside the object must leave it before it can touch.
///
/// step(), release() and reset() take an ElasticObject, a TwoRatesObject, a ReducedObject, a
/// TimeSteppedObject or a tool's share of a SharedObject; the source of each one's contact
/// instantiates them (sticky_contact_steps.h). Threads: one.
class StickyContact {
 public:
  /// Throws Error for options out of range.
  explicit StickyContact(const SpringMesh& mesh, const ContactOptions& options = {});

  /// The object's reaction to the tool at one position.
  struct Answer {
    bool in_contact = false;
    std::uint32_t epoch = 0;  ///< 0 before any contact; +1 at every discontinuity
    /// [m] The tool's position when it touched; its present position before any contact.
    Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
    /// [m] Where force and stiffness were computed: the tool's position unless the move was longer
    /// than the solver's bound (Equilibrium::reached).
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
    /// For which Equilibrium::torque_W_Nm was computed.
    Eigen::Quaterniond orientation_WT = Eigen::Quaterniond::Identity();
    Equilibrium equilibrium;      ///< zero force without contact
    bool stiffness_known = true;  ///< Equilibrium::stiffness_W is dF/dP
  };

  /// Moves the tool to `position_W` [m] and touches `object` if the rule above holds. `object` must
  /// be the same one in all calls since the last reset(). For a position that is not finite the
  /// last answer is repeated, with converged and reached false. Allocates only when contact is
  /// made.
  template <typename Object>
  Answer step(Object& object, const Eigen::Vector3d& position_W);

  /// Sets the tool's orientation for the next step(). The patch turns with an object that turns
  /// (ElasticObject::turn()); a tool with a shape touches as it is turned. One that is not finite
  /// is ignored.
  void turn_to(const Eigen::Quaterniond& orientation_WT) noexcept;

  /// Lets go and begins a new epoch. The tool must leave the surface before it can touch again.
  template <typename Object>
  void release(Object& object) noexcept;

  /// Starts a new run: no contact, epoch 0, the object released. An object without dynamics is then
  /// at rest.
  template <typename Object>
  void reset(Object& object) noexcept;

  /// [m] Where a tool at `position_W` [m] with the constant velocity `velocity_W` [m/s] touches
  /// within `within_s`; nothing if it does not, or is in contact.
  std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept;

  /// The tool's orientation when it has turned by `turn_W` since it touched.
  Eigen::Quaterniond turned_WT(const Eigen::Quaterniond& turn_W) const noexcept {
    return turn_W * touched_WT_;
  }

  bool in_contact() const noexcept { return in_contact_; }
  /// Of the last answer.
  std::uint32_t epoch() const noexcept { return epoch_; }
  const ContactOptions& options() const noexcept { return options_; }

 private:
  bool at_surface(const Eigen::Vector3d& position_W) const noexcept;
  template <typename Object>
  Equilibrium move(Object& object, const Eigen::Vector3d& position_W) const;

  ContactOptions options_;
  RestSurface surface_;
  std::optional<contact::SurfaceTree> tree_;  ///< with a tool that has a shape
  std::optional<Eigen::Vector3d> last_position_W_;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  Eigen::Quaterniond orientation_WT_ = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond touched_WT_ = Eigen::Quaterniond::Identity();  ///< when it touched
  std::uint32_t epoch_ = 0;
  bool in_contact_ = false;
  bool must_leave_first_ = false;
};

}  // namespace forcegrid::simulator
