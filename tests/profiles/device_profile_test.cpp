// SPDX-License-Identifier: Apache-2.0
#include "profiles/device_profile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>

namespace forcegrid::profiles {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr std::array<const char*, 6> kNames = {"phantom_desktop",     "phantom_desktop_wrist",
                                               "polhem_v1",           "vintage",
                                               "woodenhaptics_v2015", "woodenhaptics_v2019"};

std::vector<std::string> read_lines(const fs::path& path) {
  std::ifstream stream(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) {
    lines.push_back(line);
  }
  return lines;
}

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (fs::temp_directory_path() / "forcegrid_profile_XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) {
      throw std::runtime_error("mkdtemp failed");
    }
    path_ = pattern;
  }
  ~TemporaryFolder() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  fs::path write(const std::string& name, const std::vector<std::string>& lines) const {
    std::ofstream stream(path_ / name);
    for (const std::string& line : lines) {
      stream << line << '\n';
    }
    return path_ / name;
  }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// Error text of loading `file`; a failure of the test when it loads.
std::string error_of(const std::string& file) {
  try {
    static_cast<void>(load_device_profile(file));
  } catch (const ProfileError& error) {
    return error.what();
  }
  ADD_FAILURE() << file << " was accepted";
  return "";
}

TEST(DeviceProfile, EveryShippedProfileLoadsUnderItsOwnName) {
  EXPECT_THAT(available_profiles(), testing::IsSupersetOf(kNames));
  for (const char* name : kNames) {
    const DeviceProfile profile = load_device_profile(name);
    EXPECT_EQ(profile.name, name);
    EXPECT_EQ(fs::path(profile.file).stem(), name);
    EXPECT_EQ(profile.usb.report_bytes, 14);
    EXPECT_EQ(profile.usb.usage_page, 0xFFAB);
    EXPECT_EQ(profile.usb.usage, 0x0200);
  }
}

TEST(DeviceProfile, HoldsTheNumbersOfTheSheetsTeensy) {
  const DeviceProfile profile = load_device_profile("woodenhaptics_teensy");
  EXPECT_EQ(profile.usb.protocol, "w3");
  EXPECT_EQ(profile.usb.vendor_id, 0x16C0);
  EXPECT_EQ(profile.usb.product_id, 0x0486);
  EXPECT_EQ(profile.usb.device_release, 0x0279);
  EXPECT_EQ(profile.usb.report_bytes, 64);
  EXPECT_EQ(profile.usb.usage_page, 0xFFAB);
  EXPECT_EQ(profile.usb.usage, 0x0200);
  EXPECT_EQ(profile.usb.frame_period_us, 125);
}

TEST(DeviceProfile, HoldsTheNumbersOfTheWoodenHapticsSheet) {
  const DeviceProfile profile = load_device_profile("woodenhaptics_v2015");
  EXPECT_EQ(profile.usb.vendor_id, 0x1234);
  EXPECT_EQ(profile.usb.product_id, 0x0006);
  EXPECT_EQ(profile.usb.serial, "0123456789");
  EXPECT_EQ(profile.kinematics.link_length_m, (Axes{0.080, 0.205, 0.245}));
  EXPECT_EQ(profile.kinematics.origin_m, (Axes{0.220, 0.0, 0.080}));
  EXPECT_EQ(profile.motors.torque_constant_Nm_per_A, (Axes{0.0259, 0.0259, 0.0259}));
  EXPECT_EQ(profile.motors.full_scale_current_A, 6.0);
  EXPECT_EQ(profile.motors.continuous_current_A, (Axes{1.2, 1.2, 1.2}));
  EXPECT_EQ(profile.motors.thermal_time_constant_s, 12.0);
  EXPECT_EQ(profile.limits.max_force_N, 5.0);
  EXPECT_EQ(profile.calibration.pose_counts, (std::array<int, 6>{0, 0, 6000, 0, 0, 0}));
  // Derived in the sheet: counts of a body revolution and radians a count.
  for (std::size_t i = 0; i < 3; ++i) {
    const double counts_per_revolution = profile.kinematics.encoder_counts_per_turn[i] *
                                         profile.kinematics.body_diameter_m[i] /
                                         profile.kinematics.capstan_diameter_m[i];
    EXPECT_NEAR(counts_per_revolution, i == 0 ? 32000.0 : 24000.0, 1e-6);
  }
}

