// SPDX-License-Identifier: Apache-2.0
#include "driver/falcon_device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <thread>

#include "driver/calibration.h"
#include "scripted_falcon.h"

namespace forcegrid::driver {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using State = ScriptedFalcon::State;
using Script = ScriptedFalcon::Script;

constexpr std::uint8_t kAll = 0b111;
constexpr int kRed = 0x08 | 0x01;  // byte 13 with the homing bit, as the sheet has it
constexpr int kGreen = 0x02 | 0x01;

/// The sheet's synthetic image with a block, and enough data behind it for several chunks.
falcon::Firmware image_of_chunks() {
  falcon::Firmware firmware{.name = "test image", .bytes = {0xAA, 0x08}};
  firmware.bytes.resize(18, 0x00);
  constexpr int kWords = 100;
  for (const int byte : {0x3F, 0x00, 0x02, 0x80, kWords, 0x00, 0x3F, 0x00, 0x00, 0x80}) {
    firmware.bytes.push_back(static_cast<std::uint8_t>(byte));
  }
  for (int i = 0; i < 2 * kWords; ++i) {
    firmware.bytes.push_back(static_cast<std::uint8_t>(37 * i + 11));
  }
  firmware.bytes.resize(firmware.bytes.size() + 2, 0x00);
  return firmware;
}

/// Generous times: the tests share their machine. The ones about a time-out set their own.
OpenOptions patient() {
  OpenOptions options;
  options.connect_timeout = seconds(5);
  options.open_timeout = seconds(10);
  options.stale_after = seconds(10);
  options.servo_silence = seconds(10);
  options.write_timeout = seconds(5);
  options.realtime_io = false;
  options.firmware = image_of_chunks();
  return options;
}

/// As many attempts as the tests need, each long enough for a busy machine.
falcon::StartupTiming brief() {
  return {.probes = 2,
          .probe_reply = milliseconds(100),
          .handshakes = 2,
          .handshake_reply = milliseconds(200),
          .autobaud_reply = milliseconds(200),
          .echo = milliseconds(300),
          .write = seconds(5)};
}

template <typename Condition>
::testing::AssertionResult eventually(Condition condition) {
  const auto deadline = rt::Clock::now() + seconds(10);
  while (!condition()) {
    if (rt::Clock::now() > deadline) {
      return ::testing::AssertionFailure() << "it did not happen within 10 s";
    }
    std::this_thread::sleep_for(milliseconds(1));
  }
  return ::testing::AssertionSuccess();
}

class Falcon : public testing::Test {
 protected:
  std::unique_ptr<Device> open(const Script& script, const OpenOptions& options = patient()) {
    falcon_ = std::make_shared<ScriptedFalcon>(script);
    return open_again(options);
  }

  std::unique_ptr<Device> open_again(const OpenOptions& options = patient()) {
    return start_falcon_device(std::make_unique<ScriptedBulkTransport>(falcon_), profile_, options,
                               "scripted", true, brief());
  }

  /// Opened with its firmware running and all axes homed.
  std::unique_ptr<Device> open_homed(const OpenOptions& options = patient()) {
    auto device = open({.state = State::kRunning}, options);
    falcon_->set_homed(kAll);
    EXPECT_TRUE(eventually([&] { return device->newest_report().homed == kAll; }));
    return device;
  }

  std::string error_of_open(const Script& script, const OpenOptions& options = patient()) {
    try {
      static_cast<void>(open(script, options));
    } catch (const DeviceError& error) {
      EXPECT_THAT(error.what(), HasSubstr("device 'scripted'"));
      return error.what();
    }
    ADD_FAILURE() << "opened";
    return "";
  }

  /// Waits until the device has taken so many more packets.
  ::testing::AssertionResult after_packets(std::size_t count) {
    const std::size_t goal = falcon_->packets().size() + count;
    return eventually([&] { return falcon_->packets().size() >= goal; });
  }

  /// Waits until the newest packet carries `command`.
  ::testing::AssertionResult commands_become(const std::array<int, 3>& command) {
    return eventually([&] { return falcon_->last_command() == command; });
  }

