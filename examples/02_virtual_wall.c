/* SPDX-License-Identifier: Apache-2.0
 * A floor at z = 0 that pushes the hand up with 400 N/m, at 1 kHz.
 * usage: 02_virtual_wall [DEVICE [SECONDS]] */
#include <forcegrid/device.h>
#include <stdio.h>
#include <stdlib.h>

static int wall(const forcegrid_state* state, forcegrid_force* force, void* deepest_m) {
  const double depth_m = -state->position_m[2];
  if (depth_m > 0.0)
    force->force_N[2] = 400.0 * depth_m;
  if (depth_m > *(double*)deepest_m)
    *(double*)deepest_m = depth_m;
  return 0; /* go on */
}

int main(int argc, char** argv) {
  forcegrid_options options;
  forcegrid_device* device;
  forcegrid_state state = {.size = sizeof state};
  double deepest_m = 0.0;
  forcegrid_options_init(&options, sizeof options);
  options.device = argc > 1 ? argv[1] : "emulated:woodenhaptics_v2015";
  options.emulator_motion = "lissajous";
  if (forcegrid_open(&options, &device) != FORCEGRID_OK ||
      forcegrid_start(device, wall, &deepest_m) != FORCEGRID_OK ||
      forcegrid_enable(device, 1) != FORCEGRID_OK) {
    fprintf(stderr, "%s\n", forcegrid_last_error());
    return 1;
  }
  forcegrid_read(device, &state);
  forcegrid_wait(device, state.cycle + 1000 * (argc > 2 ? atoi(argv[2]) : 5), 60.0, &state);
  forcegrid_stop(device);
  printf("deepest %.2f mm, %u missed deadlines\n", 1e3 * deepest_m, state.missed_deadlines);
  return forcegrid_close(device) == FORCEGRID_OK ? 0 : 1;
}
