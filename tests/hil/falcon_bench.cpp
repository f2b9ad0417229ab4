// SPDX-License-Identifier: Apache-2.0
#include "tests/hil/falcon_bench.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <fstream>

namespace forcegrid::hil {

namespace fs = std::filesystem;
using std::chrono::seconds;

const std::vector<std::string> kHomed = {"--firmware-loaded", "--calibrated"};

namespace {

std::vector<std::string> emulate_command(const std::vector<std::string>& more,
                                         const std::string& report_file) {
  std::vector<std::string> arguments = {"emulate",        "--device", "falcon",   "--listen",
                                        "127.0.0.1:3240", "--json",   report_file};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

}  // namespace

std::string port_of_falcon() {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/sys/bus/usb/devices", error)) {
    if (first_line(entry.path() / "idVendor") == "0403" &&
        first_line(entry.path() / "idProduct") == "cb48") {
      return entry.path().filename().string();
    }
  }
  return "";
}

FalconBench::FalconBench(const std::vector<std::string>& emulator_arguments)
    : report_file_(forcegrid::testing::fresh_folder("falcon_emulator") + "/report.json"),
      emulator_(Program::forcegrid(emulate_command(emulator_arguments, report_file_))) {
  covers_host("kernel");
  covers_device("falcon");
  emulator_.wait_for_text("busid 1-1");
  plug_in();
}

FalconBench::~FalconBench() {
  shell("usbip detach -p 0");
  EXPECT_TRUE(eventually([] { return port_of_falcon().empty(); }));
}

void FalconBench::unplug() {
  const ShellResult detached = shell("usbip detach -p 0");
  EXPECT_EQ(detached.status, 0) << detached.text;
  EXPECT_TRUE(eventually([] { return port_of_falcon().empty(); }));
}

void FalconBench::plug_in() {
  const ShellResult attached = shell("usbip attach -r 127.0.0.1 -b 1-1");
  EXPECT_EQ(attached.status, 0) << attached.text;
  const auto has_interface = [] {
    const std::string port = port_of_falcon();
    return !port.empty() && fs::exists("/sys/bus/usb/devices/" + port + "/" + port + ":1.0");
  };
  EXPECT_TRUE(eventually(has_interface)) << shell("dmesg | tail -n 20").text;
  shell("udevadm settle --timeout=20");
  port_ = port_of_falcon();
}

nlohmann::json FalconBench::end() {
  emulator_.send_signal(SIGTERM);
  EXPECT_EQ(emulator_.wait(seconds(20)).value_or(-1), 128 + SIGTERM)
      << "the emulator said: " << emulator_.standard_error();
  std::ifstream file(report_file_);
  return nlohmann::json::parse(file, nullptr, false);
}

EndedRun run_falcon(const std::string& url, double duration_s,
                    const std::vector<std::string>& more) {
  covers_host("forcegrid-libusb");
  EndedRun result;
  result.folder = forcegrid::testing::fresh_folder("falcon_run");
  Program program = Program::forcegrid(run_arguments(url, duration_s, result.folder, more));
  result.status = program.wait(seconds(50)).value_or(-1);
  result.text = program.standard_output() + program.standard_error();
  std::ifstream file(result.folder + "/summary.json");
  if (file) {
    result.summary = nlohmann::json::parse(file, nullptr, false);
  }
  return result;
}

std::string image_file(std::size_t words) {
  std::string image("\xAA\x08", 2);
  image.append(16, '\0');
  image.append("\x3F\x00\x02\x80", 4);
  image.push_back(static_cast<char>(words & 0xFF));
  image.push_back(static_cast<char>(words >> 8));
  image.append("\x3F\x00\x00\x80", 4);
  for (std::size_t i = 0; i < words; ++i) {
    image.push_back(static_cast<char>(i & 0xFF));
    image.push_back(static_cast<char>(i >> 8 & 0xFF));
  }
  image.append(2, '\0');
  const std::string file = forcegrid::testing::fresh_folder("falcon_firmware") + "/firmware.bin";
  std::ofstream(file, std::ios::binary) << image;
  return file;
}

}  // namespace forcegrid::hil
