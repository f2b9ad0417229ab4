// SPDX-License-Identifier: Apache-2.0
// A simulator of your own, too slow for a hand, felt at 1 kHz: it gives 60 forces a second as
// samples, and the method "auto" renders between them. Here it is a spring of 200 N/m.
// usage: 03_force_method [DEVICE [SECONDS]]
#include <Eigen/Core>
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "device_session/device_session.h"

using namespace std::chrono_literals;
namespace session = forcegrid::session;

// Put your simulator here: the force that the object exerts on a tool at this place.
Eigen::Vector3d simulate(const Eigen::Vector3d& position_D_m) { return -200.0 * position_D_m; }

int main(int argc, char** argv) try {
  session::SessionOptions options;
  options.device = argc > 1 ? argv[1] : "emulated:woodenhaptics_v2015";
  options.method = "auto";
  options.emulator_motion = "lissajous";
  const auto device = session::DeviceSession::open(options);
  device->enable_force(true);
  double error_N = 0.0;
  double force_N = 0.0;
  session::ToolState state;
  const int cycles = 1000 * (argc > 2 ? std::atoi(argv[2]) : 6);
  for (int cycle = 0; cycle < cycles; ++cycle) {
    device->wait_for_cycle(state.cycle, forcegrid::rt::Clock::now() + 100ms);
    state = device->newest_state();
    const Eigen::Vector3d exact_D_N = simulate(Eigen::Vector3d(state.position_D_m.data()));
    if (cycle % 17 == 0) {  // 60 times a second
      device->push_sample(state.time_ns, state.position_D_m,
                          {exact_D_N.x(), exact_D_N.y(), exact_D_N.z()});
    }
    if (cycle >= 3000 && state.force_gain >= 1.0) {  // the hand has come, the force has ramped in
      error_N += (Eigen::Vector3d(state.commanded_force_D_N.data()) - exact_D_N).norm();
      force_N += exact_D_N.norm();
    }
  }
  std::printf("force error %.2f %% of the simulator's force\n",
              force_N > 0.0 ? 100.0 * error_N / force_N : -1.0);
  return device->close() ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
