// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/wrist_guard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "driver/gimbal_kinematics.h"
#include "driver/mechanism.h"
#include "forcegrid/simple/hold_method.h"
#include "servo_loop/servo_loop.h"
#include "servo_loop/telemetry.h"
#include "tests/servo_loop/scripted_device.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;
using profiles::DeviceProfile;
using std::chrono::milliseconds;
using Counts = std::array<std::int32_t, 6>;

constexpr double kCount_rad = 2.0 * std::numbers::pi / 1024;

DeviceProfile wrist_profile() { return profiles::load_device_profile("woodenhaptics_v2015_wrist"); }

/// Reports of a wrist that the test turns, each a millisecond or `step` after the last; the OUTs
/// take no time.
class WristGuardTest : public ::testing::Test {
 protected:
  Fault next(const Counts& counts, rt::Duration step = milliseconds(1)) {
    released_ += step;
    driver::DeviceReport report;
    report.sequence = ++sequence_;
    report.counts = counts;
    report.sampled_after = report.released = report.oldest_release = report.received = released_;
    return guard_.check(report, mechanism_->forward(counts));
  }

  DeviceProfile profile_ = wrist_profile();
  std::unique_ptr<driver::Mechanism> mechanism_ = driver::make_mechanism(profile_);
  WristGuard guard_{profile_};
  rt::TimePoint released_{std::chrono::seconds(1)};
  std::uint64_t sequence_ = 0;
};

TEST_F(WristGuardTest, NamesTheCounterThatJumps) {
  for (std::size_t counter = 3; counter < 6; ++counter) {
    guard_ = WristGuard(profile_);
    Counts counts = {0, 1313, 2535, 0, 0, 0};
    for (int i = 0; i < 10; ++i) {
      ASSERT_EQ(next(counts), Fault::kNone);
    }
    counts[counter] = 100;  // 0.6 rad in a millisecond
    EXPECT_EQ(next(counts), Fault::kImplausibleJump);
    EXPECT_EQ(guard_.encoder(), static_cast<int>(counter));
    EXPECT_THAT(sentence_for(Fault::kImplausibleJump, guard_.encoder()),
                ::testing::HasSubstr(std::string("of joint ") + static_cast<char>('a' + counter)));
  }
}

TEST_F(WristGuardTest, AllowsWhatTheProfileDoesAndNoMore) {
  // From rest A T^2 and 8 counts: with T = 4 ms, 3000 rad/s^2 give 48 mrad, 7.8 counts more.
  for (const auto& [counts, fault] : std::vector<std::pair<int, Fault>>{
           {15, Fault::kNone}, {-15, Fault::kNone}, {16, Fault::kImplausibleJump}}) {
    guard_ = WristGuard(profile_);
    ASSERT_EQ(next({0, 1313, 2535, 0, 0, 0}), Fault::kNone);
    ASSERT_EQ(next({0, 1313, 2535, 0, 0, 0}), Fault::kNone);
    EXPECT_EQ(next({0, 1313, 2535, 0, counts, 0}, milliseconds(4)), fault) << counts;
  }
}

TEST_F(WristGuardTest, KnowsTheEndOfACountersRange) {
  ASSERT_EQ(next({0, 1313, 2535, 0, 0, 0}), Fault::kNone);
  EXPECT_EQ(next({0, 1313, 2535, 0, 0, 32767}), Fault::kSaturatedEncoder);
  EXPECT_EQ(guard_.encoder(), 5);
}

