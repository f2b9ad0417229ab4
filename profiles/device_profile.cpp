// SPDX-License-Identifier: Apache-2.0
#include "profiles/device_profile.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "profiles/gimbal_profile.h"
#include "text/data_folder.h"
#include "text/file_kind.h"
#include "text/text.h"
#include "text/toml_table.h"

namespace forcegrid::profiles {

using text::joined;
using text::number_text;
namespace {

constexpr std::size_t kMaxUsbStringLength = 126;  // a string descriptor has 255 bytes at most
constexpr std::array<const char*, 3> kJointNames = {"a (base)", "b (shoulder)", "c (elbow)"};

using Range = text::NumberRange;

constexpr Range kAnyNumber{-text::kLargestNumber, text::kLargestNumber, "a finite number"};
// The arms are table-top devices: a length of several metres means a wrong unit.
constexpr Range kLength_m{1e-4, 2.0, "a length in metres from 0.0001 to 2"};
constexpr Range kLinkLength_m{0.0, 2.0, "a length in metres from 0 to 2"};
constexpr Range kPlace_m{-2.0, 2.0, "a coordinate in metres from -2 to 2"};
constexpr Range kAngle_rad{-2.0 * std::numbers::pi, 2.0 * std::numbers::pi,
                           "an angle in radians from -2 pi to 2 pi"};
// Wide enough for any arm that a person holds: a value outside means a wrong unit or digit.
constexpr Range kTorqueConstant_Nm_per_A{1e-4, 10.0,
                                         "a torque constant in N m/A from 0.0001 to 10"};
// The report's currents are 16-bit milliamperes.
constexpr Range kFullScale_A{1e-3, 32.0, "a current in amperes from 0.001 to 32"};
constexpr Range kCurrent_A{text::kAboveZero, 32.0, "a current in amperes above 0 and at most 32"};
constexpr Range kThermal_s{0.1, 1e4, "a time in seconds from 0.1 to 1e4"};
constexpr Range kForce_N{text::kAboveZero, 100.0, "a force in newtons above 0 and at most 100"};
constexpr Range kForceRate_N_per_s{text::kAboveZero, 1e6, "a rate in N/s above 0 and at most 1e6"};
constexpr Range kJointTorque_Nm{text::kAboveZero, 1000.0,
                                "a torque in N m above 0 and at most 1000"};
constexpr Range kStiffness_N_per_m{text::kAboveZero, 1e5,
                                   "a stiffness in N/m above 0 and at most 1e5"};
constexpr Range kMaxDamping_N_s_per_m{0.0, 1e3, "a damping in N s/m from 0 to 1000"};
constexpr Range kSpeed_m_per_s{text::kAboveZero, 20.0, "a speed in m/s above 0 and at most 20"};
constexpr Range kJointSpeed_rad_per_s{text::kAboveZero, 1000.0,
                                      "a speed in rad/s above 0 and at most 1000"};
constexpr Range kJointAcceleration_rad_per_s2{text::kAboveZero, 1e6,
                                              "an acceleration in rad/s^2 above 0 and at most 1e6"};
constexpr Range kAcceleration_m_per_s2{0.0, 30.0, "an acceleration in m/s^2 from 0 to 30"};
constexpr Range kLinkMass_kg{0.0, 20.0, "a mass in kilograms from 0 to 20"};
constexpr Range kTipMass_kg{1e-3, 10.0, "a mass in kilograms from 0.001 to 10"};
// Without joint inertia the arm's mass matrix is singular wherever its Jacobian is.
constexpr Range kInertia_kg_m2{text::kAboveZero, 1.0, "an inertia in kg m^2 above 0 and at most 1"};
constexpr Range kCoulomb_Nm{0.0, 10.0, "a friction torque in N m from 0 to 10"};
constexpr Range kSmoothing_s_per_rad{text::kAboveZero, 1e4,
                                     "a smoothing in s/rad above 0 and at most 1e4"};
constexpr Range kViscous_Nm_s_per_rad{0.0, 10.0, "a friction in N m s/rad from 0 to 10"};
constexpr Range kStopStiffness_Nm_per_rad{text::kAboveZero, 1e4,
                                          "a stiffness in N m/rad above 0 and at most 1e4"};
constexpr Range kStopDamping_Nm_s_per_rad{0.0, 100.0, "a damping in N m s/rad from 0 to 100"};
constexpr Range kKnobStopStiffness_N_per_m{text::kAboveZero, 1e6,
                                           "a stiffness in N/m above 0 and at most 1e6"};
constexpr Range kEncoder_rad_per_count{1e-7, 0.1, "an angle per count in radians from 1e-7 to 0.1"};
constexpr Range kTorqueGain_per_Nm{1.0, 1e6, "a command for 1 N m from 1 to 1e6"};
constexpr Range kHandMass_kg{1e-3, 20.0, "a mass in kilograms from 0.001 to 20"};
constexpr Range kHandDamping_N_s_per_m{0.0, 1e4, "a damping in N s/m from 0 to 1e4"};

using Table = text::TomlTable;

std::string usb_string(const Table& table, const char* key) {
  const std::string value = table.text(key, kMaxUsbStringLength);
  const auto odd =
      std::find_if(value.begin(), value.end(), [](char c) { return c < ' ' || c > '~'; });
  if (odd != value.end()) {
    table.refuse(key, "byte " + std::to_string(odd - value.begin() + 1) + " is not printable ASCII",
                 "write letters, digits, punctuation and spaces of ASCII only");
  }
  return value;
}

Axes whole_axes(const Table& table, const char* key, std::int64_t min, std::int64_t max) {
  const std::vector<std::int64_t> whole = table.integers(key, 3, min, max);
  Axes result{};
  std::transform(whole.begin(), whole.end(), result.begin(),
                 [](std::int64_t value) { return static_cast<double>(value); });
  return result;
}

Axes signs(const Table& table, const char* key) {
  const Axes result = table.axes(key, kAnyNumber);
  for (std::size_t i = 0; i < 3; ++i) {
    if (result[i] != 1.0 && result[i] != -1.0) {
      table.refuse(key,
                   number_text(result[i]) + " in place " + std::to_string(i + 1) + " is no sign",
                   "write 1 or -1");
    }
  }
  return result;
}

std::array<int, 6> counters(const Table& table, const char* key) {
  const std::vector<std::int64_t> whole = table.integers(
      key, 6, std::numeric_limits<std::int16_t>::min(), std::numeric_limits<std::int16_t>::max());
  std::array<int, 6> result{};
  std::transform(whole.begin(), whole.end(), result.begin(),
                 [](std::int64_t value) { return static_cast<int>(value); });
  return result;
}

std::uint16_t word(const Table& table, const char* key) {
  return static_cast<std::uint16_t>(table.integer(key, 0, 0xFFFF));
}

/// Read before the root table, because the root's tables depend on it.
DeviceKind read_kind(const toml::table& root, const std::string& file) {
  const toml::node* node = root.get("kind");
  if (node == nullptr) {
    return DeviceKind::kArm;
  }
  const std::string kind = node->value_or(std::string());
  if (kind != "arm" && kind != "delta") {
    throw text::TomlError(file + ":" + std::to_string(node->source().begin.line) +
                          ": key 'kind': '" + kind + "' is unknown; write \"arm\" or \"delta\"");
  }
  return kind == "delta" ? DeviceKind::kDelta : DeviceKind::kArm;
}

Table usb_table(const Table& root, DeviceKind kind) {
  return kind == DeviceKind::kDelta
             ? root.table("usb", {"protocol", "vendor_id", "product_id", "device_release",
                                  "manufacturer", "product", "serial", "frame_period_us"})
             : root.table("usb", {"protocol", "vendor_id", "product_id", "device_release",
                                  "manufacturer", "product", "serial", "usage_page", "usage",
                                  "report_bytes", "frame_period_us"});
}

DeviceProfile::Usb read_usb(const Table& root, DeviceKind kind) {
  const Table table = usb_table(root, kind);
  DeviceProfile::Usb usb;
  usb.protocol = table.text("protocol");
  const bool delta = kind == DeviceKind::kDelta;
  if (delta ? usb.protocol != "falcon"
            : usb.protocol != "w2" && usb.protocol != "w3" && usb.protocol != "w6") {
    table.refuse("protocol", "'" + usb.protocol + "' is unknown",
                 delta ? "write \"falcon\"" : "write \"w2\", \"w3\" or \"w6\"");
  }
  usb.vendor_id = word(table, "vendor_id");
  usb.product_id = word(table, "product_id");
  usb.device_release = word(table, "device_release");
  usb.manufacturer = usb_string(table, "manufacturer");
  usb.product = usb_string(table, "product");
  usb.serial = usb_string(table, "serial");
  if (!delta) {
    usb.usage_page = word(table, "usage_page");
    usb.usage = word(table, "usage");
    usb.report_bytes = static_cast<int>(table.integer("report_bytes", 1, 64));
    if (usb.report_bytes != (usb.protocol == "w3" ? 64 : usb.protocol == "w6" ? 20 : 14)) {
      table.refuse("report_bytes", std::to_string(usb.report_bytes) + " is impossible",
                   "write 14 with protocol \"w2\", 64 with \"w3\" and 20 with \"w6\"");
    }
  }
  usb.frame_period_us = static_cast<int>(table.integer("frame_period_us", 125, 1000));
  if (delta && usb.frame_period_us != 1000) {
    table.refuse("frame_period_us", std::to_string(usb.frame_period_us) + " is impossible",
                 "write 1000: the FT232R is a full-speed device");
  }
  if (usb.frame_period_us != 125 && usb.frame_period_us != 1000) {
    table.refuse("frame_period_us", std::to_string(usb.frame_period_us) + " is impossible",
                 "write 1000 (full speed) or 125 (high speed)");
  }
  return usb;
}

DeviceProfile::Kinematics read_kinematics(const Table& root) {
  const Table table =
      root.table("kinematics",
                 {"link_length_m", "origin_m", "capstan_diameter_m", "body_diameter_m",
                  "encoder_counts_per_turn", "encoder_sign", "linkage_sign", "linkage_offset_rad",
                  "joint_min_rad", "joint_max_rad", "elbow_min_rad", "elbow_max_rad"});
  DeviceProfile::Kinematics kinematics;
  // Some configurations put the height of the base into the origin: only L_a may be zero.
  kinematics.link_length_m = table.axes("link_length_m", kLinkLength_m);
  for (std::size_t i = 1; i < 3; ++i) {
    if (kinematics.link_length_m[i] < kLength_m.min) {
      table.refuse("link_length_m",
                   number_text(kinematics.link_length_m[i]) + " in place " + std::to_string(i + 1) +
                       " is impossible",
                   std::string("write ") + kLength_m.words);
    }
  }
  kinematics.origin_m = table.axes("origin_m", kPlace_m);
  kinematics.capstan_diameter_m = table.axes("capstan_diameter_m", kLength_m);
  kinematics.body_diameter_m = table.axes("body_diameter_m", kLength_m);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(kinematics.capstan_diameter_m[i] < kinematics.body_diameter_m[i])) {
      table.refuse("capstan_diameter_m",
                   number_text(kinematics.capstan_diameter_m[i]) + " in place " +
                       std::to_string(i + 1) + " is not below body_diameter_m (" +
                       number_text(kinematics.body_diameter_m[i]) + ")",
                   "write a smaller diameter here or a larger one there");
    }
  }
  kinematics.encoder_counts_per_turn = whole_axes(table, "encoder_counts_per_turn", 1, 10'000'000);
  kinematics.encoder_sign = signs(table, "encoder_sign");
  kinematics.linkage_sign = signs(table, "linkage_sign");
  kinematics.linkage_offset_rad = table.axes("linkage_offset_rad", kAngle_rad);
  kinematics.joint_min_rad = table.axes("joint_min_rad", kAngle_rad);
  kinematics.joint_max_rad = table.axes("joint_max_rad", kAngle_rad);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(kinematics.joint_min_rad[i] < kinematics.joint_max_rad[i])) {
      table.refuse("joint_max_rad",
                   std::string("joint ") + kJointNames[i] + ": not above joint_min_rad (" +
                       number_text(kinematics.joint_min_rad[i]) + ")",
                   "write a larger angle here or a smaller one there");
    }
  }
  constexpr Range kElbow{0.0, std::numbers::pi, "an angle in radians from 0 to pi"};
  kinematics.elbow_min_rad = table.number("elbow_min_rad", kElbow);
  kinematics.elbow_max_rad = table.number("elbow_max_rad", kElbow);
  if (!(kinematics.elbow_min_rad < kinematics.elbow_max_rad)) {
    table.refuse("elbow_max_rad",
                 "not above elbow_min_rad (" + number_text(kinematics.elbow_min_rad) + ")",
                 "write a larger angle here or a smaller one there");
  }
  return kinematics;
}

