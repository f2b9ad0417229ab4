// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <thread>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// One of hidapi's two back ends, as other people's programs link it.
struct BackEnd {
  const char* program;
  const char* host;  ///< its name in the matrix
  bool detaches;     ///< takes the device from usbhid while it is open
};
constexpr BackEnd kHidraw{"hil_client_hidraw", "hidapi-hidraw", false};
constexpr BackEnd kLibusb{"hil_client_libusb", "hidapi-libusb", true};

constexpr int kTremor_counts = 3;  // a hand holds the arm

/// What the client found, a JSON object (hid_client.cpp), or its words when it failed.
nlohmann::json client(const BackEnd& back_end, const std::string& arguments) {
  covers_host(back_end.host);
  const ShellResult result = shell(std::string(back_end.program) + " " + arguments);
  EXPECT_EQ(result.status, 0) << result.text;
  nlohmann::json findings = nlohmann::json::parse(result.text, nullptr, false);
  EXPECT_TRUE(findings.is_object()) << result.text;
  return findings;
}

std::int64_t number(const nlohmann::json& json, const char* key) {
  return json.at(key).get<std::int64_t>();
}

/// The counter `index` (a..f, then the info word) of a report in hexadecimal digits.
int word_of(const std::string& report, std::size_t index) {
  const auto byte = [&](std::size_t at) {
    return std::stoi(report.substr(2 * at, 2), nullptr, 16);
  };
  return static_cast<std::int16_t>(byte(2 * index) | byte(2 * index + 1) << 8);
}

/// hidapi's libusb back end gives the device back to usbhid when it closes; the node needs a while.
void expect_hidraw_comes_back(std::size_t count) {
  for (int i = 0; i < 200 && nodes().size() < count; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(25));
  }
  EXPECT_EQ(nodes().size(), count) << "usbhid does not have its interface back";
  shell("udevadm settle --timeout=20");
}

/// Every OUT report reached the device, and every IN report that it sent reached the client, but
/// for those that usbhid throws away during 50 ms after the open (one for each kick at most, and
/// the pending one). hidapi's libusb back end throws nothing away.
void expect_nothing_lost(const BackEnd& back_end, const nlohmann::json& findings,
                         const nlohmann::json& emulator) {
  EXPECT_EQ(number(emulator, "reports_received"), number(findings, "writes"));
  EXPECT_EQ(number(emulator, "short_reports") + number(emulator, "long_reports"), 0);
  EXPECT_EQ(number(findings, "other_lengths"), 0);
  // One report was pending when the client came, and then there is one for each that was applied.
  EXPECT_EQ(number(emulator, "reports_sent"),
            1 + number(findings, "writes") - number(emulator, "reports_drained"));
  const std::int64_t unseen = number(emulator, "reports_sent") - number(findings, "reads");
  EXPECT_GE(unseen, 0);
  EXPECT_LE(unseen, back_end.detaches ? 0 : 1 + number(findings, "kicks"));
  measured("exchange_mean", findings.at("exchange_mean_us").get<double>(), "us");
  measured("exchange_max", findings.at("exchange_max_us").get<double>(), "us");
  measured("reports_sent_by_device", static_cast<double>(number(emulator, "reports_sent")), "1");
  measured("reports_unseen_at_open", static_cast<double>(unseen), "1");
  measured("kicks", static_cast<double>(number(findings, "kicks")), "1");
}

/// What every client does: strings, calibration, and currents in lockstep, with the sheet's numbers
/// (section 11.6: -1797, 172, 330 mA).
void expect_lockstep(const BackEnd& back_end, const std::string& profile, const std::string& id,
                     int bytes, const nlohmann::json& strings) {
  Bench bench({profile});
  const auto node_count = bench.nodes().size();
  const nlohmann::json findings =
      client(back_end, "id=" + id + " bytes=" + std::to_string(bytes) +
                           " calibrate=1 exchanges=400 current=-1797,172,330");
  EXPECT_EQ(findings.at("manufacturer"), strings[0]);
  EXPECT_EQ(findings.at("product"), strings[1]);
  EXPECT_EQ(findings.at("serial"), strings[2]);
  EXPECT_EQ(findings.at("written_length"), bytes + 1) << "with the slot of the report ID";
  EXPECT_EQ(findings.at("read_length"), bytes);
  const auto calibrated = findings.at("calibrated").get<std::string>();
  ASSERT_EQ(calibrated.size(), 2U * static_cast<unsigned>(bytes));
  const int expected[7] = {0, 0, 6000, 0, 0, 0, 0};
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(word_of(calibrated, i), expected[i], i < 3 ? kTremor_counts : 0) << "word " << i;
  }
  EXPECT_EQ(calibrated.substr(28), std::string(calibrated.size() - 28, '0')) << "padding";
  expect_hidraw_comes_back(node_count);
  const nlohmann::json emulator = bench.end();
  expect_nothing_lost(back_end, findings, emulator);
  const double full_scale_mA[3] = {1797.0, 172.0, 330.0};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(emulator.at("max_abs_current_mA")[i].get<double>(), full_scale_mA[i], 1e-6)
        << "motor " << i;
    EXPECT_EQ(emulator.at("final_current_mA")[i], 0.0) << "motor " << i;
  }
  EXPECT_EQ(emulator.at("counters_loaded"), 1);
}

