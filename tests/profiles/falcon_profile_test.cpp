// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>

#include "profiles/device_profile.h"

namespace forcegrid::profiles {
namespace {

using testing::HasSubstr;

constexpr double kDegree_rad = std::numbers::pi / 180.0;

TEST(FalconProfile, HoldsTheNumbersOfTheSheet) {
  const DeviceProfile profile = load_device_profile("falcon");
  EXPECT_EQ(profile.name, "falcon");
  EXPECT_EQ(profile.kind, DeviceKind::kDelta);
  EXPECT_EQ(profile.usb.protocol, "falcon");
  EXPECT_EQ(profile.usb.vendor_id, 0x0403);
  EXPECT_EQ(profile.usb.product_id, 0xCB48);
  EXPECT_EQ(profile.usb.product, "FALCON HAPTIC");
  EXPECT_EQ(profile.usb.frame_period_us, 1000);
  const DeviceProfile::Delta& delta = profile.delta;
  EXPECT_EQ(delta.thigh_m, 0.060);
  EXPECT_EQ(delta.shin_m, 0.1025);
  EXPECT_EQ(delta.platform_offset_u_m, 0.01443);
  EXPECT_EQ(delta.knee_end_m + delta.platform_end_m, 0.0225);
  EXPECT_EQ(delta.platform_offset_v_m, -0.025);
  EXPECT_EQ(delta.base_offset_u_m, 0.0400);
  EXPECT_EQ(delta.base_offset_v_m, -0.02309);
  EXPECT_NEAR(delta.leg_azimuth_rad[0], 105.0 * kDegree_rad, 1e-15);
  EXPECT_NEAR(delta.leg_azimuth_rad[1], -15.0 * kDegree_rad, 1e-15);
  EXPECT_NEAR(delta.leg_azimuth_rad[2], -135.0 * kDegree_rad, 1e-15);
  // 1280 counts per motor turn, reduced from 110 mm to 14.25 mm.
  EXPECT_NEAR(delta.encoder_rad_per_count, 2.0 * std::numbers::pi / 1280.0 * 14.25 / 110.0, 1e-18);
  EXPECT_NEAR(delta.zero_angle_rad, 35.0 * kDegree_rad, 1e-15);
  EXPECT_EQ(profile.falcon.torque_gain_per_Nm, 10000.0);
  EXPECT_EQ(profile.falcon.command_limit, 4095);
  EXPECT_EQ(profile.limits.max_force_N, 8.0);
  EXPECT_EQ(profile.limits.max_stiffness_N_per_m, 3000.0);
  EXPECT_EQ(profile.limits.max_damping_N_s_per_m, 20.0);
}

TEST(FalconProfile, AnArmIsAnArmWithOrWithoutSayingSo) {
  EXPECT_EQ(load_device_profile("woodenhaptics_v2015").kind, DeviceKind::kArm);
}

struct Broken {
  const char* old_text;  ///< occurs once in the profile
  const char* new_text;
  const char* key;    ///< the error must name it
  const char* words;  ///< and say this
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
void PrintTo(const Broken& broken, std::ostream* stream) {
  *stream << "'" << broken.old_text << "' -> '" << broken.new_text << "'";
}

class BrokenFalconProfile : public testing::TestWithParam<Broken> {};

TEST_P(BrokenFalconProfile, IsRefusedWithFileLineAndKey) {
  const Broken& broken = GetParam();
  std::ostringstream text;
  text << std::ifstream(load_device_profile("falcon").file).rdbuf();
  std::string edited = text.str();
  const std::size_t at = edited.find(broken.old_text);
  ASSERT_NE(at, std::string::npos);
  ASSERT_EQ(edited.find(broken.old_text, at + 1), std::string::npos);
  edited.replace(at, std::string(broken.old_text).size(), broken.new_text);
  const std::string file =
      testing::TempDir() + "forcegrid_falcon_" + std::to_string(::getpid()) + ".toml";
  std::ofstream(file) << edited;
  std::string error;
  try {
    load_device_profile(file);
  } catch (const ProfileError& problem) {
    error = problem.what();
  }
  std::remove(file.c_str());
  EXPECT_THAT(error, HasSubstr(file + ":"));
  EXPECT_THAT(error, HasSubstr("key '" + std::string(broken.key) + "': "));
  EXPECT_THAT(error, HasSubstr(broken.words));
  EXPECT_THAT(error, HasSubstr("; write "));
}

INSTANTIATE_TEST_SUITE_P(
    Edits, BrokenFalconProfile,
    testing::Values(
        Broken{"kind = \"delta\"", "kind = \"dleta\"", "kind", "'dleta' is unknown"},
        Broken{"kind = \"delta\"", "kind = 3", "kind", "is unknown"},
        Broken{"kind = \"delta\"", "kind = \"arm\"", "delta", "unknown table"},
        Broken{"kind = \"delta\"", "", "delta", "unknown table"},
        Broken{"protocol = \"falcon\"", "protocol = \"w2\"", "usb.protocol", "'w2' is unknown"},
        Broken{"vendor_id = 0x0403", "vendor_id = 0x0403\nusage = 1", "usb.usage", "unknown key"},
        Broken{"frame_period_us = 1000", "frame_period_us = 125", "usb.frame_period_us",
               "125 is impossible"},
        Broken{"thigh_m = 0.060", "thigh_m = 60", "delta.thigh_m", "60 is impossible"},
        Broken{"shin_m = 0.1025", "", "delta.shin_m", "missing"},
        Broken{"shin_m = 0.1025", "shin_m = 0.0725", "limits.workspace_max_m", "leg 1"},
        Broken{"platform_offset_v_m = -0.025", "platform_offset_v_m = nan",
               "delta.platform_offset_v_m", "not finite"},
        Broken{"leg_azimuth_rad = [1.8325957145940461, ", "leg_azimuth_rad = [105, ",
               "delta.leg_azimuth_rad", "105 in place 1 is impossible"},
        Broken{"encoder_rad_per_count = 6.359047629780477e-4", "encoder_rad_per_count = 0.0",
               "delta.encoder_rad_per_count", "0 is impossible"},
        Broken{"joint_max_rad = 1.60", "joint_max_rad = -0.8", "delta.joint_max_rad",
               "not above joint_min_rad"},
        Broken{"joint_max_rad = 1.60", "joint_max_rad = 1.30", "limits.workspace_max_m",
               "beyond delta.joint_min_rad and joint_max_rad"},
        Broken{"joint_min_rad = -0.80", "joint_min_rad = 0.20", "falcon.homing_in_rad",
               "beyond a hard stop"},
        Broken{"homing_out_rad = 1.0471975511965976", "homing_out_rad = 1.70",
               "falcon.homing_out_rad", "beyond a hard stop"},
        Broken{"homing_out_rad = 1.0471975511965976", "homing_out_rad = 0.1",
               "falcon.homing_out_rad", "not above homing_in_rad"},
        Broken{"knob_max_z_m = 0.175", "knob_max_z_m = 0.075", "delta.knob_max_z_m",
               "not above knob_min_z_m"},
        Broken{"knob_max_z_m = 0.175", "knob_max_z_m = 0.140", "limits.workspace_max_m",
               "delta.knob_min_z_m and knob_max_z_m cut it off"},
        Broken{"knob_max_radius_m = 0.060", "knob_max_radius_m = 0.050", "limits.workspace_max_m",
               "delta.knob_max_radius_m cuts it off"},
        Broken{"torque_gain_per_Nm = 10000.0", "torque_gain_per_Nm = -10000.0",
               "falcon.torque_gain_per_Nm", "-10000 is impossible"},
        Broken{"command_limit = 4095", "command_limit = 40950", "falcon.command_limit",
               "40950 is impossible"},
        Broken{"command_limit = 4095", "command_limit = 4000", "limits.max_joint_torque_Nm",
               "above falcon.command_limit"},
        Broken{"center_m = [0.0, 0.0, 0.120]", "center_m = [0.0, 0.0, 0.140]",
               "limits.workspace_max_m", "beyond delta.joint_min_rad and joint_max_rad"},
        Broken{"knob_stop_stiffness_N_per_m = 100000.0", "knob_stop_stiffness_N_per_m = 0",
               "dynamics.knob_stop_stiffness_N_per_m", "impossible"},
        Broken{"homing_instruction = \"Pull", "homing_instruction = \"\" # \"Pull",
               "falcon.homing_instruction", "0 characters"}));

}  // namespace
}  // namespace forcegrid::profiles