DeviceProfile::Motors read_motors(const Table& root) {
  const Table table =
      root.table("motors", {"torque_constant_Nm_per_A", "max_current_A", "full_scale_current_A",
                            "continuous_current_A", "thermal_time_constant_s"});
  DeviceProfile::Motors motors;
  motors.torque_constant_Nm_per_A =
      table.axes("torque_constant_Nm_per_A", kTorqueConstant_Nm_per_A);
  motors.full_scale_current_A = table.number("full_scale_current_A", kFullScale_A);
  motors.max_current_A = table.axes("max_current_A", kCurrent_A);
  for (std::size_t i = 0; i < 3; ++i) {
    if (motors.max_current_A[i] > motors.full_scale_current_A) {
      table.refuse("max_current_A",
                   number_text(motors.max_current_A[i]) + " in place " + std::to_string(i + 1) +
                       " is above full_scale_current_A",
                   "write at most " + number_text(motors.full_scale_current_A) +
                       ": the firmware does not clamp");
    }
  }
  motors.continuous_current_A = table.axes("continuous_current_A", kCurrent_A);
  for (std::size_t i = 0; i < 3; ++i) {
    if (motors.continuous_current_A[i] > motors.max_current_A[i]) {
      table.refuse("continuous_current_A",
                   number_text(motors.continuous_current_A[i]) + " in place " +
                       std::to_string(i + 1) + " is above max_current_A",
                   "write at most " + number_text(motors.max_current_A[i]));
    }
  }
  motors.thermal_time_constant_s = table.number("thermal_time_constant_s", kThermal_s);
  return motors;
}