TEST_F(WristGuardTest, EstimatesTheAngularVelocityOfTheTool) {
  // Joint D at 4 rad/s about the last link; the arm stands at theta_c = pi/2, so about x of D.
  for (int ms = 0; ms < 400; ++ms) {
    const auto turned = static_cast<std::int32_t>(std::lround(4e-3 * ms / kCount_rad));
    ASSERT_EQ(next({0, 0, 6000, 0, 0, turned}), Fault::kNone);
  }
  // A count every 1.53 ms, through a filter of 30 ms: 5 % of ripple.
  EXPECT_NEAR((guard_.angular_velocity_D() - Vector3d(4.0, 0.0, 0.0)).norm(), 0.0, 0.2);
  for (int ms = 0; ms < 200; ++ms) {
    ASSERT_EQ(next({0, 0, 6000, 0, 0, 260}), Fault::kNone);
  }
  EXPECT_LT(guard_.angular_velocity_D().norm(), 0.02) << "it has stopped";
}

TEST_F(WristGuardTest, TurnsWithTheArmThatCarriesIt) {
  // Base a turns by a count of 0.196 mrad every millisecond: 0.196 rad/s about z.
  for (int ms = 0; ms < 300; ++ms) {
    ASSERT_EQ(next({ms, 0, 6000, 10, 20, 30}), Fault::kNone);
  }
  EXPECT_NEAR((guard_.angular_velocity_D() - Vector3d(0.0, 0.0, 2 * std::numbers::pi / 32)).norm(),
              0.0, 1e-3);
}

TEST_F(WristGuardTest, SuspectsAnEncoderThatStandsWhileTheToolTravelsAMetre) {
  // The shoulder swings the tip by about 40 mm and back; e and f count, and d does if it `counts`.
  int at = 0;
  std::int32_t last_turned = 0;
  std::int32_t d = 0;
  const auto travel = [&](bool counts_d) {
    double way_m = 0.0;
    std::optional<Vector3d> last_D;
    for (; way_m < 1.1; ++at) {
      const auto swing = static_cast<std::int32_t>(std::lround(400 * std::sin(1e-2 * at)));
      const auto turned = static_cast<std::int32_t>(std::lround(50 * std::sin(2e-3 * at)));
      d += counts_d ? turned - last_turned : 0;
      last_turned = turned;
      const Counts counts = {0, 1313 + swing, 2535, d, turned, -turned};
      ASSERT_EQ(next(counts), Fault::kNone);
      const Vector3d at_D = mechanism_->forward(counts).position_D;
      way_m += last_D ? (at_D - *last_D).norm() : 0.0;
      last_D = at_D;
    }
  };
  travel(true);
  EXPECT_EQ(guard_.suspected(), 0);
  travel(false);
  EXPECT_EQ(guard_.suspected(), 1);
  travel(true);
  EXPECT_EQ(guard_.suspected(), 0) << "it counts again";
}

TEST_F(WristGuardTest, TakesNoiseOfARestingArmForNoTravel) {
  for (int i = 0; i < 40000; ++i) {  // a count of the shoulder is 0.12 mm: 5 m in all
    ASSERT_EQ(next({0, 1313 + i % 2, 2535, 0, 0, 0}), Fault::kNone);
  }
  EXPECT_EQ(guard_.suspected(), 0);
}

TEST_F(WristGuardTest, DoesNothingForADeviceWithoutAWrist) {
  profile_ = profiles::load_device_profile("woodenhaptics_v2015");
  mechanism_ = driver::make_mechanism(profile_);
  guard_ = WristGuard(profile_);
  EXPECT_EQ(next({0, 1313, 2535, 0, 0, 0}), Fault::kNone);
  EXPECT_EQ(next({0, 1313, 2535, 30000, 32767, -5}), Fault::kNone);
  EXPECT_EQ(guard_.angular_velocity_D(), Vector3d::Zero());
  EXPECT_EQ(guard_.suspected(), 0);
}

