// SPDX-License-Identifier: Apache-2.0
// Where the hand is, ten times a second.
// usage: 01_read_position [DEVICE [SECONDS]]    DEVICE as `forcegrid run --device` takes it
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
  const int lines = static_cast<int>(10.0 * (argc > 2 ? std::atof(argv[2]) : 2.0));
  for (int i = 0; i < lines; ++i) {
    const auto cycle = device->newest_state().cycle + 99;  // a hundred cycles of 1 ms
    device->wait_for_cycle(cycle, forcegrid::rt::Clock::now() + 1s);
    const auto position_D_m = device->newest_state().position_D_m;
    std::printf("x %7.2f  y %7.2f  z %7.2f mm\n", 1e3 * position_D_m[0], 1e3 * position_D_m[1],
                1e3 * position_D_m[2]);
  }
  return device->close() ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
