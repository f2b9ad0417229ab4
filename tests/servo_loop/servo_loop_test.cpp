// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/servo_loop.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <thread>

#include "forcegrid/simple/hold_method.h"
#include "tests/servo_loop/loop_bench.h"

namespace forcegrid::servo {
namespace {

using driver::DeviceHealth;
using Eigen::Vector3d;

class ServoLoopCycle : public LoopBench {};

TEST_F(ServoLoopCycle, TurnsAForceIntoTheCurrentsOfTheDeviceSheet) {
  // Sheet 11.2: at counts 0, 0, 6000 a force of 1 N along z takes 0.788288288288 A on axis c.
  method_.force_W = Vector3d(0.0, 0.0, 1.0);
  const Vector3d calibration_pose_D(0.025, 0.0, 0.205);
  profile_.limits.workspace_max_m[2] = 0.3;  // this pose lies above the force box
  ServoPorts ports;
  ServoLoop loop(device_, profile_, {&method_}, ports, options());
  for (int i = 0; i < 200; ++i) {
    now_ += kPeriod;
    device_.show(calibration_pose_D, now_);
    ArrivedSample arrived;
    arrived.in_contact = true;
    arrived.arrived = now_;
    ASSERT_TRUE(ports.samples.push(arrived));
    ASSERT_EQ(loop.run_cycle(now_, now_ + kPeriod), Fault::kNone);
  }
  EXPECT_EQ(device_.report.counts[2], 6000);
  EXPECT_NEAR(device_.commands.back().current_A[0], 0.0, 1e-9);
  EXPECT_NEAR(device_.commands.back().current_A[1], 0.0, 1e-9);
  EXPECT_NEAR(device_.commands.back().current_A[2], 0.788288288288, 1e-9);
}

TEST_F(ServoLoopCycle, RampsTheForceIn) {
  method_.force_W = Vector3d(0.0, 0.0, -1.0);
  double last = 0.0;
  for (int i = 0; i < 51; ++i) {
    ASSERT_EQ(cycle(), Fault::kNone);
    const double force_N = -record().commanded_force_D_N[2];
    EXPECT_GE(force_N, last);
    EXPECT_LE(force_N - last, 0.021);  // 2 ms of a 100 ms ramp to 1 N
    last = force_N;
  }
  EXPECT_NEAR(last, 1.0, 1e-9);
}

TEST_F(ServoLoopCycle, RendersNothingBeforeTheFirstSample) {
  method_.force_W = Vector3d(0.0, 0.0, -1.0);
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(cycle(Vector3d::Zero(), false), Fault::kNone);
  }
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(ServoLoopCycle, FadesToZeroWhenSamplesStopAndRampsInWhenTheyReturn) {
  method_.force_W = Vector3d(0.0, 0.0, -1.0);
  for (int i = 0; i < 200; ++i) {
    ASSERT_EQ(cycle(), Fault::kNone);
  }
  ASSERT_NEAR(record().gain, 1.0, 1e-12);
  // 0.25 s without a sample is allowed, then 0.1 s of fading.
  for (int i = 0; i < 115; ++i) {
    ASSERT_EQ(cycle(Vector3d::Zero(), false), Fault::kNone);
  }
  EXPECT_NEAR(record().gain, 1.0, 1e-12);
  for (int i = 0; i < 80; ++i) {
    ASSERT_EQ(cycle(Vector3d::Zero(), false), Fault::kNone);
  }
  EXPECT_EQ(record().gain, 0.0);
  EXPECT_TRUE(is_zero(device_.commands.back()));
  cycles_ = 0;
  ASSERT_EQ(cycle(), Fault::kNone);
  const double first = record().gain;
  EXPECT_GT(first, 0.0);
  EXPECT_LT(first, 0.05);
}

TEST_F(ServoLoopCycle, GivesAFaultAndZeroCurrentForEveryBadHealth) {
  const std::pair<DeviceHealth, Fault> cases[] = {{DeviceHealth::kUnplugged, Fault::kUnplugged},
                                                  {DeviceHealth::kStale, Fault::kStaleReports},
                                                  {DeviceHealth::kProtocol, Fault::kProtocol},
                                                  {DeviceHealth::kClosed, Fault::kDeviceClosed}};
  method_.force_W = Vector3d(0.0, 0.0, -1.0);
  for (const auto& [health, fault] : cases) {
    device_.state = DeviceHealth::kRunning;
    for (int i = 0; i < 100; ++i) {
      ASSERT_EQ(cycle(), Fault::kNone);
    }
    ASSERT_FALSE(is_zero(device_.commands.back()));
    device_.state = health;
    EXPECT_EQ(cycle(), fault);
    EXPECT_TRUE(is_zero(device_.commands.back()));
    EXPECT_EQ(record().fault, fault);
  }
}

TEST_F(ServoLoopCycle, StopsWhenReportsAreTooOld) {
  ASSERT_EQ(cycle(), Fault::kNone);
  Fault fault = Fault::kNone;
  int late_cycles = 0;
  while (fault == Fault::kNone && late_cycles < 100) {
    now_ += kPeriod;
    fault = loop_.run_cycle(now_, now_ + kPeriod);
    ++late_cycles;
  }
  EXPECT_EQ(fault, Fault::kStaleReports);
  EXPECT_EQ(late_cycles, 50);  // 100 ms after the last report, which was 1 ms old
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(ServoLoopCycle, WaitsForReportsAsLongAsItIsTold) {
  ServoOptions patient = options();
  patient.report_timeout = std::chrono::milliseconds(400);
  ServoPorts ports;
  ServoLoop loop(device_, profile_, {&method_}, ports, patient);
  device_.show(Vector3d::Zero(), now_);
  for (const int age_ms : {0, 101, 400}) {
    const rt::TimePoint now = now_ + std::chrono::milliseconds(age_ms);
    EXPECT_EQ(loop.run_cycle(now, now + kPeriod), Fault::kNone) << age_ms;
  }
  const rt::TimePoint late = now_ + std::chrono::milliseconds(401);
  EXPECT_EQ(loop.run_cycle(late, late + kPeriod), Fault::kStaleReports);
}

TEST_F(ServoLoopCycle, StopsWhenTheEncodersJump) {
  ASSERT_EQ(cycle(Vector3d(0.0, 0.0, 0.0)), Fault::kNone);
  ASSERT_EQ(cycle(Vector3d(0.0, 0.001, 0.0)), Fault::kNone);
  EXPECT_EQ(cycle(Vector3d(0.0, 0.031, 0.0)), Fault::kImplausibleJump);
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(ServoLoopCycle, StopsWhenTheToolIsTooFast) {
  Fault fault = Fault::kNone;
  double y_m = -0.07;
  for (int i = 0; i < 50 && fault == Fault::kNone; ++i) {
    y_m += 1.3 * 0.002;  // the profile allows 1 m/s
    fault = cycle(Vector3d(0.0, y_m, 0.0));
  }
  EXPECT_EQ(fault, Fault::kTooFast);
}

TEST_F(ServoLoopCycle, StopsForCountsThatTheArmCannotHave) {
  ++device_.report.sequence;
  device_.report.received = device_.report.released = now_;
  device_.report.counts = {0, 0, 10000, 0, 0, 0};  // 150 degrees, beyond the elbow's stop
  EXPECT_EQ(loop_.run_cycle(now_, now_ + kPeriod), Fault::kBadPose);
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(ServoLoopCycle, StopsForAForceThatIsNotANumber) {
  ASSERT_EQ(cycle(), Fault::kNone);
  method_.force_W = Vector3d(0.0, std::numeric_limits<double>::quiet_NaN(), 0.0);
  EXPECT_EQ(cycle(), Fault::kNotFinite);
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(ServoLoopCycle, RendersNoForceOutsideTheProfilesBox) {
  method_.force_W = Vector3d(0.0, 0.0, -1.0);
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(cycle(), Fault::kNone);
  }
  ASSERT_FALSE(is_zero(device_.commands.back()));
  double y_m = 0.0;
  while (y_m < profile_.limits.workspace_max_m[1] + 0.001) {
    y_m += 0.001;
    ASSERT_EQ(cycle(Vector3d(0.0, y_m, 0.0)), Fault::kNone);
  }
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(ServoLoopCycle, TellsMethodsOfContactsAndGivesThemOnlySamplesInContact) {
  arrive(Vector3d::Zero(), false, 0);
  cycle(Vector3d::Zero(), false);
  EXPECT_EQ(method_.losses, 1);
  EXPECT_EQ(method_.samples, 0);
  arrive(Vector3d::Zero(), true, 1);
  arrive(Vector3d::Zero(), true, 1);
  cycle(Vector3d::Zero(), false);
  arrive(Vector3d::Zero(), true, 2);
  arrive(Vector3d::Zero(), false, 2);
  arrive(Vector3d::Zero(), false, 2);
  cycle(Vector3d::Zero(), false);
  EXPECT_EQ(method_.epochs, (std::vector<std::uint32_t>{1, 2}));
  EXPECT_EQ(method_.samples, 3);
  EXPECT_EQ(method_.losses, 2);
}

TEST_F(ServoLoopCycle, PublishesTheToolInTheWorkspaceFrame) {
  ServoOptions moved = options();
  moved.workspace.W_origin_D = Vector3d(0.01, -0.02, 0.03);
  ServoPorts ports;
  ServoLoop loop(device_, profile_, {&method_}, ports, moved);
  now_ += kPeriod;
  device_.show(Vector3d(0.02, 0.01, 0.0), now_);
  ASSERT_EQ(loop.run_cycle(now_, now_ + kPeriod), Fault::kNone);
  link::ToolState tool;
  ASSERT_TRUE(ports.tool.fetch(tool));
  constexpr double kCount_m = 1e-4;  // one encoder count moves the tool by less than this
  EXPECT_NEAR(tool.position_W_m[0], 0.01, kCount_m);
  EXPECT_NEAR(tool.position_W_m[1], 0.03, kCount_m);
  EXPECT_NEAR(tool.position_W_m[2], -0.03, kCount_m);
  EXPECT_EQ(tool.servo_time_ns, now_.time_since_epoch().count());
}

TEST_F(ServoLoopCycle, StartsTheRampAnewAfterAPause) {
  method_.force_W = Vector3d(0.0, 0.0, -1.0);
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(cycle(), Fault::kNone);
  }
  for (const int pause_ms : {60, 1000}) {
    ASSERT_NEAR(record().gain, 1.0, 1e-12);
    now_ += std::chrono::milliseconds(pause_ms);
    cycles_ = 0;
    ASSERT_EQ(cycle(), Fault::kNone);
    EXPECT_EQ(record().gain, 0.0);
    EXPECT_TRUE(is_zero(device_.commands.back()));
    ASSERT_EQ(cycle(), Fault::kNone);
    EXPECT_NEAR(record().gain, 0.02, 1e-9);  // 2 ms of a 100 ms ramp
    for (int i = 0; i < 100; ++i) {
      ASSERT_EQ(cycle(), Fault::kNone);
    }
  }
}

TEST_F(ServoLoopCycle, BelievesCountsThatAStalledBusStampedLate) {
  // At 0.3 m/s the tool moves 0.6 mm a cycle. One OUT takes 24 ms to be confirmed, so its counts
  // look new although they are 24 ms old; the next ones are 7 mm on, 1 ms later.
  double y_m = -0.03;
  for (int i = 0; i < 20; ++i) {
    y_m += 0.0006;
    ASSERT_EQ(cycle(Vector3d(0.0, y_m, 0.0)), Fault::kNone);
  }
  const rt::TimePoint sent = now_ + std::chrono::microseconds(100);
  now_ += std::chrono::milliseconds(24);
  device_.show(Vector3d(0.0, y_m + 0.0006, 0.0), now_, sent);
  ASSERT_EQ(loop_.run_cycle(now_, now_ + kPeriod), Fault::kNone);
  now_ += std::chrono::milliseconds(1);
  device_.show(Vector3d(0.0, y_m + 0.0106, 0.0), now_);
  EXPECT_EQ(loop_.run_cycle(now_, now_ + kPeriod), Fault::kNone);
}

TEST_F(ServoLoopCycle, ComparesItsVelocityWithAKnownMotion) {
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(cycle(Vector3d(0.0, -0.05 + 0.1 * 0.002 * i, 0.0)), Fault::kNone);
  }
  const CycleRecord last = record();
  EXPECT_NEAR(last.velocity_W_m_per_s[1], 0.1,
              0.02);  // counts of about 0.1 mm, filtered over 10 ms
}

TEST(ServoLoopRun, StopsTheDeviceHoweverItEnds) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  for (const bool fault : {false, true}) {
    ScriptedDevice device(profile);
    device.show(Vector3d::Zero(), rt::Clock::now() + std::chrono::seconds(1));
    if (fault) {
      device.state = DeviceHealth::kUnplugged;
    }
    SpokenMethod method;
    ServoPorts ports;
    ServoLoop loop(device, profile, {&method}, ports, {});
    const std::atomic<bool> stop{false};
    const ServoOutcome outcome = loop.run(stop, 0.05);
    EXPECT_TRUE(device.stopped);
    EXPECT_TRUE(outcome.zero_current_delivered);
    EXPECT_EQ(outcome.fault, fault ? Fault::kUnplugged : Fault::kNone);
    EXPECT_EQ(outcome.device_failure.empty(), !fault);
    EXPECT_EQ(outcome.cycles + outcome.missed_deadlines, fault ? 1u : 25u);
  }
}

TEST(ServoLoopRun, CallsItAFaultWhenTheLastZeroDoesNotReachTheDevice) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  device.show(Vector3d::Zero(), rt::Clock::now() + std::chrono::seconds(1));
  device.delivers_zero = false;
  SpokenMethod method;
  ServoPorts ports;
  ServoLoop loop(device, profile, {&method}, ports, {});
  const std::atomic<bool> stop{false};
  EXPECT_EQ(loop.run(stop, 0.05).fault, Fault::kZeroNotDelivered);
}

TEST(ServoLoopRun, EndsAtOnceWhenToldToStop) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  device.show(Vector3d::Zero(), rt::Clock::now() + std::chrono::seconds(60));
  SpokenMethod method;
  ServoPorts ports;
  ServoLoop loop(device, profile, {&method}, ports, {});
  std::atomic<bool> stop{false};
  std::thread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    stop = true;
  });
  const ServoOutcome outcome = loop.run(stop, 0.0);
  stopper.join();
  EXPECT_TRUE(device.stopped);
  EXPECT_EQ(outcome.fault, Fault::kNone);
}

