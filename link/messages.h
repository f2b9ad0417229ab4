// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace forcegrid::link {

/// x, y, z. Plain arrays, so that a foreign simulator needs no linear algebra library.
using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<double, 9>;  ///< row major
/// w, x, y, z of a rotation: q = cos(a/2) + sin(a/2) (x i + y j + z k) turns by a about (x, y, z).
using Quaternion = std::array<double, 4>;
inline constexpr Quaternion kIdentity = {1.0, 0.0, 0.0, 0.0};

/// What the datagrams of a link tell of. Both name their tool or not (ToolId).
enum class Content : std::uint8_t {
  kPosition,  ///< versions 1 and 2 of the protocol: positions and forces
  kPose,      ///< version 3: orientations, buttons and torques, too
  /// Version 4: also how force and torque change with what a sample's own stiffness is not about.
  kSensitivities,
};

/// The number of a tool among those of one simulation, chosen by its servo. 0: the only tool, of a
/// servo that speaks version 1 of the protocol.
using ToolId = std::uint16_t;
inline constexpr ToolId kMaxToolId = 999;
/// Tools that one simulator serves, at most.
inline constexpr std::size_t kMostTools = 4;

/// Servo -> simulator: where the tool is. W: the workspace frame, x toward the operator, y to the
/// operator's right, z up; the servo defines its origin and the simulator places its object in it.
struct ToolState {
  std::uint32_t sequence = 0;      ///< increases by one per message
  std::int64_t servo_time_ns = 0;  ///< the servo's clock when `position_W` was measured
  Vector3 position_W_m{};          ///< operational point
  Vector3 velocity_W_m_per_s{};
  // From here on version 3 only; versions 1 and 2 do not carry it.
  bool has_orientation = false;  ///< else the identity, and no angular velocity
  bool has_buttons = false;      ///< else none is pressed
  /// Of the rotation from the tool's frame T to W: a_W = R(orientation_WT) a_T. A unit quaternion.
  Quaternion orientation_WT = kIdentity;
  Vector3 angular_velocity_W_rad_per_s{};
  std::uint32_t buttons = 0;  ///< bit i: the device's button i is pressed
};

/// Servo -> simulator: asks for the force at that position (request method; answered in idle time).
struct Query {
  std::uint32_t query_id = 0;
  std::int64_t servo_time_ns = 0;
  Vector3 position_W_m{};
};

/// How a sample's force depends on another tool that holds the object, too.
struct ToolInfluence {
  ToolId tool = 0;
  /// ToolState::sequence of that tool's state that `position_W_m` answers: its servo's sample of
  /// the same solution echoes it.
  std::uint32_t echo_sequence = 0;
  Vector3 position_W_m{};         ///< where the simulator had that tool for this force
  Matrix3 stiffness_W_N_per_m{};  ///< d(this tool's force)/d(that tool's position), row major
};

/// Simulator -> servo: the force that the object exerts on the tool at `position_W_m`.
struct ForceSample {
  std::uint32_t sequence = 0;           ///< the simulator's own count of samples
  std::uint32_t echo_sequence = 0;      ///< ToolState::sequence that it answers
  std::int64_t echo_servo_time_ns = 0;  ///< ToolState::servo_time_ns of that message
  std::uint32_t query_id = 0;           ///< 0 for a sample, else Query::query_id
  std::uint32_t contact_epoch = 0;  ///< 0 before any contact; a new number at every discontinuity
  bool in_contact = false;
  bool converged = false;  ///< the solver reached its tolerance
  bool has_stiffness = false;
  Vector3 position_W_m{};  ///< where the force was computed: not always where the tool is now
  Vector3 force_W_N{};
  Matrix3 stiffness_W_N_per_m{};  ///< dF/dP, row major; zero unless has_stiffness
  /// Where the tool touched. Out of contact: where it would touch within some tenths of a second if
  /// it kept its velocity, else its position. In a reply: the touch to which `force_W_N` belongs,
  /// made or still predicted.
  Vector3 contact_point_W_m{};
  double relative_residual = 0.0;  ///< of the equilibrium; see the simulator's documentation
  double solve_time_s = 0.0;
  // From here on version 3 only; versions 1 and 2 do not carry it.
  bool has_torque = false;
  bool has_rotational_stiffness = false;  ///< not without a torque
  /// Of the object on the tool, about `position_W_m`; zero unless has_torque.
  Vector3 torque_W_Nm{};
  /// For which force and torque were computed, as ToolState::orientation_WT. Sent with a torque
  /// only.
  Quaternion orientation_WT = kIdentity;
  /// d(torque)/d(theta), row major, at a fixed position; theta [rad] is the rotation vector in W by
  /// which the tool turns on from `orientation_WT`. Zero unless has_rotational_stiffness.
  Matrix3 rotational_stiffness_W_Nm_per_rad{};
  // From here on version 4 only.
  bool has_torque_gradient = false;  ///< not without a torque
  /// d(torque)/dP [N], row major, at a fixed orientation; zero unless has_torque_gradient. Where
  /// the object's forces have an energy, its transpose is d(force)/d(theta) [N/rad].
  Matrix3 torque_gradient_W_N{};
  std::uint32_t influence_count = 0;  ///< of the others on this tool's force; 0 in a reply
  std::array<ToolInfluence, kMostTools - 1> influences{};  ///< the first of these; the rest is zero
};

/// Where one of the other tools of the simulation is.
struct OtherTool {
  ToolId tool = 0;
  bool in_contact = false;
  /// How long ago the simulator had received `position_W_m` when it sent this. The way to the
  /// simulator and the way from it come on top.
  std::int64_t age_ns = 0;
  Vector3 position_W_m{};
};

/// Simulator -> servo, version 2 only: the other tools of the simulation.
struct OtherTools {
  static constexpr std::size_t kMost = kMostTools - 1;
  std::uint32_t sequence = 0;  ///< the simulator's own count of these
  std::uint32_t count = 0;
  std::array<OtherTool, kMost> tools{};  ///< the first `count`; the rest is zero
};

/// Simulator -> servo, version 2 only: why it does not serve this servo, or no longer.
struct Refusal {
  enum class Reason : std::uint32_t {
    kAllPlacesTaken = 1,  ///< it serves `most_tools` other tools
    kToolTaken = 2,       ///< another servo moves the tool of this number
    kOtherFault = 3,      ///< another tool's device has failed, and the simulation stops for all
  };
  Reason reason = Reason::kAllPlacesTaken;
  std::uint32_t most_tools = 1;  ///< how many the simulator serves
};

}  // namespace forcegrid::link