  /// Keeps the servo from being silent while a test waits.
  static MotorCommand torque(double a_Nm, double b_Nm, double c_Nm) {
    return {.joint_torque_Nm = {a_Nm, b_Nm, c_Nm}};
  }

  const profiles::DeviceProfile profile_ = profiles::load_device_profile("falcon");
  std::shared_ptr<ScriptedFalcon> falcon_;
};

// --- bringing it up ---

TEST_F(Falcon, IsLoadedWithFirmwareWhenItIsCold) {
  std::vector<std::string> notices;
  OpenOptions options = patient();
  options.notice = [&](const std::string& text) { notices.push_back(text); };
  const auto device = open({}, options);
  EXPECT_EQ(falcon_->state(), State::kRunning);
  EXPECT_EQ(falcon_->image(), image_of_chunks().bytes);
  EXPECT_GE(device->newest_report().sequence, 1U);
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
  EXPECT_THAT(notices, ElementsAre(HasSubstr("sending firmware 'test image' (230 bytes)")));
}

TEST_F(Falcon, MeetsTheBootLoaderInTheSheetsOrder) {
  const auto device = open({});
  std::vector<std::pair<int, int>> settings;  // request, value; without purges
  for (const ControlRequest& request : falcon_->requests()) {
    EXPECT_EQ(request.request_type, 0x40);
    EXPECT_EQ(request.index, 0);
    if (request.request != 0x00) {
      settings.emplace_back(request.request, request.value);
    }
  }
  using Setting = std::pair<int, int>;
  EXPECT_THAT(settings,
              ElementsAre(Setting{0x09, 1}, Setting{0x03, 0x0002},       // is it running?
                          Setting{0x09, 16}, Setting{0x03, 0x4138},      // 9600 baud
                          Setting{0x04, 0x0008}, Setting{0x02, 0},       // 8N1, no flow
                          Setting{0x01, 0x0200},                         // RTS low
                          Setting{0x01, 0x0100}, Setting{0x01, 0x0101},  // DTR low, high
                          Setting{0x01, 0x0100}, Setting{0x03, 0x0015},  // DTR low, 142.9 k
                          Setting{0x09, 1}, Setting{0x03, 0x0002}));     // run
}

TEST_F(Falcon, IsNotLoadedAgainWhenFirmwareRuns) {
  OpenOptions options = patient();
  options.firmware = {};
  const auto device = open({.state = State::kRunning}, options);
  EXPECT_TRUE(falcon_->image().empty());
  for (const ControlRequest& request : falcon_->requests()) {
    EXPECT_NE(request.request, 0x01) << "DTR would restart it";
  }
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
}

TEST_F(Falcon, WithoutFirmwareSaysWhereToGetIt) {
  OpenOptions options = patient();
  options.firmware = {};
  EXPECT_THAT(error_of_open({}, options),
              AllOf(HasSubstr("no firmware runs in it"), HasSubstr("libnifalcon"),
                    HasSubstr("--firmware FILE")));
  EXPECT_TRUE(falcon_->image().empty());
}

TEST_F(Falcon, PassesOverSpuriousBytesBeforeTheBootLoadersAnswer) {
  const auto device = open({.before_greeting = {0x00}});
  EXPECT_EQ(falcon_->state(), State::kRunning);
}

TEST_F(Falcon, StopsTheDownloadAtAWrongEcho) {
  EXPECT_THAT(error_of_open({.wrong_echo_at = 70}),
              AllOf(HasSubstr("returned "), HasSubstr("for byte 70 of 'test image'"),
                    HasSubstr("try once more")));
  // The chunk with the byte went out, nothing after it: no packet into a boot loader either.
  EXPECT_EQ(falcon_->image().size(), 124U);
  EXPECT_EQ(falcon_->state(), State::kLoading);
}

TEST_F(Falcon, StopsTheDownloadWhenTheEchoStops) {
  EXPECT_THAT(error_of_open({.silent_from = 100}),
              AllOf(HasSubstr("returned only 38 of 62 bytes (at byte 62 of 230)"),
                    HasSubstr("switch the Falcon off and on again")));
}

TEST_F(Falcon, TellsADeviceThatAnswersWithStatusOnly) {
  EXPECT_THAT(error_of_open({.answers_greeting = false}),
              AllOf(HasSubstr("neither firmware nor boot loader"),
                    HasSubstr("switch the Falcon's power on")));
}

TEST_F(Falcon, TellsABootLoaderThatDoesNotAgreeOnABaudRate) {
  EXPECT_THAT(error_of_open({.answers_autobaud = false}), HasSubstr("does not return the 'A'"));
  EXPECT_TRUE(falcon_->image().empty());
}

TEST_F(Falcon, TellsADeviceThatStaysInItsBootLoader) {
  EXPECT_THAT(error_of_open({.runs_what_it_loaded = false}),
              AllOf(HasSubstr("took the firmware 'test image'"), HasSubstr("does not answer")));
}

TEST_F(Falcon, TellsAnUnplugDuringTheDownload) {
  EXPECT_THAT(
      error_of_open({.unplugged_at = 130}),
      AllOf(HasSubstr("unplugged"), HasSubstr("sending the firmware (at byte 124 of 230)")));
}

TEST_F(Falcon, TellsAChipThatTakesNoRequests) {
  EXPECT_THAT(error_of_open({.takes_requests = false}),
              AllOf(HasSubstr("does not take a control request"), HasSubstr("plug it in again")));
}

TEST_F(Falcon, RefusesADeviceWithOtherNumbersThanTheProfiles) {
  profiles::DeviceProfile other = profile_;
  other.usb.product_id = 0x6001;
  falcon_ = std::make_shared<ScriptedFalcon>(Script{.state = State::kRunning});
  try {
    static_cast<void>(start_falcon_device(std::make_unique<ScriptedBulkTransport>(falcon_), other,
                                          patient(), "scripted", true, brief()));
    FAIL() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("it is 0403:cb48"), HasSubstr("has 0403:6001")));
  }
  EXPECT_TRUE(falcon_->packets().empty());
}

