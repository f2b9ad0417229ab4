// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulated_w2.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <vector>

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using Bytes = std::vector<std::uint8_t>;

rt::TimePoint at(int time_ms) { return rt::TimePoint(milliseconds(time_ms)); }

std::int16_t int16_at(const Bytes& report, std::size_t offset) {
  return static_cast<std::int16_t>(
      static_cast<std::uint16_t>(report[offset] | (report[offset + 1] << 8)));
}

Bytes out_report(std::array<std::int16_t, 7> words) {
  Bytes bytes;
  for (const std::int16_t word : words) {
    bytes.push_back(static_cast<std::uint8_t>(static_cast<std::uint16_t>(word) & 0xFFU));
    bytes.push_back(static_cast<std::uint8_t>(static_cast<std::uint16_t>(word) >> 8));
  }
  return bytes;
}

DeviceOptions options_for(const char* profile, HandKind hand = HandKind::kFirm) {
  DeviceOptions options;
  options.profile = profiles::load_device_profile(profile);
  options.hand = hand;
  return options;
}

/// What one bus frame moved.
struct FrameResult {
  bool out_taken = false;   ///< the OUT packet was acknowledged
  std::optional<Bytes> in;  ///< the IN report that the host collected
};

/// A host that always asks EP1 IN, and has one packet or none for EP1 OUT.
class OneFrame final : public UsbHost {
 public:
  explicit OneFrame(const Bytes* out) : out_(out) {}
  std::optional<std::span<const std::uint8_t>> out_packet(std::uint8_t endpoint) override {
    EXPECT_EQ(endpoint, 0x01);
    return out_ != nullptr ? std::optional(std::span<const std::uint8_t>(*out_)) : std::nullopt;
  }
  void take_out(std::uint8_t endpoint) override {
    EXPECT_EQ(endpoint, 0x01);
    result.out_taken = true;
  }
  bool wants_in(std::uint8_t endpoint) override {
    EXPECT_EQ(endpoint, 0x81);
    return true;
  }
  void babble(std::uint8_t) override {}
  void overfill(std::uint8_t) override {}
  bool give_in(std::uint8_t endpoint, std::span<const std::uint8_t> packet) override {
    EXPECT_EQ(endpoint, 0x81);
    EXPECT_EQ(packet.size(), W2Firmware::kReportBytes);
    result.in.emplace(packet.begin(), packet.end());
    return true;
  }
  FrameResult result;

 private:
  const Bytes* out_;
};

/// A host in simulated time: one frame a millisecond, always an IN transfer pending.
class Bus {
 public:
  explicit Bus(const DeviceOptions& options) : device(options, at(0)) {
    EXPECT_FALSE(device.control({0x00, 9, 1, 0, 0}, {}, at(0)).stalled);
  }
  /// Runs frames without OUT reports until time_ms.
  void idle_until(int time_ms) {
    while (now_ms < time_ms) {
      frame();
    }
  }
  FrameResult frame(const Bytes* out = nullptr) {
    ++now_ms;
    OneFrame host(out);
    device.run(at(now_ms), host);
    if (host.result.in) {
      last = *host.result.in;
      ++reports;
    }
    return host.result;
  }
  /// One ping-pong every frame until time_ms.
  void drive_until(int time_ms, const Bytes& out) {
    while (now_ms < time_ms) {
      frame(&out);
    }
  }

  EmulatedW2 device;
  Bytes last = Bytes(W2Firmware::kReportBytes);
  int now_ms = 0;
  int reports = 0;
};

const Bytes kZero(14, 0);

TEST(EmulatedW2, OutFirstReachesOneExchangeAFrame) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(1000);
  EXPECT_EQ(bus.reports, 1) << "the unsolicited report of the start-up";
  int answered = 0;
  for (int i = 0; i < 100; ++i) {
    const auto moved = bus.frame(&kZero);
    EXPECT_TRUE(moved.out_taken);
    answered += moved.in.has_value() ? 1 : 0;
  }
  EXPECT_EQ(answered, 100);
  // The counts collected in a frame were sampled in that frame.
  EXPECT_EQ(bus.device.samples().back().time_ns, 1'100'000'000);
}

