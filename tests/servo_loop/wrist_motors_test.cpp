// SPDX-License-Identifier: Apache-2.0
// The motor check of a wrist with motors, in simulated time: the emulator's arm and the emulator's
// physics of a driven wrist, whose motors and encoders the test turns round, cuts off or exchanges.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "device_emulator/driven_wrist.h"
#include "device_emulator/wrist.h"
#include "driver/gimbal_kinematics.h"
#include "driver/mechanism.h"
#include "forcegrid/simple/hold_method.h"
#include "rt/vectors.h"
#include "servo_loop/servo_loop.h"
#include "stability/simulated_arm.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;
using emulator::HandKind;
using emulator::MotionKind;
using profiles::DeviceProfile;
using stability::SimulatedArm;
using std::chrono::milliseconds;
using ::testing::HasSubstr;

constexpr rt::Duration kPeriod = milliseconds(2);
constexpr rt::TimePoint kStart{std::chrono::seconds(1000)};
constexpr std::array<double, 3> kNoCurrent{};
constexpr std::array<const char*, 3> kJoints = {"motor of joint d", "motor of joint e",
                                                "motor of joint f"};

DeviceProfile six_motors() { return profiles::load_device_profile("emulated_6dof"); }

/// How the wrist is wired, held and moved.
struct Wrist {
  Vector3d motor_sign = Vector3d::Ones();          ///< -1: leads swapped; 0: no power
  std::array<std::size_t, 3> motor_of{0, 1, 2};    ///< the motor at joint i's plug
  std::array<std::size_t, 3> encoder_of{0, 1, 2};  ///< the joint whose encoder is at i's plug
  std::array<bool, 3> encoder_dead{};
  bool held = true;
  Vector3d at_rad{0.4, -0.5, 0.8};        ///< where the hand holds it
  Vector3d swing_rad = Vector3d::Zero();  ///< by which it turns it to and fro, at 1 Hz
};

/// The emulator's arm with its driven wrist behind the driver's interface.
class WristedArm final : public driver::Device {
 public:
  WristedArm(const DeviceProfile& profile, const Wrist& wiring, HandKind hand)
      : profile_(profile),
        wiring_(wiring),
        arm_(profile, hand, MotionKind::kStill, 7, kStart),
        geometry_(profile.gimbal),
        wrist_(profile, wiring.at_rad) {
    wrist_.hold(wiring.held);
    arm_.spoil_counts = [this](rt::TimePoint, std::array<std::int32_t, 6>& counts) {
      Vector3d seen_rad;
      for (std::size_t i = 0; i < 3; ++i) {
        seen_rad[static_cast<Eigen::Index>(i)] =
            wiring_.encoder_dead[i]
                ? 0.0
                : wrist_.angle_rad()[static_cast<Eigen::Index>(wiring_.encoder_of[i])];
      }
      const auto positions = geometry_.encoder_positions(seen_rad);
      std::transform(positions.begin(), positions.end(), counts.begin() + 3,
                     [](std::int64_t count) { return static_cast<std::int32_t>(count); });
    };
  }

  void advance_to(rt::TimePoint now) {
    turn_to(now - milliseconds(1));  // when the counters are sampled
    arm_.advance_to(now);
    turn_to(now);
  }