// --- the exchange ---

TEST_F(Falcon, ReportsCountsButtonsAndHoming) {
  const auto device = open({.state = State::kRunning});
  falcon_->set_counts({456, -998, -29});
  falcon_->set_buttons(0b1001);
  falcon_->set_homed(0b011);
  ASSERT_TRUE(eventually([&] { return device->newest_report().homed == 0b011; }));
  const DeviceReport report = device->newest_report();
  EXPECT_EQ(report.counts, (std::array<std::int32_t, 6>{456, -998, -29, 0, 0, 0}));
  EXPECT_EQ(report.buttons, 0b1001);
  EXPECT_FALSE(report.calibration_button);
  EXPECT_GE(report.received, report.released);
  EXPECT_EQ(device->identity().product, "FALCON HAPTIC");
}

TEST_F(Falcon, HasNoForceBeforeAllAxesAreHomed) {
  const auto device = open({.state = State::kRunning});
  for (const int homed : {0b000, 0b001, 0b110, 0b101}) {
    falcon_->set_homed(static_cast<std::uint8_t>(homed));
    device->command(torque(0.1, -0.1, 0.1));
    ASSERT_TRUE(after_packets(3));
    EXPECT_EQ(falcon_->last_flags(), kRed);
  }
  EXPECT_EQ(falcon_->largest_command(), 0);
}

TEST_F(Falcon, ForgetsWhatWasCommandedBeforeItWasHomed) {
  const auto device = open({.state = State::kRunning});
  device->command(torque(0.1, -0.1, 0.1));
  ASSERT_TRUE(after_packets(3));
  falcon_->set_homed(kAll);
  ASSERT_TRUE(eventually([&] { return falcon_->last_flags() == kGreen; }));
  ASSERT_TRUE(after_packets(3));
  EXPECT_EQ(falcon_->largest_command(), 0);
}

TEST_F(Falcon, CommandsTheSheetsValuesWhenHomed) {
  const auto device = open_homed();
  device->command(torque(0.166612722942, -0.068462352799, -0.012788825604));
  EXPECT_TRUE(commands_become({-1666, 684, 127}));
  EXPECT_EQ(falcon_->last_flags(), kGreen);
}

TEST_F(Falcon, ScalesCommandsTogether) {
  const auto device = open_homed();
  device->command(torque(0.9, -0.45, 0.225));
  EXPECT_TRUE(commands_become({-4095, 2047, -1023}));
  EXPECT_GE(device->statistics().commands_clamped, 1U);
}

