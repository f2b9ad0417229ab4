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

/// What a tool that slides will feel when it has touched and gone on.
struct PressForces {
  Eigen::Vector3d touch_W = Eigen::Vector3d::Zero();  ///< [m] of the tool
  /// How far it goes from there for each metre of depth: -1 along the outward normal, and what it
  /// goes along the surface.
  Eigen::Vector3d course_W = Eigen::Vector3d::Zero();
  /// [N] on the tool, 1 and 2 link::SurfacePatch::kPressDepth_m deep along the outward normal.
  std::array<Eigen::Vector3d, link::SurfacePatch::kPresses> force_W{};
};

/// Presses a copy of an object at rest where a tool will touch, before it is there: a tool that
/// slides has no stiffness when it touches, and what it feels until the simulator's first answer
/// has to be known by then. Friction is in it as far as the tool goes straight on.
///
/// The copy is solved to kTolerance, as the force is needed for a moment only. Real-time: no.
/// Threads: one.
class ContactPrediction {
 public:
  static constexpr double kTolerance = 1e-2;  ///< PressOptions::relative_tolerance
  /// [m] PressOptions::max_step_m: from rest, with friction, longer ones do not always converge.
  static constexpr double kStep_m = 0.5e-3;
  /// A tool that touches flatter than with so much way along the surface for each metre of depth is
  /// pressed on as if with so much.
  static constexpr double kMaxSlope = 2.0;

  /// Throws Error as PressedObject does.
  ContactPrediction(const SpringMesh& mesh, const contact::ToolShape& tool, PressOptions options);

  /// @param touch_W  [m] where the tool will be when it touches.
  /// @param velocity_W  [m/s] with which it goes on; only its direction counts.
  /// @returns nothing where there is no surface, or where the tool is not pushed back, and farther
  /// in the more, or not to be solved.
  std::optional<PressForces> press(const Eigen::Vector3d& touch_W,
                                   const Eigen::Vector3d& velocity_W) noexcept;

  /// See PressForces::course_W; nothing away from the surface.
  std::optional<Eigen::Vector3d> course_W(const Eigen::Vector3d& touch_W,
                                          const Eigen::Vector3d& velocity_W) const noexcept;

 private:
  contact::SurfaceTree surface_;
  PressedObject object_;
};

/// The same on a thread of its own at a low priority (nice 15), so that no answer waits for it: it
/// takes the time that few others want. Threads: one, beside its own.
class ContactPredictionThread {
 public:
  /// Throws Error as ContactPrediction does.
  ContactPredictionThread(const SpringMesh& mesh, const contact::ToolShape& tool,
                          const PressOptions& options);
  /// Waits for what is being pressed.
  ~ContactPredictionThread();
  ContactPredictionThread(const ContactPredictionThread&) = delete;
  ContactPredictionThread& operator=(const ContactPredictionThread&) = delete;

  /// A touch is expected: it will be pressed unless something is being pressed already, or the last
  /// was within kSamePlace_m of it and kSameCourse of its course. Does not wait.
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
  // Belong to whose turn it is.
  Eigen::Vector3d touch_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_W_ = Eigen::Vector3d::Zero();
  std::optional<PressForces> found_;
  bool fresh_ = false;
  // The owner's.
  std::optional<PressForces> newest_;
  std::optional<Eigen::Vector3d> pressed_at_W_;
  Eigen::Vector3d pressed_course_W_ = Eigen::Vector3d::Zero();
  std::atomic<Turn> turn_{Turn::kOwner};
  std::jthread thread_;
};

}  // namespace forcegrid::simulator
