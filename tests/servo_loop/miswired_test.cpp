// SPDX-License-Identifier: Apache-2.0
// Mistakes of the person who built or configured the device: motors or encoders at each other's
// plugs, and torque constants that are wrong by a factor. In simulated time, with the emulator's
// arm.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "forcegrid/simple/hold_method.h"
#include "rt/vectors.h"
#include "servo_loop/servo_loop.h"
#include "stability/simulated_arm.h"

namespace forcegrid::servo {
namespace {

using emulator::HandKind;
using emulator::MotionKind;
using stability::SimulatedArm;

constexpr rt::Duration kPeriod = std::chrono::milliseconds(2);
constexpr rt::TimePoint kStart{std::chrono::seconds(1000)};

// The arm with plugs of motors exchanged: the current of joint i goes to motor_of[i].
class Rewired final : public driver::Device {
 public:
  Rewired(SimulatedArm& arm, std::array<std::size_t, 3> motor_of)
      : arm_(arm), motor_of_(motor_of) {}

  const driver::DeviceIdentity& identity() const noexcept override { return arm_.identity(); }
  driver::DeviceReport newest_report() noexcept override { return arm_.newest_report(); }
  void command(const driver::MotorCommand& command) noexcept override {
    driver::MotorCommand sent = command;
    for (std::size_t i = 0; i < 3; ++i) {
      sent.current_A[motor_of_[i]] = command.current_A[i];
      most_current_A_[i] = std::max(most_current_A_[i], std::abs(command.current_A[i]));
    }
    arm_.command(sent);
  }
  driver::DeviceHealth health() const noexcept override { return arm_.health(); }
  driver::DeviceStatistics statistics() const noexcept override { return arm_.statistics(); }
  std::string failure() const override { return arm_.failure(); }
  void load_counters(const std::array<std::int16_t, 6>& counts, rt::Duration timeout) override {
    arm_.load_counters(counts, timeout);
  }
  bool stop() noexcept override { return arm_.stop(); }

  const std::array<double, 3>& most_current_A() const { return most_current_A_; }

 private:
  SimulatedArm& arm_;
  std::array<std::size_t, 3> motor_of_;
  std::array<double, 3> most_current_A_{};
};

struct Wiring {
  std::array<std::size_t, 3> motor_of{0, 1, 2};
  std::array<std::size_t, 3> counter_of{0, 1, 2};
  double torque_constant_factor = 1.0;  ///< the profile's over the motors'
};

struct Course {
  Fault fault = Fault::kNone;
  double most_force_N = 0.0;  ///< that was commanded
  std::array<double, 3> most_current_A{};
};

// A spring to the origin of the workspace, for up to 3 s.
Course run(const std::string& name, HandKind hand, MotionKind motion, const Wiring& wiring,
           double stiffness_N_per_m = 80.0) {
  const profiles::DeviceProfile real = profiles::load_device_profile(name);
  profiles::DeviceProfile believed = real;
  for (double& constant : believed.motors.torque_constant_Nm_per_A) {
    constant *= wiring.torque_constant_factor;
  }
  SimulatedArm arm(real, hand, motion, 7, kStart);
  arm.spoil_counts = [&](rt::TimePoint, std::array<std::int32_t, 6>& counts) {
    const std::array<std::int32_t, 6> right = counts;
    for (std::size_t i = 0; i < 3; ++i) {
      counts[i] = right[wiring.counter_of[i]];
    }
  };
  Rewired device(arm, wiring.motor_of);
  HoldMethod method;
  ServoPorts ports;
  ServoLoop loop(device, believed, {&method}, ports, {});
  Course course;
  rt::TimePoint now = kStart;
  for (int cycle = 0; cycle < 1500 && course.fault == Fault::kNone; ++cycle) {
    now += kPeriod;
    arm.advance_to(now);
    if (cycle % 16 == 0) {
      ArrivedSample arrived;
      arrived.sample.position_W = arm.position_D();
      arrived.sample.force_W = -stiffness_N_per_m * arm.position_D();
      arrived.sample.time_s = servo_time_s(now);
      arrived.sample.contact_epoch = 1;
      arrived.in_contact = true;
      arrived.arrived = now;
      EXPECT_TRUE(ports.samples.push(arrived));
    }
    course.fault = loop.run_cycle(now, now + kPeriod);
    for (CycleRecord record; ports.records.pop(record);) {
      course.most_force_N =
          std::max(course.most_force_N, rt::to_vector(record.commanded_force_D_N).norm());
    }
  }
  course.most_current_A = device.most_current_A();
  return course;
}

std::string name_of_hand(HandKind hand) {
  return hand == HandKind::kFirm ? "firm" : (hand == HandKind::kLight ? "light" : "no");
}

class Miswired : public ::testing::TestWithParam<std::tuple<std::string, HandKind>> {};

constexpr std::array<std::array<std::size_t, 3>, 3> kSwaps{{{1, 0, 2}, {2, 1, 0}, {0, 2, 1}}};

TEST_P(Miswired, SwappedMotorsAreFoundBeforeAnyForce) {
  const auto& [profile, hand] = GetParam();
  for (const auto& swap : kSwaps) {
    const Course course = run(profile, hand, MotionKind::kStill, {.motor_of = swap});
    EXPECT_TRUE(course.fault == Fault::kMotorWrongWay || course.fault == Fault::kMotorNoAnswer)
        << name_of(course.fault) << ", motors " << swap[0] << swap[1] << swap[2];
    EXPECT_EQ(course.most_force_N, 0.0);
  }
}

TEST_P(Miswired, SwappedEncodersAreFoundBeforeAnyForce) {
  const auto& [profile, hand] = GetParam();
  for (const auto& swap : kSwaps) {
    const Course course = run(profile, hand, MotionKind::kStill, {.counter_of = swap});
    EXPECT_NE(course.fault, Fault::kNone) << "counters " << swap[0] << swap[1] << swap[2];
    EXPECT_EQ(course.most_force_N, 0.0) << name_of(course.fault);
  }
}

// What a wrong constant can do is bounded by the current, whatever the factor.
TEST_P(Miswired, AWrongTorqueConstantNeverLeavesTheCurrentLimit) {
  const auto& [profile, hand] = GetParam();
  const profiles::DeviceProfile real = profiles::load_device_profile(profile);
  for (const double factor : {0.02, 0.1, 0.5, 2.0, 10.0}) {
    const Course course =
        run(profile, hand, MotionKind::kChirp, {.torque_constant_factor = factor}, 500.0);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_LE(course.most_current_A[i], real.motors.max_current_A[i]) << factor;
    }
    EXPECT_LE(course.most_force_N, real.limits.max_force_N * (1.0 + 1e-12)) << factor;  // rounding
    RecordProperty("factor_" + std::to_string(factor), name_of(course.fault));
  }
}

TEST_P(Miswired, NothingIsFoundWhereNothingIsWrong) {
  const auto& [profile, hand] = GetParam();
  const Course course = run(profile, hand, MotionKind::kStill, {});
  EXPECT_EQ(course.fault, Fault::kNone) << name_of(course.fault);
}

INSTANTIATE_TEST_SUITE_P(ProfilesAndHands, Miswired,
                         ::testing::Combine(::testing::Values("woodenhaptics_v2015",
                                                              "woodenhaptics_v2019", "polhem_v1",
                                                              "vintage", "phantom_desktop"),
                                            ::testing::Values(HandKind::kFirm, HandKind::kLight)),
                         [](const auto& test) {
                           return std::get<0>(test.param) + "_" +
                                  name_of_hand(std::get<1>(test.param));
                         });

}  // namespace
}  // namespace forcegrid::servo
