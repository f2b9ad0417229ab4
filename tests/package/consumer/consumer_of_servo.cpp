// SPDX-License-Identifier: Apache-2.0
#include <atomic>
#include <cstdio>

#include "device_emulator/emulator_server.h"
#include "driver/open_device.h"
#include "forcegrid/methods.h"
#include "servo_loop/servo_loop.h"

int main() {
  forcegrid::emulator::DeviceOptions arm;
  arm.profile = forcegrid::profiles::load_device_profile("woodenhaptics_v2015");
  arm.operator_script.calibrated = true;
  forcegrid::emulator::EmulatorServer server({.listen = "127.0.0.1:0", .devices = {arm}});
  server.start();
  const auto device =
      forcegrid::driver::open_device("usbip://" + server.address() + "/1-1", arm.profile);
  const auto method = forcegrid::make_force_method("hold", {});
  forcegrid::servo::ServoPorts ports;
  forcegrid::servo::ServoLoop loop(*device, arm.profile, {method.get()}, ports, {});
  const std::atomic<bool> stop{false};
  const forcegrid::servo::ServoOutcome outcome = loop.run(stop, 0.2);
  std::printf("%llu cycles\n", static_cast<unsigned long long>(outcome.cycles));
  return outcome.cycles > 50 && outcome.zero_current_delivered ? 0 : 1;
}