/// The linkage reaches the distances from the shoulder between |L_b - L_c| and L_b + L_c. The
/// farthest point of a box is one of its corners, the nearest may lie on a face or inside.
void require_reachable_workspace(const Table& table, const DeviceProfile::Limits& limits,
                                 const DeviceProfile::Kinematics& kinematics) {
  const Axes shoulder_m = {0.0 - kinematics.origin_m[0], 0.0 - kinematics.origin_m[1],
                           kinematics.link_length_m[0] - kinematics.origin_m[2]};
  Axes nearest_m{};
  Axes farthest_m{};
  double nearest2_m2 = 0.0;
  double farthest2_m2 = 0.0;
  double longest_m = -1.0;
  const char* longest_key = "workspace_max_m";
  for (std::size_t i = 0; i < 3; ++i) {
    const double min_m = limits.workspace_min_m[i];
    const double max_m = limits.workspace_max_m[i];
    const bool min_is_farther = shoulder_m[i] - min_m > max_m - shoulder_m[i];
    nearest_m[i] = std::clamp(shoulder_m[i], min_m, max_m);
    farthest_m[i] = min_is_farther ? min_m : max_m;
    const double near_m = nearest_m[i] - shoulder_m[i];
    const double far_m = std::abs(farthest_m[i] - shoulder_m[i]);
    nearest2_m2 += near_m * near_m;
    farthest2_m2 += far_m * far_m;
    if (far_m > longest_m) {
      longest_m = far_m;
      longest_key = min_is_farther ? "workspace_min_m" : "workspace_max_m";
    }
  }
  const auto place_text = [](const Axes& place_m) {
    return std::string("(") + number_text(place_m[0]) + ", " + number_text(place_m[1]) + ", " +
           number_text(place_m[2]) + ")";
  };
  const double length_b_m = kinematics.link_length_m[1];
  const double length_c_m = kinematics.link_length_m[2];
  const double reach_m = length_b_m + length_c_m;
  const double hole_m = std::abs(length_b_m - length_c_m);
  const std::string remedy =
      "write a workspace_min_m and workspace_max_m between which every point is more than " +
      number_text(hole_m) + " m and less than " + number_text(reach_m) +
      " m from the shoulder at " + place_text(shoulder_m) +
      ", or correct kinematics.link_length_m and origin_m";
  if (!(std::sqrt(farthest2_m2) < reach_m)) {
    table.refuse(longest_key,
                 "the linkage can't reach the corner " + place_text(farthest_m) +
                     " of the workspace, " + number_text(std::sqrt(farthest2_m2)) +
                     " m from the shoulder",
                 remedy);
  }
  if (!(std::sqrt(nearest2_m2) > hole_m)) {
    table.refuse("workspace_min_m",
                 "the linkage can't fold to the point " + place_text(nearest_m) +
                     " of the workspace, " + number_text(std::sqrt(nearest2_m2)) +
                     " m from the shoulder",
                 remedy);
  }
}

