// SPDX-License-Identifier: Apache-2.0
// The emulated arm of six degrees of freedom through real USB/IP bytes: what the driver's Jacobian
// makes of a wrench, against the emulator's own geometry and the hand that holds the tool.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <thread>

#include "device_emulator/arm_kinematics.h"
#include "device_emulator/emulator_server.h"
#include "device_emulator/fault_spec.h"
#include "device_emulator/wrist.h"
#include "driver/open_device.h"
#include "forcegrid/core/force_method.h"
#include "rt/vectors.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using std::chrono::milliseconds;

constexpr const char* kProfile = "emulated_6dof";

/// The same force everywhere.
class SteadyMethod final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "steady"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample&) noexcept override {}
  void contact_made(std::uint32_t, const Vector3d&) noexcept override {}
  void contact_lost() noexcept override {}
  int work(int) noexcept override { return 0; }
  ForceEstimate force(double, const Vector3d&) const noexcept override {
    ForceEstimate estimate;
    estimate.force_W = force_W;
    estimate.status = EstimateStatus::kOk;
    return estimate;
  }
  Vector3d force_W = Vector3d::Zero();
};

/// An emulated arm that a firm hand holds still in a pose, and a servo loop that pushes and turns.
class DrivenWrist : public ::testing::Test {
 protected:
  struct Wrench {
    Vector3d force_W_N;
    Vector3d torque_W_Nm;  ///< about the tip
  };

  void start(const Vector3d& position_D, const Vector3d& gimbal_rad,
             const std::string& fault = "") {
    emulator::DeviceOptions device;
    device.profile = profile_;
    device.operator_script.calibrated = true;
    device.operator_script.motion = emulator::MotionKind::kPath;
    device.operator_script.path = {{0.0, position_D, gimbal_rad}, {1.0, position_D, gimbal_rad}};
    device.operator_script.contact_D = position_D;
    if (!fault.empty()) {
      device.faults = {emulator::parse_fault(fault)};
    }
    emulator::ServerOptions options;
    options.listen = "127.0.0.1:0";
    options.devices = {device};
    server_ = std::make_unique<emulator::EmulatorServer>(options);
    server_->start();
    device_ = driver::open_device("usbip://" + server_->address() + "/1-1", profile_);
  }

  /// Runs the loop for `seconds` from when the hand has come to rest; `meanwhile` is called every
  /// 10 ms with the seconds since then.
  servo::ServoOutcome run(const Wrench& wrench, double seconds,
                          const std::function<void(double)>& meanwhile) {
    SteadyMethod method;
    method.force_W = wrench.force_W_N;
    servo::ServoPorts ports;
    servo::ServoOptions options;
    options.check_motors = false;
    options.watch_encoders = false;  // the hand holds the joints still under load
    options.rendering.passivity.mode = servo::PassivityMode::kObserve;
    servo::ServoLoop loop(*device_, profile_, {&method}, ports, options);
    servo::ServoOutcome outcome;
    const std::atomic<bool> stop{false};
    std::atomic<bool> ended{false};
    // The hand needs 2.4 s from the first report to the end of its approach.
    constexpr double kApproach_s = 2.6;
    std::thread servo([&] {
      outcome = loop.run(stop, kApproach_s + seconds);
      ended = true;
    });
    while (!ended) {
      servo::CycleRecord record;
      while (ports.records.pop(record)) {
        last_ = record.fault == servo::Fault::kNone ? record : last_;
        first_ns_ = first_ns_ == 0 ? record.time_ns : first_ns_;
      }
      const double since_s = 1e-9 * static_cast<double>(last_.time_ns - first_ns_) - kApproach_s;
      if (since_s > 0.0) {
        push(ports, wrench);
        meanwhile(since_s);
      }
      std::this_thread::sleep_for(milliseconds(10));
    }
    servo.join();
    return outcome;
  }

