// SPDX-License-Identifier: Apache-2.0
#include "tests/hil/hil_bench.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <thread>
#include <tuple>

namespace forcegrid::hil {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr char kKeptRule[] = "/tmp/10-forcegrid.rules";
constexpr milliseconds kPoll{20};
constexpr seconds kPatience{20};              // software emulation is slow
constexpr milliseconds kFirmwareStart{1100};  // 1 s after SET_CONFIGURATION

std::vector<std::string> emulate_command(const std::vector<std::string>& profiles,
                                         const std::vector<std::string>& more,
                                         const std::string& report_file) {
  std::vector<std::string> command = {FORCEGRID_PROGRAM, "emulate", "--device"};
  command.insert(command.end(), profiles.begin(), profiles.end());
  command.insert(command.end(), {"--listen", "127.0.0.1:3240", "--json", report_file});
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

nlohmann::json json_of(const std::string& file) {
  std::ifstream stream(file);
  return nlohmann::json::parse(stream, nullptr, false);
}

// The bus ids that the emulator has printed.
std::vector<std::string> offered(const Program& emulator) {
  constexpr std::string_view kWord = " busid ";
  const std::string text = emulator.standard_output();
  std::vector<std::string> busids;
  for (std::size_t at = text.find(kWord); at != std::string::npos; at = text.find(kWord, at)) {
    at += kWord.size();
    const std::size_t end = text.find(' ', at);
    if (end != std::string::npos && text.find('\n', end) != std::string::npos) {
      busids.push_back(text.substr(at, end - at));
    }
  }
  return busids;
}

}  // namespace

ShellResult shell(const std::string& command) {
  ShellResult result;
  std::FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (pipe == nullptr) {
    ADD_FAILURE() << "the guest's shell does not start";
    return result;
  }
  char buffer[512];
  for (std::size_t got = 0; (got = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) {
    result.text.append(buffer, got);
  }
  const int status = pclose(pipe);
  result.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return result;
}

ShellResult as_user(const std::string& user, const std::string& command) {
  return shell("su " + user + " -c '" + command + "'");
}

void measured(const std::string& name, double value, const std::string& unit) {
  std::printf("HIL-MEASURED %s %.6g %s\n", name.c_str(), value, unit.c_str());
  std::fflush(stdout);
}

void covers_device(const std::string& name) {
  std::printf("HIL-DEVICE %s\n", name.c_str());
  std::fflush(stdout);
}

void covers_host(const std::string& name) {
  std::printf("HIL-HOST %s\n", name.c_str());
  std::fflush(stdout);
}

bool eventually(const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) {
      return false;
    }
    std::this_thread::sleep_for(kPoll);
  }
  return true;
}

std::string first_line(const std::string& file) {
  std::ifstream stream(file);
  std::string line;
  std::getline(stream, line);
  return line;
}

RuleTakenAway::RuleTakenAway() {
  fs::copy_file(kRule, kKeptRule, fs::copy_options::overwrite_existing);
  fs::remove(kRule);
  shell("udevadm control --reload");
}

RuleTakenAway::~RuleTakenAway() {
  std::error_code error;
  fs::copy_file(kKeptRule, kRule, fs::copy_options::overwrite_existing, error);
  EXPECT_FALSE(error) << error.message();
  shell("udevadm control --reload");
}

std::vector<Node> nodes() {
  std::vector<Node> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/sys/class/hidraw", error)) {
    Node node;
    node.name = entry.path().filename().string();
    const fs::path usb = fs::canonical(entry.path() / "device", error).parent_path().parent_path();
    if (!error && fs::exists(usb / "idVendor")) {
      node.port = usb.filename().string();
    }
    found.push_back(node);
  }
  std::sort(found.begin(), found.end(), [](const Node& a, const Node& b) {
    return std::tuple(a.port.empty(), a.port, a.name) < std::tuple(b.port.empty(), b.port, b.name);
  });
  return found;
}

