/* SPDX-License-Identifier: Apache-2.0 */
/* A program on libHD: in each tick it reads the position and sets the force of a spring toward the
 * origin. Prints how long such a callback's calls take. What the motor thread takes is in the file
 * that $FORCEGRID_TIMING names.
 * usage: forcegrid_hd_spring SECONDS */
#define _POSIX_C_SOURCE 200809L /* NOLINT(bugprone-reserved-identifier) */
#include <HD/hd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define MOST_TICKS 1000000

static const double kStiffness_N_per_mm = 0.1;
static unsigned took_ns[MOST_TICKS];
static int ticks = 0;
static int errors = 0;

static double now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

static HDCallbackCode HDCALLBACK hold(void* data) {
  HDdouble position_mm[3];
  HDdouble force_N[3];
  int axis = 0;
  const double began_ns = now_ns();
  hdBeginFrame(hdGetCurrentDevice());
  hdGetDoublev(HD_CURRENT_POSITION, position_mm);
  for (axis = 0; axis < 3; ++axis) {
    force_N[axis] = -kStiffness_N_per_mm * position_mm[axis];
  }
  hdSetDoublev(HD_CURRENT_FORCE, force_N);
  hdEndFrame(hdGetCurrentDevice());
  if (ticks < MOST_TICKS) {
    took_ns[ticks++] = (unsigned)(now_ns() - began_ns);
  }
  if (hdGetError().errorCode != HD_SUCCESS) {
    ++errors;
  }
  (void)data;
  return HD_CALLBACK_CONTINUE;
}

static int by_size(const void* a, const void* b) {
  const unsigned left = *(const unsigned*)a;
  const unsigned right = *(const unsigned*)b;
  return left < right ? -1 : left > right;
}

int main(int argc, char** argv) {
  const double seconds = argc == 2 ? strtod(argv[1], NULL) : 0.0;
  struct timespec rest;
  HHD device = HD_INVALID_HANDLE;
  if (!(seconds > 0.0 && seconds <= 900.0)) {
    fprintf(stderr, "usage: forcegrid_hd_spring SECONDS (at most 900)\n");
    return 1;
  }
  memset(took_ns, 0, sizeof took_ns); /* no page comes in a tick */
  device = hdInitDevice(HD_DEFAULT_DEVICE);
  if (device == HD_INVALID_HANDLE) {
    fprintf(stderr, "forcegrid_hd_spring: no device; its reason is above\n");
    return 1;
  }
  hdEnable(HD_FORCE_OUTPUT);
  hdScheduleAsynchronous(hold, NULL, HD_DEFAULT_SCHEDULER_PRIORITY);
  hdStartScheduler();
  rest.tv_sec = (time_t)seconds;
  rest.tv_nsec = (long)(1e9 * (seconds - (double)rest.tv_sec));
  nanosleep(&rest, NULL);
  hdStopScheduler();
  hdDisableDevice(device);
  if (ticks == 0) {
    fprintf(stderr, "forcegrid_hd_spring: no tick came\n");
    return 1;
  }
  qsort(took_ns, (size_t)ticks, sizeof took_ns[0], by_size);
  printf("frame_us p50 %.3f p99 %.3f max %.3f\nticks %d errors %d\n", 1e-3 * took_ns[ticks / 2],
         1e-3 * took_ns[(ticks * 99) / 100], 1e-3 * took_ns[ticks - 1], ticks, errors);
  return errors == 0 ? 0 : 1;
}
