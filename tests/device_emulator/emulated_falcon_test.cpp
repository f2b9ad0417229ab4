// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulated_falcon.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "falcon_client.h"
#include "simulated_falcon_wire.h"

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;
using std::chrono::milliseconds;
using std::chrono::seconds;

DeviceOptions falcon_options() {
  DeviceOptions options;
  options.profile = profiles::load_device_profile("falcon");
  return options;
}

/// A falcon whose firmware runs and whose axes are homed, for tests of what comes after.
DeviceOptions ready_options() {
  DeviceOptions options = falcon_options();
  options.firmware_loaded = true;
  options.operator_script.calibrated = true;
  options.operator_script.motion = MotionKind::kStill;
  return options;
}

/// Exchanges packets until `end`.
FalconState exchange_until(SimulatedFalconWire& wire, rt::TimePoint end,
                           const std::array<int, 3>& commands = {0, 0, 0}, bool homing = true) {
  FalconClient client(wire);
  FalconState state;
  while (wire.now < end) {
    EXPECT_TRUE(client.exchange(commands, homing ? 0x08 : 0, homing, state));
  }
  return state;
}

TEST(EmulatedFalcon, GoesThroughTheWholeStartUpByteByByte) {
  SimulatedFalconWire wire(falcon_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  EXPECT_FALSE(client.probe(20)) << "cold";
  EXPECT_EQ(wire.device.firmware().state(), FalconFirmware::State::kCold);

  EXPECT_THAT(client.shake_hands(), testing::ElementsAreArray(hex_bytes("01 60 0A 44 2C 0D")));
  EXPECT_EQ(wire.device.firmware().state(), FalconFirmware::State::kAutoBaud);
  EXPECT_THAT(client.set_auto_baud(), testing::ElementsAreArray(hex_bytes("01 60 41")));
  EXPECT_EQ(wire.device.firmware().state(), FalconFirmware::State::kLoading);
  EXPECT_TRUE(client.download(FalconClient::image_with_block()));
  EXPECT_EQ(wire.device.firmware().state(), FalconFirmware::State::kRunning);
  EXPECT_TRUE(client.probe(1)) << "the first packet is answered in the first IN packet";
  EXPECT_EQ(wire.device.report().falcon->firmware_bytes_loaded, 34U);
}

TEST(EmulatedFalcon, ColdDeviceCompletesEveryInTransferWithBareStatus) {
  SimulatedFalconWire wire(falcon_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  for (int i = 0; i < 5; ++i) {
    const rt::TimePoint begin = wire.now;
    EXPECT_THAT(wire.read(64), testing::ElementsAre(0x01, 0x60));
    EXPECT_GE(wire.now - begin, milliseconds(1)) << "the latency timer";
    EXPECT_LE(wire.now - begin, milliseconds(2));
  }
  ASSERT_TRUE(client.vendor(0x09, 16));
  const rt::TimePoint begin = wire.now;
  EXPECT_THAT(wire.read(64), testing::ElementsAre(0x01, 0x60));
  EXPECT_GE(wire.now - begin, milliseconds(16));
}

TEST(EmulatedFalcon, AnswersOfTheBootLoaderAreCompleteHoweverSlowTheClient) {
  // The pauses put the free-running latency timer anywhere.
  for (const int pause_ms : {0, 3, 9, 15, 16, 17, 40}) {
    SimulatedFalconWire wire(falcon_options());
    FalconClient client(wire);
    client.enter_normal_mode();
    wire.read(64);
    wire.step(milliseconds(pause_ms));
    EXPECT_EQ(client.shake_hands(), hex_bytes("01 60 0A 44 2C 0D")) << pause_ms;
    wire.step(milliseconds(pause_ms));
    EXPECT_EQ(client.set_auto_baud(), hex_bytes("01 60 41")) << pause_ms;
  }
}

TEST(EmulatedFalcon, EchoesALargeImageInChunksOfEitherClient) {
  // 8492 bytes, as long as the longest known image: a block of 4230 words of noise.
  constexpr unsigned kSeed = 7;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937 random(kSeed);
  Bytes image = FalconClient::image_without_blocks();
  image.resize(22);
  constexpr std::size_t kWords = 4230;
  image.push_back(kWords & 0xFF);
  image.push_back(kWords >> 8);
  for (std::size_t i = 0; i < 2 * (kWords + 2); ++i) {
    image.push_back(static_cast<std::uint8_t>(random()));
  }
  image.push_back(0);
  image.push_back(0);
  ASSERT_EQ(image.size(), 8490U);
  for (const std::size_t chunk : {62U, 128U}) {
    SimulatedFalconWire wire(falcon_options());
    FalconClient client(wire);
    client.enter_normal_mode();
    client.shake_hands();
    client.set_auto_baud();
    const rt::TimePoint begin = wire.now;
    EXPECT_TRUE(client.download(image, chunk)) << chunk;
    EXPECT_TRUE(client.probe(1)) << chunk;
    // 8490 characters of ten bits at 142 857 Bd take 0.59 s.
    EXPECT_GT(wire.now - begin, milliseconds(590)) << chunk;
    EXPECT_LT(wire.now - begin, seconds(4)) << chunk;
  }
}

TEST(EmulatedFalcon, ReachesAThousandExchangesASecond) {
  SimulatedFalconWire wire(ready_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  ASSERT_TRUE(client.probe(1));
  const rt::TimePoint begin = wire.now;
  FalconState state;
  for (int i = 0; i < 1000; ++i) {
    ASSERT_TRUE(client.exchange({0, 0, 0}, 0x02, true, state));
  }
  const double rate_Hz = 1000.0 / rt::seconds(wire.now - begin);
  // The latency timer is 1 ms.
  EXPECT_GT(rate_Hz, 900.0);
  EXPECT_LT(rate_Hz, 1001.0);
}

TEST(EmulatedFalcon, FirmwareSurvivesTheHostAndDiesWithTheDtrSequence) {
  SimulatedFalconWire wire(falcon_options());
  FalconClient client(wire);
  ASSERT_TRUE(client.start_up(FalconClient::image_without_blocks()));
  wire.device.bus_reset(wire.now);
  EXPECT_EQ(wire.device.bridge().latency_ms(), 16);
  client.enter_normal_mode();
  EXPECT_TRUE(client.probe(1)) << "a second client needs no download";
  client.shake_hands();
  EXPECT_EQ(wire.device.firmware().state(), FalconFirmware::State::kAutoBaud);
  client.enter_normal_mode();
  EXPECT_FALSE(client.probe(5));
}

TEST(EmulatedFalcon, PowerCycleLosesFirmwareZerosAndForce) {
  SimulatedFalconWire wire(ready_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  FalconState state;
  ASSERT_TRUE(client.exchange({500, 0, 0}, 0, true, state));
  EXPECT_TRUE(wire.device.motors_on());
  EXPECT_EQ(state.homed, 7);
  wire.device.power_cycle(wire.now);
  EXPECT_FALSE(wire.device.motors_on());
  EXPECT_EQ(wire.device.firmware().state(), FalconFirmware::State::kCold);
  EXPECT_EQ(wire.device.bridge().latency_ms(), 16);
  ASSERT_TRUE(client.start_up(FalconClient::image_without_blocks()));
  ASSERT_TRUE(client.exchange({0, 0, 0}, 0, true, state));
  EXPECT_EQ(state.homed, 0);
}

TEST(EmulatedFalcon, CountersAreOffByARandomOffsetUntilTheOperatorHasHomed) {
  auto options = falcon_options();
  options.firmware_loaded = true;
  SimulatedFalconWire wire(options);
  FalconClient client(wire);
  client.enter_normal_mode();
  // What the mechanism would read, homed: the knob is 10 mm above the middle.
  const auto true_counts = [&wire] {
    std::array<int, 3> counts{};
    for (int leg = 0; leg < 3; ++leg) {
      counts[static_cast<std::size_t>(leg)] = static_cast<int>(
          std::lround((wire.device.delta().joint_angle_rad()[leg] - 0.6108652381980153) /
                      6.359047629780477e-4));
    }
    return counts;
  };
  FalconState state;
  ASSERT_TRUE(client.exchange({0, 0, 0}, 0x08, true, state));
  EXPECT_EQ(state.homed, 0);
  EXPECT_NE(state.encoders, true_counts());
  EXPECT_EQ(wire.device.report().falcon->lights, 0x08);

  const rt::TimePoint begin = wire.now;
  std::uint8_t seen = 0;
  while (state.homed != 7 && wire.now - begin < seconds(8)) {
    ASSERT_TRUE(client.exchange({0, 0, 0}, 0x08, true, state));
    EXPECT_EQ(state.homed & seen, seen) << "a flag stays";
    seen = state.homed;
  }
  ASSERT_EQ(state.homed, 7);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(state.encoders[axis], true_counts()[axis], 4) << "moving for up to 1 ms since";
  }
  EXPECT_EQ(wire.device.firmware().statistics().homings, 1U);
  // Flags show only while the homing bit is set; the zeros stay.
  ASSERT_TRUE(client.exchange({0, 0, 0}, 0x02, false, state));
  EXPECT_EQ(state.homed, 0);
  ASSERT_TRUE(client.exchange({0, 0, 0}, 0x02, true, state));
  EXPECT_EQ(state.homed, 7);
  // And then the operator goes to the contact point, the origin.
  state = exchange_until(wire, wire.now + seconds(5));
  EXPECT_EQ(wire.device.operator_phase(), OperatorScript::Phase::kMoving);
}

TEST(EmulatedFalcon, OperatorGoesToTheContactPointOnceHomed) {
  auto options = ready_options();
  SimulatedFalconWire wire(options);
  FalconClient(wire).enter_normal_mode();
  exchange_until(wire, wire.now + seconds(4));
  // 0.5 mm below the contact point, and what friction of 0.2 N leaves at 400 N/m.
  EXPECT_LT((wire.device.delta().position_D() - Vector3d(0.0, 0.0, -0.0005)).norm(), 1e-3);
}

TEST(EmulatedFalcon, KnobFollowsAPointerWithinItsWorkspaceAndReturns) {
  auto options = ready_options();
  SimulatedFalconWire wire(options);
  FalconClient(wire).enter_normal_mode();
  exchange_until(wire, wire.now + seconds(4));
  const Vector3d script_D = wire.device.delta().position_D();
  const Vector3d pointer_D(0.015, -0.02, 0.012);
  wire.device.point_hand_at(pointer_D);
  exchange_until(wire, wire.now + seconds(1));
  EXPECT_LT((wire.device.delta().position_D() - pointer_D).norm(), 1e-3);
  const auto& limits = options.profile.limits;
  wire.device.point_hand_at(Vector3d(0.0, 0.0, 1.0));
  exchange_until(wire, wire.now + seconds(1));
  EXPECT_NEAR(wire.device.delta().position_D().z(), limits.workspace_max_m[2], 1e-3);
  wire.device.point_hand_at(std::nullopt);
  exchange_until(wire, wire.now + seconds(1));
  EXPECT_LT((wire.device.delta().position_D() - script_D).norm(), 1e-3);
}

TEST(EmulatedFalcon, LightHandHomesToo) {
  auto options = falcon_options();
  options.firmware_loaded = true;
  options.hand = HandKind::kLight;
  SimulatedFalconWire wire(options);
  FalconClient(wire).enter_normal_mode();
  EXPECT_EQ(exchange_until(wire, wire.now + seconds(5)).homed, 7);
}

TEST(EmulatedFalcon, SheetsCommandsPushTheKnobWhereTheirForcePoints) {
  // Section 9.4 at (0, 0, 0.11): commands for 1 N along x, y, z of the base, the last four times.
  struct Case {
    std::array<int, 3> commands;
    Vector3d force_B;
  };
  for (const Case& c :
       {Case{{-154, 527, -372}, {1.0, 0.0, 0.0}}, Case{{519, -125, -393}, {0.0, 1.0, 0.0}},
        Case{{-241, -241, -241}, {0.0, 0.0, 1.0}}, Case{{964, 964, 964}, {0.0, 0.0, -4.0}}}) {
    auto options = ready_options();
    // The hand waits, and stays, where the force is known.
    options.profile.delta.center_m = {0.0, -EmulatedFalcon::kStartHeight_m, 0.110};
    options.profile.dynamics.coulomb_friction_Nm = {};
    SimulatedFalconWire wire(options);
    FalconClient client(wire);
    client.enter_normal_mode();
    const Vector3d rest_D = wire.device.delta().position_D();
    ASSERT_LT((wire.device.delta().mechanism().to_base(rest_D) - Vector3d(0.0, 0.0, 0.11)).norm(),
              1e-12);
    // 150 ms: the operator starts after 200 ms. A hand of 0.2 kg on 400 N/m needs longer to settle,
    // but it moves along the force.
    exchange_until(wire, wire.now + milliseconds(150), c.commands);
    const auto& mechanism = wire.device.delta().mechanism();
    const Vector3d moved_B =
        mechanism.to_base(wire.device.delta().position_D()) - mechanism.to_base(rest_D);
    EXPECT_GT(moved_B.norm(), 1e-3 * c.force_B.norm());
    EXPECT_GT(moved_B.normalized().dot(c.force_B.normalized()), 0.99) << moved_B.transpose();
    EXPECT_NEAR(wire.device.report().final_torque_Nm[0], -1e-4 * c.commands[0], 1e-12);
  }
}

TEST(EmulatedFalcon, CommandsBeyondTheLimitAreCutToItAndCounted) {
  SimulatedFalconWire wire(ready_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  FalconState state;
  ASSERT_TRUE(client.exchange({5000, -32768, 4095}, 0, true, state));
  const auto report = wire.device.report();
  EXPECT_EQ(report.falcon->final_command, (std::array<std::int32_t, 3>{4095, -4095, 4095}));
  EXPECT_EQ(report.falcon->saturated_commands, 2U);
  EXPECT_NEAR(report.final_torque_Nm[1], 0.4095, 1e-12) << "positive commands pull angles down";
}

TEST(EmulatedFalcon, WatchdogCutsTheMotorsAtItsOwnTime) {
  SimulatedFalconWire wire(ready_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  FalconState state;
  ASSERT_TRUE(client.exchange({500, 0, 0}, 0, true, state));
  const rt::TimePoint fed = *wire.device.firmware().last_packet();
  wire.device.advance_to(fed + milliseconds(99));
  EXPECT_EQ(wire.device.report().falcon->final_command[0], 500);
  EXPECT_EQ(wire.device.report().seconds_since_motors_nonzero, 0.0);
  wire.device.advance_to(fed + milliseconds(600));
  const auto report = wire.device.report();
  EXPECT_EQ(report.falcon->final_command[0], 0);
  EXPECT_EQ(report.watchdog_trips, 1U);
  EXPECT_NEAR(report.seconds_since_motors_nonzero.value(), 0.5, 1e-6);
  wire.now = fed + milliseconds(600);
  ASSERT_TRUE(client.exchange({400, 0, 0}, 0, true, state));
  EXPECT_EQ(wire.device.report().falcon->final_command[0], 400) << "the motors obey again";
}

TEST(EmulatedFalcon, ZeroCommandsNeverCountAsMotorsOn) {
  SimulatedFalconWire wire(ready_options());
  FalconClient(wire).enter_normal_mode();
  exchange_until(wire, wire.now + milliseconds(50));
  EXPECT_FALSE(wire.device.report().seconds_since_motors_nonzero.has_value());
  EXPECT_EQ(wire.device.report().motor_energy_delivered_J, 0.0);
}

TEST(EmulatedFalcon, CalibrationButtonIsTheCentreButtonForAMoment) {
  SimulatedFalconWire wire(ready_options());
  FalconClient(wire).enter_normal_mode();
  EXPECT_EQ(exchange_until(wire, wire.now + milliseconds(5)).buttons, 0);
  wire.device.press_calibration_button();
  EXPECT_EQ(exchange_until(wire, wire.now + milliseconds(150)).buttons, 0x04);
  EXPECT_EQ(exchange_until(wire, wire.now + milliseconds(100)).buttons, 0);
}

TEST(EmulatedFalcon, SamplesAreTheCountersOfEveryPacketWithTheirTimes) {
  SimulatedFalconWire wire(ready_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  FalconState state;
  for (int i = 0; i < 10; ++i) {
    ASSERT_TRUE(client.exchange({0, 0, 0}, 0, true, state));
    const auto samples = wire.device.samples();
    ASSERT_EQ(samples.size(), static_cast<std::size_t>(i + 1));
    EXPECT_EQ(samples.back().counts,
              (std::array<std::int32_t, 6>{state.encoders[0], state.encoders[1], state.encoders[2],
                                           0, 0, 0}));
    const rt::TimePoint time{std::chrono::nanoseconds(samples.back().time_ns)};
    EXPECT_LT(time, wire.now);
    EXPECT_GT(time, wire.now - milliseconds(2));
  }
}

TEST(EmulatedFalcon, ReportHasTheCommonKeysAndItsOwnInPlaceOfCurrents) {
  SimulatedFalconWire wire(falcon_options());
  const nlohmann::json json = wire.device.report();
  for (const char* key :
       {"device", "busid", "final_torque_Nm", "watchdog_trips", "reports_sent", "frames",
        "tip_position_m", "counters", "attached", "final_command", "max_abs_command",
        "max_abs_torque_Nm", "firmware_state", "homed", "saturated_commands"}) {
    EXPECT_TRUE(json.contains(key)) << key;
  }
  EXPECT_FALSE(json.contains("final_current_mA"));
  EXPECT_EQ(json.at("firmware_state"), "cold");
  EXPECT_EQ(json.at("device"), "falcon");
}

TEST(EmulatedFalcon, LongStallsAreCountedNotIntegrated) {
  SimulatedFalconWire wire(ready_options());
  FalconClient client(wire);
  client.enter_normal_mode();
  FalconState state;
  ASSERT_TRUE(client.exchange({300, 0, 0}, 0, true, state));
  wire.device.advance_to(wire.now + seconds(61));
  EXPECT_NEAR(wire.device.report().physics_skipped_s, 60.0, 1e-3);
  EXPECT_EQ(wire.device.report().falcon->final_command[0], 0);
  EXPECT_EQ(wire.device.report().watchdog_trips, 1U);
}

}  // namespace
}  // namespace forcegrid::emulator
