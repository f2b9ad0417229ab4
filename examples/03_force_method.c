/* SPDX-License-Identifier: Apache-2.0
 * A simulator of your own, too slow for a hand, felt at 1 kHz: it gives 60 forces a second as
 * samples, and the method "auto" renders between them. Here it is a spring of 200 N/m.
 * usage: 03_force_method [DEVICE [SECONDS]] */
#include <forcegrid/device.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Put your simulator here: the force that the object exerts on a tool at this place. */
static void simulate(const double position_m[3], double force_N[3]) {
  int i;
  for (i = 0; i < 3; ++i) force_N[i] = -200.0 * position_m[i];
}

static double length(const double v[3]) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

int main(int argc, char** argv) {
  forcegrid_options options;
  forcegrid_device* device;
  forcegrid_state state = {.size = sizeof state};
  double sample_N[3], exact_N[3], difference_N[3], error = 0.0, force = 0.0;
  const int cycles = 1000 * (argc > 2 ? atoi(argv[2]) : 6);
  int cycle, i;
  forcegrid_options_init(&options, sizeof options);
  options.device = argc > 1 ? argv[1] : "emulated:woodenhaptics_v2015";
  options.method = "auto";
  options.emulator_motion = "lissajous";
  if (forcegrid_open(&options, &device) != FORCEGRID_OK) {
    fprintf(stderr, "%s\n", forcegrid_last_error());
    return 1;
  }
  forcegrid_enable(device, 1);
  for (cycle = 0; cycle < cycles; ++cycle) {
    forcegrid_wait(device, state.cycle, 0.1, &state);
    if (cycle % 17 == 0) { /* 60 times a second */
      simulate(state.position_m, sample_N);
      forcegrid_add_sample(device, state.time_ns, state.position_m, sample_N);
    }
    if (cycle < 3000 || state.force_gain < 1.0)
      continue; /* the hand comes, the force ramps in */
    simulate(state.position_m, exact_N);
    for (i = 0; i < 3; ++i) difference_N[i] = state.force_N[i] - exact_N[i];
    error += length(difference_N);
    force += length(exact_N);
  }
  printf("force error %.2f %% of the simulator's force\n",
         force > 0.0 ? 100.0 * error / force : -1.0);
  return forcegrid_close(device) == FORCEGRID_OK ? 0 : 1;
}
