// SPDX-License-Identifier: Apache-2.0
#include "profiles/gimbal_profile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <numbers>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

namespace forcegrid::profiles {
namespace {

using testing::HasSubstr;

constexpr const char* kWrist = "woodenhaptics_v2015_wrist";
constexpr const char* kDriven = "emulated_6dof";
constexpr const char* kPhantom = "phantom_desktop_wrist";

std::vector<std::string> lines_of(const std::string& profile) {
  std::ifstream stream(load_device_profile(profile).file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) {
    lines.push_back(line);
  }
  return lines;
}

std::string written(const std::vector<std::string>& lines) {
  const std::string file =
      testing::TempDir() + "gimbal_profile_" + std::to_string(getpid()) + ".toml";
  std::ofstream stream(file);
  for (const std::string& line : lines) {
    stream << line << '\n';
  }
  return file;
}

TEST(GimbalProfile, HoldsTheNumbersOfTheSheet) {
  const DeviceProfile profile = load_device_profile(kWrist);
  ASSERT_TRUE(has_wrist(profile));
  // "Rotation encoders are consumed by the host in reverse order: (f, e, d)"; Rx(D) Ry(E) Rx(F).
  EXPECT_EQ(profile.gimbal.counter, (std::array<int, 3>{5, 4, 3}));
  EXPECT_EQ(profile.gimbal.axis, (std::array<int, 3>{0, 1, 0}));
  EXPECT_EQ(profile.gimbal.encoder_counts_per_turn, (Axes{1024, 1024, 1024}));
  EXPECT_TRUE(profile.gimbal.stylus_button);
}

TEST(GimbalProfile, HoldsTheGimbalOfThePhantomsSources) {
  const DeviceProfile profile = load_device_profile(kPhantom);
  ASSERT_TRUE(has_wrist(profile));
  // Yaw about the forearm, pitch across it, roll about the stylus; ranges of touch.urdf: from -2.51
  // to 2.55, 2.46 from in line with the forearm, 2.61 to either side.
  EXPECT_EQ(profile.gimbal.axis, (std::array<int, 3>{0, 1, 0}));
  EXPECT_EQ(profile.gimbal.joint_min_rad, (Axes{-2.51, -2.46, -2.61}));
  EXPECT_EQ(profile.gimbal.joint_max_rad, (Axes{2.55, 0.0, 2.61}));
  EXPECT_EQ(profile.gimbal.counter, (std::array<int, 3>{3, 4, 5}));
  EXPECT_TRUE(profile.gimbal.stylus_button);
  EXPECT_FALSE(profile.gimbal_motors.present);
  for (std::size_t i = 0; i < 3; ++i) {
    // A converter of 10 bits has 1023 steps, and one more count a turn would need more of them.
    const double range_turns = (profile.gimbal.joint_max_rad[i] - profile.gimbal.joint_min_rad[i]) /
                               (2.0 * std::numbers::pi);
    EXPECT_LE(profile.gimbal.encoder_counts_per_turn[i] * range_turns, 1023.0) << i;
    EXPECT_GT((profile.gimbal.encoder_counts_per_turn[i] + 1) * range_turns, 1023.0) << i;
  }
  // Level: a quarter turn from in line with the forearm.
  EXPECT_EQ(4 * profile.calibration.pose_counts[4], -profile.gimbal.encoder_counts_per_turn[1]);
}

TEST(GimbalProfile, IsTheArmWithoutAWristOtherwise) {
  for (const auto& [with_name, without_name] :
       {std::pair{kWrist, "woodenhaptics_v2015"}, std::pair{kPhantom, "phantom_desktop"}}) {
    SCOPED_TRACE(with_name);
    const DeviceProfile with = load_device_profile(with_name);
    const DeviceProfile without = load_device_profile(without_name);
    EXPECT_EQ(with.kinematics.link_length_m, without.kinematics.link_length_m);
    EXPECT_EQ(with.kinematics.origin_m, without.kinematics.origin_m);
    EXPECT_EQ(with.kinematics.linkage_sign, without.kinematics.linkage_sign);
    EXPECT_EQ(with.kinematics.joint_min_rad, without.kinematics.joint_min_rad);
    EXPECT_EQ(with.kinematics.joint_max_rad, without.kinematics.joint_max_rad);
    EXPECT_EQ(with.motors.torque_constant_Nm_per_A, without.motors.torque_constant_Nm_per_A);
    EXPECT_EQ(with.motors.max_current_A, without.motors.max_current_A);
    EXPECT_EQ(with.limits.max_joint_torque_Nm, without.limits.max_joint_torque_Nm);
    EXPECT_EQ(with.limits.max_force_N, without.limits.max_force_N);
    EXPECT_EQ(with.dynamics.tip_mass_kg, without.dynamics.tip_mass_kg);
    for (std::size_t i = 0; i < 3; ++i) {  // of the arm
      EXPECT_EQ(with.calibration.pose_counts[i], without.calibration.pose_counts[i]);
    }
    EXPECT_EQ(with.usb.vendor_id, without.usb.vendor_id);
    EXPECT_EQ(with.usb.product_id, without.usb.product_id);
  }
  EXPECT_NE(load_device_profile(kPhantom).usb.product,
            load_device_profile("phantom_desktop").usb.product);
}

TEST(GimbalProfile, IsAbsentFromEveryOtherDevice) {
  for (const std::string& name : available_profiles()) {
    if (name != kWrist && name != kDriven && name != kPhantom) {
      EXPECT_FALSE(has_wrist(load_device_profile(name))) << name;
    }
  }
}

TEST(GimbalProfile, BelongsToAnArm) {
  std::vector<std::string> lines = lines_of("falcon");
  lines.emplace_back("[gimbal]");
  try {
    static_cast<void>(load_device_profile(written(lines)));
    ADD_FAILURE() << "a delta with a wrist was accepted";
  } catch (const ProfileError& error) {
    EXPECT_THAT(error.what(), HasSubstr("gimbal"));
  }
}

TEST(GimbalProfile, HasMotorsWithTheReportsThatCarryTheirCurrents) {
  const DeviceProfile driven = load_device_profile(kDriven);
  EXPECT_EQ(driven.usb.protocol, "w6");
  EXPECT_EQ(driven.usb.report_bytes, 20);
  ASSERT_TRUE(driven.gimbal_motors.present);
  EXPECT_EQ(driven.gimbal_motors.max_torque_Nm, 0.188);
  EXPECT_FALSE(load_device_profile(kWrist).gimbal_motors.present);
  const auto error_of = [](const std::vector<std::string>& lines) -> std::string {
    try {
      static_cast<void>(load_device_profile(written(lines)));
    } catch (const ProfileError& error) {
      return error.what();
    }
    return "accepted";
  };
  std::vector<std::string> lines = lines_of(kDriven);
  const auto motors = std::find(lines.begin(), lines.end(), "[gimbal_motors]");
  auto current = std::find_if(motors, lines.end(), [](const std::string& line) {
    return line.starts_with("max_current_A");
  });
  ASSERT_NE(current, lines.end());
  *current = "max_current_A = [1.0, 7.0, 1.0]";
  EXPECT_THAT(error_of(lines), HasSubstr("7 in place 2 is above motors.full_scale_current_A"));

  lines = lines_of(kDriven);
  std::replace(lines.begin(), lines.end(), std::string("protocol = \"w6\""),
               std::string("protocol = \"w2\""));
  std::replace(lines.begin(), lines.end(), std::string("report_bytes = 20"),
               std::string("report_bytes = 14"));
  EXPECT_THAT(error_of(lines), HasSubstr("reports of protocol 'w2' have no currents for them"));

  lines = lines_of(kWrist);
  std::replace(lines.begin(), lines.end(), std::string("protocol = \"w2\""),
               std::string("protocol = \"w6\""));
  std::replace(lines.begin(), lines.end(), std::string("report_bytes = 14"),
               std::string("report_bytes = 20"));
  EXPECT_THAT(error_of(lines), HasSubstr("there is no [gimbal_motors]"));
}

struct Broken {
  const char* key;    ///< the line of [gimbal] that is replaced, and the key that the error names
  const char* value;  ///< its new value
  const char* words;  ///< what the error says
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
void PrintTo(const Broken& broken, std::ostream* stream) {
  *stream << broken.key << " = " << broken.value;
}

class BrokenGimbal : public testing::TestWithParam<Broken> {};

TEST_P(BrokenGimbal, IsRefusedWithLineKeyAndRemedy) {
  const auto& [key, value, words] = GetParam();
  std::vector<std::string> lines = lines_of(kWrist);
  auto line = std::find(lines.begin(), lines.end(), "[gimbal]");
  line = std::find_if(line, lines.end(), [key = key](const std::string& text) {
    return text.starts_with(std::string(key) + " =");
  });
  ASSERT_NE(line, lines.end());
  *line = std::string(key) + " = " + value;
  const std::string file = written(lines);
  try {
    static_cast<void>(load_device_profile(file));
    ADD_FAILURE() << *line << " was accepted";
  } catch (const ProfileError& error) {
    EXPECT_THAT(error.what(), HasSubstr(file + ":" + std::to_string(line - lines.begin() + 1)));
    EXPECT_THAT(error.what(), HasSubstr(std::string("gimbal.") + key));
    EXPECT_THAT(error.what(), HasSubstr(words));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Values, BrokenGimbal,
    testing::Values(Broken{"counters", "\"fee\"", "not d, e and f in some order"},
                    Broken{"counters", "\"abc\"", "not d, e and f in some order"},
                    Broken{"axes", "\"xxy\"", "not that of the joint before"},
                    Broken{"axes", "\"xyw\"", "each x, y or z"},
                    Broken{"axes", "\"xy\"", "is no wrist"},
                    Broken{"encoder_counts_per_turn", "[1024, 0, 1024]",
                           "0 in place 2 is a wrist without an encoder; write how many counts one "
                           "turn of the joint gives, or leave [gimbal] out"},
                    Broken{"encoder_counts_per_turn", "[1024, 1024]",
                           "write three times a whole number"},
                    Broken{"encoder_sign", "[1, 0, 1]", "0 in place 2 is no sign"},
                    Broken{"joint_max_rad", "[2.6, -1.4, 3.0]", "not above joint_min_rad"},
                    Broken{"joint_min_rad", "[0.5, -1.4, -3.0]", "in the calibration pose"},
                    Broken{"max_joint_speed_rad_per_s", "[60, 0, 60]", "rad/s above 0"},
                    Broken{"max_joint_acceleration_rad_per_s2", "[3000, 1, inf]", "rad/s^2"},
                    Broken{"stylus_button", "1", "true or false"}));

TEST(GimbalProfile, HasNoButtonOnACounterThatCountsFartherThanTheButtonsMark) {
  // 8000 counts a turn: 3.0 rad are 3820 counts, 4.1 rad are 5221.
  std::vector<std::string> lines = lines_of(kWrist);
  const auto set = [&](const std::string& key, const std::string& value) {
    auto line = std::find(lines.begin(), lines.end(), "[gimbal]");
    line = std::find_if(line, lines.end(),
                        [&](const std::string& text) { return text.starts_with(key + " ="); });
    ASSERT_NE(line, lines.end());
    *line = key + " = " + value;
  };
  set("encoder_counts_per_turn", "[1024, 1024, 8000]");
  EXPECT_TRUE(load_device_profile(written(lines)).gimbal.stylus_button);
  set("joint_max_rad", "[2.6, 1.4, 4.1]");
  try {
    static_cast<void>(load_device_profile(written(lines)));
    ADD_FAILURE() << "accepted";
  } catch (const ProfileError& error) {
    EXPECT_THAT(error.what(), HasSubstr("counter d reaches 5221"));
  }
  set("stylus_button", "false");
  EXPECT_FALSE(load_device_profile(written(lines)).gimbal.stylus_button);
}

}  // namespace
}  // namespace forcegrid::profiles