TEST_F(Falcon, SendsZeroForWhatIsNoNumber) {
  const auto device = open_homed();
  device->command(torque(0.1, 0.1, 0.1));
  ASSERT_TRUE(commands_become({-1000, -1000, -1000}));
  device->command(torque(0.1, std::numeric_limits<double>::quiet_NaN(), 0.1));
  EXPECT_TRUE(commands_become({0, 0, 0}));
  EXPECT_TRUE(eventually([&] { return device->statistics().commands_not_finite == 1; }));
}

TEST_F(Falcon, SendsZeroWhenTheServoFallsSilent) {
  OpenOptions options = patient();
  options.servo_silence = milliseconds(50);
  const auto device = open_homed(options);
  ASSERT_TRUE(eventually([&] {
    device->command(torque(0.1, 0.1, 0.1));
    return falcon_->largest_command() == 1000;
  }));
  EXPECT_TRUE(commands_become({0, 0, 0}));
  EXPECT_TRUE(eventually([&] { return device->statistics().commands_starved > 0; }));
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
}

TEST_F(Falcon, FindsPacketsBehindGarbage) {
  const auto device = open({.state = State::kRunning, .before_packet = {0x00, 0x3E, 0x41, 0x3C}});
  falcon_->set_counts({1, 2, 3});
  ASSERT_TRUE(eventually([&] { return device->newest_report().counts[2] == 3; }));
  EXPECT_EQ(device->newest_report().counts[0], 1);
  EXPECT_GT(device->statistics().reports_rejected, 0U);
  EXPECT_EQ(device->statistics().reports_lost, 0U);
}

TEST_F(Falcon, GoesOnAfterALostReply) {
  const auto device = open_homed();
  falcon_->swallow(1);
  ASSERT_TRUE(eventually([&] { return device->statistics().reports_lost >= 1; }));
  const std::uint64_t sequence = device->newest_report().sequence;
  ASSERT_TRUE(eventually([&] { return device->newest_report().sequence > sequence + 3; }));
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
}

TEST_F(Falcon, StaysInStepAfterARepeatedReply) {
  const auto device = open_homed();
  falcon_->repeat(1);
  ASSERT_TRUE(after_packets(5));
  // One packet, one reply: nothing old is left to be read later.
  const std::uint64_t before = device->newest_report().sequence;
  const std::size_t packets = falcon_->packets().size();
  ASSERT_TRUE(after_packets(20));
  const auto replies = static_cast<double>(device->newest_report().sequence - before);
  EXPECT_NEAR(replies, static_cast<double>(falcon_->packets().size() - packets), 3.0);
}

// --- ends ---

TEST_F(Falcon, GetsZeroBeforeItIsClosed) {
  const auto device = open_homed();
  device->command(torque(0.1, 0.1, 0.1));
  ASSERT_TRUE(commands_become({-1000, -1000, -1000}));
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(falcon_->last_command(), (std::array<int, 3>{}));
  EXPECT_EQ(device->health(), DeviceHealth::kClosed);
  EXPECT_TRUE(device->stop());
}

TEST_F(Falcon, AnAnswerToAnEarlierPacketIsNotOneToTheLastZero) {
  const auto device = open_homed();
  falcon_->fall_behind();
  ASSERT_TRUE(eventually([&] { return device->statistics().reports_lost >= 1; }));
  device->command(torque(0.1, 0.1, 0.1));
  ASSERT_TRUE(commands_become({-1000, -1000, -1000}));
  falcon_->set_deaf(true);
  EXPECT_FALSE(device->stop());
  EXPECT_EQ(falcon_->last_command(), (std::array<int, 3>{-1000, -1000, -1000}));
}

TEST_F(Falcon, LateAnswersAreLetArriveBeforeTheLastZero) {
  const auto device = open_homed();
  falcon_->swallow(2);
  ASSERT_TRUE(eventually([&] { return device->statistics().reports_lost >= 1; }));
  device->command(torque(0.1, 0.1, 0.1));
  ASSERT_TRUE(commands_become({-1000, -1000, -1000}));
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(falcon_->last_command(), (std::array<int, 3>{}));
}

