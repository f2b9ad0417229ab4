// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/recorded_path.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <string>

#include "device_emulator/emulator_server.h"
#include "device_emulator/hand_motion.h"

namespace forcegrid::emulator {
namespace {

using ::testing::HasSubstr;

std::string file_with(const std::string& text) {
  const std::string file =
      ::testing::TempDir() + "recorded_path_" + std::to_string(getpid()) + ".csv";
  std::ofstream(file) << text;
  return file;
}

std::string complaint_about(const std::string& text) {
  try {
    static_cast<void>(read_recorded_path(file_with(text)));
  } catch (const EmulatorError& error) {
    return error.what();
  }
  return "nothing";
}

TEST(RecordedPath, ReadsItsColumnsAmongOthers) {
  const auto path = read_recorded_path(
      file_with("cycle,x_m,time_s,y_m,z_m,note\n1,0.01,5,0.02,0.03,a\n2,0.02,5.5,0.02,-0.03,b\n"));
  ASSERT_EQ(path.size(), 2u);
  EXPECT_EQ(path[1].time_s, 5.5);
  EXPECT_EQ(path[1].position_D, Eigen::Vector3d(0.02, 0.02, -0.03));
  EXPECT_FALSE(path[1].gimbal_rad.has_value());
}

TEST(RecordedPath, ReadsTheWristsAnglesIfAllThreeAreThere) {
  const auto path =
      read_recorded_path(file_with("time_s,x_m,y_m,z_m,gimbal_1_rad,gimbal_2_rad,gimbal_3_rad\n"
                                   "0,0,0,0,0.1,0.2,0.3\n2,0,0,0,0.3,0.2,-0.3\n"));
  ASSERT_TRUE(path[1].gimbal_rad.has_value());
  EXPECT_EQ(*path[1].gimbal_rad, Eigen::Vector3d(0.3, 0.2, -0.3));
  EXPECT_NEAR((gimbal_along(path, 1.0) - Eigen::Vector3d(0.2, 0.2, 0.0)).norm(), 0.0, 1e-15);
  EXPECT_THAT(complaint_about("time_s,x_m,y_m,z_m,gimbal_2_rad\n0,0,0,0,1\n1,0,0,0,1\n"),
              HasSubstr("gimbal_1_rad, gimbal_2_rad and gimbal_3_rad, or none"));
}

TEST(RecordedPath, NamesTheLineThatItCantUse) {
  EXPECT_THAT(complaint_about("time_s,x_m,y_m\n"), HasSubstr("z_m"));
  EXPECT_THAT(complaint_about("time_s,x_m,y_m,z_m\n0,0,0,0\n"), HasSubstr("two points"));
  EXPECT_THAT(complaint_about("time_s,x_m,y_m,z_m\n0,0,0,0\n0,0,0,0\n"), HasSubstr(":3:"));
  EXPECT_THAT(complaint_about("time_s,x_m,y_m,z_m\n0,0,nan,0\n"), HasSubstr(":2:"));
  EXPECT_THAT(complaint_about("time_s,x_m,y_m,z_m\n0,0\n"), HasSubstr(":2:"));
  EXPECT_THAT(complaint_about(""), HasSubstr("empty"));
}

TEST(RecordedPath, MovesTheHandAlongStraightLinesFromItsFirstPoint) {
  const std::vector<PathPoint> path{
      {10.0, {0.1, 0.0, 0.0}}, {10.5, {0.1, 0.0, 0.02}}, {11.0, {0.1, 0.01, 0.02}}};
  const HandMotion motion(MotionKind::kPath, HandMotion::kNominalAmplitude_m, 1, path);
  constexpr double kRounding_m = 1e-15;
  const auto at = [&](double time_s) { return motion.displacement_D(time_s); };
  EXPECT_TRUE(at(-1.0).isZero());
  EXPECT_NEAR((at(0.25) - Eigen::Vector3d(0.0, 0.0, 0.01)).norm(), 0.0, kRounding_m);
  EXPECT_NEAR((at(0.75) - Eigen::Vector3d(0.0, 0.005, 0.02)).norm(), 0.0, kRounding_m);
  EXPECT_NEAR((at(99.0) - Eigen::Vector3d(0.0, 0.01, 0.02)).norm(), 0.0, kRounding_m);
  EXPECT_THROW(HandMotion(MotionKind::kPath, 0.01, 1), std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid::emulator
