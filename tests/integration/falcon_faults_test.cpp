// SPDX-License-Identifier: Apache-2.0
// Faults of an emulated Falcon through serial chip, boot loader, driver and servo loop: what is it
// called, and when are the motors without a command? By the emulator's own record of its motors.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <string>

#include "driver/device.h"
#include "driver/falcon_firmware.h"
#include "driver/mechanism.h"
#include "tests/integration/fault_bench.h"

namespace forcegrid {
namespace {

using emulator::MotionKind;
using servo::Fault;
using std::chrono::milliseconds;
using ::testing::AllOf;
using testing::Endured;
using testing::FaultBench;
using testing::FaultyRun;
using ::testing::HasSubstr;
using testing::kReaction_ms;
using testing::pushed;

constexpr std::array<std::int32_t, 3> kNoCommand = {0, 0, 0};

// --- Before the firmware runs. ---

/// A Falcon that is as after power-on but for `fault`, behind USB/IP.
class ColdFalcon {
 public:
  explicit ColdFalcon(const std::string& fault) : server_({"127.0.0.1:0", {options(fault)}}) {
    server_.start();
  }

  /// @returns what the driver says when it refuses, "" when it opens the device and closes it
  /// again.
  std::string open(const driver::falcon::Firmware& firmware) {
    // The server may still be letting go of the driver before.
    for (int i = 0; i < 2000 && server_.report().attached; ++i) {
      std::this_thread::sleep_for(milliseconds(5));
    }
    driver::OpenOptions options;
    options.firmware = firmware;
    try {
      const auto device =
          driver::open_device("usbip://" + server_.address() + "/1-1", profile(), options);
      EXPECT_TRUE(device->stop()) << device->failure();
    } catch (const driver::DeviceError& error) {
      return error.what();
    }
    return "";
  }

  emulator::EmulatorReport report() const { return server_.report(); }

 private:
  static profiles::DeviceProfile profile() { return profiles::load_device_profile("falcon"); }
  static emulator::DeviceOptions options(const std::string& fault) {
    emulator::DeviceOptions options;
    options.profile = profile();
    options.faults = {emulator::parse_fault(fault)};
    return options;
  }

