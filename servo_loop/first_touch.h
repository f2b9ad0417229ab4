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

/// The servo's own copy of what the simulator said of the surface near the tool. Plain data.
struct NearSurface {
  contact::NearPatch patch;  ///< empty: nothing is near
  double time_s = 0.0;       ///< servo clock of the tool state that it was cut out for
  std::uint32_t epoch = 0;   ///< of the air, in which alone it holds
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

/// Checks a message and builds the tree over its triangles; nothing if they are no surface.
/// Real-time: bounded, but not for the servo's thread: some microseconds. Threads: any.
std::optional<NearSurface> near_surface(const link::SurfacePatch& message) noexcept;

/// The first touch, seen by the servo itself and felt before the simulator has answered.
///
/// In the air the tool is held against the newest patch once a cycle. It touches where its gap
/// falls to zero: at P_0, between the cycle before and this one, under the outward normal n. Until
/// the simulator's first sample of the contact it feels TouchForce, which starts from zero, pushes
/// and never pulls. A patch without stiffness or press forces gives no force, the touch is only
/// counted, and the method's force comes in at once. From the first sample of the contact on the
/// method's force takes over within kHandOver_s, a weight that moves evenly from the one to the
/// other. A simulator that answers a later position with "no contact", or nothing for kPatience_s,
/// is believed: the force fades within kFade_s. A patch that is older than kStale_s, of another
/// epoch, or whose rim is what is nearest, is no reason for any touch.
///
/// Real-time: no allocation, lock or throw; one query of the patch a cycle, two for a grasper, and
/// in a cycle with a touch. Threads: one.
class FirstTouch {
 public:
  static constexpr double kHandOver_s = 0.03;
  static constexpr double kFade_s = 0.03;
  static constexpr double kPatience_s = 0.2;
  static constexpr double kStale_s = 0.15;
  /// [m] So far above P_0 along n the tool has left without an answer.
  static constexpr double kLeft_m = 0.5e-3;
  /// [m] Beyond this gap the patch is not looked at triangle by triangle.
  static constexpr double kMargin_m = 0.02;

  struct Counts {
    std::uint64_t patches = 0;   ///< taken
    std::uint64_t touches = 0;   ///< seen here first
    std::uint64_t felt = 0;      ///< of these, with a force that the patch has foretold
    std::uint64_t answered = 0;  ///< of these, by a sample in contact
    std::uint64_t denied = 0;    ///< by a sample without contact, or by none in time
    std::uint64_t left = 0;      ///< the tool was gone before an answer
    std::uint64_t unseen = 0;    ///< contacts of the simulator that were not seen here
    double wait_sum_s = 0.0;     ///< from touch to answer, of those answered
    double wait_max_s = 0.0;
  };

  explicit FirstTouch(double max_force_N) noexcept : force_(max_force_N) {}

  /// The newest patch.
  void take(const NearSurface& surface) noexcept;

  /// The simulator's newest sample has arrived.
  /// @param computed_for_s  servo clock of the tool state that it answers.
  void answer(double time_s, double computed_for_s, bool in_contact, std::uint32_t epoch) noexcept;

  /// One cycle: looks for a touch at `position_W` [m] and gives the force there.
  /// @param method_force_W  [N] what is rendered where there is nothing to add.
  Eigen::Vector3d force_W(double time_s, const Eigen::Vector3d& position_W,
                          const Eigen::Vector3d& method_force_W) noexcept;

  /// A touch is felt that the simulator has not answered, or is being handed over.
  bool acting() const noexcept { return state_ != State::kAir && state_ != State::kContact; }

  /// What the cycles before have seen is about another hand: nothing is felt.
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