Bench::Bench(const std::vector<std::string>& profiles,
             const std::vector<std::string>& emulator_arguments)
    : report_file_(forcegrid::testing::fresh_folder("emulator") + "/report.json"),
      emulator_(emulate_command(profiles, emulator_arguments, report_file_)),
      devices_(profiles.size()) {
  covers_host("kernel");
  for (const std::string& profile : profiles) {
    covers_device(fs::path(profile).stem().string());
  }
  std::vector<std::string> busids;
  EXPECT_TRUE(eventually([&] { return (busids = offered(emulator_)).size() >= devices_; }));
  for (const std::string& busid : busids) {
    plug_in(busid);
  }
  if (!eventually([&] { return hil::nodes().size() >= devices_; })) {
    ADD_FAILURE() << "the kernel made " << hil::nodes().size() << " of " << devices_
                  << " hidraw nodes; its last words:\n"
                  << shell("dmesg | tail -n 20").text << "The emulator:\n"
                  << emulator_.standard_error();
  }
  shell("udevadm settle --timeout=20");
  std::this_thread::sleep_for(kFirmwareStart);
  nodes_ = hil::nodes();
  nodes_.resize(std::max<std::size_t>(nodes_.size(), 1));
}

Bench::~Bench() { detach_all(); }

void Bench::plug_in(const std::string& busid) {
  const ShellResult attached = shell("usbip attach -r 127.0.0.1 -b " + busid);
  EXPECT_EQ(attached.status, 0) << attached.text;
}

void Bench::unplug(int vhci_port) {
  const std::size_t before = hil::nodes().size();
  const ShellResult detached = shell("usbip detach -p " + std::to_string(vhci_port));
  EXPECT_EQ(detached.status, 0) << detached.text;
  EXPECT_TRUE(eventually([&] { return hil::nodes().size() < before; }));
}

void Bench::detach_all() {
  for (std::size_t port = 0; port < devices_; ++port) {
    shell("usbip detach -p " + std::to_string(port));
  }
  EXPECT_TRUE(eventually([] { return hil::nodes().empty(); }));
}

nlohmann::json Bench::end() {
  emulator_.send_signal(SIGTERM);
  const auto status = emulator_.wait(kPatience);
  EXPECT_EQ(status.value_or(-1), 128 + SIGTERM)
      << "the emulator said: " << emulator_.standard_error();
  return json_of(report_file_);
}

std::string tiny_scene() {
  const std::string file = "/tmp/tiny.toml";
  std::ofstream(file) << "description = \"Cube of 100 vertices\"\n[[object]]\nshape = \"block\"\n"
                         "vertex_count = [5, 5, 4]\nsize_m = [0.1, 0.1, 0.1]\nlaw = \"linear\"\n"
                         "stiffness_N_per_m = 60.0\n";
  return file;
}

std::vector<std::string> run_arguments(const std::string& device, double seconds,
                                       const std::string& folder,
                                       const std::vector<std::string>& more) {
  std::vector<std::string> arguments = {
      "run",   "--device", device,   "--no-reference",        "--seconds", std::to_string(seconds),
      "--out", folder,     "--json", folder + "/summary.json"};
  if (std::find(more.begin(), more.end(), "--simulator") == more.end()) {
    arguments.insert(arguments.end(), {"--scene", tiny_scene()});
  }
  // A guest on a busy host can stand still for longer than the usual 100 ms.
  arguments.insert(arguments.end(), {"--device-timeout-ms", "400"});
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

EndedRun run(const std::string& device, double seconds, const std::vector<std::string>& more) {
  covers_host("forcegrid-hidraw");
  EndedRun result;
  result.folder = forcegrid::testing::fresh_folder("run");
  Program program = Program::forcegrid(run_arguments(device, seconds, result.folder, more));
  const auto status = program.wait(std::chrono::seconds(40) + milliseconds(long(1e3 * seconds)));
  if (!status) {
    ADD_FAILURE() << "the run did not end";
  }
  result.status = status.value_or(-1);
  result.text = program.standard_output() + program.standard_error();
  const std::string file = result.folder + "/summary.json";
  result.summary = fs::exists(file) ? json_of(file) : nlohmann::json();
  return result;
}

}  // namespace forcegrid::hil
