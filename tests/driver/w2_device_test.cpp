// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <cmath>

#include "driver/calibration.h"
#include "driver/open_device.h"
#include "scripted_usbip_server.h"

namespace forcegrid::driver {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::Each;
using testing::HasSubstr;

const Bytes kZero(14);

/// Generous times: the tests share their machine. The ones about a time-out set their own.
OpenOptions patient() {
  OpenOptions options;
  options.connect_timeout = seconds(10);
  options.open_timeout = seconds(10);
  options.stale_after = seconds(10);
  options.servo_silence = seconds(10);
  options.write_timeout = seconds(5);
  options.realtime_io = false;
  return options;
}

Bytes currents(int a, int b, int c) {
  Bytes bytes(14);
  const int values[3] = {a, b, c};
  for (std::size_t i = 0; i < 3; ++i) {
    bytes[2 * i] = static_cast<std::uint8_t>(values[i] & 0xFF);
    bytes[2 * i + 1] = static_cast<std::uint8_t>((values[i] >> 8) & 0xFF);
  }
  return bytes;
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

class W2 : public testing::Test {
 protected:
  std::unique_ptr<Device> open(const OpenOptions& options = patient()) {
    return open_device(server().url(), profile_, options);
  }

  std::string error_of_open(const OpenOptions& options = patient()) {
    try {
      static_cast<void>(open(options));
    } catch (const DeviceError& error) {
      EXPECT_THAT(error.what(), HasSubstr("device '" + server().url() + "': "));
      return error.what();
    }
    ADD_FAILURE() << "opened";
    return "";
  }

  /// The server starts on first use, so that a test can change the script before.
  ScriptedUsbipServer& server() {
    if (!server_) {
      server_ = std::make_unique<ScriptedUsbipServer>(script_);
    }
    return *server_;
  }

  Bytes last_out() { return server().outs().empty() ? Bytes{} : server().outs().back(); }

  profiles::DeviceProfile profile_ = profiles::load_device_profile("woodenhaptics_v2015");
  Script script_;
  std::unique_ptr<ScriptedUsbipServer> server_;
};

// --- opening ---

TEST_F(W2, HasAReportAndZeroCurrentWhenItIsOpen) {
  server().set_counts({1000, 2000, 6500, 0, 0, 0});
  const auto device = open();
  EXPECT_EQ(device->identity().product, "HID DEVICE");
  EXPECT_EQ(device->identity().url, server().url());
  const DeviceReport report = device->newest_report();
  EXPECT_GE(report.sequence, 1U);
  EXPECT_EQ(report.counts, (std::array<std::int32_t, 6>{1000, 2000, 6500, 0, 0, 0}));
  EXPECT_GE(report.received, report.released);
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
  EXPECT_EQ(device->failure(), "");
  EXPECT_THAT(server().outs(), Each(kZero));
}

TEST_F(W2, DiscardsTheFirstReportWhichMayBeOld) {
  // The device's first report was made before the arm moved; only what follows an OUT counts.
  server().set_counts({-30000, 0, 0, 0, 0, 0});
  script_.lie = [this](std::uint32_t sequence) {
    server_->set_counts({5, 6, 7, 0, 0, 0});
    Bytes bytes(48);
    bytes[3] = 3;
    for (std::size_t i = 0; i < 4; ++i) {
      bytes[4 + i] = static_cast<std::uint8_t>(sequence >> (24 - 8 * i));
    }
    return bytes;  // an ordinary answer, without a report: the counters moved while it was taken
  };
  script_.lie_now = true;
  const auto device = open();
  EXPECT_EQ(device->newest_report().counts, (std::array<std::int32_t, 6>{5, 6, 7, 0, 0, 0}));
  EXPECT_EQ(device->statistics().reports_discarded, 1U);
}

TEST_F(W2, KicksADeviceWhoseFirstReportWentToSomebodyElse) {
  script_.speak_first = false;
  const auto device = open();
  EXPECT_GE(device->newest_report().sequence, 1U);
  EXPECT_GE(device->statistics().kicks, 1U);
  EXPECT_THAT(server().outs(), Each(kZero));
}

TEST_F(W2, DoesNotWaitForEverForTheFirstReport) {
  script_.speak_first = false;
  script_.send_reports = false;
  OpenOptions options = patient();
  options.open_timeout = milliseconds(200);
  EXPECT_THAT(error_of_open(options), HasSubstr("no report within 200 ms; press the device's"));
  EXPECT_THAT(server().outs(), Each(kZero));
}

TEST_F(W2, DoesNotWaitForEverForADeviceThatTakesNothing) {
  script_.speak_first = false;
  script_.take_outs = false;
  OpenOptions options = patient();
  options.open_timeout = milliseconds(200);
  options.write_timeout = milliseconds(50);
  EXPECT_THAT(error_of_open(options), HasSubstr("no report within 200 ms"));
}

TEST_F(W2, RefusesW1ByItsNameBeforeItSendsAnything) {
  script_.report_descriptor[15] = 8;
  script_.report_descriptor[21] = 8;
  EXPECT_THAT(error_of_open(), HasSubstr("older W1 protocol (reports of 8 bytes)"));
  EXPECT_THAT(server().outs(), testing::IsEmpty());
}

TEST_F(W2, RefusesAnotherUsageLengthOrDescriptorBeforeItSendsAnything) {
  script_.report_descriptor[1] = 0xAC;
  EXPECT_THAT(error_of_open(), HasSubstr("HID usage is ffac:0200 where profile"));
  EXPECT_THAT(server().outs(), testing::IsEmpty());
  script_.report_descriptor[1] = 0xAB;
  script_.report_descriptor[4] = 0x01;
  EXPECT_THAT(error_of_open(), HasSubstr("HID usage is ffab:0201"));
  script_.report_descriptor[4] = 0x00;
  script_.report_descriptor[21] = 13;
  EXPECT_THAT(error_of_open(), HasSubstr("14 bytes in and 13 out"));
  script_.report_descriptor[21] = 14;
  script_.report_descriptor[26] = 0xC1;
  EXPECT_THAT(error_of_open(), HasSubstr("HID report descriptor"));
  EXPECT_THAT(server().outs(), testing::IsEmpty());
}

TEST_F(W2, RefusesAnotherVendorOrProduct) {
  script_.device_descriptor[10] = 0x07;
  EXPECT_THAT(error_of_open(), HasSubstr("it is 1234:0007 where profile"));
  EXPECT_THAT(server().outs(), testing::IsEmpty());
}

TEST_F(W2, RefusesADeviceThatSendsReportsOfAnotherLength) {
  script_.wrong_length_reports = 1000;
  EXPECT_THAT(error_of_open(), HasSubstr("reports of 13 bytes where its profile has 14"));
}

// --- W3: the same reports in 64 bytes, sheet section 2.2 ---

class W3 : public W2 {
 protected:
  W3() {
    profile_.usb.protocol = "w3";
    profile_.usb.vendor_id = 0x16C0;
    profile_.usb.product_id = 0x0486;
    profile_.usb.report_bytes = 64;
    script_.wire_bytes = 64;
    script_.strings = {"Teensyduino", "Teensyduino RawHID", "1234560"};
    script_.device_descriptor = {0x12, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x40, 0xC0,
                                 0x16, 0x86, 0x04, 0x79, 0x02, 0x01, 0x02, 0x03, 0x01};
    script_.configuration_descriptor = {
        0x09, 0x02, 0x49, 0x00, 0x02, 0x01, 0x00, 0xC0, 0x32,  //
        0x09, 0x04, 0x00, 0x00, 0x02, 0x03, 0x00, 0x00, 0x00,  // RawHID
        0x09, 0x21, 0x11, 0x01, 0x00, 0x01, 0x22, 0x1C, 0x00,  //
        0x07, 0x05, 0x83, 0x03, 0x40, 0x00, 0x01,              //
        0x07, 0x05, 0x04, 0x03, 0x40, 0x00, 0x01,              //
        0x09, 0x04, 0x01, 0x00, 0x02, 0x03, 0x00, 0x00, 0x00,  // serial line
        0x09, 0x21, 0x11, 0x01, 0x00, 0x01, 0x22, 0x21, 0x00,  //
        0x07, 0x05, 0x82, 0x03, 0x40, 0x00, 0x01,              //
        0x07, 0x05, 0x02, 0x03, 0x20, 0x00, 0x02};
    script_.report_descriptor = {0x06, 0xAB, 0xFF, 0x0A, 0x00, 0x02, 0xA1, 0x01, 0x75, 0x08,
                                 0x15, 0x00, 0x26, 0xFF, 0x00, 0x95, 0x40, 0x09, 0x01, 0x81,
                                 0x02, 0x95, 0x40, 0x09, 0x02, 0x91, 0x02, 0xC0};
  }
};

TEST_F(W3, CarriesW2ReportsInTheFirst14Of64Bytes) {
  server().set_counts({-1500, 1200, 5200, 0, 0, 0});
  const auto device = open();
  EXPECT_EQ(device->identity().serial, "1234560");
  EXPECT_EQ(device->newest_report().counts,
            (std::array<std::int32_t, 6>{-1500, 1200, 5200, 0, 0, 0}));
  device->command({.current_A = {-1.797, 0.172, 0.330}});
  Bytes expected = currents(-1797, 172, 330);
  expected.resize(64);
  EXPECT_TRUE(eventually([&] { return last_out() == expected; }));
  device->load_counters({0, 0, 6000, 0, 0, 0}, seconds(10));
  EXPECT_EQ(server().counts(), (std::array<std::int32_t, 6>{0, 0, 6000, 0, 0, 0}));
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(last_out(), Bytes(64));
  EXPECT_THAT(server().outs(), Each(testing::SizeIs(64)));
}

TEST_F(W3, RefusesReportsOf14Bytes) {
  script_.wire_bytes = 14;
  EXPECT_THAT(error_of_open(), HasSubstr("reports of 14 bytes where its profile has 64"));
  script_.report_descriptor[16] = 14;
  script_.report_descriptor[22] = 14;
  EXPECT_THAT(error_of_open(), HasSubstr("14 bytes in and 14 out where profile"));
}

// --- running ---

TEST_F(W2, SendsACommandAndLimitsItToTheProfile) {
  const auto device = open();
  device->command({.current_A = {-1.7976, 0.1725, 0.3300}});
  EXPECT_TRUE(eventually([&] {
    const auto outs = server().outs();
    return std::find(outs.begin(), outs.end(),
                     Bytes{0xFB, 0xF8, 0xAC, 0x00, 0x4A, 0x01, 0, 0, 0, 0, 0, 0, 0, 0}) !=
           outs.end();  // the sheet's bytes of (-1797, 172, 330) mA
  }));
  device->command({.current_A = {40.0, -40.0, 0.0}});
  EXPECT_TRUE(eventually([&] {
    const auto outs = server().outs();
    return std::find(outs.begin(), outs.end(), currents(5999, -5999, 0)) != outs.end();
  }));
  EXPECT_EQ(device->statistics().commands_clamped, 1U);
}

TEST_F(W2, SendsZerosForACurrentThatIsNotFinite) {
  const auto device = open();
  device->command({.current_A = {1.0, std::nan(""), 1.0}});
  EXPECT_TRUE(eventually([&] { return device->statistics().commands_not_finite == 1; }));
  ASSERT_TRUE(device->stop());
  EXPECT_THAT(server().outs(), Each(kZero));
}

TEST_F(W2, RepeatsTheCommandToRenewTheCountsUntilTheServoFallsSilent) {
  OpenOptions options = patient();
  options.servo_silence = milliseconds(500);
  const auto device = open(options);
  device->command({.current_A = {0.5, 0.0, 0.0}});
  EXPECT_TRUE(eventually([&] { return device->statistics().commands_starved >= 5; }));
  const auto outs = server().outs();
  EXPECT_GE(std::count(outs.begin(), outs.end(), currents(500, 0, 0)), 2);
  // Once the zeros have begun, the old command does not come back, but the counts stay fresh.
  const auto sequence = device->newest_report().sequence;
  EXPECT_TRUE(eventually([&] { return device->newest_report().sequence > sequence + 10; }));
  const auto later = server().outs();
  EXPECT_THAT(
      std::vector<Bytes>(later.begin() + static_cast<std::ptrdiff_t>(outs.size()), later.end()),
      Each(kZero));
}

TEST_F(W2, StartsNoRefreshThatWouldBeUnderWayAtTheServosNextRead) {
  OpenOptions options = patient();
  options.servo_silence = milliseconds(500);
  const auto device = open(options);
  EXPECT_TRUE(eventually([&] { return device->statistics().refreshes >= 20; }));
  device->command({.current_A = {0.5, 0.0, 0.0}, .next_read = rt::Clock::now()});
  EXPECT_TRUE(eventually([&] { return device->statistics().commands_starved >= 5; }));
  ASSERT_TRUE(device->stop());
  const auto outs = server().outs();
  // Sent once and never repeated: what follows are the zeros of the silent servo.
  EXPECT_EQ(std::count(outs.begin(), outs.end(), currents(500, 0, 0)), 1);
}

TEST_F(W2, RefreshesWhenTheNextReadIsFarAway) {
  const auto device = open();
  const auto before = device->statistics().refreshes;
  device->command({.current_A = {0.5, 0.0, 0.0}, .next_read = rt::Clock::now() + seconds(10)});
  EXPECT_TRUE(eventually([&] { return device->statistics().refreshes >= before + 20; }));
  EXPECT_EQ(last_out(), currents(500, 0, 0));
}

TEST_F(W2, KeepsCountsFreshWhileTheServoIsSilent) {
  const auto device = open();
  server().set_counts({11, 22, 33, 0, 0, 0});
  EXPECT_TRUE(eventually([&] { return device->newest_report().counts[2] == 33; }));
  const DeviceReport report = device->newest_report();
  EXPECT_TRUE(eventually([&] { return device->newest_report().sequence > report.sequence; }));
  EXPECT_GT(device->newest_report().released, report.released);
}

TEST_F(W2, SendsAgainBeforeAReportThatTheBusHandsOverLate) {
  const auto device = open();
  script_.in_first = true;
  // Each report comes only with the next OUT: waiting for it first would stand still.
  const auto sequence = device->newest_report().sequence;
  DeviceReport report;
  EXPECT_TRUE(eventually([&] {
    report = device->newest_report();
    return report.sequence > sequence + 100;
  }));
  EXPECT_LE(device->statistics().reports_lost, 1U);  // the switch may cost the report under way
  EXPECT_LT(report.sampled_after, report.received);
  EXPECT_LE(report.released, report.received);  // equal where both came in one piece
  device->command({.current_A = {0.25, 0.0, 0.0}});
  EXPECT_TRUE(eventually([&] { return last_out() == currents(250, 0, 0); }));
  device->load_counters({1, 2, 3, 0, 0, 0}, seconds(10));
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(last_out(), kZero);
}

TEST_F(W2, GoesOnAfterTwoOutsThatReleaseOneReport) {
  const auto device = open();
  script_.merge_outs = 1;
  EXPECT_TRUE(eventually([&] { return script_.merge_outs == 0; }));
  const auto sequence = device->newest_report().sequence;
  EXPECT_TRUE(eventually([&] { return device->newest_report().sequence > sequence + 20; }));
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
}

TEST_F(W2, FollowsCountersThroughTheWrapOf16Bits) {
  server().set_counts({32760, -32760, 0, 0, 0, 0});
  const auto device = open();
  EXPECT_EQ(device->newest_report().counts[0], 32760);
  server().set_counts({32780, -32790, 0, 0, 0, 0});
  EXPECT_TRUE(eventually([&] {
    const auto counts = device->newest_report().counts;
    return counts[0] == 32780 && counts[1] == -32790;
  }));
}

TEST_F(W2, CountsAFewShortReportsAndGoesOn) {
  const auto device = open();
  script_.wrong_length_reports = 5;
  EXPECT_TRUE(eventually([&] { return device->statistics().reports_rejected == 5; }));
  const auto sequence = device->newest_report().sequence;
  EXPECT_TRUE(eventually([&] { return device->newest_report().sequence > sequence + 5; }));
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
}

TEST_F(W2, StopsAfterTenShortReportsInARow) {
  const auto device = open();
  device->command({.current_A = {1.0, 1.0, 1.0}});
  script_.wrong_length_reports = 1000;
  EXPECT_TRUE(eventually([&] { return device->health() == DeviceHealth::kProtocol; }));
  EXPECT_THAT(device->failure(), HasSubstr("reports of 13 bytes"));
  EXPECT_GE(device->statistics().reports_rejected, 10U);
  EXPECT_TRUE(eventually([&] { return last_out() == kZero; }));
}

// --- the end ---

TEST_F(W2, SendsZeroWhenItStops) {
  const auto device = open();
  device->command({.current_A = {1.0, -1.0, 0.5}});
  EXPECT_TRUE(eventually([&] { return last_out() == currents(1000, -1000, 500); }));
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(last_out(), kZero);
  EXPECT_TRUE(eventually([&] { return server().unlinks() == 1; }));
  EXPECT_EQ(device->health(), DeviceHealth::kClosed);
  EXPECT_THAT(device->failure(), HasSubstr("closed"));
  const auto sent = server().outs().size();
  device->command({.current_A = {1.0, 1.0, 1.0}});
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(server().outs().size(), sent);
}

TEST_F(W2, SendsZeroWhenItIsDestroyed) {
  {
    const auto device = open();
    device->command({.current_A = {1.0, -1.0, 0.5}});
    EXPECT_TRUE(eventually([&] { return last_out() == currents(1000, -1000, 500); }));
  }
  EXPECT_EQ(last_out(), kZero);
}

TEST_F(W2, IsUnpluggedWhenTheServerClosesInMidRun) {
  const auto device = open();
  script_.close_after_outs = 20;
  EXPECT_TRUE(eventually([&] { return device->health() == DeviceHealth::kUnplugged; }));
  EXPECT_THAT(device->failure(), HasSubstr("check the device and its server"));
  const auto sequence = device->newest_report().sequence;
  device->command({.current_A = {1.0, 1.0, 1.0}});
  EXPECT_FALSE(device->stop());
  EXPECT_EQ(device->newest_report().sequence, sequence);
  EXPECT_EQ(device->health(), DeviceHealth::kUnplugged);
}

TEST_F(W2, IsUnpluggedWhenTheServerSaysThatTheDeviceIsGone) {
  const auto device = open();
  script_.report_status = -ENODEV;
  EXPECT_TRUE(eventually([&] { return device->health() == DeviceHealth::kUnplugged; }));
  EXPECT_THAT(device->failure(), HasSubstr("No such device (USB status -19)"));
}

TEST_F(W2, FailsWithASentenceWhenTheServerSendsGarbageInMidRun) {
  const auto device = open();
  script_.lie = [](std::uint32_t) { return Bytes(96, 0xA5); };
  script_.lie_now = true;
  EXPECT_TRUE(eventually([&] { return device->health() == DeviceHealth::kProtocol; }));
  EXPECT_THAT(device->failure(), HasSubstr("which is unknown"));
}

TEST_F(W2, IsStaleWhenReportsEndAndThenSendsOnlyZeros) {
  OpenOptions options = patient();
  options.stale_after = milliseconds(1000);
  options.servo_silence = seconds(10);
  const auto device = open(options);
  device->command({.current_A = {1.0, 1.0, 1.0}});
  EXPECT_TRUE(eventually([&] { return last_out() == currents(1000, 1000, 1000); }));
  script_.send_reports = false;
  EXPECT_TRUE(eventually([&] { return device->health() == DeviceHealth::kStale; }));
  EXPECT_THAT(device->failure(), HasSubstr("no report for 1000 ms"));
  EXPECT_TRUE(eventually([&] { return last_out() == kZero; }));
  EXPECT_GE(device->statistics().reports_lost, 1U);
  const auto faulted = server().outs().size();
  device->command({.current_A = {1.0, 1.0, 1.0}});
  EXPECT_FALSE(device->stop());  // taken, but no report says that the device acted on it
  const auto outs = server().outs();
  EXPECT_THAT(std::vector<Bytes>(outs.begin() + static_cast<std::ptrdiff_t>(faulted), outs.end()),
              Each(kZero));
}

TEST_F(W2, FindsItsWayBackAfterALostReport) {
  const auto device = open();
  script_.send_reports = false;
  EXPECT_TRUE(eventually([&] { return device->statistics().reports_lost >= 1; }));
  script_.send_reports = true;
  const auto sequence = device->newest_report().sequence;
  EXPECT_TRUE(eventually([&] { return device->newest_report().sequence > sequence + 10; }));
  EXPECT_EQ(device->health(), DeviceHealth::kRunning);
}

// Each command makes the device answer, whoever sent it, and the arm moves.
TEST_F(W2, NoticesASecondProgramThatCommandsTheDevice) {
  const auto device = open();
  script_.arm_step = 1;
  device->command({.current_A = {1.0, 1.0, 1.0}});
  EXPECT_TRUE(eventually([&] { return last_out() == currents(1000, 1000, 1000); }));
  script_.foreign_outs = 1000;
  EXPECT_TRUE(eventually([&] { return device->health() == DeviceHealth::kSecondWriter; }));
  EXPECT_THAT(device->failure(), HasSubstr("another program commands it; end that program"));
  EXPECT_TRUE(eventually([&] { return last_out() == kZero; }));
  EXPECT_GE(device->statistics().reports_unasked, 5U);
}

TEST_F(W2, TakesReportsThatComeTwiceForNoSecondProgram) {
  const auto device = open();
  script_.foreign_step = 0;
  script_.foreign_outs = 100;
  EXPECT_TRUE(eventually([&] { return script_.foreign_outs == 0; }));
  const auto sequence = device->newest_report().sequence;
  EXPECT_TRUE(eventually([&] { return device->newest_report().sequence > sequence + 10; }));
  EXPECT_EQ(device->health(), DeviceHealth::kRunning) << device->failure();
  EXPECT_GE(device->statistics().reports_drained, 50U);
}

TEST_F(W2, ForgivesAFewReportsThatAnswerNothing) {
  const auto device = open();
  script_.foreign_outs = 4;
  EXPECT_TRUE(eventually([&] { return script_.foreign_outs == 0; }));
  const auto sequence = device->newest_report().sequence;
  EXPECT_TRUE(eventually([&] { return device->newest_report().sequence > sequence + 10; }));
  EXPECT_EQ(device->health(), DeviceHealth::kRunning) << device->failure();
}

TEST_F(W2, StopsInBoundedTimeWhenTheServerNoLongerAnswers) {
  const auto device = open();
  script_.send_reports = false;
  server_.reset();  // the listener and the connection end
  const auto begun = rt::Clock::now();
  EXPECT_FALSE(device->stop());
  EXPECT_LT(rt::Clock::now() - begun, seconds(5));
}

// --- calibration ---

TEST_F(W2, LoadsCountersAndClearsTheButton) {
  const auto device = open();
  server().press_button();
  EXPECT_TRUE(eventually([&] { return device->newest_report().calibration_button; }));
  device->load_counters({0, 0, 6000, 7, 8, -9}, seconds(10));
  EXPECT_EQ(server().counts(), (std::array<std::int32_t, 6>{0, 0, 6000, 7, 8, -9}));
  const DeviceReport report = device->newest_report();
  EXPECT_EQ(report.counts, (std::array<std::int32_t, 6>{0, 0, 6000, 7, 8, -9}));
  EXPECT_FALSE(report.calibration_button);
}

TEST_F(W2, ForgetsTheCommandWhenCountersAreLoaded) {
  const auto device = open();
  device->command({.current_A = {1.0, 0.0, 0.0}});
  EXPECT_TRUE(eventually([&] { return last_out() == currents(1000, 0, 0); }));
  device->load_counters({0, 0, 6000, 0, 0, 0}, seconds(10));
  const auto outs = server().outs();
  const auto load =
      std::find(outs.begin(), outs.end(), Bytes{0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0x70, 0x17});
  ASSERT_NE(load, outs.end());
  EXPECT_EQ(std::count(load, outs.end(), currents(1000, 0, 0)), 0);
}

TEST_F(W2, RefusesCountersFromADeviceThatFails) {
  const auto device = open();
  script_.close_after_outs = 0;
  EXPECT_THROW(device->load_counters({}, seconds(10)), DeviceError);
}

TEST_F(W2, CalibratesWhenTheButtonIsPressed) {
  const auto device = open();
  server().set_counts({123, -456, 789, 0, 0, 0});
  std::string prompt;
  calibrate(*device, profile_, seconds(10), [&](const std::string& text) {
    prompt = text;
    server().press_button();
  });
  EXPECT_EQ(prompt, profile_.calibration.instruction);
  EXPECT_EQ(device->newest_report().counts, (std::array<std::int32_t, 6>{0, 0, 6000, 0, 0, 0}));
}

TEST_F(W2, SaysThatTheButtonWasNotPressedInTime) {
  const auto device = open();
  try {
    calibrate(*device, profile_, milliseconds(50));
    ADD_FAILURE() << "calibrated";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("was not pressed in time"));
  }
}

TEST_F(W2, CalibratesAtOnceWhenAsked) {
  const auto device = open();
  calibrate_now(*device, profile_);
  EXPECT_EQ(device->newest_report().counts[2], 6000);
}

// --- a wrist ---

class W2Wrist : public W2 {
 protected:
  W2Wrist() { profile_ = profiles::load_device_profile("woodenhaptics_v2015_wrist"); }
};

TEST_F(W2Wrist, CalibratesAllSixCounters) {
  profile_.calibration.pose_counts = {0, 0, 6000, 0, 30, -12};
  const auto device = open();
  calibrate_now(*device, profile_);
  EXPECT_EQ(device->newest_report().counts, (std::array<std::int32_t, 6>{0, 0, 6000, 0, 30, -12}));
}

TEST_F(W2Wrist, RefusesADeviceWithoutEncodersThere) {
  script_.has_wrist = false;
  const auto device = open();
  try {
    calibrate_now(*device, profile_);
    ADD_FAILURE() << "calibrated";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("has no encoders there; use a profile without [gimbal]"));
  }
}