TEST(EmulatedW2, InFirstCollectsTheAnswerAFrameLater) {
  auto options = options_for("woodenhaptics_v2015");
  options.frame_order = FrameOrder::kInFirst;
  Bus bus(options);
  bus.idle_until(1001);
  ASSERT_EQ(bus.reports, 1);
  EXPECT_FALSE(bus.frame(&kZero).in.has_value()) << "its answer can't be ready within the frame";
  const auto next = bus.frame();
  ASSERT_TRUE(next.in.has_value());
  // Collected at 1003 ms, sampled at 1002 ms.
  EXPECT_EQ(bus.device.samples().back().time_ns, 1'002'000'000);
}

TEST(EmulatedW2, CalibratesWithTheOperatorAndReportsThePoseCounts) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(1000);
  EXPECT_EQ(int16_at(bus.last, 4), 0) << "counters are zero at power-up";
  bus.drive_until(1195, kZero);
  EXPECT_EQ(int16_at(bus.last, 12), 0);
  bus.drive_until(1210, kZero);
  EXPECT_EQ(int16_at(bus.last, 12), 1) << "the operator has pressed the button";
  bus.drive_until(bus.now_ms + 1, out_report({0, 0, 0, 1, 0, 0, 6000}));
  EXPECT_EQ(int16_at(bus.last, 0), 0);
  EXPECT_EQ(int16_at(bus.last, 2), 0);
  EXPECT_EQ(int16_at(bus.last, 4), 6000);
  EXPECT_EQ(int16_at(bus.last, 12), 0);
  EXPECT_EQ(bus.device.operator_phase(), OperatorScript::Phase::kCalibrating);
  // From here the counters know the reference: the tip goes to the contact point, D's origin.
  bus.drive_until(3300, kZero);
  const auto& kinematics = bus.device.arm().kinematics();
  const Vector3d seen_D = kinematics.position_D(kinematics.joint_angle_rad(
      Vector3d(int16_at(bus.last, 0), int16_at(bus.last, 2), int16_at(bus.last, 4))));
  EXPECT_LT((seen_D - bus.device.arm().position_D()).norm(), 1e-4);  // half a count an axis
  EXPECT_LT((seen_D - Vector3d(0.0, 0.0, -0.0005)).norm(), 3e-4);    // and friction's creep
}

TEST(EmulatedW2, PowerUpCountersCanBeRandomAndAreSeeded) {
  auto options = options_for("woodenhaptics_v2015");
  options.random_power_up_counters = true;
  const EmulatedW2 one(options, at(0));
  const EmulatedW2 same(options, at(0));
  options.operator_script.seed = 2;
  const EmulatedW2 other(options, at(0));
  EXPECT_EQ(one.firmware().counters(), same.firmware().counters());
  EXPECT_NE(one.firmware().counters(), other.firmware().counters());
  options.operator_script.calibrated = true;
  const EmulatedW2 calibrated(options, at(0));
  EXPECT_EQ(calibrated.firmware().counters(), (W2Firmware::Counters{0, 0, 6000, 0, 0, 0}));
}

TEST(EmulatedW2, CurrentMovesTheTipByForceOverTheHandsStiffness) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop"}) {
    auto options = options_for(name);
    Bus bus(options);
    bus.idle_until(1000);
    const Vector3d rest_D = bus.device.arm().position_D();
    const std::array<double, 3> current_A{0.2, -0.3, 0.25};
    bus.drive_until(4000, out_report({200, -300, 250, 0, 0, 0, 0}));
    Vector3d torque_Nm;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& kinematics = options.profile.kinematics;
      torque_Nm[static_cast<Eigen::Index>(i)] =
          kinematics.encoder_sign[i] * options.profile.motors.torque_constant_Nm_per_A[i] *
          current_A[i] * kinematics.body_diameter_m[i] / kinematics.capstan_diameter_m[i];
    }
    const auto& arm = bus.device.arm();
    const auto motion = arm.kinematics().motion(arm.joint_angle_rad(), Vector3d::Zero());
    const Vector3d expected_D =
        motion.jacobian_m_per_rad.transpose().partialPivLu().solve(torque_Nm) /
        options.profile.firm_hand.stiffness_N_per_m;
    EXPECT_GT(expected_D.norm(), 4e-4);
    EXPECT_LT((arm.position_D() - rest_D - expected_D).norm(), 2e-3 * expected_D.norm() + 1e-6)
        << name;
    const auto report = bus.device.report();
    EXPECT_NEAR(report.final_current_mA[1], -300.0, 1e-9);
    EXPECT_NEAR(report.max_abs_current_mA[1], 300.0, 1e-9);
    EXPECT_NEAR(report.final_torque_Nm[2], torque_Nm[2], 1e-12);
    EXPECT_GT(report.motor_energy_delivered_J, 0.0);
    EXPECT_EQ(report.seconds_since_motors_nonzero, 0.0);
  }
}

