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

constexpr std::array<const char*, 5> kNames = {"phantom_desktop", "polhem_v1", "vintage",
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

TEST(DeviceProfile, HoldsTheNumbersOfTheWoodenHapticsSheet) {
  const DeviceProfile profile = load_device_profile("woodenhaptics_v2015");
  EXPECT_EQ(profile.usb.vendor_id, 0x1234);
  EXPECT_EQ(profile.usb.product_id, 0x0006);
  EXPECT_EQ(profile.usb.serial, "0123456789");
  EXPECT_EQ(profile.kinematics.link_length_m, (Axes{0.080, 0.205, 0.245}));
  EXPECT_EQ(profile.kinematics.origin_m, (Axes{0.220, 0.0, 0.080}));
  EXPECT_EQ(profile.motors.torque_constant_Nm_per_A, (Axes{0.0259, 0.0259, 0.0259}));
  EXPECT_EQ(profile.motors.full_scale_current_A, 6.0);
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
  EXPECT_THAT(error_of(folder.path().string() + "/"), HasSubstr("not a regular file"));
}

struct Broken {
  const char* old_line;                 ///< start of the one line that is replaced
  const char* new_line;                 ///< its replacement; empty: the line is removed
  const char* key;                      ///< the error must name it
  const char* words;                    ///< and say this
  const char* reported_line = nullptr;  ///< start of the line that the error names, if another
};

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
        Broken{"vendor_id", "vender_id = 1", "usb.vender_id", "unknown key"},
        Broken{"protocol", "protocol = \"w1\"", "usb.protocol", "'w1' is unknown"},
        Broken{"serial", "serial = \"\"", "usb.serial", "0 characters"},
        Broken{"report_bytes", "report_bytes = 8", "usb.report_bytes", "8 is impossible"},
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
        Broken{"description", "", "description", "missing", "# WoodenHaptics"},
        Broken{"[dynamics]", "colour = 3", "gravity.colour", "unknown key"}));

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

}  // namespace
}  // namespace forcegrid::profiles
