// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>

#include "link/surface_patch.h"
#include "simulator/mesh/scene.h"
#include "simulator/mesh/tool_options.h"
#include "simulator/touch/contact_prediction.h"
#include "simulator/touch/local_surface.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/workers/query_solver.h"

namespace forcegrid::simulator {

/// Predicts the next contact of a tool that does not touch the object yet: where it will touch if
/// it keeps its velocity, which part of the surface is near, and the forces just after the touch.
/// For a tool that sticks these are the stiffness at the touch, solved on request. For a tool that
/// slides they are the forces of a ContactPredictionThread, which starts earlier, when a touch is
/// predicted within 1 s. Real-time: no. Threads: one.
class PredictedContact {
 public:
  /// Throws Error as LocalSurface and ContactPrediction do.
  PredictedContact(const Scene& scene, const ToolOptions& tool);

  /// Updates the prediction for a tool at `position_W` [m] with the velocity `velocity_W` [m/s].
  void look(const ToolContact& contact, const Eigen::Vector3d& position_W,
            const Eigen::Vector3d& velocity_W);
  /// The same for a tool of several: `expected_touch` gives where it touches within so many
  /// seconds.
  using ExpectedTouch = std::function<std::optional<Eigen::Vector3d>(double within_s)>;
  void look(const ExpectedTouch& expected_touch, const Eigen::Vector3d& velocity_W);
  /// Starts a new run: no touch is predicted.
  void begin_anew() noexcept;

  /// [m] Where the tool will touch within 0.3 s. The point is kept until the prediction moves by
  /// more than 2 mm, since to grab another patch takes time.
  [[nodiscard]] const std::optional<Eigen::Vector3d>& expected_W() const noexcept {
    return expected_W_;
  }

  /// Whether a touch is predicted whose stiffness is still to be solved.
  [[nodiscard]] bool wants_stiffness() const noexcept;
  /// Solves for that stiffness; it is zero where the solve fails.
  /// @param answer  solves for a tool that has just touched there.
  void learn_stiffness(const std::function<StickyContact::Answer(const QueryJob&)>& answer,
                       std::uint32_t epoch);

  /// Fills `patch` with the surface near `patch.position_W_m` and the forces there.
  /// @returns false for an object without a surface.
  bool cut(link::SurfacePatch& patch);

 private:
  bool slides_;
  std::optional<LocalSurface> local_surface_;  ///< nothing: the object has no surface
  std::unique_ptr<ContactPredictionThread> contact_prediction_;
  std::optional<Eigen::Vector3d> later_touch_W_;  ///< within 1 s: to press takes time
  std::optional<Eigen::Vector3d> expected_W_;
  std::optional<Eigen::Matrix3f> stiffness_W_N_per_m_;  ///< there; nothing: not solved yet
};

}  // namespace forcegrid::simulator
