// SPDX-License-Identifier: Apache-2.0
// A floor at z = 0 that pushes the hand up with 400 N/m, at 1 kHz.
// usage: 02_virtual_wall [DEVICE [SECONDS]]
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "device_session/device_session.h"

using namespace std::chrono_literals;
namespace session = forcegrid::session;

int main(int argc, char** argv) try {
  session::SessionOptions options;
  options.device = argc > 1 ? argv[1] : "emulated:woodenhaptics_v2015";
  options.emulator_motion = "lissajous";
  const auto device = session::DeviceSession::open(options);
  device->enable_force(true);
  double deepest_m = 0.0;
  session::ToolState state;
  for (int cycle = 1000 * (argc > 2 ? std::atoi(argv[2]) : 5); cycle > 0; --cycle) {
    device->wait_for_cycle(state.cycle, forcegrid::rt::Clock::now() + 20ms);
    state = device->newest_state();
    const double depth_m = std::max(0.0, -state.position_D_m[2]);
    device->command_force({0.0, 0.0, 400.0 * depth_m}, 100ms);
    deepest_m = std::max(deepest_m, depth_m);
  }
  std::printf("deepest %.2f mm, %u missed deadlines\n", 1e3 * deepest_m, state.missed_deadlines);
  return device->close() ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