DeviceProfile::Delta read_delta(const Table& root) {
  const Table table = root.table(
      "delta", {"thigh_m", "shin_m", "platform_offset_u_m", "knee_end_m", "platform_end_m",
                "platform_offset_v_m", "base_offset_u_m", "base_offset_v_m", "leg_azimuth_rad",
                "encoder_rad_per_count", "zero_angle_rad", "center_m", "joint_min_rad",
                "joint_max_rad", "knob_min_z_m", "knob_max_z_m", "knob_max_radius_m"});
  DeviceProfile::Delta delta;
  delta.thigh_m = table.number("thigh_m", kLength_m);
  delta.shin_m = table.number("shin_m", kLength_m);
  delta.platform_offset_u_m = table.number("platform_offset_u_m", kPlace_m);
  delta.knee_end_m = table.number("knee_end_m", kLinkLength_m);
  delta.platform_end_m = table.number("platform_end_m", kLinkLength_m);
  delta.platform_offset_v_m = table.number("platform_offset_v_m", kPlace_m);
  delta.base_offset_u_m = table.number("base_offset_u_m", kPlace_m);
  delta.base_offset_v_m = table.number("base_offset_v_m", kPlace_m);
  delta.leg_azimuth_rad = table.axes("leg_azimuth_rad", kAngle_rad);
  delta.encoder_rad_per_count = table.number("encoder_rad_per_count", kEncoder_rad_per_count);
  delta.zero_angle_rad = table.number("zero_angle_rad", kAngle_rad);
  delta.center_m = table.axes("center_m", kPlace_m);
  delta.joint_min_rad = table.number("joint_min_rad", kAngle_rad);
  delta.joint_max_rad = table.number("joint_max_rad", kAngle_rad);
  if (!(delta.joint_min_rad < delta.joint_max_rad)) {
    table.refuse("joint_max_rad",
                 "not above joint_min_rad (" + number_text(delta.joint_min_rad) + ")",
                 "write a larger angle here or a smaller one there");
  }
  delta.knob_min_z_m = table.number("knob_min_z_m", kPlace_m);
  delta.knob_max_z_m = table.number("knob_max_z_m", kPlace_m);
  if (!(delta.knob_min_z_m < delta.knob_max_z_m)) {
    table.refuse("knob_max_z_m", "not above knob_min_z_m (" + number_text(delta.knob_min_z_m) + ")",
                 "write a larger coordinate here or a smaller one there");
  }
  delta.knob_max_radius_m = table.number("knob_max_radius_m", kLength_m);
  return delta;
}