  const driver::DeviceIdentity& identity() const noexcept override { return arm_.identity(); }
  driver::DeviceReport newest_report() noexcept override { return arm_.newest_report(); }
  void command(const driver::MotorCommand& command) noexcept override {
    last = command;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto joint = static_cast<Eigen::Index>(wiring_.motor_of[i]);
      const auto& motors = profile_.gimbal_motors;
      const auto motor = static_cast<std::size_t>(joint);
      torque_Nm_[joint] = wiring_.motor_sign[joint] * profile_.gimbal.encoder_sign[motor] *
                          motors.torque_constant_Nm_per_A[motor] * motors.ratio[motor] *
                          command.wrist_current_A[i];
      most_A[i] = std::max(most_A[i], std::abs(command.wrist_current_A[i]));
    }
    arm_.command(command);
  }
  driver::DeviceHealth health() const noexcept override { return arm_.health(); }
  driver::DeviceStatistics statistics() const noexcept override { return arm_.statistics(); }
  std::string failure() const override { return arm_.failure(); }
  void load_counters(const std::array<std::int16_t, 6>& counts, rt::Duration timeout) override {
    arm_.load_counters(counts, timeout);
  }
  bool stop() noexcept override { return arm_.stop(); }

  const Vector3d& wrist_rad() const { return wrist_.angle_rad(); }
  Vector3d position_D() const { return arm_.position_D(); }
  const emulator::ArmKinematics& kinematics() const { return arm_.arm().kinematics(); }

  driver::MotorCommand last;
  std::array<double, 3> most_A{};

 private:
  void turn_to(rt::TimePoint when) {
    const double since_s = rt::seconds(when - kStart);
    const Vector3d target_rad =
        wiring_.at_rad + std::sin(2.0 * std::numbers::pi * since_s) * wiring_.swing_rad;
    const Vector3d linkage_rad =
        kinematics().motion(arm_.arm().joint_angle_rad(), Vector3d::Zero()).linkage_angle_rad;
    wrist_.advance(rt::seconds(when - now_), torque_Nm_, target_rad, linkage_rad);
    now_ = when;
  }

  DeviceProfile profile_;
  Wrist wiring_;
  SimulatedArm arm_;
  emulator::Wrist geometry_;
  emulator::DrivenWrist wrist_;
  Vector3d torque_Nm_ = Vector3d::Zero();
  rt::TimePoint now_ = kStart;
};

struct Found {
  MotorCheck::Verdict verdict = MotorCheck::Verdict::kRunning;
  int joint = -1;
  double seconds = 0.0;
  std::array<double, 3> most_A{};
  double most_turn_rad = 0.0;  ///< of any joint, from where the hand holds it
};

/// The check alone, for up to 5 s.
Found check(const Wrist& wiring, const DeviceProfile& profile = six_motors(),
            HandKind hand = HandKind::kFirm) {
  WristedArm arm(profile, wiring, hand);
  const auto mechanism = driver::make_mechanism(profile);
  const driver::ArmKinematics kinematics(profile);
  MotorCheck check(profile, kPeriod);
  Found found;
  rt::TimePoint now = kStart;
  while (found.verdict == MotorCheck::Verdict::kRunning && now < kStart + std::chrono::seconds(5)) {
    now += kPeriod;
    arm.advance_to(now);
    const driver::DeviceReport report = arm.newest_report();
    found.verdict = check.update(now, report, mechanism->forward(report.counts));
    driver::MotorCommand command;
    command.current_A = rt::to_array(kinematics.motor_current_A(check.joint_torque_Nm()));
    command.wrist_current_A = check.wrist_current_A();
    arm.command(command);
    found.most_turn_rad =
        std::max(found.most_turn_rad, (arm.wrist_rad() - wiring.at_rad).cwiseAbs().maxCoeff());
  }
  found.joint = check.joint();
  found.seconds = rt::seconds(now - kStart);
  found.most_A = arm.most_A;
  EXPECT_EQ(arm.last.wrist_current_A, kNoCurrent);
  return found;
}

std::string sentence(const Found& found) {
  return sentence_for(found.verdict == MotorCheck::Verdict::kWrongWay ? Fault::kMotorWrongWay
                                                                      : Fault::kMotorNoAnswer,
                      found.joint);
}

/// A held wrist, one that the hand turns meanwhile, and one that nobody holds.
std::vector<Wrist> hands() {
  Wrist turned;
  turned.swing_rad = Vector3d(0.3, -0.2, 0.5);
  Wrist let_go;
  let_go.held = false;
  return {Wrist{}, turned, let_go};
}

TEST(WristMotorCheck, PassesAWristThatIsRightHoweverItIsHeld) {
  for (const Wrist& wiring : hands()) {
    for (const Vector3d& at_rad : {Vector3d(0.0, 0.0, 0.0), Vector3d(0.4, -0.5, 0.8),
                                   Vector3d(-0.7, 1.0, -1.5), Vector3d(0.2, -1.1, 0.3)}) {
      Wrist here = wiring;
      here.at_rad = at_rad;
      const Found found = check(here);
      EXPECT_EQ(found.verdict, MotorCheck::Verdict::kPassed)
          << static_cast<int>(found.verdict) << " of joint " << found.joint << " at "
          << at_rad.transpose() << (here.held ? "" : ", let go");
      // Six joints, four pushes of 16 ms, each after a rest of 32 ms, and a cycle that judges.
      if (here.held) {
        EXPECT_NEAR(found.seconds, 6 * (4 * 0.048 + 0.002), 1e-9);
      }
    }
  }
}