TEST(EmulatedW2, PositiveForceInEachDirectionPushesTheTipThatWay) {
  // The sheets' currents for 1 N along x, y, z in the calibration pose.
  struct Case {
    const char* profile;
    std::array<std::int16_t, 3> current_mA;
    int axis;
  };
  for (const Case& c :
       {Case{"woodenhaptics_v2015", {0, 659, 0}, 0}, Case{"woodenhaptics_v2015", {0, 0, 788}, 2},
        Case{"phantom_desktop", {0, 0, 633}, 0}, Case{"phantom_desktop", {633, 0, 0}, 1},
        Case{"phantom_desktop", {0, 633, 0}, 2}}) {
    const auto options = options_for(c.profile);
    Bus bus(options);
    bus.idle_until(1000);
    const Vector3d rest_D = bus.device.arm().position_D();
    bus.drive_until(3500,
                    out_report({c.current_mA[0], c.current_mA[1], c.current_mA[2], 0, 0, 0, 0}));
    const Vector3d moved_D = bus.device.arm().position_D() - rest_D;
    const Vector3d expected_D =
        Vector3d::Unit(c.axis) / options.profile.firm_hand.stiffness_N_per_m;
    // 2.5 mm of motion turn the Jacobian by some percent.
    EXPECT_LT((moved_D - expected_D).norm(), 0.05 * expected_D.norm()) << c.profile << c.axis;
  }
}

TEST(EmulatedW2, TheTipFollowsAPointerStaysThereAndReturnsToTheMotion) {
  for (const char* name : {"woodenhaptics_v2015", "phantom_desktop", "polhem_v1"}) {
    for (const HandKind hand : {HandKind::kFirm, HandKind::kLight}) {
      SCOPED_TRACE(std::string(name) + (hand == HandKind::kFirm ? ", firm" : ", light"));
      auto options = options_for(name, hand);
      options.operator_script.calibrated = true;
      options.operator_script.motion = MotionKind::kStill;
      Bus bus(options);
      bus.idle_until(1000);
      bus.drive_until(4000, kZero);
      ASSERT_EQ(bus.device.operator_phase(), OperatorScript::Phase::kMoving);
      const auto tip_D = [&bus] { return bus.device.arm().position_D(); };
      const Vector3d script_D = tip_D();
      const Vector3d pointer_D = script_D + Vector3d(0.02, -0.01, 0.02);  // 30 mm at once
      bus.device.point_hand_at(pointer_D);
      Vector3d before_D = tip_D();
      Vector3d last_D = before_D;
      double most_m_per_s = 0.0;
      double most_m_per_s2 = 0.0;
      for (int ms = 1; ms <= 1000; ++ms) {
        bus.frame(&kZero);
        most_m_per_s = std::max(most_m_per_s, 1e3 * (tip_D() - last_D).norm());
        most_m_per_s2 = std::max(most_m_per_s2, 1e6 * (tip_D() - 2.0 * last_D + before_D).norm());
        before_D = last_D;
        last_D = tip_D();
      }
      // The target moves with at most 0.35 m/s and 20 m/s^2; a hand with its mass on a spring
      // swings beyond that by less than a half.
      EXPECT_LT(most_m_per_s, 0.5);
      EXPECT_LT(most_m_per_s2, 30.0);
      EXPECT_GT(most_m_per_s, 0.1);
      EXPECT_LT((tip_D() - pointer_D).norm(), 1e-3);
      bus.drive_until(bus.now_ms + 3000, kZero);
      EXPECT_LT((tip_D() - pointer_D).norm(), 1e-3) << "nothing new: it holds still";
      bus.device.point_hand_at(std::nullopt);
      bus.drive_until(bus.now_ms + 1, kZero);
      EXPECT_LT((tip_D() - pointer_D).norm(), 1e-3) << "no jump";
      bus.drive_until(bus.now_ms + 1000, kZero);
      EXPECT_LT((tip_D() - script_D).norm(), 1e-3);
    }
  }
}