  void push(servo::ServoPorts& ports, const Wrench& wrench) const {
    servo::ArrivedSample arrived;
    arrived.sample.position_W = rt::to_vector(last_.position_W_m);
    arrived.sample.force_W = wrench.force_W_N;
    arrived.sample.contact_epoch = 1;
    arrived.sample.time_s = 1e-9 * static_cast<double>(last_.time_ns);
    arrived.in_contact = true;
    arrived.has_torque = true;
    arrived.torque_W_Nm = wrench.torque_W_Nm;
    arrived.orientation_WT_wxyz = last_.orientation_WT_wxyz;
    arrived.arrived = rt::Clock::now();
    static_cast<void>(ports.samples.push(arrived));
  }

  /// The work of a wrench at the tool per radian of each joint, by finite differences of the
  /// emulator's own pose: what its six motors have to exert.
  std::array<double, 6> virtual_work(const emulator::EmulatorReport& report,
                                     const Vector3d& force_D, const Vector3d& torque_D) const {
    const emulator::ArmKinematics arm(profile_.kinematics);
    const emulator::Wrist wrist(profile_.gimbal);
    const auto& n = report.counters;
    const Vector3d joints_rad = arm.joint_angle_rad(Vector3d(n[0], n[1], n[2]));
    const Vector3d gimbal_rad = rt::to_vector(report.wrist->angle_rad);
    const auto pose = [&](const Vector3d& q, const Vector3d& g) {
      const auto motion = arm.motion(q, Vector3d::Zero());
      return std::pair(motion.position_D, wrist.tool_axes_D(motion.linkage_angle_rad, g));
    };
    constexpr double kStep_rad = 1e-5;
    std::array<double, 6> work{};
    for (int i = 0; i < 6; ++i) {
      Vector3d q = Vector3d::Zero();
      Vector3d g = Vector3d::Zero();
      (i < 3 ? q : g)[i % 3] = kStep_rad;
      const auto [low_D, low_R] = pose(joints_rad - q, gimbal_rad - g);
      const auto [high_D, high_R] = pose(joints_rad + q, gimbal_rad + g);
      const Eigen::AngleAxisd turned(Matrix3d(high_R * low_R.transpose()));
      work[static_cast<std::size_t>(i)] =
          (force_D.dot(high_D - low_D) + turned.angle() * torque_D.dot(turned.axis())) /
          (2.0 * kStep_rad);
    }
    return work;
  }

  void expect_no_current(const emulator::EmulatorReport& report) const {
    EXPECT_EQ(report.final_current_mA, (std::array<double, 3>{}));
    EXPECT_EQ(report.wrist->final_current_mA, (std::array<double, 3>{}));
    EXPECT_GT(rt::to_vector(report.wrist->max_abs_current_mA).maxCoeff(), 50.0) << "it had turned";
  }

  profiles::DeviceProfile profile_ = profiles::load_device_profile(kProfile);
  std::unique_ptr<emulator::EmulatorServer> server_;
  std::unique_ptr<driver::Device> device_;
  servo::CycleRecord last_;
  std::int64_t first_ns_ = 0;
};

constexpr auto kUntilWatchdog = milliseconds(800);
const Vector3d kHere_D(0.01, -0.02, 0.015);
const Vector3d kTurned_rad(0.4, -0.3, 0.8);

