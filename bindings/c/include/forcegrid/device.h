/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Forcegrid's devices for C, and for every language that can call C.
 *
 *   forcegrid_options options;
 *   forcegrid_device* device;
 *   forcegrid_options_init(&options, sizeof options);
 *   options.device = "emulated:woodenhaptics_v2015";
 *   if (forcegrid_open(&options, &device) != FORCEGRID_OK) puts(forcegrid_last_error());
 *
 * Units: metres, newtons, newton metres, radians, seconds; times in nanoseconds of CLOCK_MONOTONIC.
 * Frame D of the device: x toward the user, y to the user's right, z up. Forces are those of the
 * device on the hand. Orientations are quaternions (w, x, y, z) from the tool's frame to D.
 *
 * Motors: a thread of the library drives them at rate_Hz with every limit and guard of
 * `forcegrid run`, whatever the program's threads do. No force before forcegrid_enable(device, 1).
 * A commanded force holds for hold_s and then falls to zero within 0.1 s. A program that crashes
 * leaves zero current: the device's own watchdog sees to it.
 *
 * Structs begin with their size, which the caller sets (forcegrid_..._init() does): programs built
 * against this header go on working with later libraries, whose structs are longer.
 *
 * Errors: functions that can fail return a forcegrid_status; forcegrid_last_error() has the calling
 * thread's newest error as one sentence. Null pointers give FORCEGRID_BAD_ARGUMENT. Nothing throws.
 * Threads: every function from any thread, unless it says otherwise; not during or after
 * forcegrid_close() of the same device.
 */
#ifndef FORCEGRID_DEVICE_H
#define FORCEGRID_DEVICE_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define FORCEGRID_API __attribute__((visibility("default")))
#else
#define FORCEGRID_API
#endif

/* C's names and forms. */
/* NOLINTBEGIN(readability-identifier-naming) */
/* NOLINTBEGIN(modernize-use-using) */

