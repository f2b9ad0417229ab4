#pragma once

#include <Eigen/Core>
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
  /// [m] A tool that moves down touches this far above the surface already; >= 0.
  double approach_distance_m = 0.2e-3;
  /// The tool's shape, by which it touches; nothing: a point. What it then holds is in either case
  /// what lies around its tip.
  std::optional<contact::ToolShape> tool;
};

/// When the tool touches the object, and what that is worth: it sticks. From the touch on, the
/// patch around the contact point moves rigidly with the tool, relative to the tool's position at
/// that moment, so that the force starts at zero.
///
/// A point touches when it is inside the object's surface at rest (SpringMesh::triangles), or up
/// to approach_distance_m above it and lower than at the position before; and when a free vertex
/// lies within patch_radius_m of it; a tool with a shape when that overlaps the surface, or is as
/// near to it and as much lower. The contact holds until release(). A tool that is first seen
/// inside the object must leave it before it can touch: it never came through the surface.
///
/// Objects are an ElasticObject, a TwoRatesObject, a ReducedObject or, where time counts, a
/// TimeSteppedObject. Threads: one.
class StickyContact {
 public:
  /// Throws Error for options out of range.
  explicit StickyContact(const SpringMesh& mesh, const ContactOptions& options = {});

  /// What the object does to a tool at one position.
  struct Answer {
    bool in_contact = false;
    std::uint32_t epoch = 0;  ///< 0 before any contact; +1 at every discontinuity
    /// [m] The tool's position when it touched; its present position before any contact.
    Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
    /// [m] Where force and stiffness were computed: the tool's position unless the move was longer
    /// than the solver's bound (Equilibrium::reached).
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
    Equilibrium equilibrium;      ///< zero force without contact
    bool stiffness_known = true;  ///< Equilibrium::stiffness_W is dF/dP
  };

  /// Moves the tool to `position_W` [m], touching `object` if the rule above says so.
  /// `object` must be the one of all calls since the last reset(). A position that is not finite
  /// answers as the last one did, with converged and reached false.
  /// Allocates when contact is made, otherwise not.
  template <typename Object>
  Answer step(Object& object, const Eigen::Vector3d& position_W);

  /// Lets go, a new epoch. The tool must leave the surface before it can touch again.
  template <typename Object>
  void release(Object& object) noexcept;

  /// A new run: no contact, epoch 0, the object let go of: what has no motion is then at rest.
  template <typename Object>
  void reset(Object& object) noexcept;

  /// Where a tool in the air at `position_W` [m] that goes straight on with `velocity_W` [m/s]
  /// would touch within `within_s`; nothing if it would not, or the contact holds already.
  std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept;

  bool in_contact() const noexcept { return in_contact_; }
  const ContactOptions& options() const noexcept { return options_; }

 private:
  bool at_surface(const Eigen::Vector3d& position_W) const noexcept;

  ContactOptions options_;
  RestSurface surface_;
  std::optional<contact::SurfaceTree> tree_;  ///< with a tool that has a shape
  std::optional<Eigen::Vector3d> last_position_W_;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  std::uint32_t epoch_ = 0;
  bool in_contact_ = false;
  bool must_leave_first_ = false;
};

}  // namespace forcegrid::simulator