DeviceProfile::Falcon read_falcon(const Table& root, const DeviceProfile::Delta& delta) {
  const Table table = root.table("falcon", {"torque_gain_per_Nm", "command_limit", "homing_out_rad",
                                            "homing_in_rad", "homing_instruction"});
  DeviceProfile::Falcon falcon;
  falcon.torque_gain_per_Nm = table.number("torque_gain_per_Nm", kTorqueGain_per_Nm);
  // The packet's commands are of 16 bits.
  falcon.command_limit = static_cast<int>(table.integer("command_limit", 1, 32767));
  falcon.homing_out_rad = table.number("homing_out_rad", kAngle_rad);
  falcon.homing_in_rad = table.number("homing_in_rad", kAngle_rad);
  if (!(falcon.homing_in_rad < falcon.homing_out_rad)) {
    table.refuse("homing_out_rad",
                 "not above homing_in_rad (" + number_text(falcon.homing_in_rad) + ")",
                 "write a larger angle here or a smaller one there");
  }
  if (falcon.homing_in_rad <= delta.joint_min_rad) {
    table.refuse("homing_in_rad", number_text(falcon.homing_in_rad) + " is beyond a hard stop",
                 "write an angle above delta.joint_min_rad");
  }
  if (falcon.homing_out_rad >= delta.joint_max_rad) {
    table.refuse("homing_out_rad", number_text(falcon.homing_out_rad) + " is beyond a hard stop",
                 "write an angle below delta.joint_max_rad");
  }
  falcon.homing_instruction = table.text("homing_instruction");
  return falcon;
}

/// Why the knob can't be at a place in the base frame; empty when it can. The legs close when |Q_v|
/// <= b and the triangle of thigh, shin with its end pieces, and (Q_u, Q_w) exists.
std::string obstacle_at(const DeviceProfile::Delta& delta, const Axes& place_B_m) {
  if (place_B_m[2] < delta.knob_min_z_m || place_B_m[2] > delta.knob_max_z_m) {
    return "delta.knob_min_z_m and knob_max_z_m cut it off";
  }
  if (std::hypot(place_B_m[0], place_B_m[1]) > delta.knob_max_radius_m) {
    return "delta.knob_max_radius_m cuts it off";
  }
  for (std::size_t leg = 0; leg < 3; ++leg) {
    const double cosine = std::cos(delta.leg_azimuth_rad[leg]);
    const double sine = std::sin(delta.leg_azimuth_rad[leg]);
    const double u_m = place_B_m[0] * cosine + place_B_m[1] * sine - delta.base_offset_u_m +
                       delta.platform_offset_u_m;
    const double v_m = -place_B_m[0] * sine + place_B_m[1] * cosine - delta.base_offset_v_m +
                       delta.platform_offset_v_m;
    const double shin2_m2 = delta.shin_m * delta.shin_m - v_m * v_m;
    const double reach_m = std::hypot(u_m, place_B_m[2]);
    const double shin_m =
        delta.knee_end_m + delta.platform_end_m + std::sqrt(std::max(shin2_m2, 0.0));
    const double cosine_knee =
        (reach_m * reach_m + delta.thigh_m * delta.thigh_m - shin_m * shin_m) /
        (2.0 * delta.thigh_m * reach_m);
    if (!(shin2_m2 > 0.0) || !(std::abs(cosine_knee) < 1.0)) {
      return "leg " + std::to_string(leg + 1) + " can't reach it";
    }
    const double angle_rad = std::atan2(place_B_m[2], u_m) - std::acos(cosine_knee);
    if (angle_rad < delta.joint_min_rad || angle_rad > delta.joint_max_rad) {
      return "leg " + std::to_string(leg + 1) + " would be at " + number_text(angle_rad) +
             " rad, beyond delta.joint_min_rad and joint_max_rad";
    }
  }
  return {};
}

