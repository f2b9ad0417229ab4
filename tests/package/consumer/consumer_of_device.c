/* SPDX-License-Identifier: Apache-2.0 */
#include <forcegrid/device.h>
#include <stdio.h>

int main(void) {
  forcegrid_options options;
  forcegrid_device* device;
  forcegrid_state state = {.size = sizeof state};
  forcegrid_options_init(&options, sizeof options);
  if (forcegrid_open(&options, &device) != FORCEGRID_OK) {
    fprintf(stderr, "%s\n", forcegrid_last_error());
    return 1;
  }
  if (forcegrid_wait(device, 50, 5.0, &state) != FORCEGRID_OK)
    return 2;
  printf("forcegrid %s, cycle %llu\n", forcegrid_version(), (unsigned long long)state.cycle);
  return forcegrid_close(device) == FORCEGRID_OK ? 0 : 3;
}
