// SPDX-License-Identifier: Apache-2.0
// A Novint Falcon on the stock kernel: libusb and usbfs in place of hidraw, firmware that has to be
// sent first, and a serial driver that could take the interface.

#include <gmock/gmock.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/hil/falcon_bench.h"
#include "tests/hil/faulty_run.h"
#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Clock = std::chrono::steady_clock;

constexpr char kSerial[] = "FT000001";

double seconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// The kernel's driver of the interface at `port`; empty when none has it.
std::string driver_of(const std::string& port) {
  std::error_code error;
  const fs::path link =
      fs::canonical("/sys/bus/usb/devices/" + port + "/" + port + ":1.0/driver", error);
  return error ? "" : link.filename().string();
}

/// The usbfs node of the device at `port`.
std::string usb_node(const std::string& port) {
  const std::string usb = "/sys/bus/usb/devices/" + port;
  char node[64];
  std::snprintf(node, sizeof node, "/dev/bus/usb/%03d/%03d", std::stoi(first_line(usb + "/busnum")),
                std::stoi(first_line(usb + "/devnum")));
  return node;
}

std::size_t bytes_of_image(std::size_t words) { return 30 + 2 * words; }

/// No fault, the zero at the end was answered, and not a byte was lost on the way.
void expect_sound(const EndedRun& felt, double duration_s) {
  ASSERT_EQ(felt.status, 0) << felt.text;
  ASSERT_TRUE(felt.summary.is_object()) << felt.text;
  EXPECT_TRUE(felt.summary.at("faults").empty()) << felt.summary.at("faults");
  EXPECT_TRUE(felt.summary.at("zero_current_delivered").get<bool>());
  EXPECT_EQ(number(felt.summary, "reports_rejected"), 0);
  EXPECT_GT(felt.summary.at("cycles").get<double>(),
            0.2 * duration_s * felt.summary.at("servo_rate_requested_Hz").get<double>());
}

void expect_motors_off_and_clean_line(const nlohmann::json& emulator) {
  ASSERT_TRUE(emulator.is_object());
  EXPECT_EQ(emulator.at("final_command"), kMotorsOff) << emulator;
  EXPECT_EQ(number(emulator, "malformed_packets"), 0);
  EXPECT_EQ(number(emulator, "serial_overruns"), 0);
  EXPECT_EQ(number(emulator, "serial_framing_errors"), 0);
}

void report_timing(const EndedRun& felt) {
  measured("servo_rate", felt.summary.at("servo_rate_Hz").get<double>(), "Hz");
  // Those of the homing are among them.
  measured("exchanges", static_cast<double>(number(felt.summary, "reports_received")), "1");
  measured("exchanges_lost", static_cast<double>(number(felt.summary, "reports_lost")), "1");
  for (const char* part : {"p50", "p99", "max"}) {
    measured(std::string("report_age_") + part,
             felt.summary.at("report_age_us").at(part).get<double>(), "us");
  }
}

// --- From power-on ---

TEST(Falcon, TakesItsFirmwareIsHomedAndFeelsTheBlock) {
  ASSERT_THAT(shell("lsmod").text, HasSubstr("ftdi_sio")) << "it should have had its chance";
  FalconBench bench;
  EXPECT_EQ(driver_of(bench.port()), "") << "a driver of the kernel has taken the interface";
  constexpr std::size_t kWords = 200;
  constexpr double kSeconds = 2.5;
  const std::string image = image_file(kWords);
  const EndedRun felt = run_falcon("falcon", kSeconds, {"--firmware", image});
  expect_sound(felt, kSeconds);
  EXPECT_THAT(felt.text,
              AllOf(HasSubstr("sending firmware '" + image + "' (430 bytes)"),
                    HasSubstr("Pull the knob all the way out"), HasSubstr("FALCON HAPTIC")));
  EXPECT_GT(number(felt.summary, "samples_received"), 0) << felt.text;
  const nlohmann::json emulator = bench.end();
  expect_motors_off_and_clean_line(emulator);
  EXPECT_EQ(number(emulator, "firmware_bytes_loaded"),
            static_cast<std::int64_t>(bytes_of_image(kWords)));
  EXPECT_EQ(number(emulator, "firmware_starts"), 1);
  EXPECT_EQ(emulator.at("homed"), nlohmann::json({true, true, true}));
  EXPECT_GT(largest_command(emulator), 20) << "the motors never pushed";
  // Beside those of the loop the firmware has answered the probes after its start, at most ten.
  const std::int64_t probes =
      number(emulator, "reports_received") - number(felt.summary, "commands_sent");
  EXPECT_GE(probes, 1);
  EXPECT_LE(probes, 10);
  report_timing(felt);
}

