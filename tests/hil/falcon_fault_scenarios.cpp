// SPDX-License-Identifier: Apache-2.0
// Faults of an emulated Falcon on the stock kernel, through usbfs and libusb: of its boot loader,
// and in mid-force. By the emulator's own record of its motors.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/hil/falcon_bench.h"
#include "tests/hil/faulty_run.h"
#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using std::chrono::milliseconds;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

// --- Before the firmware runs. ---

/// Refused with all of `words`; the motors never on.
FaultyRun expect_refused(const std::string& fault, const std::string& image,
                         const std::vector<std::string>& words) {
  FalconBench bench(fault.empty() ? std::vector<std::string>{}
                                  : std::vector<std::string>{"--fault", fault});
  FaultyRun result{run_falcon("falcon", 1.0, {"--firmware", image}), {}};
  EXPECT_EQ(result.felt.status, 1) << result.felt.text;
  for (const std::string& each : words) {
    EXPECT_THAT(result.felt.text, HasSubstr(each));
  }
  EXPECT_THAT(result.felt.text, Not(HasSubstr("terminate called")));
  result.emulator = bench.end();
  EXPECT_EQ(largest_command(result.emulator), 0.0);
  EXPECT_EQ(number(result.emulator, "firmware_starts"), 0);
  return result;
}

constexpr char kOffAndOn[] = "switch the Falcon off and on again, and try once more";
constexpr char kNobodyAnswers[] = "its USB chip answers, but neither firmware nor boot loader does";

TEST(LongFalconFault, AWrongEchoIsNamedWithItsByteAndTheNextDownloadWorks) {
  FalconBench bench({"--fault", "wrong-echo:at=70,count=1"});
  const std::string image = image_file(60);
  // 28 bytes come before the data, whose byte 42 is the low half of word 21.
  const EndedRun refused = run_falcon("falcon", 1.0, {"--firmware", image});
  EXPECT_EQ(refused.status, 1) << refused.text;
  EXPECT_THAT(refused.text, AllOf(HasSubstr("the boot loader returned 14 for byte 70 of '" + image +
                                            "', which is 15"),
                                  HasSubstr("try once more")));
  const EndedRun again = run_falcon("falcon", 0.5, {"--firmware", image});
  EXPECT_EQ(again.status, 0) << again.text;
  const nlohmann::json emulator = bench.end();
  EXPECT_EQ(number(emulator, "firmware_starts"), 1) << "the rest of the image was sent";
  EXPECT_EQ(final_command(emulator), kMotorsOff);
}

TEST(LongFalconFault, ATruncatedImageReachesNoDevice) {
  const std::string image = image_file(60);
  std::filesystem::resize_file(image, 100);
  const FaultyRun result = expect_refused("", image, {"'" + image + "'", "nothing was sent"});
  EXPECT_EQ(number(result.emulator, "boot_handshakes"), 0);
  EXPECT_EQ(number(result.emulator, "firmware_bytes_loaded"), 0);
}

TEST(LongFalconFault, ABootLoaderThatDoesNotGreetIsRefused) {
  expect_refused("stuck-boot-loader:step=greeting", image_file(60), {kNobodyAnswers});
}

TEST(LongFalconFault, ABootLoaderWithoutABaudRateIsRefused) {
  expect_refused("stuck-boot-loader:step=baud-rate", image_file(60),
                 {"the boot loader answers its greeting but does not return the 'A'", kOffAndOn});
}

TEST(LongFalconFault, AnImageThatDoesNotStartIsRefused) {
  expect_refused("stuck-boot-loader", image_file(60),
                 {"but the firmware does not answer", "switch the device off and on again"});
}

TEST(LongFalconFault, AChipThatAnswersWithStatusOnlyIsRefused) {
  expect_refused("status-only", image_file(60),
                 {kNobodyAnswers, "switch the Falcon's power on (or off and on again)"});
}

TEST(LongFalconFault, AStallOnControlLeavesNoDeviceToOpen) {
  covers_device("falcon");
  covers_host("kernel");
  const nlohmann::json report = expect_refused_with_stalled_control(
      "falcon",
      [] {
        return run_falcon("falcon", 1.0, {"--firmware", image_file(2)});
      },
      "no such device is attached");
  ASSERT_TRUE(report.is_object());
  EXPECT_EQ(number(report, "boot_handshakes"), 0);
}

// --- In mid-force. ---

// What was under way, a frame of the bus, and a guest that stands still for a moment.
constexpr double kSlack_s = 0.05;
constexpr double kWatchdog_s = 0.1;
constexpr double kUntilWatchdog_s = kWatchdog_s + kSlack_s;
// The cycle that sees a fault, and the packet that carries the zero.
constexpr double kReaction_s = 0.02 + kSlack_s;
// The scenarios' --device-timeout-ms 400, seen at the end of an exchange, which may take 40 ms, and
// one such exchange more for the zero.
constexpr double kUntilStale_s = 0.4 + 2 * 0.04 + kReaction_s;

