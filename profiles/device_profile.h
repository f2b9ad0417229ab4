// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace forcegrid::profiles {
#pragma GCC visibility push(default)

/// A profile that can't be used. `what()` names file, line, key, what is wrong and what to write.
class ProfileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Three numbers, one per axis: joints a, b, c (base, shoulder, elbow) or x, y, z.
using Axes = std::array<double, 3>;

/// Standard gravity, for devices whose profile has no [gravity].
inline constexpr double kStandardGravity_m_per_s2 = 9.80665;

/// The hand that holds the emulated device: a mass on a spring and damper to a moving target.
struct HandProfile {
  double mass_kg = 0.0;
  double damping_N_s_per_m = 0.0;
  double stiffness_N_per_m = 0.0;
  std::string source;  ///< where the numbers come from
};

/// A whole arm that keeps its posture, of every device.
HandProfile arm_hand();

/// The mechanism of a device, by the key `kind` of its profile.
enum class DeviceKind : std::uint8_t {
  kArm,    ///< "arm", also when the key is absent: yaw and two links, see Kinematics
  kDelta,  ///< "delta": three equal legs in parallel, see Delta
};

/// Everything that driver and emulator know about one kind of device, read from one TOML file. It
/// holds data only: each side has its own codec and its own kinematics, so that neither can hide a
/// mistake of the other. Device frame D: x toward the user, y to the user's right, z up.
///
/// An arm has the tables kinematics, motors, calibration and gravity; a delta has delta and falcon.
/// Members for the other kind's tables stay zero. For an arm: joint angle q_i = encoder_sign_i * (2
/// pi n_i / counts_per_turn_i) * (d_i / D_i); linkage angle theta_i = linkage_offset_rad_i +
/// linkage_sign_i * q_i (theta_a yaw, theta_b from the vertical, theta_c absolute from straight
/// down). Source: the device fact sheets named in the file's `source`.
struct DeviceProfile {
  std::string file;  ///< the file it came from, for messages
  std::string name;
  std::string description;
  std::string source;
  DeviceKind kind = DeviceKind::kArm;

  struct Usb {
    /// Arm: "w2", "w3" (the same in reports of 64 bytes), or "w6" (the same in reports of 20 bytes,
    /// with the currents of three motors more). Delta: "falcon", which is not a HID
    /// device and has no usage page, usage or report length.
    std::string protocol;
    std::uint16_t vendor_id = 0;
    std::uint16_t product_id = 0;
    std::uint16_t device_release = 0;  ///< bcdDevice
    std::string manufacturer;
    std::string product;
    std::string serial;
    std::uint16_t usage_page = 0;
    std::uint16_t usage = 0;
    int report_bytes = 0;
    int frame_period_us = 0;  ///< bus frame: 1000 at full speed
  } usb;

  struct Kinematics {
    Axes link_length_m{};  ///< L_a, L_b, L_c
    Axes origin_m{};       ///< o_x, o_y, o_z
    Axes capstan_diameter_m{};
    Axes body_diameter_m{};
    Axes encoder_counts_per_turn{};  ///< quadrature counts of one motor turn
    Axes encoder_sign{};             ///< s_i, +1 or -1
    Axes linkage_sign{};             ///< +1 or -1
    Axes linkage_offset_rad{};
    Axes joint_min_rad{};  ///< hard stops, in q
    Axes joint_max_rad{};
    /// Hard stops of the angle between the links, theta_b + theta_c (0: folded, pi: stretched).
    double elbow_min_rad = 0.0;
    double elbow_max_rad = 0.0;
  } kinematics;

  struct Motors {
    Axes torque_constant_Nm_per_A{};
    Axes max_current_A{};               ///< limit of what the host commands
    double full_scale_current_A = 0.0;  ///< I_full of the firmware's PWM
    Axes continuous_current_A{};  ///< what the motors withstand indefinitely; at most max_current_A
    double thermal_time_constant_s = 0.0;  ///< of their windings
  } motors;