TEST_F(DrivenWrist, ExertsAWrenchThatTheHandBearsInRandomPoses) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  const auto vector = [&](double length) {
    return Vector3d(length * Vector3d(any(random), any(random), any(random)));
  };
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 2; ++trial) {
    first_ns_ = 0;
    start(vector(0.03), vector(0.8));
    // The wrist's outer axes meet at 44 degrees or more here: one motor at least feels 0.37 of any
    // torque, and 0.08 N m are more than 50 mA in it.
    const Vector3d towards(normal(random), normal(random), normal(random));
    const Wrench wrench{vector(1.5), 0.08 * towards.normalized()};
    emulator::EmulatorReport held;
    const servo::ServoOutcome outcome = run(wrench, 2.0, [&](double since_s) {
      if (since_s < 1.9) {
        held = server_->report();
      }
    });
    ASSERT_EQ(outcome.fault, servo::Fault::kNone) << servo::name_of(outcome.fault);
    EXPECT_TRUE(outcome.zero_current_delivered);
    const Vector3d force_D = rt::to_vector(last_.commanded_force_D_N);
    const Vector3d torque_D = rt::to_vector(last_.tool_torque_W_Nm);
    EXPECT_NEAR((force_D - wrench.force_W_N).norm(), 0.0, 0.01) << "the whole force";
    EXPECT_NEAR((torque_D - wrench.torque_W_Nm).norm(), 0.0, 0.003) << "the whole torque";
    // The hand at rest turns back with what the wrist's motors exert.
    EXPECT_NEAR((rt::to_vector(held.wrist->hand_torque_Nm) + torque_D).norm(), 0.0, 0.003);
    // The motors exert what moving each joint would take, by the emulator's geometry. A report
    // rounds currents to 1 mA: 0.3 to 0.4 mN m at the arm, 0.2 at the wrist.
    const auto work = virtual_work(held, force_D, torque_D);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(held.final_torque_Nm[i], work[i], 0.003) << "joint " << i;
      EXPECT_NEAR(held.wrist->final_torque_Nm[i], work[i + 3], 0.001) << "wrist joint " << i;
    }
    device_.reset();
    expect_no_current(server_->report());
  }
}

TEST_F(DrivenWrist, HasNoCurrentAfterTheCableIsPulled) {
  start(kHere_D, kTurned_rad);
  bool pulled = false;
  const servo::ServoOutcome outcome =
      run({Vector3d(0.0, 0.0, 1.0), Vector3d(0.05, 0.03, -0.04)}, 2.0, [&](double since_s) {
        if (since_s > 1.0 && !pulled) {
          pulled = true;
          EXPECT_FALSE(rt::to_vector(server_->report().wrist->final_current_mA).isZero());
          server_->device().unplug();
        }
      });
  EXPECT_EQ(outcome.fault, servo::Fault::kUnplugged);
  std::this_thread::sleep_for(kUntilWatchdog);
  expect_no_current(server_->report());
  EXPECT_EQ(server_->report().watchdog_trips, 1u) << "the firmware itself, in half a second";
}

TEST_F(DrivenWrist, HasNoCurrentAfterAFaultOfItsOwnEncoder) {
  start(kHere_D, kTurned_rad, "jumping-encoder:axis=d,when=motors");
  const servo::ServoOutcome outcome =
      run({Vector3d(0.0, 0.0, 1.0), Vector3d(0.05, 0.03, -0.04)}, 3.0, [](double) {});
  EXPECT_EQ(outcome.fault, servo::Fault::kImplausibleJump) << servo::name_of(outcome.fault);
  EXPECT_EQ(outcome.joint, 3);
  EXPECT_TRUE(outcome.zero_current_delivered);
  expect_no_current(server_->report());
}

TEST_F(DrivenWrist, HasNoCurrentWhenTheServoFallsSilent) {
  start(kHere_D, kTurned_rad);
  driver::MotorCommand command;
  command.current_A = {0.1, 0.0, 0.0};
  command.wrist_current_A = {0.2, -0.2, 0.1};
  for (int i = 0; i < 50; ++i) {
    device_->command(command);
    std::this_thread::sleep_for(milliseconds(5));
  }
  const auto flowing_mA = server_->report().wrist->final_current_mA;
  EXPECT_NEAR(flowing_mA[0], 200.0, 1.0);
  EXPECT_NEAR(flowing_mA[1], -200.0, 1.0);
  EXPECT_NEAR(flowing_mA[2], 100.0, 1.0);
  std::this_thread::sleep_for(milliseconds(300));  // the I/O thread sends zeros after 50 ms
  expect_no_current(server_->report());
  EXPECT_EQ(server_->report().watchdog_trips, 0u);
}

}  // namespace
}  // namespace forcegrid
