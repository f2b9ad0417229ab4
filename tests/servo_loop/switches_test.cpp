// SPDX-License-Identifier: Apache-2.0
// Emergency stop and dead-man's switch, cycle by cycle.

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <stdexcept>

#include "rt/vectors.h"
#include "tests/servo_loop/loop_bench.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

TEST(EmergencyStop, StaysPressedAndKnowsWhoWasFirst) {
  EmergencyStop stop;
  EXPECT_FALSE(stop.pressed());
  stop.press(EmergencySource::kKey);
  stop.press(EmergencySource::kSignal);
  EXPECT_TRUE(stop.pressed());
  EXPECT_EQ(stop.source(), EmergencySource::kKey);
  EXPECT_STREQ(name_of(stop.source()), "key");
}

driver::DeviceReport report_of(bool calibration_button, std::uint8_t buttons) {
  driver::DeviceReport report;
  report.sequence = 1;
  report.calibration_button = calibration_button;
  report.buttons = buttons;
  return report;
}

TEST(DeviceButton, OfAW2IsPressedOnceAndNeverHeld) {
  DeviceButton button(profiles::load_device_profile("woodenhaptics_v2015"));
  button.update(report_of(false, 0));
  EXPECT_FALSE(button.pressed());
  button.update(report_of(true, 0));
  EXPECT_TRUE(button.pressed());
  EXPECT_FALSE(button.held());
}

TEST(DeviceButton, OfAStylusIsHeldAndThatOfItsDeviceIsPressed) {
  DeviceButton button(profiles::load_device_profile("woodenhaptics_v2015_wrist"));
  button.update(report_of(false, 0));
  button.update(report_of(false, 1));
  EXPECT_TRUE(button.held());
  EXPECT_FALSE(button.pressed());
  button.update(report_of(true, 0));
  EXPECT_FALSE(button.held());
  EXPECT_TRUE(button.pressed());
}

TEST(DeviceButton, ThatWasDownFromTheStartHasToGoUpFirst) {
  DeviceButton button(profiles::load_device_profile("falcon"));
  button.update({});  // no report yet says nothing
  button.update(report_of(false, 4));
  EXPECT_FALSE(button.pressed());
  EXPECT_TRUE(button.held());
  button.update(report_of(false, 0));
  button.update(report_of(false, 8));
  EXPECT_TRUE(button.pressed());
  button.restart();
  button.update(report_of(false, 8));
  EXPECT_FALSE(button.pressed());
}

TEST(DeadManSignal, IsHeldForAFifthOfASecondAfterEachSign) {
  const rt::TimePoint now(std::chrono::seconds(100));
  DeadManSignal signal;
  EXPECT_FALSE(signal.held(now));
  signal.sign(now);
  EXPECT_TRUE(signal.held(now + std::chrono::milliseconds(200)));
  EXPECT_FALSE(signal.held(now + std::chrono::milliseconds(201)));
}

// A base of its own, so that the stop is there before the loop.
class WithStop {
 protected:
  EmergencyStop stop_;
};

class Switches : private WithStop, public LoopBench {
 protected:
  Switches() : LoopBench(with(&stop_)) { method_.force_W = Vector3d(0.0, 0.0, -1.0); }

  static ServoOptions with(EmergencyStop* stop) {
    ServoOptions changed = options();
    changed.emergency_stop = stop;
    return changed;
  }

  void feel() {
    for (int i = 0; i < 100; ++i) {
      ASSERT_EQ(cycle(), Fault::kNone);
    }
    ASSERT_FALSE(is_zero(device_.commands.back()));
  }

  using WithStop::stop_;
};