  /// The wrist of an arm: three joints in series between its last link and the tool, each with an
  /// encoder and without a motor, whose axes meet in the tip. Joint angle g_i = encoder_sign_i *
  /// 2 pi n_i / counts_per_turn_i, from the inside out. With T the tool's frame and R_k(g) the
  /// rotation by g about axis k of the frame that the joints before have left:
  ///
  ///   R_DT = R_z(theta_a) R_y(pi/2 - theta_c) R_axis1(g_1) R_axis2(g_2) R_axis3(g_3)
  ///
  /// So T has the axes of D when the last link points toward the user and all g_i are zero. The
  /// counts at which that is so are zero; calibration.pose_counts d, e, f are those of the
  /// calibration pose.
  struct Gimbal {
    bool present = false;          ///< false: the file has no [gimbal]; the rest is zero
    std::array<int, 3> counter{};  ///< which of a report's counters measures g_i: 3, 4, 5 (d, e, f)
    std::array<int, 3> axis{};     ///< 0, 1, 2 for x, y, z
    Axes encoder_counts_per_turn{};  ///< quadrature counts of one turn of the joint
    Axes encoder_sign{};             ///< +1 or -1
    Axes joint_min_rad{};            ///< hard stops, in g
    Axes joint_max_rad{};
    Axes max_joint_speed_rad_per_s{};  ///< counts that turn a joint faster have jumped
    Axes max_joint_acceleration_rad_per_s2{};
    /// The stylus has a button: while it is pressed the device adds 10000 to counter d, which is
    /// below 5000 otherwise.
    bool stylus_button = false;
  } gimbal;

  /// The motors of a wrist that has them, and what the emulated hand does about them. Joint torque
  /// = encoder_sign_i torque_constant_i ratio_i I_i. They share the arm's full_scale_current_A.
  struct GimbalMotors {
    bool present = false;  ///< false: the file has no [gimbal_motors]; the rest is zero
    Axes torque_constant_Nm_per_A{};
    Axes ratio{};          ///< motor turns of one turn of the joint
    Axes max_current_A{};  ///< that the motors withstand indefinitely
    Axes max_joint_torque_Nm{};
    double max_torque_Nm = 0.0;  ///< of the torque at the tool
    double max_torque_rate_Nm_per_s = 0.0;
    // The emulated arm only, see emulator::DrivenWrist.
    double joint_inertia_kg_m2 = 0.0;
    double joint_damping_Nm_s_per_rad = 0.0;
    double hand_stiffness_Nm_per_rad = 0.0;
    double hand_damping_Nm_s_per_rad = 0.0;
  } gimbal_motors;

  /// Mechanism of a delta. In leg i's own frame u points out of the base at azimuth phi_i, v is u
  /// turned by +90 degrees, and w is z of the base frame B: x to the user's right, y up, z out of
  /// the device toward the user. Driven angle theta_i = zero_angle_rad + encoder_rad_per_count n_i,
  /// from u toward w. Device frame: x_D = z_B - center_z, y_D = x_B - center_x,
  /// z_D = y_B - center_y.
  struct Delta {
    double thigh_m = 0.0;              ///< a, driven arm
    double shin_m = 0.0;               ///< b, parallelogram
    double platform_offset_u_m = 0.0;  ///< c
    double knee_end_m = 0.0;           ///< d, end piece between knee and shin
    double platform_end_m = 0.0;       ///< e, end piece between shin and platform
    double platform_offset_v_m = 0.0;  ///< f
    double base_offset_u_m = 0.0;      ///< r
    double base_offset_v_m = 0.0;      ///< s
    Axes leg_azimuth_rad{};            ///< phi_1, phi_2, phi_3
    double encoder_rad_per_count = 0.0;
    double zero_angle_rad = 0.0;  ///< theta at zero counts
    Axes center_m{};              ///< origin of D, in B
    double joint_min_rad = 0.0;   ///< hard stops of each theta
    double joint_max_rad = 0.0;
    double knob_min_z_m = 0.0;  ///< hard stops of the knob against the body, in B
    double knob_max_z_m = 0.0;
    double knob_max_radius_m = 0.0;  ///< from the z axis of B
  } delta;

