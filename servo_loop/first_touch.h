// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <type_traits>

#include "contact/near_patch.h"
#include "link/surface_patch.h"
#include "servo_loop/touch_force.h"

namespace forcegrid::servo {

/// The servo's copy of the surface near the tool, as the simulator sent it. Plain data.
struct NearSurface {
  contact::NearPatch patch;  ///< empty: nothing is near
  double time_s = 0.0;       ///< servo clock of the tool state that it was cut for
  std::uint32_t epoch = 0;   ///< of the stretch in the air for which the patch is valid
  double tool_radius_m = 0.0;
  double tool_length_m = 0.0;
  double tool_opening_rad = 0.0;  ///< above 0: two such rods, see link::SurfacePatch
  bool has_stiffness = false;
  /// dF/dP of a tool that has just touched there, row by row.
  std::array<double, 9> stiffness_W_N_per_m{};
  bool has_press_forces = false;
  /// On a tool that slides, see link::SurfacePatch.
  std::array<std::array<double, 3>, link::SurfacePatch::kPresses> press_forces_W_N{};
};
static_assert(std::is_trivially_copyable_v<NearSurface>);

/// Checks a message and builds the tree over its triangles. @returns nothing if the triangles are
/// not a surface. Real-time: bounded, but takes some microseconds: keep it off the servo thread.
/// Threads: any.
std::optional<NearSurface> near_surface(const link::SurfacePatch& message) noexcept;

/// Detects the first touch on the servo and renders it before the simulator has answered.
///
/// In the air, each cycle compares the tool with the newest patch. The tool touches where its gap
/// falls to zero: at P_0, between the last cycle and this one, with the outward normal n. Until the
/// simulator's first sample of the contact, TouchForce is rendered. It starts from zero, pushes and
/// never pulls. If the patch has neither stiffness nor press forces, the touch is only counted, and
/// the method's force comes in at once.
///
/// From the first sample of the contact on, the weight moves linearly from TouchForce to the
/// method's force within kHandOver_s. If the simulator answers a later position with "no contact",
/// or gives no answer for kPatience_s, the force fades within kFade_s. A patch that is older than
/// kStale_s, belongs to another epoch, or is nearest at its rim causes no touch.
///
/// Real-time: no allocation, lock or throw. One query of the patch per cycle; two for a grasper, or
/// in a cycle with a touch. Threads: one.
class FirstTouch {
 public:
  static constexpr double kHandOver_s = 0.03;
  static constexpr double kFade_s = 0.03;
  static constexpr double kPatience_s = 0.2;
  static constexpr double kStale_s = 0.15;
  /// [m] At this height above P_0 along n the tool has left the surface again.
  static constexpr double kLeft_m = 0.5e-3;
  /// [m] Beyond this gap the patch is not searched triangle by triangle.
  static constexpr double kMargin_m = 0.02;

  struct Counts {
    std::uint64_t patches = 0;   ///< taken
    std::uint64_t touches = 0;   ///< detected before the simulator's answer
    std::uint64_t felt = 0;      ///< of these, with a force predicted from the patch
    std::uint64_t answered = 0;  ///< of these, by a sample in contact
    std::uint64_t denied = 0;    ///< of these, by a sample without contact, or by none in time
    std::uint64_t left = 0;      ///< of these, the tool left before an answer
    std::uint64_t unseen = 0;    ///< contacts of the simulator that were not detected here
    double wait_sum_s = 0.0;     ///< from touch to answer, of those answered
    double wait_max_s = 0.0;
  };

  explicit FirstTouch(double max_force_N) noexcept : force_(max_force_N) {}

  /// Takes the newest patch.
  void take(const NearSurface& surface) noexcept;

  /// The simulator's newest sample has arrived.
  /// @param computed_for_s  servo clock of the tool state that it answers.
  void answer(double time_s, double computed_for_s, bool in_contact, std::uint32_t epoch) noexcept;

  /// One cycle: detects a touch at `position_W` [m].
  /// @param method_force_W  [N] of the rendered method.
  /// @returns the force [N] to render: `method_force_W` unless acting().
  Eigen::Vector3d force_W(double time_s, const Eigen::Vector3d& position_W,
                          const Eigen::Vector3d& method_force_W) noexcept;

  /// A touch is rendered that the simulator has not answered yet, or that is handed over or fading.
  bool acting() const noexcept { return state_ != State::kAir && state_ != State::kContact; }

  /// Forgets the touch, as after a pause: nothing is added to the method's force.
  void forget() noexcept;

  const Counts& counts() const noexcept { return counts_; }

 private:
  enum class State : std::uint8_t { kAir, kTouching, kFading, kHandingOver, kContact };

  void look(double time_s, const Eigen::Vector3d& position_W) noexcept;
  void touch(double time_s, const Eigen::Vector3d& position_W, double gap_m,
             const Eigen::Vector3d& normal_W) noexcept;
  void fade(double time_s) noexcept;

  TouchForce force_;
  NearSurface surface_;
  State state_ = State::kAir;
  std::uint32_t air_epoch_ = 0;
  std::optional<double> last_gap_m_;  ///< of the cycle before, where it was above zero
  Eigen::Vector3d last_position_W_ = Eigen::Vector3d::Zero();
  double touched_s_ = 0.0;
  double turned_s_ = 0.0;  ///< when fading or handing over began
  Counts counts_;
};

}  // namespace forcegrid::servo