// --- udev/10-forcegrid.rules ---

/// `command` as another user, with that user's groups.
ShellResult as_user(const std::string& user, const std::string& command) {
  return shell("su " + user + " -c '" + command + "'");
}

TEST(LongFalcon, IsGivenToThePlugdevGroupByTheUdevRuleAndToNobodyElse) {
  covers_host("forcegrid-libusb");
  FalconBench bench(kHomed);
  const std::string node = usb_node(bench.port());
  struct stat status {};
  ASSERT_EQ(::stat(node.c_str(), &status), 0) << node;
  EXPECT_EQ(status.st_mode & 07777, 0660U);
  EXPECT_EQ(status.st_uid, 0U);
  const group* const plugdev = ::getgrnam("plugdev");
  ASSERT_NE(plugdev, nullptr);
  EXPECT_EQ(status.st_gid, plugdev->gr_gid);
  const std::string sysfs = "/sys/bus/usb/devices/" + bench.port();
  EXPECT_THAT(shell("udevadm info --query=property --path=" + sysfs).text, HasSubstr(":uaccess:"));
  EXPECT_EQ(first_line(sysfs + "/power/control"), "on") << "it may be suspended";
  const std::string link = std::string("/dev/forcegrid/falcon-") + kSerial;
  std::error_code error;
  EXPECT_EQ(fs::canonical(link, error).string(), node);

  const std::string command =
      "forcegrid run --device falcon --device-timeout-ms 400 --no-reference --scene " +
      tiny_scene() + " --seconds 0.5 --out /tmp/out-$(id -u)";
  const ShellResult member = as_user("operator", command);
  EXPECT_EQ(member.status, 0) << member.text;
  EXPECT_THAT(member.text, HasSubstr("zero current at the end delivered"));
  const ShellResult other = as_user("visitor", command);
  EXPECT_EQ(other.status, 1) << other.text;
  EXPECT_THAT(other.text,
              AllOf(HasSubstr("device 'falcon': open: "), HasSubstr("LIBUSB_ERROR_ACCESS"),
                    HasSubstr("install the udev rule (make install-udev)")));

  bench.unplug();
  shell("udevadm settle --timeout=20");
  EXPECT_FALSE(fs::exists(fs::symlink_status(link))) << "the link stays when the device is gone";
  expect_motors_off_and_clean_line(bench.end());
}

// --- Which one ---

TEST(LongFalcon, IsOpenedByItsSerialNumberAndByItsPort) {
  FalconBench bench(kHomed);
  for (const std::string& url : {std::string("falcon:") + kSerial, "falcon:path=" + bench.port()}) {
    SCOPED_TRACE(url);
    expect_sound(run_falcon(url, 1.0), 1.0);
  }
  for (const char* url : {"falcon:FT999999", "falcon:path=9-9"}) {
    SCOPED_TRACE(url);
    const EndedRun refused = run_falcon(url, 1.0);
    EXPECT_EQ(refused.status, 1);
    EXPECT_THAT(refused.text, AllOf(HasSubstr("no such device is attached"), HasSubstr(kSerial)));
  }
  expect_motors_off_and_clean_line(bench.end());
}

// libftdi's own tool takes the chip for an FT232R and finds the checksum right.
TEST(LongFalcon, HasAnEepromThatLibftdisToolReads) {
  FalconBench bench(kHomed);
  std::ofstream("/tmp/falcon.conf") << "vendor_id=0x0403\nproduct_id=0xcb48\n"
                                       "filename=/tmp/falcon.eeprom\n";
  const ShellResult read = shell("ftdi_eeprom --verbose --read-eeprom /tmp/falcon.conf");
  EXPECT_EQ(read.status, 0) << read.text;
  for (const char* fact :
       {"EEPROM size: 128", "VID:     0x0403", "PID:     0xcb48", "Release: 0x0600",
        "Bus Powered:  90 mA", "Manufacturer: FTDI", "Product:      FALCON HAPTIC",
        "Serial:       FT000001", "Checksum      : 05c9", "Internal EEPROM",
        "Channel A has Mode UART", "C3 Function: PWREN"}) {
    EXPECT_THAT(read.text, HasSubstr(fact));
  }
  EXPECT_THAT(read.text, AllOf(Not(HasSubstr("hecksum Error")), Not(HasSubstr("unexpected"))));
}