TEST(WristMotorCheck, PushesByAQuarterOfTheLargestTorqueAndLeavesTheHandWhereItIs) {
  const Found found = check({});
  ASSERT_EQ(found.verdict, MotorCheck::Verdict::kPassed);
  for (const double most_A : found.most_A) {
    EXPECT_NEAR(most_A, 0.25 * 0.188 / (0.0163 * 12), 1e-12);
  }
  RecordProperty("most_turn_mrad", std::to_string(1e3 * found.most_turn_rad));
  EXPECT_GT(found.most_turn_rad, 0.002);
  EXPECT_LT(found.most_turn_rad, 0.05);
}

TEST(WristMotorCheck, StaysWithinEachMotorsLimitsHoweverHardItPushes) {
  DeviceProfile profile = six_motors();
  profile.gimbal_motors.max_current_A = {0.3, 1.0, 0.1};
  profile.gimbal_motors.max_joint_torque_Nm = {0.19, 0.06, 0.19};
  const double torque_per_current = 0.0163 * 12;
  for (int joint = 0; joint < 3; ++joint) {
    Wrist dead;
    dead.motor_sign[joint] = 0.0;  // three attempts, the last 2.25 times as strong
    const Found found = check(dead, profile);
    EXPECT_EQ(found.verdict, MotorCheck::Verdict::kNoAnswer);
    const std::array<double, 3> most_A = {0.3, 0.06 / torque_per_current, 0.1};
    EXPECT_NEAR(found.most_A[static_cast<std::size_t>(joint)],
                most_A[static_cast<std::size_t>(joint)], 1e-12);
  }
}

TEST(WristMotorCheck, NamesTheMotorThatPushesTheWrongWay) {
  for (const Wrist& wiring : hands()) {
    for (int joint = 0; joint < 3; ++joint) {
      Wrist reversed = wiring;
      reversed.motor_sign[joint] = -1.0;
      const Found found = check(reversed);
      EXPECT_EQ(found.verdict, MotorCheck::Verdict::kWrongWay) << joint;
      EXPECT_EQ(found.joint, 3 + joint);
      EXPECT_THAT(sentence(found), HasSubstr("pushes the wrong way"));
      EXPECT_THAT(sentence(found), HasSubstr(kJoints[static_cast<std::size_t>(joint)]));
    }
  }
}

TEST(WristMotorCheck, NamesTheMotorThatDoesNothingAndTheEncoderThatDoesNotCount) {
  for (int joint = 0; joint < 3; ++joint) {
    Wrist dead;
    dead.motor_sign[joint] = 0.0;
    Wrist blind;
    blind.encoder_dead[static_cast<std::size_t>(joint)] = true;
    for (const Wrist& wiring : {dead, blind}) {
      const Found found = check(wiring);
      EXPECT_EQ(found.verdict, MotorCheck::Verdict::kNoAnswer) << joint;
      EXPECT_EQ(found.joint, 3 + joint);
      EXPECT_THAT(sentence(found), HasSubstr("moved nothing"));
      EXPECT_THAT(sentence(found), HasSubstr(kJoints[static_cast<std::size_t>(joint)]));
    }
  }
}

TEST(WristMotorCheck, FindsMotorsAndEncodersAtEachOthersPlug) {
  for (const auto& swap : {std::array<std::size_t, 3>{1, 0, 2}, std::array<std::size_t, 3>{2, 1, 0},
                           std::array<std::size_t, 3>{0, 2, 1}}) {
    // At a pitch of 1.1 rad the axes of joints 1 and 3 are 27 degrees apart, so that a push of one
    // turns the other the right way, too.
    for (const double pitch_rad : {0.0, -0.5, -1.1, 1.1}) {
      Wrist motors;
      motors.at_rad[1] = pitch_rad;
      Wrist encoders = motors;
      motors.motor_of = swap;
      encoders.encoder_of = swap;
      for (const Wrist& wiring : {motors, encoders}) {
        const Found found = check(wiring);
        EXPECT_TRUE(found.verdict == MotorCheck::Verdict::kWrongWay ||
                    found.verdict == MotorCheck::Verdict::kNoAnswer)
            << static_cast<int>(found.verdict) << ": " << swap[0] << swap[1] << swap[2]
            << ", pitch " << pitch_rad;
        EXPECT_GE(found.joint, 3);
      }
    }
  }
}