const nlohmann::json kMbed = {"mbed.org", "HID DEVICE", "0123456789"};
const nlohmann::json kTeensy = {"Teensyduino", "Teensyduino RawHID", "1234560"};

TEST(OtherClients, HidapiOnHidrawIn14Bytes) {
  expect_lockstep(kHidraw, "woodenhaptics_v2015", "1234:0006", 14, kMbed);
}

TEST(LongOtherClients, HidapiOnLibusbIn14Bytes) {
  expect_lockstep(kLibusb, "woodenhaptics_v2015", "1234:0006", 14, kMbed);
}

TEST(LongOtherClients, HidapiOnHidrawIn64Bytes) {
  expect_lockstep(kHidraw, "woodenhaptics_teensy", "16C0:0486", 64, kTeensy);
}

TEST(LongOtherClients, HidapiOnLibusbIn64Bytes) {
  expect_lockstep(kLibusb, "woodenhaptics_teensy", "16C0:0486", 64, kTeensy);
}

// W2 speaks first: the report that it has armed waits for the first host. usbhid throws it away;
// libusb hands it on; and afterwards a host that does not write hears nothing.
TEST(LongOtherClients, OfTheFirstReportAfterOpenOnlyLibusbHears) {
  for (const BackEnd& back_end : {kHidraw, kLibusb}) {
    SCOPED_TRACE(back_end.program);
    Bench bench;
    const nlohmann::json findings = client(back_end, "id=1234:0006 kick=0 listen_ms=400");
    EXPECT_EQ(findings.at("listened"), back_end.detaches ? 1 : 0);
    EXPECT_EQ(findings.at("writes"), 0);
    expect_hidraw_comes_back(1);
    // The next client finds no report armed, and kicks.
    const nlohmann::json next = client(back_end, "id=1234:0006 exchanges=20");
    EXPECT_GE(number(next, "kicks"), 1);
    expect_hidraw_comes_back(1);
    const nlohmann::json emulator = bench.end();
    EXPECT_EQ(number(emulator, "reports_received"), number(next, "writes"));
    EXPECT_EQ(emulator.at("max_abs_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
  }
}

// A client that writes on without reading: both queues overflow, each in its way, the device takes
// every report, and the newest counts are there as soon as the client has drained its queue.
TEST(LongOtherClients, GoOnAfterAQueueThatRanOver) {
  constexpr int kBurst = 150;
  for (const BackEnd& back_end : {kHidraw, kLibusb}) {
    SCOPED_TRACE(back_end.program);
    Bench bench;
    const nlohmann::json findings =
        client(back_end, "id=1234:0006 burst=" + std::to_string(kBurst) + " exchanges=50");
    // Linux keeps 64 reports less one, hidapi-libusb about 30.
    EXPECT_GE(number(findings, "after_burst"), back_end.detaches ? 25 : 60);
    EXPECT_LE(number(findings, "after_burst"), back_end.detaches ? 35 : 64);
    expect_hidraw_comes_back(1);
    const nlohmann::json emulator = bench.end();
    EXPECT_EQ(number(emulator, "reports_received"), number(findings, "writes"));
    EXPECT_GE(number(emulator, "reports_sent"), kBurst / 2) << "two OUTs can share one IN";
    // The operator holds the arm still until somebody calibrates it, and has pressed the button by
    // now: what was drained is old, and what came after it is new.
    const auto last = findings.at("last").get<std::string>();
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(word_of(last, i), 0, kTremor_counts);
    }
    EXPECT_EQ(word_of(findings.at("first").get<std::string>(), 6), 0);
    EXPECT_EQ(word_of(last, 6), 1) << "the calibration button";
    measured("reports_left_in_queue", static_cast<double>(number(findings, "after_burst")), "1");
  }
}

// The libusb back end takes the interface from usbhid and gives it back: whoever comes next, by
// whichever way, finds a working device.
TEST(LongOtherClients, TakeTurnsWithEachOtherAndWithThisProgram) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  for (const BackEnd& back_end : {kLibusb, kHidraw, kLibusb}) {
    SCOPED_TRACE(back_end.program);
    const nlohmann::json findings = client(back_end, "id=1234:0006 exchanges=100");
    EXPECT_GE(number(findings, "reads"), 100);
    expect_hidraw_comes_back(1);
  }
  const EndedRun felt = run("hid:1234:0006", 1.0, {"--calibrated"});
  EXPECT_EQ(felt.status, 0) << felt.text;
  EXPECT_EQ(bench.end().at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
}

// The rule covers both nodes: usbfs for libusb, which also needs it to detach usbhid.
TEST(LongOtherClients, RunAsAMemberOfPlugdevAndAsNobodyElse) {
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  for (const BackEnd& back_end : {kHidraw, kLibusb}) {
    SCOPED_TRACE(back_end.program);
    covers_host(back_end.host);
    const std::string command = std::string(back_end.program) + " id=1234:0006 exchanges=20";
    const ShellResult member = shell("su operator -c '" + command + "'");
    EXPECT_EQ(member.status, 0) << member.text;
    expect_hidraw_comes_back(1);
    const ShellResult other = shell("su visitor -c '" + command + "'");
    EXPECT_EQ(other.status, 2) << other.text;
    EXPECT_THAT(other.text, HasSubstr("can't open the device"));
    EXPECT_EQ(nodes().size(), 1U);
  }
}

// The composite device: two hidraw nodes of the same numbers, of which the driver takes the one
// with the usage, and whose link and permissions are those of interface 0 only.
TEST(LongTeensy, TheProgramChoosesTheInterfaceWithTheReports) {
  Bench bench({"woodenhaptics_teensy"}, {"--calibrated"});
  ASSERT_EQ(bench.nodes().size(), 2U);
  const ShellResult usb = shell("lsusb -v -d 16c0:0486");
  for (const char* fact :
       {"1 Teensyduino", "2 Teensyduino RawHID", "3 1234560", "wTotalLength       0x0049",
        "bNumInterfaces          2", "wDescriptorLength      28", "EP 3 IN", "EP 4 OUT", "EP 2 IN",
        "EP 2 OUT", "bcdDevice            2.79"}) {
    EXPECT_THAT(usb.text, HasSubstr(fact));
  }
  std::error_code error;
  const std::string linked = fs::canonical("/dev/forcegrid/w3-1234560", error).string();
  EXPECT_EQ(fs::canonical(
                "/sys/class/hidraw/" + fs::path(linked).filename().string() + "/device/..", error)
                .filename(),
            bench.node().port + ":1.0");
  for (const std::string& url : {std::string("hid:16C0:0486"), "hid:path=" + bench.node().port,
                                 std::string("hid:/dev/forcegrid/w3-1234560")}) {
    SCOPED_TRACE(url);
    const EndedRun felt = run(url, 1.0, {"--calibrated", "--profile", "woodenhaptics_teensy"});
    EXPECT_EQ(felt.status, 0) << felt.text;
    EXPECT_TRUE(felt.summary.at("faults").empty()) << felt.text;
  }
  for (const Node& node : bench.nodes()) {
    if (node.dev() != linked) {
      const EndedRun refused =
          run("hid:" + node.dev(), 1.0, {"--calibrated", "--profile", "woodenhaptics_teensy"});
      EXPECT_EQ(refused.status, 1);
      EXPECT_THAT(refused.text, HasSubstr("HID report descriptor"));
    }
  }
  const nlohmann::json emulator = bench.end();
  EXPECT_EQ(emulator.at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
  EXPECT_EQ(number(emulator, "short_reports") + number(emulator, "long_reports"), 0);
}

// A high-speed and a full-speed device plugged in together, as into any computer.
TEST(LongTeensy, StandsBesideAFullSpeedArm) {
  Bench bench({"woodenhaptics_teensy", "woodenhaptics_v2015"}, {"--calibrated"});
  ASSERT_EQ(bench.nodes().size(), 3U) << "two of the Teensy, one of the arm";
  std::map<std::string, std::string> speeds;  // Mbit/s by USB numbers
  for (const Node& node : bench.nodes()) {
    const std::string usb = "/sys/bus/usb/devices/" + node.port;
    speeds[first_line(usb + "/idVendor")] = first_line(usb + "/speed");
  }
  EXPECT_EQ(speeds, (std::map<std::string, std::string>{{"16c0", "480"}, {"1234", "12"}}));
  const EndedRun teensy =
      run("hid:16C0:0486", 1.0, {"--calibrated", "--profile", "woodenhaptics_teensy"});
  const EndedRun arm = run("hid:1234:0006", 1.0, {"--calibrated"});
  for (const EndedRun* felt : {&teensy, &arm}) {
    EXPECT_EQ(felt->status, 0) << felt->text;
    EXPECT_TRUE(felt->summary.at("faults").empty()) << felt->text;
  }
  const nlohmann::json reports = bench.end();
  ASSERT_EQ(reports.size(), 2U);
  for (const nlohmann::json& report : reports) {
    EXPECT_EQ(report.at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
    EXPECT_GT(number(report, "reports_sent"), 100);
  }
}

}  // namespace
}  // namespace forcegrid::hil