TEST(DeviceProfile, HoldsTheCountsPerRevolutionOfTheOtherSheets) {
  const auto radians_per_count = [](const char* name, std::size_t axis) {
    const auto k = load_device_profile(name).kinematics;
    return 2.0 * std::numbers::pi / k.encoder_counts_per_turn[axis] * k.capstan_diameter_m[axis] /
           k.body_diameter_m[axis];
  };
  EXPECT_NEAR(radians_per_count("polhem_v1", 0), 2.0 * std::numbers::pi / 36000.0, 1e-15);
  EXPECT_NEAR(radians_per_count("polhem_v1", 1), 2.0 * std::numbers::pi / 20000.0, 1e-15);
  EXPECT_NEAR(radians_per_count("vintage", 0), 2.0 * std::numbers::pi / 36000.0, 1e-15);
  EXPECT_NEAR(radians_per_count("vintage", 2), 2.0 * std::numbers::pi / 30800.0, 1e-15);
  EXPECT_NEAR(radians_per_count("phantom_desktop", 1), 1.704423097650712e-04, 1e-16);
}

TEST(DeviceProfile, GivesThePhantomClassItsPublishedForceAtTheNominalPose) {
  const DeviceProfile profile = load_device_profile("phantom_desktop");
  // 5 A through ratio 9 at a 0.13335 m arm: the sheet says 7.90 N.
  const double force_N =
      profile.motors.max_current_A[0] * profile.motors.torque_constant_Nm_per_A[0] *
      profile.kinematics.body_diameter_m[0] / profile.kinematics.capstan_diameter_m[0] /
      profile.kinematics.link_length_m[1];
  EXPECT_NEAR(force_N, 7.90, 0.005);
  EXPECT_TRUE(profile.gravity.balanced);
}

TEST(DeviceProfile, AcceptsACopyByItsPath) {
  const TemporaryFolder folder;
  const auto lines = read_lines(load_device_profile("vintage").file);
  const fs::path copy = folder.write("copy.toml", lines);
  EXPECT_EQ(load_device_profile(copy.string()).name, "vintage");
}

TEST(DeviceProfile, FindsAProfileInTheFolderOfTheEnvironment) {
  const TemporaryFolder folder;
  folder.write("my_arm.toml", read_lines(load_device_profile("vintage").file));
  ASSERT_EQ(::setenv("FORCEGRID_PROFILE_PATH", ("::" + folder.path().string()).c_str(), 1), 0);
  EXPECT_EQ(load_device_profile("my_arm").file, (folder.path() / "my_arm.toml").string());
  EXPECT_THAT(available_profiles(), testing::Contains("my_arm"));
  ::unsetenv("FORCEGRID_PROFILE_PATH");
}

TEST(DeviceProfile, NamesTheKnownProfilesForAnUnknownOne) {
  for (const char* name : {"woodenhaptic", "", "..", "WOODENHAPTICS_V2015"}) {
    const std::string error = error_of(name);
    EXPECT_THAT(error, HasSubstr("unknown")) << name;
    for (const char* known : kNames) {
      EXPECT_THAT(error, HasSubstr(known)) << name;
    }
  }
}

TEST(DeviceProfile, NamesTheFileThatIsMissingOrNoFile) {
  EXPECT_THAT(error_of("no/such.toml"), HasSubstr("'no/such.toml': no such file"));
  const TemporaryFolder folder;
  EXPECT_THAT(error_of(folder.path().string() + "/"), HasSubstr("a folder, not a file"));
}

const std::string kLongestSerial = "serial = \"" + std::string(126, 'x') + "\"";
const std::string kTooLongSerial = "serial = \"" + std::string(127, 'x') + "\"";