#ifdef __cplusplus
extern "C" {
#endif

typedef struct forcegrid_device forcegrid_device;

typedef enum forcegrid_status {
  FORCEGRID_OK = 0,
  FORCEGRID_BAD_ARGUMENT = 1, /* a null pointer, a size, a number that is not finite */
  FORCEGRID_UNUSABLE = 2,     /* an option, a profile, a URL that can't be used */
  FORCEGRID_NOT_FOUND = 3,    /* no such device, or it does not answer */
  FORCEGRID_IN_USE = 4,       /* another program has the device */
  FORCEGRID_UNCALIBRATED = 5, /* the counters are not absolute yet: no force */
  FORCEGRID_LOST = 6,         /* the device is gone and is looked for; no force */
  FORCEGRID_FAULT = 7,        /* a fault ended the motor thread; close and open anew */
  FORCEGRID_SLOW = 8,         /* a callback lasted longer than longest_callback_s: zero force */
  FORCEGRID_TIMEOUT = 9,      /* nothing happened in time */
  FORCEGRID_REFUSED = 10,     /* not in this mode: see the function */
  FORCEGRID_NO_MEMORY = 11,
  FORCEGRID_THREW = 12 /* a callback ended with a C++ exception: zero force */
} forcegrid_status;

typedef struct forcegrid_options {
  uint32_t size; /* of this struct */
  uint32_t tool; /* id of the tool, 0 */
  /* URL as `forcegrid run --device` takes it, or emulated:PROFILE, which starts an emulator. */
  const char* device;
  const char* profile;       /* name or TOML file; null: the device's own */
  const char* method;        /* null: forces as commanded; "auto": see forcegrid_add_sample() */
  double rate_Hz;            /* of the motor thread, 100 to 4000 [1000] */
  double ramp_in_s;          /* from no force to the whole force [0.2] */
  double open_timeout_s;     /* for the device's first report [2] */
  double longest_callback_s; /* [0.05; with a method 0.2] */
  int32_t calibrated;   /* 1: the counters are absolute already [0]; emulated ones always are */
  int32_t check_motors; /* short pushes before the first force [1] */
  int32_t gravity_compensation; /* [0] */
  int32_t realtime;             /* ask for SCHED_FIFO [1] */
  const char* falcon_firmware;  /* file for a Falcon that runs none; null: none */
  const char* emulator_hand;    /* "firm" (null), "light", "none" */
  const char* emulator_motion;  /* "still" (null), "chirp", "lissajous", ... */
  const char* emulator_summary; /* file for what the emulated motors did (JSON); null: none */
  /* Is told what a person should know, a line at a time, on any thread; may be null. */
  void (*notice)(const char* text, void* data);
  void* notice_data;
  const char* emulator_wrist;    /* how the hand turns a wrist: "still" (null), "turn", "twist" */
  double emulator_click_every_s; /* the hand presses the stylus button this often; 0: never */
} forcegrid_options;

/* Where the tool is and what its motors do, after one cycle of the motor thread. */
typedef struct forcegrid_state {
  uint32_t size;
  uint32_t tool;
  uint64_t cycle; /* 1 for the first */
  int64_t time_ns;
  double position_m[3];
  double orientation[4]; /* w not negative; 1, 0, 0, 0 for an arm without a wrist */
  double velocity_m_per_s[3];
  double angular_velocity_rad_per_s[3];
  double force_N[3];         /* commanded, after every limit */
  double torque_Nm[3];       /* at the tool; zero for an arm without motors in its wrist */
  double joint_angle_rad[6]; /* of the arm, then of its wrist; 0, 0, 0 without one */
  double force_gain;         /* ramp and fade, 0 to 1 */
  double motor_warmth;       /* of the warmest motor; 1: its limit */
  int32_t counts[6];
  uint32_t buttons;          /* bit i: button i + 1; that of a stylus is button 1 */
  uint32_t limits;           /* what shortened the force: 1 not finite, 2 force, 4 slew, 8 torque,
                                16 current, 32 warm motor */
  uint32_t missed_deadlines; /* of the motor thread, in all */
  uint32_t status;           /* a forcegrid_status */
} forcegrid_state;

typedef struct forcegrid_force {
  uint32_t size;
  uint32_t tool;
  double force_N[3];
  double torque_Nm[3]; /* taken and ignored by an arm without motors in its wrist */
  double hold_s;       /* 0: 0.1 s */
} forcegrid_force;

typedef struct forcegrid_limits {
  uint32_t size;
  uint32_t tool;
  double max_force_N;
  double max_torque_Nm; /* 0 for an arm without motors in its wrist */
  double max_stiffness_N_per_m;
  double max_damping_N_s_per_m;
  double max_speed_m_per_s;
  double workspace_min_m[3]; /* no force outside of this box */
  double workspace_max_m[3];
  double rate_Hz; /* of the motor thread */
} forcegrid_limits;

typedef struct forcegrid_identity {
  uint32_t size;
  uint32_t degrees_of_freedom; /* that are sensed: 3, or 6 with a wrist */
  char url[128];
  char profile[64];
  char manufacturer[64];
  char product[64];
  char serial[64];
} forcegrid_identity;

/* Is called once a cycle. Writes the force into `force`, which is zero before the call.
 * Returns 0 to go on; anything else ends the calls, with zero force. */
typedef int (*forcegrid_callback)(const forcegrid_state* state, forcegrid_force* force, void* data);

/* The library's version, e.g. "0.2.0". Static text. */
FORCEGRID_API const char* forcegrid_version(void);

/* Static text for a status, never null. */
FORCEGRID_API const char* forcegrid_status_text(forcegrid_status status);

/* The calling thread's newest error, one sentence with its remedy; "" if there was none. Valid
 * until the thread's next call. */
FORCEGRID_API const char* forcegrid_last_error(void);

/* Sets every option to its default. `size` is sizeof(forcegrid_options). */
FORCEGRID_API void forcegrid_options_init(forcegrid_options* options, size_t size);

/* The same for a force: none, of tool 0. */
FORCEGRID_API void forcegrid_force_init(forcegrid_force* force, size_t size);

/* Opens a device; its motor thread runs and its first state is there when this returns.
 * FORCEGRID_UNUSABLE, _NOT_FOUND, _IN_USE: *device is null. */
FORCEGRID_API forcegrid_status forcegrid_open(const forcegrid_options* options,
                                              forcegrid_device** device);

/* Zero current, then the end of motor thread, device and emulator. Null is allowed.
 * FORCEGRID_TIMEOUT: the zero was not confirmed, or a callback has not returned within 1 s. */
FORCEGRID_API forcegrid_status forcegrid_close(forcegrid_device* device);

/* The newest state; set state->size first. Real-time: neither allocates nor locks. */
FORCEGRID_API forcegrid_status forcegrid_read(forcegrid_device* device, forcegrid_state* state);

/* The first state after cycle `cycle`, waiting at most `timeout_s`. Returns some 0.1 ms after
 * that cycle began. FORCEGRID_TIMEOUT: `state` has the newest one all the same. */
FORCEGRID_API forcegrid_status forcegrid_wait(forcegrid_device* device, uint64_t cycle,
                                              double timeout_s, forcegrid_state* state);

/* Switches force on (it ramps in; the motors are checked before the first time) or off (zero force
 * in the next cycle). Real-time. */
FORCEGRID_API forcegrid_status forcegrid_enable(forcegrid_device* device, int on);

/* 1: force is switched on. A lost device comes back with force switched off. Real-time. */
FORCEGRID_API int forcegrid_is_enabled(forcegrid_device* device);

/* The force from now on. Longer than max_force_N: shortened, with its direction. One thread at a
 * time. Real-time. FORCEGRID_BAD_ARGUMENT: not finite, not taken. FORCEGRID_REFUSED: a method
 * renders. */
FORCEGRID_API forcegrid_status forcegrid_command(forcegrid_device* device,
                                                 const forcegrid_force* force);

/* One force [N] that an object exerts on a tool at `position_m`, where the tool was at `time_ns`:
 * with options.method these are what the method renders from, 5 to 200 a second. Zero force: not in
 * contact. One thread at a time. Real-time. FORCEGRID_REFUSED: no method was asked for, or samples
 * come faster than the motor thread takes them. */
FORCEGRID_API forcegrid_status forcegrid_add_sample(forcegrid_device* device, int64_t time_ns,
                                                    const double position_m[3],
                                                    const double force_N[3]);

/* Calls `callback` after each cycle of the motor thread on a thread of the library's own. Its force
 * goes out in the next cycle; with options.method it is taken as a sample. While it lasts longer
 * than longest_callback_s there is zero force (FORCEGRID_SLOW in the states). */
FORCEGRID_API forcegrid_status forcegrid_start(forcegrid_device* device,
                                               forcegrid_callback callback, void* data);

/* Ends the calls, with zero force; waits at most 1 s for one that lasts. From within the callback
 * it only asks. FORCEGRID_TIMEOUT: it still lasts. FORCEGRID_THREW: it had ended with an exception.
 */
FORCEGRID_API forcegrid_status forcegrid_stop(forcegrid_device* device);

/* How the device is: FORCEGRID_OK, _UNCALIBRATED, _LOST, _FAULT, _SLOW or _THREW. Real-time. */
FORCEGRID_API forcegrid_status forcegrid_health(forcegrid_device* device);

/* Why it is so, one sentence, into `text`, cut to `size` bytes with the final zero. Returns the
 * whole length. */
FORCEGRID_API size_t forcegrid_failure(forcegrid_device* device, char* text, size_t size);

/* Sets the counters of an arm that is held in its calibration pose. */
FORCEGRID_API forcegrid_status forcegrid_calibrate_now(forcegrid_device* device);

/* Set limits->size and identity->size first. */
FORCEGRID_API forcegrid_status forcegrid_get_limits(forcegrid_device* device,
                                                    forcegrid_limits* limits);
FORCEGRID_API forcegrid_status forcegrid_get_identity(forcegrid_device* device,
                                                      forcegrid_identity* identity);

#ifdef __cplusplus
}
#endif

/* NOLINTEND(modernize-use-using) */
/* NOLINTEND(readability-identifier-naming) */

#endif