TEST_F(Switches, EmergencyStopsTheMotorsInTheVeryNextCycle) {
  feel();
  stop_.press(EmergencySource::kSignal);
  EXPECT_EQ(cycle(), Fault::kEmergencyStop);
  EXPECT_TRUE(is_zero(device_.commands.back()));
  EXPECT_EQ(record().fault, Fault::kEmergencyStop);
  EXPECT_EQ(cycle(), Fault::kEmergencyStop);  // and it stays so
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(Switches, TheDevicesButtonIsAnEmergencyStop) {
  feel();
  device_.report.calibration_button = true;
  EXPECT_EQ(cycle(), Fault::kEmergencyStop);
  EXPECT_TRUE(is_zero(device_.commands.back()));
  EXPECT_EQ(stop_.source(), EmergencySource::kDeviceButton);
}

TEST_F(Switches, AButtonThatCalibrationHasLeftLatchedIsNone) {
  device_.report.calibration_button = true;
  feel();
  EXPECT_FALSE(stop_.pressed());
}

TEST_F(Switches, EndTheLoopAsAnEmergencyAlsoWhereItIsStoppedAtTheSameTime) {
  device_.show(Vector3d::Zero(), rt::Clock::now() + std::chrono::seconds(1));
  stop_.press(EmergencySource::kKey);
  for (const bool stopped : {false, true}) {
    const std::atomic<bool> stop{stopped};
    const ServoOutcome outcome = loop_.run(stop, 1.0);
    EXPECT_EQ(outcome.fault, Fault::kEmergencyStop);
    EXPECT_EQ(outcome.emergency, EmergencySource::kKey);
    EXPECT_TRUE(device_.stopped);
    EXPECT_LE(outcome.cycles, 1u);
  }
}

TEST_F(Switches, RefuseADeadMansButtonThatCanNotBeHeld) {
  ServoOptions button = options();
  button.dead_man = DeadMan::kButton;
  EXPECT_THROW(ServoLoop(device_, profile_, {&method_}, ports_, button), std::invalid_argument);
  ServoOptions signal = options();
  signal.dead_man = DeadMan::kSignal;
  EXPECT_THROW(ServoLoop(device_, profile_, {&method_}, ports_, signal), std::invalid_argument);
}

TEST_F(Switches, ADeadMansSignalIsNeededForForceAndItsEndTakesTheForceAway) {
  DeadManSignal signal;
  ServoOptions held = options();
  held.dead_man = DeadMan::kSignal;
  held.dead_man_signal = &signal;
  ServoPorts ports;
  ServoLoop loop(device_, profile_, {&method_}, ports, held);
  CycleRecord last;
  const auto run = [&](int cycles, bool signed_now) {
    for (int i = 0; i < cycles; ++i) {
      now_ += kPeriod;
      device_.show(Vector3d::Zero(), now_);
      ArrivedSample arrived;
      arrived.in_contact = true;
      arrived.arrived = now_;
      ASSERT_TRUE(ports.samples.push(arrived));
      if (signed_now) {
        signal.sign(now_);
      }
      ASSERT_EQ(loop.run_cycle(now_, now_ + kPeriod), Fault::kNone);
      while (ports.records.pop(last)) {
      }
    }
  };
  run(200, false);
  EXPECT_TRUE(is_zero(device_.commands.back()));
  EXPECT_EQ(last.rung, Rung::kZero);
  EXPECT_EQ(last.held_back, HeldBack::kDeadMan);
  run(200, true);
  EXPECT_FALSE(is_zero(device_.commands.back()));
  EXPECT_EQ(last.rung, Rung::kFresh);
  run(100, false);  // 0.2 s: still held
  EXPECT_EQ(last.rung, Rung::kFresh);
  run(51, false);  // and faded in 0.1 s
  EXPECT_EQ(last.gain, 0.0);
  EXPECT_EQ(last.rung, Rung::kDamping);
  run(1200, false);
  EXPECT_EQ(last.rung, Rung::kZero);
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

TEST_F(Switches, APauseFadesTheForceAndItsEndRampsItIn) {
  feel();
  CycleRecord last = record();
  const auto force_N = [&] { return rt::to_vector(last.commanded_force_D_N).norm(); };
  const double felt_N = force_N();
  ASSERT_GT(felt_N, 0.5);
  const auto run = [&](int cycles) {
    for (int i = 0; i < cycles; ++i) {
      const double before_N = force_N();
      ASSERT_EQ(cycle(), Fault::kNone);
      last = record();
      ASSERT_LE(std::abs(force_N() - before_N), 0.03 * felt_N) << "a step in cycle " << i;
    }
  };
  ports_.force_paused = true;
  run(25);  // half of the fade's 0.1 s
  EXPECT_NEAR(last.gain, 0.5, 0.03);
  EXPECT_EQ(last.held_back, HeldBack::kPaused);
  run(26);
  EXPECT_EQ(last.gain, 0.0);
  run(1200);  // the damping field is over, too
  EXPECT_EQ(last.rung, Rung::kZero);
  EXPECT_TRUE(is_zero(device_.commands.back()));
  ports_.force_paused = false;
  run(25);  // half of the ramp's 0.1 s
  EXPECT_NEAR(last.gain, 0.5, 0.03);
  EXPECT_EQ(last.held_back, HeldBack::kNot);
  run(26);
  EXPECT_EQ(last.gain, 1.0);
  EXPECT_NEAR(force_N(), felt_N, 0.03 * felt_N);
}

TEST_F(Switches, NoMotorIsCheckedBeforeTheDeadMansSwitchIsHeld) {
  DeadManSignal signal;
  ServoOptions held = options();
  held.check_motors = true;
  held.dead_man = DeadMan::kSignal;
  held.dead_man_signal = &signal;
  ServoPorts ports;
  ServoLoop loop(device_, profile_, {&method_}, ports, held);
  const auto step = [&] {
    now_ += kPeriod;
    device_.show(Vector3d::Zero(), now_);
    ArrivedSample arrived;
    arrived.arrived = now_;
    ASSERT_TRUE(ports.samples.push(arrived));
    ASSERT_EQ(loop.run_cycle(now_, now_ + kPeriod), Fault::kNone);
  };
  for (int i = 0; i < 100; ++i) {
    step();
    ASSERT_TRUE(is_zero(device_.commands.back())) << i;
  }
  bool pushed = false;
  for (int i = 0; i < 100 && !pushed; ++i) {
    signal.sign(now_);
    step();
    pushed = !is_zero(device_.commands.back());
  }
  EXPECT_TRUE(pushed);
  // Let go of in the middle of a push: no push is left standing.
  now_ += DeadManSignal::kHold;
  device_.show(Vector3d::Zero(), now_);
  step();
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

}  // namespace
}  // namespace forcegrid::servo
