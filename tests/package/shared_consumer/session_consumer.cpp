// SPDX-License-Identifier: Apache-2.0
// An emulated arm in this process and a session on it, both of the shared library, with a listener
// of this program's in its servo loop, and each of its exceptions caught by type.
#include <atomic>
#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "device_emulator/emulator_server.h"
#include "device_session/device_session.h"
#include "driver/open_device.h"
#include "forcegrid/methods.h"
#include "link/simulator_endpoint.h"
#include "servo_loop/servo_loop.h"

namespace {

namespace driver = forcegrid::driver;
namespace emulator = forcegrid::emulator;
namespace session = forcegrid::session;
namespace servo = forcegrid::servo;

emulator::DeviceOptions calibrated_arm() {
  emulator::DeviceOptions arm;
  arm.profile = forcegrid::profiles::load_device_profile("woodenhaptics_v2015");
  arm.operator_script.calibrated = true;
  return arm;
}

constexpr int kAttempts = 20;  // a machine that stands still for 0.1 s ends a session

bool session_reads(const std::string& url) {
  session::SessionOptions options;
  options.device = url;
  options.calibrated = true;
  const auto device = session::DeviceSession::open(options);
  const bool reads =
      device->wait_for_cycle(50, forcegrid::rt::Clock::now() + std::chrono::seconds(2));
  const session::ToolState state = device->newest_state();
  std::printf("session: cycle %llu\n", static_cast<unsigned long long>(state.cycle));
  return device->close() && reads && state.cycle >= 50;
}

class Counter final : public servo::CycleListener {
 public:
  void cycle_ended(const servo::CycleRecord& record, const driver::DeviceReport& /*report*/,
                   const driver::ArmPose& pose) noexcept override {
    if (record.fault == servo::Fault::kNone && pose.status == driver::KinematicsStatus::kOk) {
      ++cycles;
    }
  }
  std::atomic<int> cycles{0};
};

bool loop_calls_back(const std::string& url, const forcegrid::profiles::DeviceProfile& profile) {
  driver::OpenOptions open;
  open.open_timeout = open.stale_after = std::chrono::seconds(10);
  const auto device = driver::open_device(url, profile, open);
  const auto method = forcegrid::make_force_method("hold", {});
  servo::ServoPorts ports;
  servo::ServoOptions options;
  Counter counter;
  options.listener = &counter;
  options.report_timeout = std::chrono::seconds(10);
  servo::ServoLoop loop(*device, profile, {method.get()}, ports, options);
  const std::atomic<bool> stop{false};
  const servo::ServoOutcome outcome = loop.run(stop, 0.2);
  std::printf("loop: %llu cycles, %s\n", static_cast<unsigned long long>(outcome.cycles),
              servo::name_of(outcome.fault));
  return outcome.zero_current_delivered && counter.cycles > 0;
}

/// Whether `works` does in one of kAttempts.
template <typename Works>
bool in_time(Works works) {
  for (int attempt = 1; attempt <= kAttempts; ++attempt) {
    try {
      if (works()) {
        return true;
      }
    } catch (const std::runtime_error& error) {
      std::printf("attempt %d: %s\n", attempt, error.what());
    }
  }
  return false;
}

template <typename Error, typename Call>
bool throws(const char* name, Call call) {
  try {
    call();
  } catch (const Error& error) {
    std::printf("%s: %s\n", name, error.what());
    return true;
  } catch (const std::exception& error) {
    std::printf("%s expected: %s\n", name, error.what());
  }
  return false;
}

bool exceptions_cross(const forcegrid::profiles::DeviceProfile& profile) {
  session::SessionOptions absent;
  absent.device = "usbip://127.0.0.1:1/1-1";
  const bool each[] = {
      throws<forcegrid::profiles::ProfileError>(
          "ProfileError", [] { forcegrid::profiles::load_device_profile("no_such_profile"); }),
      throws<forcegrid::link::LinkError>(
          "LinkError", [] { forcegrid::link::SimulatorEndpoint endpoint("nowhere:1"); }),
      throws<driver::DeviceError>("DeviceError",
                                  [&] { driver::open_device("usbip://127.0.0.1:1/1-1", profile); }),
      throws<emulator::EmulatorError>(
          "EmulatorError", [] { emulator::EmulatorServer server({.listen = "nowhere:1"}); }),
      throws<session::SessionError>("SessionError", [&] { session::DeviceSession::open(absent); })};
  for (const bool one : each) {
    if (!one) {
      return false;
    }
  }
  return true;
}

}  // namespace

int main() {
  const emulator::DeviceOptions arm = calibrated_arm();
  emulator::EmulatorServer server({.listen = "127.0.0.1:0", .devices = {arm}});
  server.start();
  const std::string url = "usbip://" + server.address() + "/1-1";
  if (!in_time([&] { return session_reads(url); })) {
    return 1;
  }
  if (!in_time([&] { return loop_calls_back(url, arm.profile); })) {
    return 2;
  }
  return exceptions_cross(arm.profile) ? 0 : 3;
}
