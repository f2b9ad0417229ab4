// SPDX-License-Identifier: Apache-2.0
#include "profiles/gimbal_profile.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "text/text.h"

namespace forcegrid::profiles {
namespace {

using text::number_text;
using Table = text::TomlTable;
using Range = text::NumberRange;

constexpr int kFirstCounter = 3;  // d
constexpr double kButtonCounts = 5000.0;
constexpr std::int64_t kMostCounts = 10'000'000;
constexpr Range kWristSign{-1.0, 1.0, "1 or -1"};
constexpr Range kWristAngle_rad{-2.0 * std::numbers::pi, 2.0 * std::numbers::pi,
                                "an angle in radians from -2 pi to 2 pi"};
constexpr Range kWristSpeed_rad_per_s{text::kAboveZero, 1000.0,
                                      "a speed in rad/s above 0 and at most 1000"};
constexpr Range kWristAcceleration_rad_per_s2{text::kAboveZero, 1e6,
                                              "an acceleration in rad/s^2 above 0 and at most 1e6"};

constexpr Range kWristTorqueConstant_Nm_per_A{1e-4, 10.0,
                                              "a torque constant in N m/A from 0.0001 to 10"};
constexpr Range kRatio{1.0, 1000.0, "motor turns of one turn of the joint, from 1 to 1000"};
constexpr Range kWristCurrent_A{text::kAboveZero, 32.0,
                                "a current in amperes above 0 and at most 32"};
constexpr Range kWristTorque_Nm{text::kAboveZero, 10.0, "a torque in N m above 0 and at most 10"};
constexpr Range kTorqueRate_Nm_per_s{text::kAboveZero, 1e4,
                                     "a rate in N m/s above 0 and at most 1e4"};
constexpr Range kWristInertia_kg_m2{1e-7, 0.1, "an inertia in kg m^2 from 1e-7 to 0.1"};
constexpr Range kWristDamping_Nm_s_per_rad{0.0, 10.0, "a damping in N m s/rad from 0 to 10"};
constexpr Range kWristStiffness_Nm_per_rad{text::kAboveZero, 100.0,
                                           "a stiffness in N m/rad above 0 and at most 100"};

std::string at(std::size_t i) { return " in place " + std::to_string(i + 1); }

/// Which counters measure the joints: each of d, e, f once, as "fed".
std::array<int, 3> read_counters(const Table& table) {
  const std::string letters = table.text("counters");
  std::string sorted = letters;
  std::sort(sorted.begin(), sorted.end());
  if (sorted != "def") {
    table.refuse("counters", "'" + letters + "' is not d, e and f in some order",
                 "write the report's counters of the three joints from the arm outward, as "
                 "\"fed\"");
  }
  std::array<int, 3> result{};
  std::transform(letters.begin(), letters.end(), result.begin(),
                 [](char letter) { return letter - 'd' + kFirstCounter; });
  return result;
}

/// Axes of the joints, as "xyx". Two parallel ones in a row would be one joint.
std::array<int, 3> read_axes(const Table& table) {
  const std::string letters = table.text("axes");
  if (letters.size() != 3 || letters.find_first_not_of("xyz") != std::string::npos ||
      letters[0] == letters[1] || letters[1] == letters[2]) {
    table.refuse("axes", "'" + letters + "' is no wrist",
                 "write the three joints' axes from the arm outward, as \"xyx\": each x, y or z, "
                 "and not that of the joint before");
  }
  std::array<int, 3> result{};
  std::transform(letters.begin(), letters.end(), result.begin(),
                 [](char letter) { return letter - 'x'; });
  return result;
}

Axes read_counts_per_turn(const Table& table) {
  const std::vector<std::int64_t> counts =
      table.integers("encoder_counts_per_turn", 3, 0, kMostCounts);
  Axes result{};
  for (std::size_t i = 0; i < 3; ++i) {
    if (counts[i] == 0) {
      table.refuse("encoder_counts_per_turn", "0" + at(i) + " is a wrist without an encoder",
                   "write how many counts one turn of the joint gives, or leave [gimbal] out: the "
                   "tool's orientation is then not known");
    }
    result[i] = static_cast<double>(counts[i]);
  }
  return result;
}

Axes read_signs(const Table& table) {
  const Axes result = table.axes("encoder_sign", kWristSign);
  for (std::size_t i = 0; i < 3; ++i) {
    if (std::abs(result[i]) != 1.0) {
      table.refuse("encoder_sign", number_text(result[i]) + at(i) + " is no sign", "write 1 or -1");
    }
  }
  return result;
}

void check_stops(const Table& table, const DeviceProfile::Gimbal& gimbal,
                 const std::array<int, 6>& pose_counts) {
  for (std::size_t i = 0; i < 3; ++i) {
    const double min_rad = gimbal.joint_min_rad[i];
    const double max_rad = gimbal.joint_max_rad[i];
    if (!(min_rad < max_rad)) {
      table.refuse("joint_max_rad",
                   number_text(max_rad) + at(i) + " is not above joint_min_rad (" +
                       number_text(min_rad) + ")",
                   "write a larger angle here or a smaller one there");
    }
    const double rad_per_count = 2.0 * std::numbers::pi / gimbal.encoder_counts_per_turn[i];
    const double pose_rad = gimbal.encoder_sign[i] * rad_per_count *
                            pose_counts.at(static_cast<std::size_t>(gimbal.counter[i]));
    if (pose_rad < min_rad || pose_rad > max_rad) {
      table.refuse(pose_rad < min_rad ? "joint_min_rad" : "joint_max_rad",
                   "the joint" + at(i) + " would be at " + number_text(pose_rad) +
                       " rad in the calibration pose, beyond its hard stops",
                   "write stops around it, or correct calibration.pose_counts");
    }
    const double most_counts = std::max(std::abs(min_rad), std::abs(max_rad)) / rad_per_count;
    if (gimbal.stylus_button && gimbal.counter[i] == kFirstCounter &&
        !(most_counts < kButtonCounts)) {
      table.refuse("stylus_button",
                   "counter d reaches " + number_text(std::ceil(most_counts)) +
                       " at a hard stop, and from 5000 on it means that the button is pressed",
                   "write false, or closer stops for the joint" + at(i));
    }
  }
}

}  // namespace

DeviceProfile::Gimbal read_gimbal(const Table& root, const std::array<int, 6>& pose_counts) {
  DeviceProfile::Gimbal gimbal;
  if (!root.has("gimbal")) {
    return gimbal;
  }
  const Table table =
      root.table("gimbal", {"counters", "axes", "encoder_counts_per_turn", "encoder_sign",
                            "joint_min_rad", "joint_max_rad", "max_joint_speed_rad_per_s",
                            "max_joint_acceleration_rad_per_s2", "stylus_button"});
  gimbal.present = true;
  gimbal.counter = read_counters(table);
  gimbal.axis = read_axes(table);
  gimbal.encoder_counts_per_turn = read_counts_per_turn(table);
  gimbal.encoder_sign = read_signs(table);
  gimbal.joint_min_rad = table.axes("joint_min_rad", kWristAngle_rad);
  gimbal.joint_max_rad = table.axes("joint_max_rad", kWristAngle_rad);
  gimbal.max_joint_speed_rad_per_s = table.axes("max_joint_speed_rad_per_s", kWristSpeed_rad_per_s);
  gimbal.max_joint_acceleration_rad_per_s2 =
      table.axes("max_joint_acceleration_rad_per_s2", kWristAcceleration_rad_per_s2);
  gimbal.stylus_button = table.flag("stylus_button");
  check_stops(table, gimbal, pose_counts);
  return gimbal;
}

DeviceProfile::GimbalMotors read_gimbal_motors(const Table& root, const DeviceProfile& profile) {
  DeviceProfile::GimbalMotors motors;
  motors.present = root.has("gimbal_motors");
  if (motors.present != (profile.usb.protocol == "w6")) {
    root.refuse(motors.present ? "gimbal_motors" : "usb",
                motors.present
                    ? "reports of protocol '" + profile.usb.protocol + "' have no currents for them"
                    : "protocol 'w6' has currents for motors of a wrist, and there is no "
                      "[gimbal_motors]",
                "write protocol \"w6\" and [gimbal_motors], or neither");
  }
  if (!motors.present) {
    return motors;
  }
  const Table table = root.table(
      "gimbal_motors",
      {"torque_constant_Nm_per_A", "ratio", "max_current_A", "max_joint_torque_Nm", "max_torque_Nm",
       "max_torque_rate_Nm_per_s", "joint_inertia_kg_m2", "joint_damping_Nm_s_per_rad",
       "hand_stiffness_Nm_per_rad", "hand_damping_Nm_s_per_rad"});
  if (!profile.gimbal.present) {
    root.refuse("gimbal_motors", "there is no [gimbal] that they could turn",
                "describe the wrist in [gimbal], or leave [gimbal_motors] out");
  }
  motors.torque_constant_Nm_per_A =
      table.axes("torque_constant_Nm_per_A", kWristTorqueConstant_Nm_per_A);
  motors.ratio = table.axes("ratio", kRatio);
  motors.max_current_A = table.axes("max_current_A", kWristCurrent_A);
  for (std::size_t i = 0; i < 3; ++i) {
    if (motors.max_current_A[i] > profile.motors.full_scale_current_A) {
      table.refuse(
          "max_current_A",
          number_text(motors.max_current_A[i]) + at(i) + " is above motors.full_scale_current_A",
          "write at most " + number_text(profile.motors.full_scale_current_A));
    }
  }
  motors.max_joint_torque_Nm = table.axes("max_joint_torque_Nm", kWristTorque_Nm);
  motors.max_torque_Nm = table.number("max_torque_Nm", kWristTorque_Nm);
  motors.max_torque_rate_Nm_per_s = table.number("max_torque_rate_Nm_per_s", kTorqueRate_Nm_per_s);
  motors.joint_inertia_kg_m2 = table.number("joint_inertia_kg_m2", kWristInertia_kg_m2);
  motors.joint_damping_Nm_s_per_rad =
      table.number("joint_damping_Nm_s_per_rad", kWristDamping_Nm_s_per_rad);
  motors.hand_stiffness_Nm_per_rad =
      table.number("hand_stiffness_Nm_per_rad", kWristStiffness_Nm_per_rad);
  motors.hand_damping_Nm_s_per_rad =
      table.number("hand_damping_Nm_s_per_rad", kWristDamping_Nm_s_per_rad);
  return motors;
}

}  // namespace forcegrid::profiles
