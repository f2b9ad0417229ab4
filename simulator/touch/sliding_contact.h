// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "simulator/mesh/rest_surface.h"
#include "simulator/solver/pressed_object.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::simulator {

struct SlidingOptions {
  PressOptions press;
  double grasp_N = 0.3;  ///< see ToolOptions
  double let_go_N = 1.0;
  bool turns = false;  ///< by turn_to(); answers then have a torque
};

/// A tool that presses and slides (PressedObject). A new epoch begins when the tool touches,
/// leaves, grasps or lets go, and when the object snaps into another shape. A change between
/// sticking and slipping begins none, since the force is continuous. Answer::point_W is the tool's
/// position at the touch, where the force is zero.
///
/// A grasper closes when the surface presses it with SlidingOptions::grasp_N along its axis, T's z,
/// and opens when it is pulled down with let_go_N. It must then leave the surface before it can
/// close again. A tool whose first position is inside the object must leave it before it can touch.
/// Threads: one.
class SlidingContact final : public ToolContact {
 public:
  /// Throws Error as PressedObject does.
  SlidingContact(const SpringMesh& mesh, const contact::ToolShape& tool,
                 const SlidingOptions& options);

  void turn_to(const Eigen::Quaterniond& orientation_WT) noexcept override;
  Answer step(const Eigen::Vector3d& position_W) override;
  void reset() noexcept override;
  bool in_contact() const noexcept override { return in_contact_; }
  std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept override;
  bool depends_on_position_alone() const noexcept override { return false; }
  SolverReport report() const noexcept override { return {}; }
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) override {
    object_.copy_positions(vertices, position_W);
  }
  std::size_t vertex_count() const noexcept override { return object_.vertex_count(); }
  std::size_t spring_count() const noexcept override { return object_.spring_count(); }

  /// The result of the last step, with more detail than Answer.
  const Pressed& pressed() const noexcept { return pressed_; }

 private:
  bool overlaps(const Eigen::Vector3d& position_W) const noexcept;
  std::optional<Eigen::Vector3d> touch_along(const Eigen::Vector3d& from_W,
                                             const Eigen::Vector3d& path_W) const noexcept;
  void press(const Eigen::Vector3d& position_W);
  void work_jaws() noexcept;

  PressedObject object_;
  SlidingOptions options_;
  RestSurface surface_;
  Pressed pressed_;
  std::optional<Eigen::Vector3d> last_position_W_;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  Eigen::Quaterniond orientation_WT_ = Eigen::Quaterniond::Identity();
  std::uint32_t epoch_ = 0;
  bool in_contact_ = false;
  bool must_leave_first_ = false;
  bool holding_ = false;
  bool has_let_go_ = false;
};

}  // namespace forcegrid::simulator