/// A loop on a scripted device with a wrist, and the telemetry of its records.
class WristLoop : public ::testing::Test {
 protected:
  WristLoop() { device_.report.counts[3] = 0; }
  static ServoOptions options() {
    ServoOptions options;
    options.check_motors = false;
    options.watch_encoders = false;
    options.workspace.W_origin_D = Vector3d(0.01, 0.02, 0.03);
    return options;
  }
  Fault cycle(const std::array<std::int32_t, 3>& gimbal_counts, std::uint8_t buttons = 0) {
    now_ += milliseconds(2);
    device_.show(Vector3d(0.01, 0.02, 0.03), now_ - milliseconds(1));
    std::copy(gimbal_counts.begin(), gimbal_counts.end(), device_.report.counts.begin() + 3);
    device_.report.buttons = buttons;
    const Fault fault = loop_.run_cycle(now_, now_ + milliseconds(2));
    CycleRecord record;
    while (ports_.records.pop(record)) {
      last_ = record;
    }
    return fault;
  }

  DeviceProfile profile_ = wrist_profile();
  ScriptedDevice device_{profile_};
  HoldMethod method_;
  ServoPorts ports_;
  ServoLoop loop_{device_, profile_, {&method_}, ports_, options()};
  rt::TimePoint now_ = rt::TimePoint(std::chrono::seconds(1000));
  CycleRecord last_;
};

TEST_F(WristLoop, PutsOrientationAnglesAndButtonsIntoTheRecord) {
  ASSERT_EQ(cycle({7, -5, 3}, 1), Fault::kNone);
  EXPECT_TRUE(last_.has_orientation);
  EXPECT_EQ(last_.buttons, 1);
  EXPECT_EQ(last_.gimbal_counts, (std::array<std::int32_t, 3>{7, -5, 3}));
  EXPECT_NEAR(last_.gimbal_angle_rad[0], 3 * kCount_rad, 1e-15);  // joint 1 is counter f
  EXPECT_NEAR(last_.gimbal_angle_rad[2], 7 * kCount_rad, 1e-15);
  const auto& counts = device_.report.counts;
  const Eigen::Quaterniond expected =
      Eigen::AngleAxisd(2 * std::numbers::pi * counts[0] / 32000, Vector3d::UnitZ()) *
      Eigen::AngleAxisd(std::numbers::pi / 2 - 2 * std::numbers::pi * counts[2] / 24000,
                        Vector3d::UnitY()) *
      Eigen::AngleAxisd(3 * kCount_rad, Vector3d::UnitX()) *
      Eigen::AngleAxisd(-5 * kCount_rad, Vector3d::UnitY()) *
      Eigen::AngleAxisd(7 * kCount_rad, Vector3d::UnitX());
  const auto& [w, x, y, z] = last_.orientation_WT_wxyz;
  EXPECT_GE(w, 0.0);
  EXPECT_NEAR(expected.angularDistance(Eigen::Quaterniond(w, x, y, z)), 0.0, 1e-7);
}

TEST_F(WristLoop, SendsThePoseAndRecordsTheTorqueOfTheForceThatItCommands) {
  // A wrench whose force acts 10 mm beside the tip: torque = lever x force, and no couple.
  ArrivedSample arrived;
  arrived.sample.force_W = Vector3d(0.0, 0.0, 2.0);
  arrived.sample.contact_epoch = 1;
  arrived.in_contact = true;
  arrived.has_torque = true;
  arrived.torque_W_Nm = Vector3d(0.01, 0.0, 0.0).cross(arrived.sample.force_W);
  device_.show(Vector3d(0.01, 0.02, 0.03), now_);
  Counts counts = device_.report.counts;
  counts[3] = 7;
  counts[4] = -5;
  counts[5] = 3;
  // The wrist stands as it stood for the sample: no turn, so the lever keeps its place.
  arrived.orientation_WT_wxyz =
      driver::quaternion_wxyz(driver::make_mechanism(profile_)->forward(counts).rotation_DT);
  for (int i = 0; i < 400; ++i) {
    arrived.sample.time_s = rt::seconds(now_.time_since_epoch());
    arrived.arrived = now_;
    ASSERT_TRUE(ports_.samples.push(arrived));
    ASSERT_EQ(cycle({7, -5, 3}, 1), Fault::kNone);
  }
  const Vector3d force_D(last_.commanded_force_D_N.data());
  ASSERT_GT(force_D.norm(), 0.5) << "the force has ramped in";
  const Vector3d expected_Nm = Vector3d(0.01, 0.0, 0.0).cross(force_D);
  EXPECT_NEAR((Vector3d(last_.tool_torque_W_Nm.data()) - expected_Nm).norm(), 0.0, 1e-9);
  link::ToolState sent;
  ASSERT_TRUE(ports_.tool.fetch(sent));
  EXPECT_TRUE(sent.has_orientation);
  EXPECT_TRUE(sent.has_buttons);
  EXPECT_EQ(sent.buttons, 1u);
  EXPECT_EQ(sent.orientation_WT, last_.orientation_WT_wxyz);

  arrived.in_contact = false;
  arrived.sample.contact_epoch = 2;
  arrived.arrived = now_;
  ASSERT_TRUE(ports_.samples.push(arrived));
  ASSERT_EQ(cycle({7, -5, 3}), Fault::kNone);
  EXPECT_EQ(last_.tool_torque_W_Nm, (Triple{})) << "no contact, no torque";
}

