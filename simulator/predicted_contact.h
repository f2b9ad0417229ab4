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

/// What a simulator can say about a tool in the air: where it will touch if it goes straight on,
/// what of the surface is near, and what it will feel just after the touch. Of a tool that sticks
/// that is the stiffness there, solved for when asked; of one that slides the forces of a
/// ContactPredictionThread, which begins earlier: where the tool will touch within 1 s. Real-time:
/// no. Threads: one.
class PredictedContact {
 public:
  /// Throws Error as LocalSurface and ContactPrediction do.
  PredictedContact(const Scene& scene, const ToolOptions& tool);

  /// The tool is at `position_W` [m] and goes on with `velocity_W` [m/s].
  void look(const ToolContact& contact, const Eigen::Vector3d& position_W,
            const Eigen::Vector3d& velocity_W);
  /// A new run: nothing is expected.
  void begin_anew() noexcept;

  /// Where the tool will touch soon. The place of a tool that sticks stays until it has moved by
  /// more than 2 mm, since taking hold of another patch takes a while.
  [[nodiscard]] const std::optional<Eigen::Vector3d>& expected_W() const noexcept {
    return expected_W_;
  }

  /// A touch is expected whose stiffness is to be solved for and is not yet.
  [[nodiscard]] bool wants_stiffness() const noexcept;
  /// @param answer  solves for a tool that has just touched there. What can't be sent is none.
  void learn_stiffness(const std::function<StickyContact::Answer(const QueryJob&)>& answer,
                       std::uint32_t epoch);

  /// Fills in what is near `patch.position_W_m` and what is felt there.
  /// @returns false where there is no surface to cut from.
  bool cut(link::SurfacePatch& patch);

 private:
  bool slides_;
  std::optional<LocalSurface> cutter_;  ///< nothing: the object has no surface
  std::unique_ptr<ContactPredictionThread> contact_prediction_;
  std::optional<Eigen::Vector3d>
      pressed_ahead_W_;  ///< where, sooner or later, as pressing takes time
  std::optional<Eigen::Vector3d> expected_W_;
  std::optional<Eigen::Matrix3f> stiffness_W_N_per_m_;  ///< there; nothing: not solved yet
};

}  // namespace forcegrid::simulator