TEST(WristMotorCheck, FollowsCountersAndSignsOfTheProfile) {
  DeviceProfile profile = six_motors();
  profile.gimbal.counter = {5, 3, 4};
  profile.gimbal.encoder_sign = {-1.0, 1.0, -1.0};
  EXPECT_EQ(check({}, profile).verdict, MotorCheck::Verdict::kPassed);
  for (int joint = 0; joint < 3; ++joint) {
    Wrist reversed;
    reversed.motor_sign[joint] = -1.0;
    const Found found = check(reversed, profile);
    EXPECT_EQ(found.verdict, MotorCheck::Verdict::kWrongWay);
    EXPECT_EQ(found.joint, profile.gimbal.counter[static_cast<std::size_t>(joint)]);
  }
}

/// Torques and current of every cycle of a check of an arm that answers as it should.
struct Pushes {
  std::vector<Vector3d> arm_Nm;
  double most_wrist_A = 0.0;
};

Pushes pushes(const DeviceProfile& profile, MotorCheck::Motors motors) {
  SimulatedArm arm(profile, HandKind::kFirm, MotionKind::kStill, 7, kStart);
  const auto mechanism = driver::make_mechanism(profile);
  const driver::ArmKinematics kinematics(profile);
  MotorCheck check(profile, kPeriod, motors);
  Pushes result;
  for (rt::TimePoint now = kStart + kPeriod; result.arm_Nm.size() < 5000; now += kPeriod) {
    arm.advance_to(now);
    const driver::DeviceReport report = arm.newest_report();
    const auto verdict = check.update(now, report, mechanism->forward(report.counts));
    driver::MotorCommand command;
    command.current_A = rt::to_array(kinematics.motor_current_A(check.joint_torque_Nm()));
    arm.command(command);
    result.arm_Nm.emplace_back(check.joint_torque_Nm());
    for (const double current_A : check.wrist_current_A()) {
      result.most_wrist_A = std::max(result.most_wrist_A, std::abs(current_A));
    }
    if (verdict != MotorCheck::Verdict::kRunning) {
      EXPECT_EQ(verdict, MotorCheck::Verdict::kPassed);
      break;
    }
  }
  return result;
}

TEST(MotorCheck, PushesAnArmWithoutWristMotorsAsItDoesOneWithoutAWrist) {
  const Pushes bare =
      pushes(profiles::load_device_profile("woodenhaptics_v2015"), MotorCheck::Motors::kAll);
  // Three joints, four pushes of 8 cycles, each after a rest of 16, and a cycle that judges.
  EXPECT_EQ(bare.arm_Nm.size(), 3u * (4u * 24u + 1u));
  const Pushes sensed =
      pushes(profiles::load_device_profile("woodenhaptics_v2015_wrist"), MotorCheck::Motors::kAll);
  const Pushes arm_only = pushes(six_motors(), MotorCheck::Motors::kArm);
  for (const Pushes& other : {sensed, arm_only}) {
    EXPECT_EQ(other.arm_Nm, bare.arm_Nm);
    EXPECT_EQ(other.most_wrist_A, 0.0);
  }
}

/// The whole loop on such a device, with a simulator that answers with a spring.
class WristLoop {
 public:
  explicit WristLoop(const Wrist& wiring, EmergencyStop* stop = nullptr)
      : arm(profile, wiring, HandKind::kFirm), loop(arm, profile, {&method}, ports, with(stop)) {}

  static ServoOptions with(EmergencyStop* stop) {
    ServoOptions options;
    options.emergency_stop = stop;
    return options;
  }

  Fault cycle() {
    now += kPeriod;
    arm.advance_to(now);
    if (++cycles_ % 16 == 0) {
      ArrivedSample arrived;
      arrived.sample.position_W = arm.position_D();
      arrived.sample.force_W = Vector3d(0.0, 0.0, 1.0);
      arrived.sample.time_s = servo_time_s(now);
      arrived.sample.contact_epoch = 1;
      arrived.in_contact = arrived.has_torque = true;
      arrived.torque_W_Nm = Vector3d(0.02, 0.03, -0.02);
      arrived.arrived = now;
      EXPECT_TRUE(ports.samples.push(arrived));
    }
    const Fault fault = loop.run_cycle(now, now + kPeriod);
    for (CycleRecord record; ports.records.pop(record);) {
      last = record;
      most_force_N = std::max(most_force_N, rt::to_vector(record.commanded_force_D_N).norm());
    }
    EXPECT_EQ(last.wrist_current_A, arm.last.wrist_current_A);
    return fault;
  }