// Under a constant force a hand gives way by F / K, whichever hand holds the tip by then.
TEST(EmulatedW2, AnotherHandTakesOverWithoutAJump) {
  const auto options = options_for("woodenhaptics_v2015", HandKind::kFirm);
  Bus bus(options);
  bus.idle_until(1000);
  const auto tip_D = [&bus] { return bus.device.arm().position_D(); };
  const Vector3d rest_D = tip_D();
  const auto push = out_report({0, 659, 0, 0, 0, 0, 0});  // the sheet's 1 N along x
  const Hands hands = hands_of(options.profile);
  bus.drive_until(3500, push);
  for (const HandKind hand : {HandKind::kLight, HandKind::kArm, HandKind::kFirm}) {
    SCOPED_TRACE(to_string(hand));
    const Vector3d before_D = tip_D();
    bus.device.hold_with(hand);
    bus.frame(&push);
    EXPECT_LT((tip_D() - before_D).norm(), 20e-6) << "within a millisecond";
    bus.drive_until(bus.now_ms + 4000, push);
    const double stiffness_N_per_m = hands[static_cast<std::size_t>(hand)]->stiffness_N_per_m;
    // 10 mm of motion turn the Jacobian by some percent.
    EXPECT_NEAR(stiffness_N_per_m * (tip_D() - rest_D).norm(), 1.0, 0.12);
    EXPECT_EQ(bus.device.report().hand, to_string(hand));
  }
}

TEST(EmulatedW2, AHandThatLetsGoCanTakeTheTipAgainWhereItIs) {
  auto options = options_for("woodenhaptics_v2015", HandKind::kFirm);
  options.operator_script.calibrated = true;
  options.operator_script.motion = MotionKind::kStill;
  Bus bus(options);
  bus.idle_until(1000);
  bus.drive_until(4000, kZero);
  const auto tip_D = [&bus] { return bus.device.arm().position_D(); };
  const Vector3d held_D = tip_D();
  bus.device.hold_with(HandKind::kNone);
  bus.drive_until(5500, kZero);
  const Vector3d fallen_D = tip_D();
  EXPECT_GT((fallen_D - held_D).norm(), 0.01) << "nothing bears the links' weight";
  bus.device.hold_with(HandKind::kFirm);
  double most_m_per_s = 0.0;
  for (int ms = 0; ms < 2500; ++ms) {
    const Vector3d last_D = tip_D();
    bus.frame(&kZero);
    most_m_per_s = std::max(most_m_per_s, 1e3 * (tip_D() - last_D).norm());
  }
  EXPECT_LT(most_m_per_s, options.profile.limits.max_speed_m_per_s)
      << "it is carried back, not flung";
  EXPECT_LT((tip_D() - held_D).norm(), 1e-3);
}

TEST(EmulatedW2, APointerThatIsFlungAboutKeepsTheTipBelowTheProfilesSpeed) {
  for (const HandKind hand : {HandKind::kFirm, HandKind::kLight}) {
    auto options = options_for("woodenhaptics_v2015", hand);
    options.operator_script.calibrated = true;
    options.operator_script.motion = MotionKind::kStill;
    Bus bus(options);
    bus.idle_until(1000);
    bus.drive_until(4000, kZero);
    double most_m_per_s = 0.0;
    for (const int flung : {1, -1, 1, -1}) {
      bus.device.point_hand_at(Vector3d::Constant(flung));  // from corner to corner
      for (int ms = 0; ms < 450; ++ms) {
        const Vector3d last_D = bus.device.arm().position_D();
        bus.frame(&kZero);
        most_m_per_s =
            std::max(most_m_per_s, 1e3 * (bus.device.arm().position_D() - last_D).norm());
      }
    }
    EXPECT_GT(most_m_per_s, 0.5);
    EXPECT_LT(most_m_per_s, options.profile.limits.max_speed_m_per_s);
  }
}

TEST(EmulatedW2, CurrentsBeyondTheAmplifierGiveNoneAndAreCounted) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(1000);
  bus.drive_until(bus.now_ms + 1, out_report({6000, -6000, 6001, 0, 0, 0, 0}));
  EXPECT_NEAR(bus.device.current_A()[0], 6.0, 1e-12);
  EXPECT_NEAR(bus.device.current_A()[1], -6.0, 1e-12);
  EXPECT_EQ(bus.device.current_A()[2], 0.0);
  EXPECT_EQ(bus.device.report().out_of_range_currents, 1U);
}

TEST(EmulatedW2, WatchdogCutsTheCurrentAtItsOwnTimeEvenWithinOneLongStep) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(1000);
  bus.drive_until(bus.now_ms + 1, out_report({300, 0, 0, 0, 0, 0, 0}));  // at 1001 ms
  bus.device.advance_to(at(1001) + milliseconds(499));
  EXPECT_NEAR(bus.device.report().final_current_mA[0], 300.0, 1e-9);
  bus.device.advance_to(at(1901));
  const auto report = bus.device.report();
  EXPECT_EQ(report.final_current_mA, (std::array<double, 3>{0.0, 0.0, 0.0}));
  EXPECT_EQ(report.watchdog_trips, 1U);
  ASSERT_TRUE(report.seconds_since_motors_nonzero.has_value());
  EXPECT_NEAR(*report.seconds_since_motors_nonzero, 0.4, 1e-9);
}