TEST_F(WristLoop, EndsAtAJumpOfTheWristAndNamesItEvenBeyondTheStops) {
  ASSERT_EQ(cycle({0, 0, 0}), Fault::kNone);
  ASSERT_EQ(cycle({0, 0, 0}), Fault::kNone);
  EXPECT_EQ(cycle({0, 300, 0}), Fault::kImplausibleJump) << "1.84 rad, beyond the stop of 1.4";
  EXPECT_EQ(device_.commands.back().current_A, (std::array<double, 3>{}));
}

TEST_F(WristLoop, EndsInAPoseThatTheWristCannotHave) {
  EXPECT_EQ(cycle({0, 300, 0}), Fault::kBadPose);
}

TEST_F(WristLoop, TheStylusButtonIsNoEmergencyStop) {
  ASSERT_EQ(cycle({0, 0, 0}, 0), Fault::kNone);
  ASSERT_EQ(cycle({0, 0, 0}, 1), Fault::kNone);
  device_.report.calibration_button = true;
  EXPECT_EQ(cycle({0, 0, 0}, 0), Fault::kEmergencyStop);
}

TEST(WristTelemetry, CountsWhatWasSuspectedAndPressedAndSaysItOnce) {
  ServoPorts ports;
  std::vector<std::string> sentences;
  TelemetryOptions options;
  options.on_sentence = [&](const std::string& sentence) { sentences.push_back(sentence); };
  Telemetry telemetry(ports, options);
  for (int i = 0; i < 30; ++i) {
    CycleRecord record;
    record.cycle = static_cast<std::uint64_t>(i);
    record.rung = Rung::kZero;
    record.has_orientation = true;
    record.suspected_wrist_encoders = i >= 10 && i < 20 ? 4 : 0;
    record.buttons = i % 10 < 5 ? 1 : 0;
    record.angular_velocity_W_rad_per_s = {0.0, 3.0, i == 7 ? 4.0 : 0.0};
    record.orientation_WT_wxyz = {0.0, 1.0, 0.0, 0.0};
    ASSERT_TRUE(ports.records.push(record));
  }
  telemetry.start();
  telemetry.stop();
  const OrientationStatistics& seen = telemetry.statistics().orientation;
  EXPECT_TRUE(seen.known);
  EXPECT_EQ(seen.cycles_suspected, 10u);
  EXPECT_EQ(seen.suspected_encoders, 4);
  EXPECT_EQ(seen.button_presses, 3u);
  EXPECT_DOUBLE_EQ(seen.largest_speed_rad_per_s, 5.0);
  EXPECT_EQ(seen.last_WT_wxyz, (std::array<double, 4>{0.0, 1.0, 0.0, 0.0}));
  ASSERT_EQ(sentences.size(), 1u);
  EXPECT_THAT(sentences[0], ::testing::HasSubstr("Encoder f of the wrist"));
}

}  // namespace
}  // namespace forcegrid::servo
