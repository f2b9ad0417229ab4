/* SPDX-License-Identifier: Apache-2.0
 * A servo loop of your own: one force a cycle, computed in your thread. It damps the hand and
 * pulls it softly toward where it was at the start.
 * usage: 04_servo_loop [DEVICE [SECONDS]] */
#include <forcegrid/device.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char** argv) {
  forcegrid_options options;
  forcegrid_device* device;
  forcegrid_state state = {.size = sizeof state}, start;
  forcegrid_force force;
  const int cycles = 1000 * (argc > 2 ? atoi(argv[2]) : 5);
  int cycle, i, late = 0;
  forcegrid_options_init(&options, sizeof options);
  forcegrid_force_init(&force, sizeof force);
  options.device = argc > 1 ? argv[1] : "emulated:woodenhaptics_v2015";
  options.emulator_motion = "lissajous";
  if (forcegrid_open(&options, &device) != FORCEGRID_OK) {
    fprintf(stderr, "%s\n", forcegrid_last_error());
    return 1;
  }
  forcegrid_enable(device, 1);
  forcegrid_read(device, &state);
  start = state;
  for (cycle = 0; cycle < cycles; ++cycle) {
    late += forcegrid_wait(device, state.cycle, 0.002, &state) == FORCEGRID_TIMEOUT;
    if (state.status != FORCEGRID_OK) {
      char why[256];
      forcegrid_failure(device, why, sizeof why);
      fprintf(stderr, "%s\n", why);
      break;
    }
    for (i = 0; i < 3; ++i)
      force.force_N[i] =
          50.0 * (start.position_m[i] - state.position_m[i]) - 2.0 * state.velocity_m_per_s[i];
    forcegrid_command(device, &force);
  }
  printf("%d cycles, %d late\n", cycle, late);
  return forcegrid_close(device) == FORCEGRID_OK && cycle == cycles ? 0 : 1;
}
