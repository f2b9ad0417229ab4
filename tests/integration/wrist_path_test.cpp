// SPDX-License-Identifier: Apache-2.0
// An emulated arm with a wrist through real USB/IP bytes: driver and emulator have each a
// kinematics of its own, written from the device sheet.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <thread>

#include "device_emulator/arm_kinematics.h"
#include "device_emulator/emulator_server.h"
#include "device_emulator/wrist.h"
#include "driver/calibration.h"
#include "driver/gimbal_kinematics.h"
#include "driver/mechanism.h"
#include "driver/open_device.h"

namespace forcegrid {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr const char* kProfile = "woodenhaptics_v2015_wrist";
// A count of the wrist is 6.1 mrad, of the arm 0.26 mrad: half of each, in three and two joints.
// The PHANTOM's are smaller.
constexpr double kCounts_rad = 3 * 0.5 * 6.14e-3 + 2 * 0.5 * 0.262e-3;

/// A hand that goes from one random pose to the next and stays there.
std::vector<emulator::PathPoint> random_stays(const profiles::DeviceProfile& profile, int stays,
                                              std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  std::vector<emulator::PathPoint> path;
  for (int i = 0; i < stays; ++i) {
    const Vector3d at_D(0.03 * any(random), 0.03 * any(random), 0.03 * any(random));
    Vector3d gimbal_rad;
    for (int joint = 0; joint < 3; ++joint) {
      const double low_rad = profile.gimbal.joint_min_rad[static_cast<std::size_t>(joint)];
      const double high_rad = profile.gimbal.joint_max_rad[static_cast<std::size_t>(joint)];
      gimbal_rad[joint] =
          0.5 * (low_rad + high_rad) + 0.9 * any(random) * 0.5 * (high_rad - low_rad);
    }
    path.push_back({1.0 * i, at_D, gimbal_rad});
    path.push_back({1.0 * i + 0.6, at_D, gimbal_rad});
  }
  return path;
}

double angle_between_rad(const Matrix3d& a, const Matrix3d& b) {
  return Eigen::AngleAxisd(a.transpose() * b).angle();
}

Matrix3d rotation_of(const std::array<double, 4>& wxyz) {
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]).toRotationMatrix();
}

class EveryWrist : public ::testing::TestWithParam<const char*> {};

TEST_P(EveryWrist, DriverAndEmulatorAgreeOverRandomPosesOnTheWire) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  emulator::DeviceOptions options;
  options.profile = profiles::load_device_profile(GetParam());
  options.operator_script.motion = emulator::MotionKind::kPath;
  options.operator_script.path = random_stays(options.profile, 5, seed);
  options.operator_script.contact_D = options.operator_script.path.front().position_D;
  emulator::ServerOptions server_options;
  server_options.listen = "127.0.0.1:0";
  server_options.devices = {options};
  emulator::EmulatorServer server(server_options);
  server.start();
  const auto device = driver::open_device("usbip://" + server.address() + "/1-1", options.profile);
  // The operator presses the button; the driver loads all six counters.
  ASSERT_TRUE(driver::calibrate(*device, options.profile, std::chrono::seconds(10)));
  const auto mechanism = driver::make_mechanism(options.profile);
  const emulator::ArmKinematics arm(options.profile.kinematics);
  const emulator::Wrist wrist(options.profile.gimbal);

  double turned_rad = 0.0;
  int compared = 0;
  Matrix3d first = Matrix3d::Identity();
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(7);
  while (std::chrono::steady_clock::now() < end) {
    const driver::DeviceReport report = device->newest_report();
    const driver::ArmPose pose = mechanism->forward(report.counts);
    ASSERT_EQ(pose.status, driver::KinematicsStatus::kOk);
    // The same counts through the emulator's geometry: nothing but rounding lies between.
    const Vector3d joints_rad =
        arm.joint_angle_rad(Vector3d(report.counts[0], report.counts[1], report.counts[2]));
    const Matrix3d axes_D =
        wrist.tool_axes_D(arm.motion(joints_rad, Vector3d::Zero()).linkage_angle_rad,
                          wrist.joint_angle_rad(report.counts));
    EXPECT_LT((pose.rotation_DT - axes_D).norm(), 1e-12);
    EXPECT_LT((pose.position_D - arm.position_D(joints_rad)).norm(), 1e-12);
    // Where both stand still, the emulator's true angles: nothing but the counts lies between.
    const emulator::EmulatorReport before = server.report();
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    const driver::DeviceReport later = device->newest_report();
    const emulator::EmulatorReport after = server.report();
    const Matrix3d truth = rotation_of(after.wrist->orientation_wxyz);
    if (later.counts == report.counts &&
        angle_between_rad(truth, rotation_of(before.wrist->orientation_wxyz)) < 1e-6) {
      ++compared;
      EXPECT_LT(angle_between_rad(pose.rotation_DT, truth), kCounts_rad);
      turned_rad = std::max(turned_rad, angle_between_rad(first, truth));
    }
  }
  std::printf("compared at %d rests, turned by up to %.2f rad\n", compared, turned_rad);
  EXPECT_GT(compared, 10);
  EXPECT_GT(turned_rad, 0.2);
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(server.report().final_current_mA, (std::array<double, 3>{}));
}

INSTANTIATE_TEST_SUITE_P(Profiles, EveryWrist,
                         ::testing::Values("woodenhaptics_v2015_wrist", "phantom_desktop_wrist"),
                         [](const auto& test) { return std::string(test.param); });

TEST(WristPath, ClicksOfTheStylusReachTheHostAndLeaveTheOrientationAlone) {
  emulator::DeviceOptions options;
  options.profile = profiles::load_device_profile(kProfile);
  options.operator_script.calibrated = true;
  options.operator_script.motion = emulator::MotionKind::kStill;
  options.operator_script.wrist_motion = emulator::WristMotionKind::kStill;
  options.operator_script.click_every_s = 0.5;
  emulator::ServerOptions server_options;
  server_options.listen = "127.0.0.1:0";
  server_options.devices = {options};
  emulator::EmulatorServer server(server_options);
  server.start();
  const auto device = driver::open_device("usbip://" + server.address() + "/1-1", options.profile);
  std::uint64_t clicks = 0;
  bool down = false;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (clicks < 3 && std::chrono::steady_clock::now() < end) {
    const driver::DeviceReport report = device->newest_report();
    EXPECT_EQ(report.counts[3], 0);
    clicks += report.buttons != 0 && !down ? 1 : 0;
    down = report.buttons != 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_EQ(clicks, 3u);
  EXPECT_GE(server.report().wrist->stylus_clicks, clicks);
  EXPECT_TRUE(device->stop());
}

}  // namespace
}  // namespace forcegrid