TEST(EmulatedW2, BusResetStopsReportsAndTheWatchdogStopsTheMotors) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(1000);
  bus.drive_until(1100, out_report({300, 0, 0, 0, 0, 0, 0}));
  const auto counters = bus.device.firmware().counters();
  bus.device.bus_reset(at(1100));
  EXPECT_FALSE(bus.device.usb().configured());
  const auto moved = bus.frame(&kZero);
  EXPECT_FALSE(moved.out_taken);
  EXPECT_FALSE(moved.in.has_value());
  EXPECT_NEAR(bus.device.report().final_current_mA[0], 300.0, 1e-9) << "the firmware can't know";
  bus.idle_until(1700);
  EXPECT_EQ(bus.device.report().final_current_mA[0], 0.0);
  EXPECT_EQ(bus.device.report().watchdog_trips, 1U);
  EXPECT_LT(std::abs(bus.device.firmware().counters()[2] - counters[2]), 100) << "kept";
}

TEST(EmulatedW2, HaltedEndpointsMoveNothing) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(999);
  ASSERT_FALSE(bus.device.control({0x02, 3, 0, 0x81, 0}, {}, at(999)).stalled);
  bus.idle_until(1010);
  EXPECT_EQ(bus.reports, 0);
  ASSERT_FALSE(bus.device.control({0x02, 1, 0, 0x81, 0}, {}, at(1010)).stalled);
  bus.idle_until(1011);
  EXPECT_EQ(bus.reports, 1);
}

TEST(EmulatedW2, LongStallsAreCountedNotIntegrated) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(1000);
  bus.drive_until(bus.now_ms + 1, out_report({300, 0, 0, 0, 0, 0, 0}));
  bus.device.advance_to(at(61001));
  EXPECT_NEAR(bus.device.report().physics_skipped_s, 59.0, 1e-9);
  EXPECT_EQ(bus.device.report().final_current_mA[0], 0.0);
  EXPECT_EQ(bus.device.report().watchdog_trips, 1U);
}

TEST(EmulatedW2, KeepsTheNewestSamplesWithTheirTimes) {
  Bus bus(options_for("woodenhaptics_v2015"));
  bus.idle_until(1000);
  bus.drive_until(6000, kZero);
  const auto samples = bus.device.samples();
  ASSERT_EQ(samples.size(), CounterSamples::kCapacity);
  EXPECT_EQ(samples.back().time_ns, 6'000'000'000);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    ASSERT_EQ(samples[i].time_ns - samples[i - 1].time_ns, 1'000'000);
  }
}

TEST(EmulatedW2, UnbalancedArmFallsWithoutAHandAndABalancedOneDoesNot) {
  auto options = options_for("woodenhaptics_v2015", HandKind::kNone);
  EmulatedW2 loose(options, at(0));
  loose.advance_to(at(300));
  EXPECT_LT(loose.arm().position_D().z(), 0.200);
  options.profile.gravity.balanced = true;
  EmulatedW2 balanced(options, at(0));
  balanced.advance_to(at(300));
  EXPECT_NEAR(balanced.arm().position_D().z(), 0.205, 1e-9);
}

TEST(EmulatedW2, NamesOfHandsAndFrameOrdersAreStrict) {
  EXPECT_EQ(parse_hand("light"), HandKind::kLight);
  EXPECT_EQ(parse_frame_order("in-first"), FrameOrder::kInFirst);
  EXPECT_THROW(parse_hand("Firm"), std::invalid_argument);
  EXPECT_THROW(parse_frame_order("out"), std::invalid_argument);
}

TEST(EmulatorReport, JsonCarriesTheSameNamesAndNullForNever) {
  EmulatedW2 device(options_for("woodenhaptics_v2015"), at(0));
  const nlohmann::json json = device.report();
  EXPECT_EQ(json.at("device"), "woodenhaptics_v2015");
  EXPECT_EQ(json.at("final_current_mA").size(), 3U);
  EXPECT_EQ(json.at("watchdog_trips"), 0);
  EXPECT_TRUE(json.at("seconds_since_motors_nonzero").is_null());
  EXPECT_TRUE(json.at("hand_target").is_null());
  EXPECT_TRUE(json.at("core").is_null());
}

}  // namespace
}  // namespace forcegrid::emulator