  Fault run(double seconds) {
    Fault fault = Fault::kNone;
    for (const rt::TimePoint end = now + rt::from_seconds(seconds);
         fault == Fault::kNone && now < end;) {
      fault = cycle();
    }
    return fault;
  }

  /// Until a motor of the wrist pushes.
  void push() {
    while (arm.last.wrist_current_A == kNoCurrent) {
      ASSERT_EQ(cycle(), Fault::kNone);
      ASSERT_LT(rt::seconds(now - kStart), 2.0);
    }
    ASSERT_EQ(last.gain, 0.0) << "no force yet";
  }

  bool is_off() const {
    return arm.last.current_A == kNoCurrent && arm.last.wrist_current_A == kNoCurrent;
  }

  DeviceProfile profile = six_motors();
  WristedArm arm;
  HoldMethod method;
  ServoPorts ports;
  ServoLoop loop;
  CycleRecord last;
  double most_force_N = 0.0;
  rt::TimePoint now = kStart;

 private:
  int cycles_ = 0;
};

TEST(WristLoopCheck, RendersForceAndTorqueOnceAllSixMotorsHavePassed) {
  WristLoop bench({});
  bench.push();
  while (bench.last.gain == 0.0) {
    ASSERT_EQ(bench.cycle(), Fault::kNone);
    ASSERT_LT(rt::seconds(bench.now - kStart), 2.0);
    if (bench.last.gain == 0.0) {
      EXPECT_EQ(bench.last.tool_torque_W_Nm, (Triple{})) << "a push is no torque of the object";
      EXPECT_EQ(bench.most_force_N, 0.0);
    }
  }
  ASSERT_EQ(bench.run(1.0), Fault::kNone);
  EXPECT_GT(bench.most_force_N, 0.5);
  EXPECT_GT(rt::to_vector(bench.last.tool_torque_W_Nm).norm(), 0.02);
}

TEST(WristLoopCheck, EndsWithZeroInAllSixMotorsBeforeAnyForce) {
  for (int joint = 0; joint < 3; ++joint) {
    for (const double sign : {-1.0, 0.0}) {
      Wrist wiring;
      wiring.motor_sign[joint] = sign;
      WristLoop bench(wiring);
      EXPECT_EQ(bench.run(5.0), sign < 0.0 ? Fault::kMotorWrongWay : Fault::kMotorNoAnswer)
          << joint;
      EXPECT_TRUE(bench.is_off());
      EXPECT_EQ(bench.most_force_N, 0.0);
      EXPECT_GT(bench.arm.most_A[static_cast<std::size_t>(joint)], 0.1) << "it was pushed";
    }
  }
}

TEST(WristLoopCheck, EveryOtherWayOutOfAPushIsZeroInAllSixMotors) {
  {
    EmergencyStop stop;
    WristLoop bench({}, &stop);
    bench.push();
    stop.press(EmergencySource::kKey);
    EXPECT_EQ(bench.cycle(), Fault::kEmergencyStop);
    EXPECT_TRUE(bench.is_off());
  }
  {
    WristLoop bench({});
    bench.push();
    bench.ports.force_paused = true;
    EXPECT_EQ(bench.cycle(), Fault::kNone);
    EXPECT_TRUE(bench.is_off());
    EXPECT_EQ(bench.run(0.5), Fault::kNone);
    EXPECT_TRUE(bench.is_off());
    bench.ports.force_paused = false;  // the joint is checked from its start
    EXPECT_EQ(bench.run(2.5), Fault::kNone);
    EXPECT_GT(bench.most_force_N, 0.5);
  }
  {
    WristLoop bench({});
    bench.push();
    bench.now += milliseconds(80);  // a stall: the driver has sent zeros meanwhile
    EXPECT_EQ(bench.cycle(), Fault::kNone);
    EXPECT_TRUE(bench.is_off());
  }
}

}  // namespace
}  // namespace forcegrid::servo
