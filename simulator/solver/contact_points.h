// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "contact/surface_tree.h"
#include "contact/tool_shape.h"
#include "simulator/mesh/surface_points.h"
#include "simulator/solver/contact_law.h"
#include "simulator/solver/pressed_springs.h"

namespace forcegrid::simulator {

/// Which points of a surface a tool presses on, and with what force: PressedObject's contact half.
/// Positions are from the springs' origin. Real-time: no allocation after construction. Threads:
/// one.
class ContactPoints {
 public:
  ContactPoints(const SpringMesh& mesh, const PressedSprings& springs, double spacing_m,
                const ContactLaw& law);

  /// Sums over the points that bear force.
  struct Sums {
    int points = 0;
    int slipping = 0;
    int held = 0;
    Eigen::Vector3d force_W = Eigen::Vector3d::Zero();      ///< [N] on the surface
    Eigen::Matrix3d stiffness_W = Eigen::Matrix3d::Zero();  ///< [N/m] dF/dP of the tool's force F
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();       ///< [m] weighted with the forces
    double normal_N = 0.0;
    Eigen::Vector3d friction_W = Eigen::Vector3d::Zero();  ///< [N] of force_W
    double deepest_m = 0.0;
    Eigen::Vector3d torque_W_Nm = Eigen::Vector3d::Zero();  ///< on the surface, about the tool
  };

  std::size_t point_count() const noexcept { return known_.size(); }

  /// Puts the surface at rest; no point bears a force.
  void clear() noexcept;

  /// Saves the present state for restore(), and where each point is on the tool, as it is turned.
  void begin_step(const PressedSprings& springs, const contact::ToolShape& tool,
                  const Eigen::Vector3d& tool_place) noexcept;
  void restore() noexcept;

  /// Moves the surface with the springs.
  void follow(const PressedSprings& springs) noexcept;

  /// follow(), then every point's reaction to the tool at `tool_place`.
  void find(const contact::ToolShape& tool, const Eigen::Vector3d& tool_place,
            const PressedSprings& springs) noexcept;

  /// How far find()'s forces are from the known ones.
  struct Unsettled {
    double place_m = 0.0;     ///< how far a point still gives where it must not, at most
    double friction_N = 0.0;  ///< by how much slipping points' friction falls short of mu R_n
  };
  const Unsettled& unsettled() const noexcept { return unsettled_; }

  /// How far a point gives where it must not, at most, per metre that the tool moves.
  double pull_unsettled(const PressedSprings& springs) const noexcept;

  /// Makes find()'s forces the known ones; the springs' S says how they change.
  void substitute(const PressedSprings& springs) noexcept;

  /// substitute(), then forgets the points that bear no force: the step is over.
  void accept(const PressedSprings& springs) noexcept;

  const std::vector<PointLoad>& active() const noexcept { return active_; }
  bool any() const noexcept { return !active_.empty(); }
  Sums sums(const PressedSprings& springs, const Eigen::Vector3d& tool_place) const noexcept;

  /// [m] From the tool to the surface, or `margin_m`.
  double gap_m(const contact::ToolShape& tool, const Eigen::Vector3d& tool_place,
               double margin_m) const noexcept;

  /// Whether the tool would press on no point of the surface at rest, and holds none.
  bool free_at_rest(const contact::ToolShape& tool,
                    const Eigen::Vector3d& tool_place) const noexcept;

  /// See PressedObject.
  int grasp(const contact::ToolShape& tool, const Eigen::Vector3d& tool_place) noexcept;
  void let_go() noexcept;

 private:
  Eigen::Vector3d place(std::size_t point,
                        const std::vector<Eigen::Vector3d>& positions) const noexcept;
  // I - S of a point: how far it stays behind when the tool moves.
  Eigen::Matrix3d lag(const PointLoad& load, const PressedSprings& springs) const noexcept;
  void react_at(std::int32_t point, const contact::ToolShape& tool,
                const Eigen::Vector3d& tool_place) noexcept;

  SurfacePoints surface_;
  contact::SurfaceTree tree_;
  contact::SurfaceTree rest_tree_;
  ContactLaw law_;                 // with the e of the point visited last
  std::vector<double> e_N_per_m_;  // react()'s e, one per point
  std::vector<ContactPoint> known_;
  std::vector<std::uint32_t> seen_;      // number of the search that last visited a point
  std::vector<std::uint32_t> anchored_;  // number of the step in which a point got its anchor
  std::uint32_t search_ = 0;
  std::uint32_t step_ = 0;
  std::vector<std::int32_t> bearing_;  // points with a known force, or held
  std::vector<std::int32_t> saved_bearing_;
  std::vector<ContactPoint> saved_;  // of saved_bearing_
  std::vector<PointLoad> active_;
  std::vector<Eigen::Vector3d> rest_;
  std::vector<Eigen::Vector3d> positions_;
  std::vector<Eigen::Vector3d> positions_before_;  // when the step began
  Eigen::Vector3d tool_before_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rotation_before_WT_ = Eigen::Matrix3d::Identity();
  Unsettled unsettled_;
  int held_ = 0;
};

}  // namespace forcegrid::simulator
