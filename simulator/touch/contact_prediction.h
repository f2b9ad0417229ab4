// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <optional>
#include <thread>

#include "contact/surface_tree.h"
#include "contact/tool_shape.h"
#include "link/surface_patch.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/pressed_object.h"

namespace forcegrid::simulator {

/// Predicted forces on a tool that slides, just after it touches.
struct PressForces {
  Eigen::Vector3d touch_W = Eigen::Vector3d::Zero();  ///< [m] of the tool
  /// Direction of travel per metre of depth: -1 along the outward normal, plus the tangential part.
  Eigen::Vector3d course_W = Eigen::Vector3d::Zero();
  /// [N] on the tool, 1 and 2 link::SurfacePatch::kPressDepth_m deep along the outward normal.
  std::array<Eigen::Vector3d, link::SurfacePatch::kPresses> force_W{};
};

/// Predicts the forces on a sliding tool just after it touches, by pressing the tool into a copy of
/// the object at rest. The servo needs them before the simulator's first answer, since a tool that
/// slides has no stiffness at the touch. Friction is included as if the tool kept its direction.
///
/// The copy is solved to kTolerance only, since the forces are needed for a moment.
/// Real-time: no. Threads: one.
class ContactPrediction {
 public:
  static constexpr double kTolerance = 1e-2;  ///< PressOptions::relative_tolerance
  /// [m] PressOptions::max_step_m: from rest, with friction, longer ones do not always converge.
  static constexpr double kStep_m = 0.5e-3;
  /// Approach angles shallower than this ratio of tangential to normal travel are clamped to it.
  static constexpr double kMaxSlope = 2.0;

  /// Throws Error as PressedObject does.
  ContactPrediction(const SpringMesh& mesh, const contact::ToolShape& tool, PressOptions options);

  /// @param touch_W  [m] the tool's position at the touch.
  /// @param velocity_W  [m/s] of the tool; only its direction counts.
  /// @returns nothing if there is no surface there, if the force does not increase with depth, or
  ///   if the solve fails.
  std::optional<PressForces> press(const Eigen::Vector3d& touch_W,
                                   const Eigen::Vector3d& velocity_W) noexcept;

  /// See PressForces::course_W; nothing away from the surface.
  std::optional<Eigen::Vector3d> course_W(const Eigen::Vector3d& touch_W,
                                          const Eigen::Vector3d& velocity_W) const noexcept;

 private:
  contact::SurfaceTree surface_;
  PressedObject object_;
};

/// Runs a ContactPrediction on a separate thread of low priority (nice 15), so that no answer waits
/// for it. Threads: one owner, beside the thread that it starts.
class ContactPredictionThread {
 public:
  /// Throws Error as ContactPrediction does.
  ContactPredictionThread(const SpringMesh& mesh, const contact::ToolShape& tool,
                          const PressOptions& options);
  /// Waits until a prediction in progress has ended.
  ~ContactPredictionThread();
  ContactPredictionThread(const ContactPredictionThread&) = delete;
  ContactPredictionThread& operator=(const ContactPredictionThread&) = delete;

  /// Starts a prediction for this touch, unless one is in progress or the last one was for a touch
  /// within kSamePlace_m and a direction within kSameCourse. Does not wait.
  void expect(const Eigen::Vector3d& touch_W, const Eigen::Vector3d& velocity_W) noexcept;

  /// The newest forces, if they are of a touch within kUsable_m [m] of this one. Does not wait.
  std::optional<PressForces> near(const Eigen::Vector3d& touch_W) noexcept;

  static constexpr double kSamePlace_m = 1e-3;
  static constexpr double kSameCourse = 0.2;
  static constexpr double kUsable_m = 5e-3;

 private:
  enum class Turn { kOwner, kPress, kQuit };

  void run() noexcept;
  void take() noexcept;

  ContactPrediction press_;
  // Belong to the thread whose turn it is.
  Eigen::Vector3d touch_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_W_ = Eigen::Vector3d::Zero();
  std::optional<PressForces> found_;
  bool fresh_ = false;
  // Belong to the owner.
  std::optional<PressForces> newest_;
  std::optional<Eigen::Vector3d> pressed_at_W_;
  Eigen::Vector3d pressed_course_W_ = Eigen::Vector3d::Zero();
  std::atomic<Turn> turn_{Turn::kOwner};
  std::jthread thread_;
};

}  // namespace forcegrid::simulator