  emulator::EmulatorServer server_;
};

/// Two chunks and a bit of the download (fact sheet, section 4.4).
driver::falcon::Firmware long_firmware() {
  constexpr std::size_t kWords = 60;
  driver::falcon::Firmware firmware = driver::falcon::synthetic_firmware();
  firmware.name = "long image";
  auto& bytes = firmware.bytes;
  bytes.resize(22);  // key, reserved words and entry address
  bytes.insert(bytes.end(), {kWords, 0x00, 0x3F, 0x00, 0x00, 0x80});
  for (std::size_t i = 0; i < 2 * kWords; ++i) {
    bytes.push_back(static_cast<std::uint8_t>(i));
  }
  bytes.insert(bytes.end(), {0x00, 0x00});
  driver::falcon::check_firmware(bytes, firmware.name);
  return firmware;
}

TEST(FalconWrongEcho, IsNamedWithItsByteAndEndsTheDownload) {
  ColdFalcon falcon("wrong-echo:at=70,count=1");
  // Byte 70 is the 43rd data byte, 0x2A, and comes back with its lowest bit turned.
  EXPECT_THAT(
      falcon.open(long_firmware()),
      AllOf(HasSubstr("the boot loader returned 2B for byte 70 of 'long image', which is 2A"),
            HasSubstr("the line is disturbed"), HasSubstr("try once more")));
  EXPECT_EQ(falcon.report().faults.at(0).times, 1u);
  EXPECT_EQ(falcon.report().falcon->firmware_starts, 0u) << "the rest of the image was sent";
  EXPECT_EQ(falcon.report().falcon->max_abs_command, kNoCommand);
  // The advice helps: the boot loader starts again, and the second image gets through.
  EXPECT_EQ(falcon.open(long_firmware()), "");
  EXPECT_EQ(falcon.report().falcon->firmware_starts, 1u);
  EXPECT_EQ(falcon.report().falcon->firmware_state, "running");
}

struct Stuck {
  const char* test;
  const char* fault;
  const char* words;
  const char* remedy;
};

class StuckFalcon : public ::testing::TestWithParam<Stuck> {};

TEST_P(StuckFalcon, IsRefusedWithWhatItDoesAndWhatToDo) {
  const Stuck& stuck = GetParam();
  ColdFalcon falcon(stuck.fault);
  EXPECT_THAT(falcon.open(driver::falcon::synthetic_firmware()),
              AllOf(HasSubstr(stuck.words), HasSubstr(stuck.remedy)));
  EXPECT_GE(falcon.report().faults.at(0).times, 1u);
  EXPECT_EQ(falcon.report().falcon->firmware_starts, 0u);
  EXPECT_EQ(falcon.report().falcon->max_abs_command, kNoCommand);
}

constexpr char kOffAndOn[] = "switch the Falcon off and on again, and try once more";

INSTANTIATE_TEST_SUITE_P(
    Faults, StuckFalcon,
    ::testing::Values(
        Stuck{"NoAnswerToTheGreeting", "stuck-boot-loader:step=greeting",
              "its USB chip answers, but neither firmware nor boot loader does",
              "switch the Falcon's power on (or off and on again)"},
        Stuck{"NoBaudRate", "stuck-boot-loader:step=baud-rate",
              "the boot loader answers its greeting but does not return the 'A'", kOffAndOn},
        Stuck{"NoStart", "stuck-boot-loader",
              "it took the firmware 'synthetic image for the emulated Falcon', but the firmware "
              "does not answer",
              "switch the device off and on again"},
        Stuck{"StatusOnly", "status-only",
              "its USB chip answers, but neither firmware nor boot loader does",
              "switch the Falcon's power on (or off and on again)"}),
    [](const auto& test) { return test.param.test; });

TEST(FalconStallOnControl, IsRefusedWhenTheFalconIsOpened) {
  ColdFalcon falcon("stall-control");
  EXPECT_THAT(falcon.open(driver::falcon::synthetic_firmware()),
              HasSubstr("refuses its device descriptor"));
  EXPECT_EQ(falcon.report().falcon->boot_handshakes, 0u);
}

// --- In mid-force. ---

/// What the driver waits for a reply before its next packet.
constexpr double kReplyWait_ms = 40.0;
constexpr double kWatchdog_ms = 100.0;
// A packet under way and a frame of the bus.
constexpr double kWatchdogSlack_ms = 30.0;
// Time enough for the motors to push for half a second, and for any fault to be seen.
constexpr double kLongest_s = 5.0;

FaultyRun run_with(const std::string& fault, double duration_s = kLongest_s,
                   bool check_motors = false, milliseconds settle = milliseconds(0)) {
  return FaultBench(fault, MotionKind::kLissajous, "falcon").run(duration_s, check_motors, settle);
}

struct Stop {
  const char* test;
  const char* fault;
  Fault expected;
  const char* words;          ///< of the driver; "" where the loop itself sees the fault
  double visible_after_ms;    ///< until the first cycle that can see it; beyond it 20 ms
  double packet_after_ms;     ///< from then until the driver can send its next packet
  bool zero_answered = true;  ///< whether an answer can come back
};

bool has_no_pose(const servo::CycleRecord& record) {
  const auto mechanism = driver::make_mechanism(profiles::load_device_profile("falcon"));
  const auto status =
      mechanism->forward({record.counts[0], record.counts[1], record.counts[2], 0, 0, 0}).status;
  return status == driver::KinematicsStatus::kOutOfRange ||
         status == driver::KinematicsStatus::kNotFinite;
}

void expect_named(const FaultyRun& run, const Stop& stop) {
  // Random angles mostly belong to no pose of the three arms: then there is no telling how far they
  // jumped, and that is a name for them as well.
  const bool no_pose = run.outcome.fault == Fault::kBadPose && has_no_pose(run.last());
  EXPECT_EQ(no_pose ? Fault::kImplausibleJump : run.outcome.fault, stop.expected)
      << servo::name_of(run.outcome.fault) << ": " << run.outcome.device_failure;
  EXPECT_THAT(run.outcome.device_failure, HasSubstr(stop.words));
  testing::expect_seen(run, stop.fault, stop.visible_after_ms);
}

class FalconFaultWithAnOpenChannel : public ::testing::TestWithParam<Stop> {};

TEST_P(FalconFaultWithAnOpenChannel, IsNamedAndTheMotorsGetZeroWithTheNextPacket) {
  const Stop& stop = GetParam();
  const FaultyRun run = run_with(stop.fault);
  ASSERT_FALSE(run.records.empty());
  ASSERT_TRUE(pushed(run));
  expect_named(run, stop);
  EXPECT_LE(run.motors_off_after_ms(), stop.packet_after_ms + kReaction_ms + run.held_up_ms);
  EXPECT_EQ(run.outcome.zero_current_delivered, stop.zero_answered);
}

INSTANTIATE_TEST_SUITE_P(
    Faults, FalconFaultWithAnOpenChannel,
    ::testing::Values(
        Stop{"LateByHalfASecond", "late-report:ms=500", Fault::kStaleReports,
             "no packet for 100 ms", 140.0, kReplyWait_ms, false},
        Stop{"TooShort", "short-report", Fault::kStaleReports, "no packet for 100 ms", 140.0,
             kReplyWait_ms, false},
        Stop{"StatusOnly", "status-only:when=motors", Fault::kStaleReports, "no packet for 100 ms",
             140.0, kReplyWait_ms, false},
        // Half of the time is allowed to be late; being late all the time uses a quarter of a
        // second up in half a second. The driver sends anew after 40 ms, so that replies 70 ms late
        // come in turns of at most 40 and at least 30 ms: each is late, in whatever phase. (Of 50
        // ms every second one can be in time.)
        Stop{"LateBySeventyMilliseconds", "late-report:ms=70", Fault::kLateReports, "", 700.0,
             kReplyWait_ms},
        Stop{"Corrupt", "corrupt-report", Fault::kImplausibleJump, "", 0.0, 0.0},
        Stop{"EncoderJumps", "jumping-encoder", Fault::kImplausibleJump, "", 0.0, 0.0},
        Stop{"EncoderSaturates", "saturated-encoder", Fault::kSaturatedEncoder, "", 0.0, 0.0},
        // The patience with a joint that has just been suspected is a second.
        Stop{"EncodersFreeze", "frozen-encoder", Fault::kFrozenEncoder, "", 1160.0, 0.0},
        Stop{"StallOnIn", "stall-in", Fault::kProtocol, "Broken pipe", 0.0, 0.0, false},
        Stop{"Babble", "babble", Fault::kProtocol, "Value too large", 0.0, 0.0, false},
        Stop{"OverLongPayload", "over-long-payload", Fault::kProtocol,
             "128 bytes where at most 64 were asked for", 0.0, 0.0, false}),
    [](const auto& test) { return test.param.test; });

class FalconFaultWithAClosedChannel : public ::testing::TestWithParam<Stop> {};

TEST_P(FalconFaultWithAClosedChannel, IsNamedAndTheWatchdogStopsTheMotors) {
  const Stop& stop = GetParam();
  const FaultyRun run = run_with(stop.fault, kLongest_s, false, milliseconds(200));
  ASSERT_FALSE(run.records.empty());
  ASSERT_TRUE(pushed(run));
  expect_named(run, stop);
  EXPECT_FALSE(run.outcome.zero_current_delivered);
  ASSERT_TRUE(run.emulator.faults.at(0).seconds_until_motors_off);
  EXPECT_LE(1e3 * *run.emulator.faults.at(0).seconds_until_motors_off,
            kWatchdog_ms + kWatchdogSlack_ms + run.held_up_ms);
}

INSTANTIATE_TEST_SUITE_P(
    Faults, FalconFaultWithAClosedChannel,
    ::testing::Values(Stop{"StallOnOut", "stall-out", Fault::kProtocol, "Broken pipe", 0.0, 0.0},
                      Stop{"NakForEverOnOut", "nak-out", Fault::kStaleReports,
                           "no packet for 100 ms", 140.0, 0.0},
                      Stop{"FirmwareSlowByThreeTenths", "slow-firmware:ms=300",
                           Fault::kStaleReports, "no packet for 100 ms", 140.0, 0.0},
                      Stop{"FirmwareReboots", "firmware-reboot", Fault::kUnplugged,
                           "closed the connection", 0.0, 0.0},
                      Stop{"ConnectionCloses", "connection-closed", Fault::kUnplugged,
                           "closed the connection", 0.0, 0.0}),
    [](const auto& test) { return test.param.test; });

// --- Faults that the loop lives with, and counts. ---

class EnduredFalconFault : public ::testing::TestWithParam<Endured> {};

TEST_P(EnduredFalconFault, IsCountedAndTheLoopGoesOn) {
  testing::expect_endured(run_with(GetParam().fault, 1.1), GetParam());
}

INSTANTIATE_TEST_SUITE_P(
    Faults, EnduredFalconFault,
    ::testing::Values(
        Endured{"DroppedReports", "drop-report", &driver::DeviceStatistics::reports_lost},
        Endured{"DuplicatedReports", "duplicate-report",
                &driver::DeviceStatistics::reports_drained},
        Endured{"ReportsLateByFiveMilliseconds", "late-report:ms=5", nullptr},
        Endured{"ShortReportsNowAndThen", "short-report:every=50",
                &driver::DeviceStatistics::reports_rejected},
        // What is behind a whole packet is skipped up to the next one.
        Endured{"LongReports", "long-report", &driver::DeviceStatistics::reports_rejected},
        Endured{"CorruptWithinThePlausible", "corrupt-report:size=small", nullptr},
        Endured{"FirmwareSlowByTwentyMilliseconds", "slow-firmware:ms=20", nullptr},
        Endured{"CounterOfSixteenBits", "wrapping-encoder:when=power-up", nullptr}),
    [](const auto& test) { return test.param.test; });

TEST(FalconWrongWayMotor, IsFoundByAPushBeforeAnyForceIsRendered) {
  testing::expect_wrong_way_motor(run_with("wrong-way-motor:axis=b", kLongest_s, true));
}

}  // namespace
}  // namespace forcegrid