TEST(LongFalcon, IsRefusedWhileAnotherProgramDrivesIt) {
  FalconBench bench(kHomed);
  const std::string folder = forcegrid::testing::fresh_folder("falcon_first");
  Program first = Program::forcegrid(run_arguments("falcon", 4.0, folder));
  first.wait_for_line("Simulator: ");
  const EndedRun second = run_falcon("falcon", 1.0);
  EXPECT_EQ(second.status, 1);
  EXPECT_THAT(second.text,
              AllOf(HasSubstr("LIBUSB_ERROR_BUSY"), HasSubstr("it is in use by process ")));
  EXPECT_EQ(first.wait(seconds(40)).value_or(-1), 0)
      << first.standard_output() << first.standard_error();
  expect_motors_off_and_clean_line(bench.end());
}

// --- The kernel's own driver of this chip ---

/// ftdi_sio with the Falcon's numbers added to those it knows; loaded anew at the end, since it
/// can't be made to forget them.
class ToldFtdiSio {
 public:
  ToldFtdiSio() {
    const ShellResult told = shell("echo 0403 cb48 > /sys/bus/usb-serial/drivers/ftdi_sio/new_id");
    EXPECT_EQ(told.status, 0) << told.text;
  }
  ~ToldFtdiSio() {
    const ShellResult again = shell("rmmod ftdi_sio && insmod $(grep ftdi_sio /hil/modules)");
    EXPECT_EQ(again.status, 0) << again.text;
  }
  ToldFtdiSio(const ToldFtdiSio&) = delete;
  ToldFtdiSio& operator=(const ToldFtdiSio&) = delete;
};

TEST(LongFalcon, IsTakenFromFtdiSioWhereThatWasToldToHaveItAndGivenBack) {
  FalconBench bench(kHomed);
  ASSERT_EQ(driver_of(bench.port()), "");
  const ToldFtdiSio told;
  ASSERT_TRUE(eventually([&] { return driver_of(bench.port()) == "ftdi_sio"; }))
      << shell("dmesg | tail").text;
  ASSERT_TRUE(eventually([] { return fs::exists("/dev/ttyUSB0"); }));
  const std::string folder = forcegrid::testing::fresh_folder("falcon_detached");
  covers_host("forcegrid-libusb");
  Program program = Program::forcegrid(run_arguments("falcon", 2.0, folder));
  program.wait_for_line("Simulator: ");
  EXPECT_EQ(driver_of(bench.port()), "usbfs");
  EXPECT_EQ(program.wait(seconds(40)).value_or(-1), 0)
      << program.standard_output() << program.standard_error();
  EXPECT_TRUE(eventually([&] { return driver_of(bench.port()) == "ftdi_sio"; }))
      << "its driver has not got it back, but '" << driver_of(bench.port()) << "'";
  EXPECT_EQ(bench.end().at("final_command"), kMotorsOff);
}

// --- The cable ---

TEST(LongFalcon, UnpluggedDuringTheDownloadEndsTheRunAndTakesItsFirmwareNextTime) {
  FalconBench bench;
  // Some four seconds at 142.9 kBaud.
  constexpr std::size_t kWords = 30000;
  const std::string folder = forcegrid::testing::fresh_folder("falcon_download");
  covers_host("forcegrid-libusb");
  Program program =
      Program::forcegrid(run_arguments("falcon", 1.0, folder, {"--firmware", image_file(kWords)}));
  ASSERT_TRUE(program.wait_for_text("sending firmware")) << program.standard_error();
  std::this_thread::sleep_for(milliseconds(1500));
  const auto pulled = Clock::now();
  bench.unplug();
  EXPECT_EQ(program.wait(seconds(20)).value_or(-1), 1);
  measured("run_ended_after_unplug", seconds_between(pulled, Clock::now()), "s");
  const std::string text = program.standard_output() + program.standard_error();
  const std::string where = "(while sending the firmware (at byte ";
  EXPECT_THAT(text, AllOf(HasSubstr("check the cable and plug it in again " + where),
                          HasSubstr(" of " + std::to_string(bytes_of_image(kWords)) + "))"),
                          Not(HasSubstr("terminate called"))));
  EXPECT_EQ(text.find(where), text.rfind(where)) << text;

  // The boot loader still waits for the rest; the pulse on DTR makes it begin anew.
  bench.plug_in();
  const EndedRun again = run_falcon("falcon", 1.0, {"--firmware", image_file(2)});
  expect_sound(again, 1.0);
  const nlohmann::json emulator = bench.end();
  EXPECT_EQ(emulator.at("final_command"), kMotorsOff);
  EXPECT_EQ(number(emulator, "firmware_starts"), 1) << "the first image had no end";
  EXPECT_GT(number(emulator, "firmware_bytes_loaded"),
            static_cast<std::int64_t>(bytes_of_image(2)));
  EXPECT_LT(number(emulator, "firmware_bytes_loaded"),
            static_cast<std::int64_t>(bytes_of_image(kWords)));
}