class W6 : public W2 {
 protected:
  W6() {
    profile_ = profiles::load_device_profile("emulated_6dof");
    script_.wire_bytes = 20;
    script_.strings = {"haptic-emu", "6-DOF arm (emulated)", "6DOF0001"};
    // Vendor 0x1209, product 0x0006; 20 bytes each way.
    script_.device_descriptor[8] = 0x09;
    script_.device_descriptor[9] = 0x12;
    script_.report_descriptor[15] = 20;
    script_.report_descriptor[21] = 20;
  }
};

TEST_F(W6, SendsTheWristsCurrentsBehindThoseOfTheArmAndLimitsThem) {
  const auto device = open();
  device->command({.current_A = {-1.797, 0.172, 0.330}, .wrist_current_A = {0.1, -0.1, 40.0}});
  Bytes expected = currents(-1797, 172, 330);
  // 100, -100, and one milliampere below the profile's 1 A.
  for (const std::uint8_t byte : {0x64, 0x00, 0x9C, 0xFF, 0xE7, 0x03}) {
    expected.push_back(byte);
  }
  EXPECT_TRUE(eventually([&] { return last_out() == expected; }));
  EXPECT_EQ(device->statistics().commands_clamped, 1U);
  device->command({.current_A = {1.0, 0.0, 0.0}, .wrist_current_A = {0.0, std::nan(""), 0.0}});
  EXPECT_TRUE(eventually([&] { return last_out() == Bytes(20); }));
  EXPECT_EQ(device->statistics().commands_not_finite, 1U);
  EXPECT_TRUE(device->stop());
  EXPECT_EQ(last_out(), Bytes(20));
}

TEST_F(W2Wrist, ReportsTheStylusButtonAndTheCounterWithoutIt) {
  server().set_counts({0, 0, 6000, 9877, 7, 8});
  const auto device = open();
  const DeviceReport pressed = device->newest_report();
  EXPECT_EQ(pressed.buttons, 1);
  EXPECT_EQ(pressed.counts, (std::array<std::int32_t, 6>{0, 0, 6000, -123, 7, 8}));
  server().set_counts({0, 0, 6000, -124, 7, 8});
  EXPECT_TRUE(eventually([&] { return device->newest_report().buttons == 0; }));
  EXPECT_EQ(device->newest_report().counts[3], -124);
}

}  // namespace
}  // namespace forcegrid::driver