TEST_F(Falcon, KeepsItsFirmwareForTheNextClient) {
  open({})->stop();
  OpenOptions options = patient();
  options.firmware = {};
  const auto device = open_again(options);
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
}

TEST_F(Falcon, TellsAnUnplugDuringForce) {
  const auto device = open_homed();
  device->command(torque(0.1, 0.1, 0.1));
  ASSERT_TRUE(commands_become({-1000, -1000, -1000}));
  falcon_->unplug();
  ASSERT_TRUE(eventually([&] { return device->health() == DeviceHealth::kUnplugged; }));
  EXPECT_THAT(device->failure(), HasSubstr("unplugged"));
  EXPECT_FALSE(device->stop());
}

TEST_F(Falcon, TellsFirmwareThatFallsSilentAndCommandsZero) {
  OpenOptions options = patient();
  options.stale_after = milliseconds(300);
  const auto device = open_homed(options);
  device->command(torque(0.1, 0.1, 0.1));
  ASSERT_TRUE(commands_become({-1000, -1000, -1000}));
  falcon_->set_answering(false);
  ASSERT_TRUE(eventually([&] { return device->health() == DeviceHealth::kStale; }));
  EXPECT_THAT(device->failure(),
              AllOf(HasSubstr("no packet for 300 ms"), HasSubstr("Falcon's power")));
  EXPECT_TRUE(commands_become({0, 0, 0}));
  EXPECT_FALSE(device->stop());
}

TEST_F(Falcon, EndsWithZeroWhenAnAxisLosesItsReference) {
  const auto device = open_homed();
  device->command(torque(0.1, 0.1, 0.1));
  ASSERT_TRUE(commands_become({-1000, -1000, -1000}));
  const DeviceReport before = device->newest_report();
  falcon_->set_counts({9000, 9000, 9000});
  falcon_->set_homed(0b101);
  ASSERT_TRUE(eventually([&] { return device->health() == DeviceHealth::kProtocol; }));
  EXPECT_THAT(device->failure(),
              AllOf(HasSubstr("axis 2 (right) lost its reference"), HasSubstr("home it")));
  EXPECT_TRUE(commands_become({0, 0, 0}));
  // Counts without a reference never become a position.
  EXPECT_TRUE(device->newest_report().counts == before.counts ||
              device->newest_report().homed == kAll);
}

TEST_F(Falcon, CantHaveItsCountersSet) {
  const auto device = open_homed();
  try {
    device->load_counters({});
    FAIL() << "loaded";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("home it"), HasSubstr("Pull the knob")));
  }
}

// --- homing ---

TEST_F(Falcon, IsHomedByAPersonWhoIsToldWhatToDo) {
  const auto device = open({.state = State::kRunning});
  std::vector<std::string> prompts;
  const bool done = calibrate(*device, profile_, seconds(20), [&](const std::string& text) {
    prompts.push_back(text);
    falcon_->set_homed(kAll);
  });
  EXPECT_TRUE(done);
  EXPECT_THAT(prompts, ElementsAre(AllOf(HasSubstr("Pull the knob"), HasSubstr("push it"))));
}

TEST_F(Falcon, AsksNobodyWhenItIsHomedAlready) {
  const auto device = open_homed();
  EXPECT_TRUE(calibrate(*device, profile_, seconds(20),
                        [](const std::string& text) { ADD_FAILURE() << text; }));
}

TEST_F(Falcon, SaysWhichAxesWereNotHomedInTime) {
  const auto device = open({.state = State::kRunning});
  falcon_->set_homed(0b010);
  ASSERT_TRUE(eventually([&] { return device->newest_report().homed == 0b010; }));
  try {
    static_cast<void>(calibrate(*device, profile_, milliseconds(50)));
    FAIL() << "homed";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("axis 1 (top), 3 (left) was not homed in time"));
  }
}

TEST_F(Falcon, HomingCanBeGivenUp) {
  const auto device = open({.state = State::kRunning});
  EXPECT_FALSE(calibrate(*device, profile_, seconds(20), {}, [] { return true; }));
}

}  // namespace
}  // namespace forcegrid::driver