TEST(LongFalcon, UnpluggedInMidForceItsWatchdogStopsTheMotorsAndTheRunEnds) {
  std::vector<std::string> arguments = kHomed;
  arguments.insert(arguments.end(), {"--motion", "hold"});
  FalconBench bench(arguments);
  const std::string folder = forcegrid::testing::fresh_folder("falcon_unplug");
  covers_host("forcegrid-libusb");
  Program program = Program::forcegrid(run_arguments("falcon", 60.0, folder));
  program.wait_for_line("Simulator: ");
  // The operator is at the object by then, and stays there.
  std::this_thread::sleep_for(milliseconds(4500));
  const auto pulled = Clock::now();
  bench.unplug();
  const auto gone = Clock::now();
  EXPECT_EQ(program.wait(seconds(20)).value_or(-1), 1);
  measured("run_ended_after_unplug", seconds_between(pulled, Clock::now()), "s");
  const std::string text = program.standard_output() + program.standard_error();
  EXPECT_THAT(text, HasSubstr("FAULT: The device is gone; check the cable, plug it in again, and "
                              "start again."));
  EXPECT_EQ(text.find("FAULT"), text.rfind("FAULT")) << text;
  EXPECT_THAT(text, Not(HasSubstr("terminate called")));
  std::ifstream file(folder + "/summary.json");
  const nlohmann::json summary = nlohmann::json::parse(file, nullptr, false);
  ASSERT_TRUE(summary.is_object()) << text;
  ASSERT_EQ(summary.at("faults").size(), 1U);
  EXPECT_EQ(summary.at("faults")[0].at("name"), "unplugged");
  EXPECT_FALSE(summary.at("zero_current_delivered").get<bool>());
  EXPECT_TRUE(fs::exists(folder + "/flight_record.csv"));

  std::this_thread::sleep_for(seconds(1));
  const auto asked = Clock::now();
  const nlohmann::json emulator = bench.end();
  expect_motors_off_and_clean_line(emulator);
  EXPECT_GE(number(emulator, "watchdog_trips"), 1);
  EXPECT_GT(largest_command(emulator), 20) << "the motors never pushed";
  ASSERT_TRUE(emulator.at("seconds_since_motors_nonzero").is_number()) << emulator;
  const double off_for_s = emulator.at("seconds_since_motors_nonzero").get<double>();
  constexpr double kWatchdog_s = 0.1;
  constexpr double kLate_s = 0.2;  // how late a thread of the emulator may run in the guest
  EXPECT_GT(seconds_between(pulled, asked) - off_for_s, 0.0)
      << "the motors had no command when the cable was pulled";
  EXPECT_LE(seconds_between(gone, asked) - off_for_s, kWatchdog_s + kLate_s);
  measured("motors_off_after_unplug", seconds_between(pulled, asked) - off_for_s, "s");
}

// --- For long ---

TEST(LongFalcon, TheDevicesOwnRateFor20s) {
  FalconBench bench;
  constexpr double kSeconds = 20.0;
  const EndedRun felt =
      run_falcon("falcon", kSeconds, {"--rate", "1000", "--firmware", image_file(2)});
  expect_sound(felt, kSeconds);
  report_timing(felt);
  const nlohmann::json emulator = bench.end();
  expect_motors_off_and_clean_line(emulator);
  EXPECT_GT(largest_command(emulator), 20) << "the motors never pushed";
  EXPECT_LE(number(emulator, "watchdog_trips"), 1) << "it may only trip after the end";
}

}  // namespace
}  // namespace forcegrid::hil