/// A grid over the whole box, because the surfaces that bound a delta's workspace have dents.
void require_reachable_workspace(const Table& table, const DeviceProfile::Limits& limits,
                                 const DeviceProfile::Delta& delta) {
  constexpr int kSteps = 8;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      for (int k = 0; k <= kSteps; ++k) {
        const auto along = [&](std::size_t axis, int step) {
          return limits.workspace_min_m[axis] +
                 (limits.workspace_max_m[axis] - limits.workspace_min_m[axis]) * step / kSteps;
        };
        const Axes place_D_m = {along(0, i), along(1, j), along(2, k)};
        const std::string obstacle =
            obstacle_at(delta, {place_D_m[1] + delta.center_m[0], place_D_m[2] + delta.center_m[1],
                                place_D_m[0] + delta.center_m[2]});
        if (!obstacle.empty()) {
          table.refuse("workspace_max_m",
                       "the knob can't be at (" + number_text(place_D_m[0]) + ", " +
                           number_text(place_D_m[1]) + ", " + number_text(place_D_m[2]) +
                           ") of the workspace: " + obstacle,
                       "write a smaller box, or correct delta.center_m or the mechanism");
        }
      }
    }
  }
}

DeviceProfile::Limits read_limits(const Table& root, const DeviceProfile& profile) {
  const Table table =
      root.table("limits", {"max_force_N", "max_force_rate_N_per_s", "max_joint_torque_Nm",
                            "max_stiffness_N_per_m", "max_damping_N_s_per_m", "max_speed_m_per_s",
                            "max_joint_speed_rad_per_s", "max_joint_acceleration_rad_per_s2",
                            "workspace_min_m", "workspace_max_m"});
  DeviceProfile::Limits limits;
  limits.max_force_N = table.number("max_force_N", kForce_N);
  limits.max_force_rate_N_per_s = table.number("max_force_rate_N_per_s", kForceRate_N_per_s);
  limits.max_joint_torque_Nm = table.axes("max_joint_torque_Nm", kJointTorque_Nm);
  limits.max_stiffness_N_per_m = table.number("max_stiffness_N_per_m", kStiffness_N_per_m);
  limits.max_damping_N_s_per_m = table.number("max_damping_N_s_per_m", kMaxDamping_N_s_per_m);
  limits.max_speed_m_per_s = table.number("max_speed_m_per_s", kSpeed_m_per_s);
  limits.max_joint_speed_rad_per_s = table.axes("max_joint_speed_rad_per_s", kJointSpeed_rad_per_s);
  limits.max_joint_acceleration_rad_per_s2 =
      table.axes("max_joint_acceleration_rad_per_s2", kJointAcceleration_rad_per_s2);
  limits.workspace_min_m = table.axes("workspace_min_m", kPlace_m);
  limits.workspace_max_m = table.axes("workspace_max_m", kPlace_m);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(limits.workspace_min_m[i] < limits.workspace_max_m[i])) {
      table.refuse("workspace_max_m",
                   number_text(limits.workspace_max_m[i]) + " in place " + std::to_string(i + 1) +
                       " is not above workspace_min_m",
                   "write a larger coordinate here or a smaller one there");
    }
  }
  if (profile.kind == DeviceKind::kDelta) {
    const double most_Nm = profile.falcon.command_limit / profile.falcon.torque_gain_per_Nm;
    for (std::size_t i = 0; i < 3; ++i) {
      if (limits.max_joint_torque_Nm[i] > most_Nm) {
        table.refuse("max_joint_torque_Nm",
                     number_text(limits.max_joint_torque_Nm[i]) + " in place " +
                         std::to_string(i + 1) + " needs a command above falcon.command_limit",
                     "write at most command_limit / torque_gain_per_Nm, " + number_text(most_Nm));
      }
    }
    require_reachable_workspace(table, limits, profile.delta);
  } else {
    require_reachable_workspace(table, limits, profile.kinematics);
  }
  return limits;
}