struct Broken {
  const char* old_line;                 ///< start of the one line that is replaced
  const char* new_line;                 ///< its replacement; empty: the line is removed
  const char* key;                      ///< the error must name it
  const char* words;                    ///< and say this
  const char* reported_line = nullptr;  ///< start of the line that the error names, if another
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
void PrintTo(const Broken& broken, std::ostream* stream) {
  *stream << "'" << broken.old_line << "' -> '" << broken.new_line << "'";
}

class BrokenProfile : public testing::TestWithParam<Broken> {};

TEST_P(BrokenProfile, IsRefusedWithFileLineAndKey) {
  const Broken& broken = GetParam();
  auto lines = read_lines(load_device_profile("woodenhaptics_v2015").file);
  const auto starting_with = [&](const std::string& start) {
    const auto found = std::find_if(lines.begin(), lines.end(), [&](const std::string& line) {
      return line.starts_with(start);
    });
    EXPECT_NE(found, lines.end()) << "no line starts with " << start;
    return found;
  };
  const auto edited = starting_with(broken.old_line);
  ASSERT_NE(edited, lines.end());
  auto line_number = edited - lines.begin() + 1;
  if (broken.reported_line != nullptr) {
    line_number = starting_with(broken.reported_line) - lines.begin() + 1;
  }
  if (*broken.new_line == '\0') {
    lines.erase(edited);
  } else {
    *edited = broken.new_line;
  }
  const TemporaryFolder folder;
  const fs::path file = folder.write("broken.toml", lines);
  const std::string error = error_of(file.string());
  EXPECT_THAT(error, HasSubstr(file.string() + ":" + std::to_string(line_number) + ": key '" +
                               broken.key + "': "));
  EXPECT_THAT(error, HasSubstr(broken.words));
  EXPECT_THAT(error, HasSubstr("; write "));
}

INSTANTIATE_TEST_SUITE_P(
    Edits, BrokenProfile,
    testing::Values(
        Broken{"vendor_id", "vendor_id = 0x12345", "usb.vendor_id", "74565 is impossible"},
        Broken{"vendor_id", "vendor_id = \"1234\"", "usb.vendor_id", "wrong type"},
        Broken{"vendor_id", "vendor_id = 1.5", "usb.vendor_id", "wrong type"},
        Broken{"vendor_id", "", "usb.vendor_id", "missing", "[usb]"},
        Broken{"vendor_id", "vender_id = 1", "usb.vender_id", "the nearest is vendor_id"},
        Broken{"protocol", "protocol = \"w1\"", "usb.protocol", "'w1' is unknown"},
        Broken{"serial", "serial = \"\"", "usb.serial", "0 characters"},
        Broken{"report_bytes", "report_bytes = 8", "usb.report_bytes", "8 is impossible"},
        Broken{"report_bytes", "report_bytes = 64", "usb.report_bytes", "64 is impossible"},
        Broken{"protocol", "protocol = \"w3\"", "usb.report_bytes", "14 is impossible",
               "report_bytes"},
        Broken{"frame_period_us", "frame_period_us = 500", "usb.frame_period_us", "impossible"},
        Broken{"link_length_m", "link_length_m = [0.08, 0.0, 0.245]", "kinematics.link_length_m",
               "0 in place 2 is impossible"},
        Broken{"link_length_m", "link_length_m = [0.08, 0.2, -0.245]", "kinematics.link_length_m",
               "-0.245 in place 3 is impossible"},
        Broken{"link_length_m", "link_length_m = [80, 205, 245]", "kinematics.link_length_m",
               "80 in place 1 is impossible"},
        Broken{"link_length_m", "link_length_m = [0.08, 0.2]", "kinematics.link_length_m",
               "2 elements"},
        Broken{"link_length_m", "link_length_m = 0.08", "kinematics.link_length_m", "wrong type"},
        Broken{"origin_m", "origin_m = [0.22, nan, 0.08]", "kinematics.origin_m",
               "not finite in place 2"},
        Broken{"capstan_diameter_m", "capstan_diameter_m = [0.01, 0.0, 0.01]",
               "kinematics.capstan_diameter_m", "impossible"},
        Broken{"encoder_counts", "encoder_counts_per_turn = [2000, -2000, 2000]",
               "kinematics.encoder_counts_per_turn", "-2000 in place 2 is impossible"},
        Broken{"encoder_sign", "encoder_sign = [1, 0, 1]", "kinematics.encoder_sign",
               "0 in place 2 is no sign"},
        Broken{"linkage_sign", "linkage_sign = [1, 1, -1.5]", "kinematics.linkage_sign",
               "is no sign"},
        Broken{"linkage_offset_rad", "linkage_offset_rad = [0, 90, 0]",
               "kinematics.linkage_offset_rad", "90 in place 2 is impossible"},
        Broken{"joint_max_rad", "joint_max_rad = [1.2, -0.6, 2.3]", "kinematics.joint_max_rad",
               "not above joint_min_rad"},
        Broken{"elbow_max_rad", "elbow_max_rad = 0.1", "kinematics.elbow_max_rad",
               "not above elbow_min_rad"},
        Broken{"torque_constant", "torque_constant_Nm_per_A = [0.0259, inf, 0.0259]",
               "motors.torque_constant_Nm_per_A", "not finite in place 2"},
        Broken{"max_current_A", "max_current_A = [6.0, 6.1, 6.0]", "motors.max_current_A",
               "above full_scale_current_A"},
        Broken{"full_scale", "full_scale_current_A = 0", "motors.full_scale_current_A",
               "impossible"},
        Broken{"full_scale", "full_scale_current_A = 40", "motors.full_scale_current_A",
               "impossible"},
        Broken{"continuous_current", "continuous_current_A = [1.2, 6.5, 1.2]",
               "motors.continuous_current_A", "6.5 in place 2 is above max_current_A"},
        Broken{"continuous_current", "continuous_current_A = [1.2, 1.2, 0]",
               "motors.continuous_current_A", "0 in place 3 is impossible"},
        Broken{"thermal_time_constant", "thermal_time_constant_s = 0.01",
               "motors.thermal_time_constant_s", "0.01 is impossible"},
        Broken{"max_force_N", "max_force_N = nan", "limits.max_force_N", "not finite"},
        Broken{"max_force_N", "max_force_N = \"5 N\"", "limits.max_force_N", "wrong type"},
        Broken{"max_force_rate", "max_force_rate_N_per_s = 0", "limits.max_force_rate_N_per_s",
               "impossible"},
        Broken{"max_damping", "max_damping_N_s_per_m = -1", "limits.max_damping_N_s_per_m",
               "impossible"},
        Broken{"workspace_max_m", "workspace_max_m = [0.06, -0.08, 0.06]", "limits.workspace_max_m",
               "not above workspace_min_m"},
        Broken{"pose_counts", "pose_counts = [0, 0, 6000, 0, 0]", "calibration.pose_counts",
               "5 elements"},
        Broken{"pose_counts", "pose_counts = [0, 0, 32768, 0, 0, 0]", "calibration.pose_counts",
               "32768 in place 3 is impossible"},
        Broken{"pose_counts", "pose_counts = [0, 0, 12000, 0, 0, 0]", "calibration.pose_counts",
               "joint c (elbow) would be at 3.14159265 rad"},
        Broken{"pose_counts", "pose_counts = [0, 0, 0, 0, 0, 0]", "calibration.pose_counts",
               "angle between the links would be 0 rad"},
        Broken{"balanced", "balanced = 1", "gravity.balanced", "wrong type"},
        Broken{"link_b_mass_kg", "link_b_mass_kg = -0.17", "gravity.link_b_mass_kg", "impossible"},
        Broken{"tip_mass_kg", "tip_mass_kg = 0", "dynamics.tip_mass_kg", "impossible"},
        Broken{"stiffness_N_per_m", "stiffness_N_per_m = 0", "firm_hand.stiffness_N_per_m",
               "impossible"},
        Broken{"[light_hand]", "[ligth_hand]", "ligth_hand", "unknown table"},
        Broken{"description", "", "description", "missing", "# SPDX"},
        Broken{"[dynamics]", "colour = 3", "gravity.colour", "unknown key"}));

// woodenhaptics_v2015: the shoulder is at (-0.22, 0, 0) of the device frame, the linkage reaches
// distances from 0.04 m to 0.45 m.
INSTANTIATE_TEST_SUITE_P(
    Ranges, BrokenProfile,
    testing::Values(
        Broken{"manufacturer", "manufacturer = \"mb\\u00e9d\"", "usb.manufacturer",
               "byte 3 is not printable ASCII"},
        Broken{"product =", "product = \"HID\\tDEVICE\"", "usb.product",
               "byte 4 is not printable ASCII"},
        Broken{"serial", "serial = \"1\\u007F\"", "usb.serial", "byte 2 is not printable ASCII"},
        Broken{"serial", kTooLongSerial.c_str(), "usb.serial", "127 characters"},
        Broken{"frame_period_us", "frame_period_us = 124", "usb.frame_period_us", "124 is"},
        Broken{"frame_period_us", "frame_period_us = 10001", "usb.frame_period_us", "10001 is"},
        Broken{"link_length_m", "link_length_m = [0.08, 0.205, 2.1]", "kinematics.link_length_m",
               "2.1 in place 3 is impossible"},
        Broken{"link_length_m", "link_length_m = [-0.01, 0.205, 0.245]", "kinematics.link_length_m",
               "-0.01 in place 1 is impossible"},
        Broken{"origin_m", "origin_m = [220, 0.0, 80]", "kinematics.origin_m", "220 in place 1"},
        Broken{"capstan_diameter_m", "capstan_diameter_m = [0.01, 0.12, 0.01]",
               "kinematics.capstan_diameter_m", "0.12 in place 2 is not below body_diameter_m"},
        Broken{"body_diameter_m", "body_diameter_m = [160, 120, 120]", "kinematics.body_diameter_m",
               "160 in place 1 is impossible"},
        Broken{"body_diameter_m", "body_diameter_m = [0.16, 0.12, -0.12]",
               "kinematics.body_diameter_m", "-0.12 in place 3 is impossible"},
        Broken{"encoder_counts", "encoder_counts_per_turn = [2000, 2000, 2000.5]",
               "kinematics.encoder_counts_per_turn", "wrong type in place 3"},
        Broken{"encoder_counts", "encoder_counts_per_turn = [0, 2000, 2000]",
               "kinematics.encoder_counts_per_turn", "0 in place 1 is impossible"},
        Broken{"encoder_counts", "encoder_counts_per_turn = [2000, 10000001, 2000]",
               "kinematics.encoder_counts_per_turn", "10000001 in place 2 is impossible"},
        Broken{"joint_min_rad", "joint_min_rad = [-70, -0.6, -0.3]", "kinematics.joint_min_rad",
               "-70 in place 1 is impossible"},
        Broken{"joint_max_rad", "joint_max_rad = [70, 1.3, 2.3]", "kinematics.joint_max_rad",
               "70 in place 1 is impossible"},
        Broken{"elbow_min_rad", "elbow_min_rad = -0.1", "kinematics.elbow_min_rad",
               "-0.1 is impossible"},
        Broken{"elbow_max_rad", "elbow_max_rad = 3.2", "kinematics.elbow_max_rad",
               "3.2 is impossible"},
        Broken{"torque_constant", "torque_constant_Nm_per_A = [0.0259, 0.0259, 0.00009]",
               "motors.torque_constant_Nm_per_A", "9e-05 in place 3 is impossible"},
        Broken{"torque_constant", "torque_constant_Nm_per_A = [25.9, 25.9, 25.9]",
               "motors.torque_constant_Nm_per_A", "25.9 in place 1 is impossible"},
        Broken{"max_current_A", "max_current_A = [6.0, 0, 6.0]", "motors.max_current_A",
               "0 in place 2 is impossible"},
        Broken{"max_current_A", "max_current_A = [6.0, 6.0, 6000]", "motors.max_current_A",
               "6000 in place 3 is impossible"},
        Broken{"max_force_N", "max_force_N = 0", "limits.max_force_N", "0 is impossible"},
        Broken{"max_force_N", "max_force_N = 100.1", "limits.max_force_N", "100.1 is impossible"},
        Broken{"max_force_rate", "max_force_rate_N_per_s = 1.1e6", "limits.max_force_rate_N_per_s",
               "1100000 is impossible"},
        Broken{"max_joint_torque", "max_joint_torque_Nm = [2.25, 0, 1.6]",
               "limits.max_joint_torque_Nm", "0 in place 2 is impossible"},
        Broken{"max_joint_torque", "max_joint_torque_Nm = [2250, 1400, 1600]",
               "limits.max_joint_torque_Nm", "2250 in place 1 is impossible"},
        Broken{"max_stiffness", "max_stiffness_N_per_m = 0", "limits.max_stiffness_N_per_m",
               "0 is impossible"},
        Broken{"max_stiffness", "max_stiffness_N_per_m = 1.1e5", "limits.max_stiffness_N_per_m",
               "110000 is impossible"},
        Broken{"max_damping", "max_damping_N_s_per_m = 1001", "limits.max_damping_N_s_per_m",
               "1001 is impossible"},
        Broken{"max_speed", "max_speed_m_per_s = 0", "limits.max_speed_m_per_s", "0 is impossible"},
        Broken{"max_speed", "max_speed_m_per_s = 20.5", "limits.max_speed_m_per_s",
               "20.5 is impossible"},
        Broken{"max_joint_speed", "max_joint_speed_rad_per_s = [19, 0, 19]",
               "limits.max_joint_speed_rad_per_s", "0 in place 2 is impossible"},
        Broken{"max_joint_speed", "max_joint_speed_rad_per_s = [19, 23, 1001]",
               "limits.max_joint_speed_rad_per_s", "1001 in place 3 is impossible"},
        Broken{"max_joint_acceleration", "max_joint_acceleration_rad_per_s2 = [0, 1500, 1250]",
               "limits.max_joint_acceleration_rad_per_s2", "0 in place 1 is impossible"},
        Broken{"max_joint_acceleration", "max_joint_acceleration_rad_per_s2 = [1.1e6, 1500, 1250]",
               "limits.max_joint_acceleration_rad_per_s2", "1100000 in place 1 is impossible"},
        Broken{"workspace_min_m", "workspace_min_m = [-60, -80, -60]", "limits.workspace_min_m",
               "-60 in place 1 is impossible"},
        Broken{"workspace_max_m", "workspace_max_m = [60, 80, 60]", "limits.workspace_max_m",
               "60 in place 1 is impossible"},
        // sqrt(0.43^2 + 0.12^2 + 0.1^2) = 0.4575 m
        Broken{"workspace_max_m", "workspace_max_m = [0.21, 0.12, 0.1]", "limits.workspace_max_m",
               "can't reach the corner (0.21, 0.12, 0.1) of the workspace, 0.457493169 m"},
        Broken{"workspace_min_m", "workspace_min_m = [-0.06, -0.09, -0.4]",
               "limits.workspace_min_m", "can't reach the corner (0.06, -0.09, -0.4)"},
        Broken{"workspace_min_m", "workspace_min_m = [-0.19, -0.08, -0.06]",
               "limits.workspace_min_m", "can't fold to the point (-0.19, 0, 0)"},
        Broken{"link_length_m", "link_length_m = [0.08, 0.1, 0.12]", "limits.workspace_max_m",
               "can't reach the corner", "workspace_max_m"},
        Broken{"acceleration", "acceleration_m_per_s2 = -9.81", "gravity.acceleration_m_per_s2",
               "-9.81 is impossible"},
        Broken{"acceleration", "acceleration_m_per_s2 = 9810", "gravity.acceleration_m_per_s2",
               "9810 is impossible"},
        Broken{"link_b_mass_kg", "link_b_mass_kg = 170", "gravity.link_b_mass_kg",
               "170 is impossible"},
        Broken{"link_c_mass_kg", "link_c_mass_kg = 110", "gravity.link_c_mass_kg",
               "110 is impossible"},
        Broken{"link_b_center_m", "link_b_center_m = 0.21", "gravity.link_b_center_m",
               "0.21 is impossible; write a distance in metres from -0.205 to 0.205"},
        Broken{"link_c_center_m", "link_c_center_m = -0.25", "gravity.link_c_center_m",
               "-0.25 is impossible; write a distance in metres from -0.245 to 0.245"},
        Broken{"tip_mass_kg", "tip_mass_kg = 0.0009", "dynamics.tip_mass_kg",
               "0.0009 is impossible"},
        Broken{"tip_mass_kg", "tip_mass_kg = 100", "dynamics.tip_mass_kg", "100 is impossible"},
        Broken{"joint_inertia", "joint_inertia_kg_m2 = 0", "dynamics.joint_inertia_kg_m2",
               "0 is impossible"},
        Broken{"joint_inertia", "joint_inertia_kg_m2 = 1.1", "dynamics.joint_inertia_kg_m2",
               "1.1 is impossible"},
        Broken{"coulomb_friction", "coulomb_friction_Nm = -0.02", "dynamics.coulomb_friction_Nm",
               "-0.02 is impossible"},
        Broken{"coulomb_friction", "coulomb_friction_Nm = 20", "dynamics.coulomb_friction_Nm",
               "20 is impossible"},
        Broken{"coulomb_friction", "coulomb_friction_Nm = [0.02, 20, 0.02]",
               "dynamics.coulomb_friction_Nm", "20 in place 2 is impossible"},
        Broken{"coulomb_smoothing", "coulomb_smoothing_s_per_rad = 0",
               "dynamics.coulomb_smoothing_s_per_rad", "0 is impossible"},
        Broken{"coulomb_smoothing", "coulomb_smoothing_s_per_rad = 10001",
               "dynamics.coulomb_smoothing_s_per_rad", "10001 is impossible"},
        Broken{"viscous_friction", "viscous_friction_Nm_s_per_rad = -0.002",
               "dynamics.viscous_friction_Nm_s_per_rad", "-0.002 is impossible"},
        Broken{"viscous_friction", "viscous_friction_Nm_s_per_rad = 11",
               "dynamics.viscous_friction_Nm_s_per_rad", "11 is impossible"},
        Broken{"stop_stiffness", "stop_stiffness_Nm_per_rad = 0",
               "dynamics.stop_stiffness_Nm_per_rad", "0 is impossible"},
        Broken{"stop_stiffness", "stop_stiffness_Nm_per_rad = 10001",
               "dynamics.stop_stiffness_Nm_per_rad", "10001 is impossible"},
        Broken{"stop_damping", "stop_damping_Nm_s_per_rad = 101",
               "dynamics.stop_damping_Nm_s_per_rad", "101 is impossible"},
        Broken{"mass_kg", "mass_kg = 0.0009", "firm_hand.mass_kg", "0.0009 is impossible"},
        Broken{"mass_kg", "mass_kg = 200", "firm_hand.mass_kg", "200 is impossible"},
        Broken{"damping_N_s_per_m", "damping_N_s_per_m = -10", "firm_hand.damping_N_s_per_m",
               "-10 is impossible"},
        Broken{"damping_N_s_per_m", "damping_N_s_per_m = 1.1e4", "firm_hand.damping_N_s_per_m",
               "11000 is impossible"},
        Broken{"stiffness_N_per_m", "stiffness_N_per_m = 4e5", "firm_hand.stiffness_N_per_m",
               "400000 is impossible"}));

struct Edge {
  const char* old_line;  ///< start of the one line that is replaced
  const char* new_line;
};

TEST(DeviceProfile, AcceptsTheLastValuesThatAreAllowed) {
  const auto shipped = read_lines(load_device_profile("woodenhaptics_v2015").file);
  const TemporaryFolder folder;
  for (const Edge& edge :
       {Edge{"serial", kLongestSerial.c_str()}, Edge{"product =", "product = \" ~\""},
        Edge{"frame_period_us", "frame_period_us = 125"},
        Edge{"capstan_diameter_m", "capstan_diameter_m = [0.01, 0.119, 0.01]"},
        Edge{"encoder_counts", "encoder_counts_per_turn = [1, 10000000, 2000]"},
        Edge{"torque", "torque_constant_Nm_per_A = [1e-4, 10, 0.1]"},
        Edge{"max_force_N", "max_force_N = 100"},
        Edge{"max_force_rate", "max_force_rate_N_per_s = 1e6"},
        Edge{"max_joint_torque", "max_joint_torque_Nm = [1000, 1e-3, 1]"},
        Edge{"max_stiffness", "max_stiffness_N_per_m = 1e5"},
        Edge{"max_damping", "max_damping_N_s_per_m = 0"},
        Edge{"max_speed", "max_speed_m_per_s = 20"},
        Edge{"max_joint_speed", "max_joint_speed_rad_per_s = [1000, 1, 1]"},
        Edge{"max_joint_acceleration", "max_joint_acceleration_rad_per_s2 = [1e6, 1, 1]"},
        // sqrt(0.425^2 + 0.11^2 + 0.09^2) = 0.4481 m, below 0.45 m
        Edge{"workspace_max_m", "workspace_max_m = [0.205, 0.11, 0.09]"},
        // 0.045 m from the shoulder, above 0.04 m
        Edge{"workspace_min_m", "workspace_min_m = [-0.175, -0.08, -0.06]"},
        Edge{"acceleration", "acceleration_m_per_s2 = 30"},
        Edge{"link_b_mass_kg", "link_b_mass_kg = 20"},
        Edge{"link_b_center_m", "link_b_center_m = 0.205"},
        Edge{"link_c_center_m", "link_c_center_m = -0.245"},
        Edge{"tip_mass_kg", "tip_mass_kg = 1e-3"}, Edge{"joint_inertia", "joint_inertia_kg_m2 = 1"},
        Edge{"coulomb_friction", "coulomb_friction_Nm = 0"},
        Edge{"coulomb_friction", "coulomb_friction_Nm = [0, 0.5, 10]"},
        Edge{"viscous_friction", "viscous_friction_Nm_s_per_rad = 10"},
        Edge{"stop_stiffness", "stop_stiffness_Nm_per_rad = 1e4"}, Edge{"mass_kg", "mass_kg = 20"},
        Edge{"damping_N_s_per_m", "damping_N_s_per_m = 1e4"},
        Edge{"stiffness_N_per_m", "stiffness_N_per_m = 1e5"}}) {
    auto lines = shipped;
    const auto line = std::find_if(lines.begin(), lines.end(), [&](const std::string& text) {
      return text.starts_with(edge.old_line);
    });
    ASSERT_NE(line, lines.end()) << edge.old_line;
    *line = edge.new_line;
    const fs::path file = folder.write("edge.toml", lines);
    EXPECT_NO_THROW(static_cast<void>(load_device_profile(file.string()))) << edge.new_line;
  }
}

TEST(DeviceProfile, FrictionIsOneNumberForAllJointsOrThree) {
  auto lines = read_lines(load_device_profile("vintage").file);
  const TemporaryFolder folder;
  for (std::string& line : lines) {
    if (line.starts_with("coulomb_friction_Nm")) {
      line = "coulomb_friction_Nm = [0.01, 0.02, 0.03]";
    } else if (line.starts_with("viscous_friction")) {
      line = "viscous_friction_Nm_s_per_rad = 0.004";
    }
  }
  const auto dynamics = load_device_profile(folder.write("friction.toml", lines)).dynamics;
  EXPECT_EQ(dynamics.coulomb_friction_Nm, (Axes{0.01, 0.02, 0.03}));
  EXPECT_EQ(dynamics.viscous_friction_Nm_s_per_rad, (Axes{0.004, 0.004, 0.004}));
}

TEST(DeviceProfile, NamesTheLineOfASyntaxError) {
  auto lines = read_lines(load_device_profile("vintage").file);
  lines[9] = "vendor_id = = 3";
  const TemporaryFolder folder;
  const fs::path file = folder.write("syntax.toml", lines);
  EXPECT_THAT(error_of(file.string()), HasSubstr(file.string() + ":10: "));
}

TEST(DeviceProfile, RefusesAKeyThatStandsTwice) {
  auto lines = read_lines(load_device_profile("vintage").file);
  const auto name = std::find_if(lines.begin(), lines.end(),
                                 [](const std::string& line) { return line.starts_with("name"); });
  const auto number = name - lines.begin() + 2;
  lines.insert(name + 1, "name = \"again\"");
  const TemporaryFolder folder;
  const fs::path file = folder.write("twice.toml", lines);
  EXPECT_THAT(error_of(file.string()),
              HasSubstr(file.string() + ":" + std::to_string(number) + ": "));
}

TEST(DeviceProfile, RefusesAKeyThatTomlDoesNotAllowAlsoWhereTheParserOnlyAsserts) {
  const TemporaryFolder folder;
  const std::string error = error_of(folder.write("header.toml", {"[<"}).string());
  EXPECT_NE(error.find("header.toml"), std::string::npos) << error;
  EXPECT_NE(error.find("use letters, digits"), std::string::npos) << error;
}

TEST(DeviceProfile, RefusesCharactersBeyondAsciiWithTheirLine) {
  const TemporaryFolder folder;
  const std::string error =
      error_of(folder.write("odd.toml", {"# first", "na\xcf\x91 = 1"}).string());
  EXPECT_NE(error.find("odd.toml:2: a character that is not ASCII"), std::string::npos) << error;
}

}  // namespace
}  // namespace forcegrid::profiles
