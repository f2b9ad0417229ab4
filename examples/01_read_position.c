/* SPDX-License-Identifier: Apache-2.0
 * Where the hand is, ten times a second.
 * usage: 01_read_position [DEVICE [SECONDS]]    DEVICE as `forcegrid run --device` takes it */
#include <forcegrid/device.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char** argv) {
  forcegrid_options options;
  forcegrid_device* device;
  forcegrid_state state = {.size = sizeof state};
  const double seconds = argc > 2 ? atof(argv[2]) : 2.0;
  int i;
  forcegrid_options_init(&options, sizeof options);
  options.device = argc > 1 ? argv[1] : "emulated:woodenhaptics_v2015";
  options.emulator_motion = "lissajous";
  if (forcegrid_open(&options, &device) != FORCEGRID_OK) {
    fprintf(stderr, "%s\n", forcegrid_last_error());
    return 1;
  }
  for (i = 0; i < (int)(10.0 * seconds); ++i) {
    forcegrid_read(device, &state);
    forcegrid_wait(device, state.cycle + 99, 1.0, &state); /* a hundred cycles of 1 ms */
    printf("x %7.2f  y %7.2f  z %7.2f mm\n", 1e3 * state.position_m[0], 1e3 * state.position_m[1],
           1e3 * state.position_m[2]);
  }
  return forcegrid_close(device) == FORCEGRID_OK ? 0 : 1;
}