DeviceProfile::Calibration read_calibration(const Table& root,
                                            const DeviceProfile::Kinematics& kinematics) {
  const Table table = root.table("calibration", {"pose_counts", "instruction"});
  DeviceProfile::Calibration calibration;
  calibration.pose_counts = counters(table, "pose_counts");
  calibration.instruction = table.text("instruction");
  double elbow_rad = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double joint_rad = kinematics.encoder_sign[i] * 2.0 * std::numbers::pi *
                             calibration.pose_counts[i] / kinematics.encoder_counts_per_turn[i] *
                             kinematics.capstan_diameter_m[i] / kinematics.body_diameter_m[i];
    if (joint_rad < kinematics.joint_min_rad[i] || joint_rad > kinematics.joint_max_rad[i]) {
      table.refuse("pose_counts",
                   std::string("joint ") + kJointNames[i] + " would be at " +
                       number_text(joint_rad) + " rad, beyond its hard stops",
                   "write the counts of a pose between kinematics.joint_min_rad and "
                   "joint_max_rad");
    }
    if (i > 0) {
      elbow_rad += kinematics.linkage_offset_rad[i] + kinematics.linkage_sign[i] * joint_rad;
    }
  }
  if (elbow_rad < kinematics.elbow_min_rad || elbow_rad > kinematics.elbow_max_rad) {
    table.refuse("pose_counts",
                 "the angle between the links would be " + number_text(elbow_rad) +
                     " rad, beyond its hard stops",
                 "write the counts of a pose between kinematics.elbow_min_rad and elbow_max_rad");
  }
  return calibration;
}

DeviceProfile::Gravity read_gravity(const Table& root,
                                    const DeviceProfile::Kinematics& kinematics) {
  const Table table =
      root.table("gravity", {"acceleration_m_per_s2", "link_b_mass_kg", "link_c_mass_kg",
                             "link_b_center_m", "link_c_center_m", "balanced"});
  DeviceProfile::Gravity gravity;
  gravity.acceleration_m_per_s2 = table.number("acceleration_m_per_s2", kAcceleration_m_per_s2);
  gravity.link_b_mass_kg = table.number("link_b_mass_kg", kLinkMass_kg);
  gravity.link_c_mass_kg = table.number("link_c_mass_kg", kLinkMass_kg);
  // A centre of mass behind the joint (a counterweight) is negative.
  const auto center_m = [&](const char* key, double length_m) {
    const std::string words = "a distance in metres from " + number_text(-length_m) + " to " +
                              number_text(length_m) + ", the length of the link";
    return table.number(key, {-length_m, length_m, words.c_str()});
  };
  gravity.link_b_center_m = center_m("link_b_center_m", kinematics.link_length_m[1]);
  gravity.link_c_center_m = center_m("link_c_center_m", kinematics.link_length_m[2]);
  gravity.balanced = table.flag("balanced");
  return gravity;
}

Table dynamics_table(const Table& root, DeviceKind kind) {
  return kind == DeviceKind::kDelta
             ? root.table("dynamics",
                          {"tip_mass_kg", "joint_inertia_kg_m2", "coulomb_friction_Nm",
                           "coulomb_smoothing_s_per_rad", "viscous_friction_Nm_s_per_rad",
                           "stop_stiffness_Nm_per_rad", "stop_damping_Nm_s_per_rad",
                           "knob_stop_stiffness_N_per_m", "knob_stop_damping_N_s_per_m"})
             : root.table("dynamics",
                          {"tip_mass_kg", "joint_inertia_kg_m2", "coulomb_friction_Nm",
                           "coulomb_smoothing_s_per_rad", "viscous_friction_Nm_s_per_rad",
                           "stop_stiffness_Nm_per_rad", "stop_damping_Nm_s_per_rad"});
}

DeviceProfile::Dynamics read_dynamics(const Table& root, DeviceKind kind) {
  const Table table = dynamics_table(root, kind);
  DeviceProfile::Dynamics dynamics;
  dynamics.tip_mass_kg = table.number("tip_mass_kg", kTipMass_kg);
  dynamics.joint_inertia_kg_m2 = table.number("joint_inertia_kg_m2", kInertia_kg_m2);
  dynamics.coulomb_friction_Nm = table.axes_or_number("coulomb_friction_Nm", kCoulomb_Nm);
  dynamics.coulomb_smoothing_s_per_rad =
      table.number("coulomb_smoothing_s_per_rad", kSmoothing_s_per_rad);
  dynamics.viscous_friction_Nm_s_per_rad =
      table.axes_or_number("viscous_friction_Nm_s_per_rad", kViscous_Nm_s_per_rad);
  dynamics.stop_stiffness_Nm_per_rad =
      table.number("stop_stiffness_Nm_per_rad", kStopStiffness_Nm_per_rad);
  dynamics.stop_damping_Nm_s_per_rad =
      table.number("stop_damping_Nm_s_per_rad", kStopDamping_Nm_s_per_rad);
  if (kind == DeviceKind::kDelta) {
    dynamics.knob_stop_stiffness_N_per_m =
        table.number("knob_stop_stiffness_N_per_m", kKnobStopStiffness_N_per_m);
    dynamics.knob_stop_damping_N_s_per_m =
        table.number("knob_stop_damping_N_s_per_m", kMaxDamping_N_s_per_m);
  }
  return dynamics;
}