TEST(ServoLoop, RefusesOptionsOutOfRange) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  SpokenMethod method;
  ServoPorts ports;
  const auto with = [&](const std::function<void(ServoOptions&)>& change) {
    ServoOptions options;
    change(options);
    ServoLoop loop(device, profile, {&method}, ports, options);
  };
  EXPECT_THROW(with([](ServoOptions& o) { o.rate_Hz = 99.0; }), std::invalid_argument);
  EXPECT_THROW(with([](ServoOptions& o) { o.rate_Hz = 4001.0; }), std::invalid_argument);
  EXPECT_THROW(with([](ServoOptions& o) { o.fill_budget = 0; }), std::invalid_argument);
  EXPECT_THROW(with([](ServoOptions& o) { o.rendering.ladder.ramp_in_s = 0.0; }),
               std::invalid_argument);
  EXPECT_THROW(ServoLoop(device, profile, {}, ports, {}), std::invalid_argument);
}

TEST(Fault, HasANameAndASentenceForEach) {
  for (int i = 0; i <= static_cast<int>(Fault::kZeroNotDelivered); ++i) {
    EXPECT_STRNE(name_of(static_cast<Fault>(i)), "invalid");
    EXPECT_NE(sentence_for(static_cast<Fault>(i)), "Unknown fault.");
  }
}

}  // namespace
}  // namespace forcegrid::servo