/// The tool is at the object from 1.7 s on; after half a second of force the fault begins.
FaultyRun run_with(const std::string& fault, double run_s = 3.6, const char* motion = "chirp") {
  std::vector<std::string> arguments = kHomed;
  arguments.insert(arguments.end(), {"--motion", motion, "--fault", fault});
  FalconBench bench(arguments);
  FaultyRun result{run_falcon("falcon", run_s), {}};
  std::this_thread::sleep_for(milliseconds(300));  // longer than the device's watchdog takes
  result.emulator = bench.end();
  expect_orderly_end(result);
  return result;
}

/// Endured, and counted under this key of the summary.
void expect_counted(const FaultyRun& run, const char* key) {
  expect_endured(run);
  if (run.felt.summary.is_object()) {
    EXPECT_GT(number(run.felt.summary, key), 0);
  }
}

TEST(LongFalconFault, DroppedPacketsAreCounted) {
  expect_counted(run_with("drop-report"), "reports_lost");
}

TEST(LongFalconFault, DuplicatedPacketsAreDrained) {
  expect_counted(run_with("duplicate-report"), "reports_drained");
}

TEST(LongFalconFault, ShortPacketsNowAndThenAreSkipped) {
  expect_counted(run_with("short-report:every=50"), "reports_rejected");
}

TEST(LongFalconFault, BytesBehindAPacketAreSkipped) {
  expect_counted(run_with("long-report"), "reports_rejected");
}

TEST(LongFalconFault, PacketsLateBy5msAreEndured) { expect_endured(run_with("late-report:ms=5")); }

TEST(LongFalconFault, ASmallCorruptionIsEndured) {
  expect_endured(run_with("corrupt-report:size=small"));
}

TEST(LongFalconFault, AWrapOf16BitsIsNormal) {
  expect_endured(run_with("wrapping-encoder:when=power-up"));
}

TEST(LongFalconFault, FirmwareSlowBy20msIsEndured) {
  expect_endured(run_with("slow-firmware:ms=20"));
}

TEST(LongFalconFault, PacketsLateBy70msEndTheRun) {
  expect_motors_off(run_with("late-report:ms=70", 5.0), {"late_reports"}, 2.0);
}

TEST(LongFalconFault, PacketsLateBy500msEndTheRun) {
  expect_motors_off(run_with("late-report:ms=500"), {"stale_reports"}, kUntilStale_s);
}

TEST(LongFalconFault, ShortPacketsAlwaysEndTheRun) {
  expect_motors_off(run_with("short-report"), {"stale_reports"}, kUntilStale_s);
}

TEST(LongFalconFault, StatusOnlyInMidForceEndsTheRun) {
  expect_motors_off(run_with("status-only:when=motors"), {"stale_reports"}, kUntilStale_s);
}

TEST(LongFalconFault, CorruptPacketsEndTheRun) {
  expect_zero_sent(run_with("corrupt-report"), {"implausible_jump", "too_fast", "bad_pose"},
                   kReaction_s);
}

TEST(LongFalconFault, AJumpingEncoderEndsTheRun) {
  expect_zero_sent(run_with("jumping-encoder"), {"implausible_jump"}, kReaction_s);
}

TEST(LongFalconFault, ASaturatedEncoderEndsTheRun) {
  expect_zero_sent(run_with("saturated-encoder"), {"saturated_encoder"}, kReaction_s);
}

// A joint is watched for 0.16 s, and a suspicion that came just before may have left it alone for a
// second. By then the hand pulls at the object and only trembles.
TEST(LongFalconFault, FrozenEncodersEndTheRun) {
  expect_zero_sent(run_with("frozen-encoder:axis=all,when=7", 10.0, "hold"), {"frozen_encoder"},
                   1.16 + kReaction_s);
}

// libusb hears of the halt, and the way to the motors is open: a zero goes out that nothing
// answers.
TEST(LongFalconFault, AStallOnInEndsTheRun) {
  expect_watchdog(run_with("stall-in"), {"protocol"}, kReaction_s);
}

TEST(LongFalconFault, BabbleEndsTheRun) {
  expect_watchdog(run_with("babble"), {"protocol"}, kReaction_s);
}

TEST(LongFalconFault, AStallOnOutLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("stall-out"), {"protocol"}, kUntilWatchdog_s);
}

TEST(LongFalconFault, NakForEverOnOutLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("nak-out"), {"stale_reports"}, kUntilWatchdog_s);
}

// Longer than the scenarios' --device-timeout-ms 400.
TEST(LongFalconFault, FirmwareSlowBy600msLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("slow-firmware:ms=600"), {"stale_reports"}, kUntilWatchdog_s);
}

TEST(LongFalconFault, AConnectionThatClosesLeavesTheMotorsToTheWatchdog) {
  expect_watchdog(run_with("connection-closed"), {"unplugged"}, kUntilWatchdog_s);
}

TEST(LongFalconFault, ARebootOfTheFirmwareTakesThePowerAndEndsTheRun) {
  expect_watchdog(run_with("firmware-reboot"), {"unplugged"}, kSlack_s);
}

TEST(LongFalconFault, AMotorThatPushesTheWrongWayIsFoundBeforeAnyForce) {
  expect_wrong_way_motor(run_with("wrong-way-motor:axis=b"));
}

}  // namespace
}  // namespace forcegrid::hil