HandProfile read_hand(const Table& root, const char* key) {
  const Table table =
      root.table(key, {"mass_kg", "damping_N_s_per_m", "stiffness_N_per_m", "source"});
  HandProfile hand;
  hand.mass_kg = table.number("mass_kg", kHandMass_kg);
  hand.damping_N_s_per_m = table.number("damping_N_s_per_m", kHandDamping_N_s_per_m);
  hand.stiffness_N_per_m = table.number("stiffness_N_per_m", kStiffness_N_per_m);
  hand.source = table.text("source");
  return hand;
}

const text::DataFolder& profile_folder() {
  static const text::DataFolder folder{"FORCEGRID_PROFILE_PATH", "profiles",
                                       FORCEGRID_PROFILE_SOURCE_DIR};
  return folder;
}

std::string find_file(const std::string& name_or_path) {
  if (text::is_data_path(name_or_path)) {
    return name_or_path;
  }
  const std::string file = text::find_data_file(profile_folder(), name_or_path);
  if (file.empty()) {
    throw ProfileError("device profile '" + name_or_path + "': unknown; write one of: " +
                       joined(available_profiles()) + ", or a file name that ends in .toml");
  }
  return file;
}

DeviceProfile read_profile(const toml::table& parsed, const std::string& file) {
  const DeviceKind kind = read_kind(parsed, file);
  const Table root = kind == DeviceKind::kDelta
                         ? Table(parsed, file, "",
                                 {"name", "description", "source", "kind", "usb", "delta", "falcon",
                                  "limits", "dynamics", "firm_hand", "light_hand"})
                         : Table(parsed, file, "",
                                 {"name", "description", "source", "kind", "usb", "kinematics",
                                  "gimbal", "gimbal_motors", "motors", "limits", "calibration",
                                  "gravity", "dynamics", "firm_hand", "light_hand"});
  DeviceProfile profile;
  profile.file = file;
  profile.name = root.text("name");
  profile.description = root.text("description");
  profile.source = root.text("source");
  profile.kind = kind;
  profile.usb = read_usb(root, kind);
  if (kind == DeviceKind::kDelta) {
    profile.delta = read_delta(root);
    profile.falcon = read_falcon(root, profile.delta);
    profile.limits = read_limits(root, profile);
  } else {
    profile.kinematics = read_kinematics(root);
    profile.motors = read_motors(root);
    profile.limits = read_limits(root, profile);
    profile.calibration = read_calibration(root, profile.kinematics);
    profile.gimbal = read_gimbal(root, profile.calibration.pose_counts);
    profile.gimbal_motors = read_gimbal_motors(root, profile);
    profile.gravity = read_gravity(root, profile.kinematics);
  }
  profile.dynamics = read_dynamics(root, kind);
  profile.firm_hand = read_hand(root, "firm_hand");
  profile.light_hand = read_hand(root, "light_hand");
  return profile;
}

}  // namespace

HandProfile arm_hand() {
  return {1.5, 20.0, 300.0,
          "in the range of arms that keep a posture: stiffness Mussa-Ivaldi, Hogan and Bizzi, J. "
          "Neuroscience 5(10), 1985; inertia and viscosity Tsuji et al., Biol. Cybern. 72, 1995"};
}

DeviceProfile load_device_profile(const std::string& name_or_path) {
  const std::string file = find_file(name_or_path);
  const std::string why_not = text::why_no_file(file);
  if (!why_not.empty()) {
    throw ProfileError("device profile '" + file + "': " + why_not +
                       "; write the path of a profile or one of: " + joined(available_profiles()));
  }
  try {
    return read_profile(text::read_toml_file(file), file);
  } catch (const text::TomlError& problem) {
    throw ProfileError(problem.what());
  }
}

std::vector<std::string> available_profiles() { return text::data_names(profile_folder()); }

}  // namespace forcegrid::profiles