  /// Electronics of the Novint Falcon. Motor command = -torque_gain * theta's torque.
  struct Falcon {
    double torque_gain_per_Nm = 0.0;  ///< command for 1 N m at a driven angle
    int command_limit = 0;            ///< largest command, of either sign
    /// A homing axis finds its zero when theta, after it was above the first angle, falls below the
    /// second (the emulated device's rule).
    double homing_out_rad = 0.0;
    double homing_in_rad = 0.0;
    std::string homing_instruction;  ///< how a person homes the device
  } falcon;

  struct Limits {
    double max_force_N = 0.0;
    double max_force_rate_N_per_s = 0.0;
    Axes max_joint_torque_Nm{};
    double max_stiffness_N_per_m = 0.0;
    double max_damping_N_s_per_m = 0.0;
    double max_speed_m_per_s = 0.0;
    /// Between two reports no joint can turn farther than these allow; counts that do have jumped.
    Axes max_joint_speed_rad_per_s{};
    Axes max_joint_acceleration_rad_per_s2{};
    Axes workspace_min_m{};  ///< D, axis-aligned box in which force may be rendered
    Axes workspace_max_m{};
  } limits;

  struct Calibration {
    std::array<int, 6> pose_counts{};  ///< counters in the calibration pose
    std::string instruction;           ///< how a person puts the arm there
  } calibration;

  /// Static gravity model of the links (driver's compensation, off unless asked for).
  struct Gravity {
    double acceleration_m_per_s2 = 0.0;
    double link_b_mass_kg = 0.0;
    double link_c_mass_kg = 0.0;
    double link_b_center_m = 0.0;  ///< from the shoulder along link B
    double link_c_center_m = 0.0;  ///< from the elbow along link C
    bool balanced = true;  ///< the emulated arm is counterbalanced: gravity does not move it
  } gravity;

  /// The emulated arm only.
  struct Dynamics {
    double tip_mass_kg = 0.0;
    double joint_inertia_kg_m2 = 0.0;
    /// Per joint; the file has three numbers, or one for all.
    Axes coulomb_friction_Nm{};
    double coulomb_smoothing_s_per_rad = 0.0;  ///< friction = -coulomb * tanh(smoothing * q')
    Axes viscous_friction_Nm_s_per_rad{};      ///< likewise
    double stop_stiffness_Nm_per_rad = 0.0;
    double stop_damping_Nm_s_per_rad = 0.0;
    double knob_stop_stiffness_N_per_m = 0.0;  ///< delta only: the knob against the body
    double knob_stop_damping_N_s_per_m = 0.0;
  } dynamics;

  HandProfile firm_hand;
  HandProfile light_hand;
};

/// Reads and checks one profile. An unknown, missing, mistyped, non-finite or impossible value is
/// an error. A value is impossible if no table-top arm has it (each number has its range, which the
/// error states) or if it contradicts the rest of the file: a capstan not smaller than its body, a
/// current above full scale, a centre of mass beyond its link, a calibration pose beyond the hard
/// stops, or a workspace with a point that the linkage can't reach (distance to the shoulder not
/// between |L_b - L_c| and L_b + L_c). For a delta, each point of the workspace must let the legs
/// close and must lie within the hard stops.
/// @param name_or_path a file name with a slash or ending in ".toml", or a profile's name, looked
///        up in $FORCEGRID_PROFILE_PATH (if set), then beside the installed program, then in the
///        source tree.
/// @throws ProfileError naming file, line and key; for an unknown name, the known names.
DeviceProfile load_device_profile(const std::string& name_or_path);

/// Names that load_device_profile finds without a path, sorted.
std::vector<std::string> available_profiles();

/// Whether its mechanism is a delta: three arms that carry one platform, as a Falcon's.
inline bool is_delta(const DeviceProfile& profile) { return profile.kind == DeviceKind::kDelta; }

/// Whether it has a wrist with encoders, so that the tool's orientation is known.
inline bool has_wrist(const DeviceProfile& profile) { return profile.gimbal.present; }

#pragma GCC visibility pop
}  // namespace forcegrid::profiles
