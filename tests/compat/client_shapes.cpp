// SPDX-License-Identifier: Apache-2.0
// Programs of the shapes that exist: which functions they call, in which order, with which
// parameters. C++98, as most of them are. They hold the tool by a spring of 0.3 N/mm.
// usage: compat_client_shapes SHAPE SECONDS [END]
//   END: "device-first" disables before it stops, "twice" does both twice, "not-at-all" only exits,
//        "abort" ends by abort().
// Prints what it saw; status 0: nothing was wrong.
// NOLINTBEGIN: C++98
#include <HD/hd.h>
#include <HDU/hdu.h>
#include <HDU/hduError.h>
#include <HDU/hduMatrix.h>
#include <HDU/hduQuaternion.h>
#include <HDU/hduVector.h>
#include <HL/hl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <string>

namespace {

volatile int ticks = 0;
volatile int failures = 0;
const double kStiffness_N_per_mm = 0.3;

void check(bool holds, const char* what) {
  if (!holds) {
    fprintf(stderr, "wrong: %s\n", what);
    failures = failures + 1;
  }
}

// Whether there was an error, which counts as a failure.
bool error_is_there(const char* what) {
  HDErrorInfo error;
  if (HD_DEVICE_ERROR(error = hdGetError())) {
    hduPrintError(stderr, &error, what);
    failures = failures + 1;
    return true;
  }
  return false;
}

void wait_seconds(double seconds) { usleep(static_cast<useconds_t>(1e6 * seconds)); }

void end_as(const std::string& end, HHD device) {
  if (end == "not-at-all") {
    exit(failures == 0 ? 0 : 1);
  }
  if (end == "abort") {
    abort();
  }
  if (end == "device-first" || end == "twice") {
    hdDisableDevice(device);
  }
  hdStopScheduler();
  if (end == "twice") {
    hdStopScheduler();
    check(!error_is_there("stop"), "an end in the wrong order");
  }
  if (end != "device-first") {
    hdDisableDevice(device);
  }
}

// RV: everything in one callback; schedules before it starts.
HDCallbackCode HDCALLBACK rv_callback(void*) {
  hduVector3Dd position, velocity, force, torque, joints, gimbal;
  hduVector3Dd spin, joint_torque, gimbal_torque;
  HDdouble transform[16];
  hdBeginFrame(hdGetCurrentDevice());
  hdGetDoublev(HD_CURRENT_POSITION, position);
  hdGetDoublev(HD_CURRENT_VELOCITY, velocity);
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  hdGetDoublev(HD_CURRENT_ANGULAR_VELOCITY, spin);
  hdGetDoublev(HD_CURRENT_JOINT_ANGLES, joints);
  hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, gimbal);
  force = -kStiffness_N_per_mm * position;
  hdSetDoublev(HD_CURRENT_FORCE, force);
  hdGetDoublev(HD_CURRENT_FORCE, torque);
  check(torque == force, "the force of this frame");
  hdGetDoublev(HD_CURRENT_TORQUE, torque);
  hdGetDoublev(HD_CURRENT_JOINT_TORQUE, joint_torque);
  hdGetDoublev(HD_CURRENT_GIMBAL_TORQUE, gimbal_torque);
  hdEndFrame(hdGetCurrentDevice());
  HDErrorInfo error;
  if (HD_DEVICE_ERROR(error = hdGetError())) {
    hduPrintError(stderr, &error, "callback");
    failures = failures + 1;
    if (hduIsSchedulerError(&error)) {
      return HD_CALLBACK_DONE;
    }
  }
  ticks = ticks + 1;
  return HD_CALLBACK_CONTINUE;
}

void rv(double seconds, const std::string& end) {
  const HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
  if (error_is_there("init")) {
    return;
  }
  check(!hdIsEnabled(HD_FORCE_OUTPUT), "force is off after init");
  hdEnable(HD_FORCE_OUTPUT);
  check(hdIsEnabled(HD_FORCE_OUTPUT), "force is on");
  hdScheduleAsynchronous(rv_callback, 0, HD_MAX_SCHEDULER_PRIORITY);
  hdStartScheduler();
  error_is_there("start");
  wait_seconds(seconds);
  if (end.empty()) {
    hdStopScheduler();
    hdDisable(HD_FORCE_OUTPUT);
    hdDisableDevice(device);
    return;
  }
  end_as(end, device);
}

// RG and BM: calibration in every tick, matrices; BM's quaternion of (constant x rotation).
HDCallbackCode HDCALLBACK rg_callback(void*) {
  if (hdCheckCalibration() == HD_CALIBRATION_NEEDS_UPDATE) {
    hdUpdateCalibration(HD_CALIBRATION_AUTO);
  }
  hdBeginFrame(hdGetCurrentDevice());
  hduMatrix transform;
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  hduVector3Dd position;
  hdGetDoublev(HD_CURRENT_POSITION, position);
  hduVector3Dd joints, gimbal;
  hdGetDoublev(HD_CURRENT_JOINT_ANGLES, joints);
  hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, gimbal);
  int buttons = 0;
  hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
  const hduVector3Dd force = position * -kStiffness_N_per_mm;
  hdSetDoublev(HD_CURRENT_FORCE, force);
  hdEndFrame(hdGetCurrentDevice());
  check(hduVector3Dd(transform[3][0], transform[3][1], transform[3][2]) == position,
        "translation and position");
  hduMatrix rows(transform);
  rows.transpose();
  check(rows[0][3] == position[0] && rows[1][3] == position[1], "transposed rows");
  transform.getRotationMatrix(transform);
  static const double turn[16] = {0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1};
  const hduQuaternion q(hduMatrix(turn) * transform);
  check(hduIsEqual(q.s() * q.s() + q.v().dotProduct(q.v()), 1.0, 1e-9), "a unit quaternion");
  error_is_there("callback");
  ticks = ticks + 1;
  return HD_CALLBACK_CONTINUE;
}

void rg(double seconds, const std::string&) {
  const HHD device = hdInitDevice("Default PHANTOM");
  if (error_is_there("init")) {
    return;
  }
  printf("model %s\n", hdGetString(HD_DEVICE_MODEL_TYPE));
  HDint styles = 0;
  hdGetIntegerv(HD_CALIBRATION_STYLE, &styles);
  while (hdCheckCalibration() != HD_CALIBRATION_OK) {
    hdUpdateCalibration(static_cast<HDenum>(styles));
  }
  hdEnable(HD_FORCE_OUTPUT);
  hdStartScheduler();
  error_is_there("start");
  hdScheduleAsynchronous(rg_callback, 0, HD_MAX_SCHEDULER_PRIORITY);
  wait_seconds(seconds);
  hdStopScheduler();
  hdDisableDevice(device);
}

// UN: a control loop outside, synchronous reads, one-shot writes, errors read synchronously.
struct UnState {
  HHD device;
  HDfloat force[3];
  HDdouble transform[16];
  HDErrorInfo error;
};

HDCallbackCode HDCALLBACK un_read(void* data) {
  UnState& state = *static_cast<UnState*>(data);
  HDfloat velocity[3], spin[3], gimbal[3];
  HDint rate = 0;
  HDboolean out = 0;
  hdBeginFrame(state.device);
  hdGetDoublev(HD_CURRENT_TRANSFORM, state.transform);
  hdGetFloatv(HD_CURRENT_VELOCITY, velocity);
  hdGetFloatv(HD_CURRENT_ANGULAR_VELOCITY, spin);
  hdGetFloatv(HD_CURRENT_GIMBAL_ANGLES, gimbal);
  hdGetBooleanv(HD_CURRENT_INKWELL_SWITCH, &out);
  hdGetIntegerv(HD_INSTANTANEOUS_UPDATE_RATE, &rate);
  hdEndFrame(state.device);
  check(out == 1, "the stylus is out");
  check(rate > 0, "a rate");
  ticks = ticks + 1;
  return HD_CALLBACK_DONE;
}

HDCallbackCode HDCALLBACK un_write(void* data) {
  UnState& state = *static_cast<UnState*>(data);
  hdBeginFrame(state.device);
  hdSetFloatv(HD_CURRENT_FORCE, state.force);
  hdEndFrame(state.device);
  return HD_CALLBACK_DONE;
}

HDCallbackCode HDCALLBACK un_error(void* data) {
  static_cast<UnState*>(data)->error = hdGetError();
  return HD_CALLBACK_DONE;
}

void un(double seconds, const std::string&) {
  static UnState state;  // one-shot callbacks may run after this function
  state.device = hdInitDevice(HD_DEFAULT_DEVICE);
  if (state.device == HD_INVALID_HANDLE || error_is_there("init")) {
    failures = failures + 1;
    return;
  }
  hdStartScheduler();
  while (hdCheckCalibration() != HD_CALIBRATION_OK) {
    hdUpdateCalibration(HD_CALIBRATION_AUTO | HD_CALIBRATION_INKWELL);
  }
  hdEnable(HD_FORCE_OUTPUT);
  check(hdIsEnabled(HD_FORCE_OUTPUT), "force is on");
  for (int k = 0; k < seconds * 100; ++k) {
    hdScheduleSynchronous(un_read, &state, HD_DEFAULT_SCHEDULER_PRIORITY);
    for (int i = 0; i < 3; ++i) {
      state.force[i] = static_cast<HDfloat>(-kStiffness_N_per_mm * state.transform[12 + i]);
    }
    hdScheduleAsynchronous(un_write, &state, HD_DEFAULT_SCHEDULER_PRIORITY);
    hdScheduleSynchronous(un_error, &state, HD_DEFAULT_SCHEDULER_PRIORITY);
    check(state.error.errorCode == HD_SUCCESS, "no error in the servo thread");
    wait_seconds(0.01);
  }
  hdStopScheduler();
  hdDisableDevice(state.device);
}

// HP: everything there is, of this frame and of the last one; any error is fatal.
HDCallbackCode HDCALLBACK hp_callback(void* data) {
  static const HDenum kReals[] = {HD_CURRENT_POSITION,
                                  HD_CURRENT_VELOCITY,
                                  HD_CURRENT_TRANSFORM,
                                  HD_CURRENT_ANGULAR_VELOCITY,
                                  HD_CURRENT_JACOBIAN,
                                  HD_CURRENT_JOINT_ANGLES,
                                  HD_CURRENT_GIMBAL_ANGLES,
                                  HD_LAST_POSITION,
                                  HD_LAST_VELOCITY,
                                  HD_LAST_TRANSFORM,
                                  HD_LAST_ANGULAR_VELOCITY,
                                  HD_LAST_JACOBIAN,
                                  HD_LAST_JOINT_ANGLES,
                                  HD_LAST_GIMBAL_ANGLES,
                                  HD_CURRENT_FORCE,
                                  HD_CURRENT_TORQUE,
                                  HD_CURRENT_JOINT_TORQUE,
                                  HD_CURRENT_GIMBAL_TORQUE,
                                  HD_LAST_FORCE,
                                  HD_LAST_TORQUE,
                                  HD_LAST_JOINT_TORQUE,
                                  HD_LAST_GIMBAL_TORQUE};
  double values[36];
  HDboolean inkwell = 0;
  const HHD device = *static_cast<HHD*>(data);
  hdBeginFrame(device);
  for (unsigned i = 0; i < sizeof kReals / sizeof *kReals; ++i) {
    hdGetDoublev(kReals[i], values);
  }
  hdGetBooleanv(HD_LAST_INKWELL_SWITCH, &inkwell);
  hdGetDoublev(HD_CURRENT_POSITION, values);
  hduVecScaleInPlace(values, -kStiffness_N_per_mm);
  hdSetDoublev(HD_CURRENT_FORCE, values);
  hdEndFrame(device);
  ticks = ticks + 1;
  return error_is_there("callback") ? HD_CALLBACK_DONE : HD_CALLBACK_CONTINUE;
}

void hp(double seconds, const std::string&) {
  HHD device = hdInitDevice("Default Device");
  if (error_is_there("init")) {
    return;
  }
  hdSetSchedulerRate(1000);
  error_is_there("rate");
  printf("%s %s %s %s\n", hdGetString(HD_DEVICE_MODEL_TYPE), hdGetString(HD_DEVICE_VENDOR),
         hdGetString(HD_DEVICE_SERIAL_NUMBER), hdGetString(HD_DEVICE_DRIVER_VERSION));
  check(hdCheckCalibration() == HD_CALIBRATION_OK, "calibrated");
  hdEnable(HD_FORCE_OUTPUT);
  const HDSchedulerHandle handle =
      hdScheduleAsynchronous(hp_callback, &device, HD_DEFAULT_SCHEDULER_PRIORITY);
  hdStartScheduler();
  wait_seconds(seconds);
  hdUnschedule(handle);
  hdStopScheduler();
  hdDisable(HD_FORCE_OUTPUT);
  hdDisableDevice(device);
  error_is_there("end");
}

// GP: waits until its callback is scheduled, sets joint torques, ends by waiting for it.
volatile int gp_ends = 0;

HDCallbackCode HDCALLBACK gp_callback(void*) {
  hduVector3Dd force, torque;
  hduMatrix transform;
  double jacobian[36];
  hdBeginFrame(hdGetCurrentDevice());
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  hdGetDoublev(HD_CURRENT_JACOBIAN, jacobian);
  force = hduVector3Dd(transform[3]) * -kStiffness_N_per_mm;
  for (int joint = 0; joint < 3; ++joint) {  // tau = J^T F, in N mm
    torque[joint] = jacobian[joint] * force[0] + jacobian[6 + joint] * force[1] +
                    jacobian[12 + joint] * force[2];
  }
  hdSetDoublev(HD_CURRENT_JOINT_TORQUE, torque);
  hdEndFrame(hdGetCurrentDevice());
  hduQuaternion rotation;
  transform.getRotation(rotation);
  check(hduIsEqual(rotation.s(), 1.0, 1e-12), "no gimbal, no rotation");
  HDErrorInfo error;
  if (HD_DEVICE_ERROR(error = hdGetError())) {
    hduPrintError(stderr, &error, "callback");
    failures = failures + 1;
    if (hduIsSchedulerError(&error)) {
      return HD_CALLBACK_DONE;
    }
  }
  ticks = ticks + 1;
  return gp_ends ? HD_CALLBACK_DONE : HD_CALLBACK_CONTINUE;
}

void gp(double seconds, const std::string&) {
  const HHD device = hdInitDevice("");
  if (error_is_there("init")) {
    return;
  }
  HDint styles = 0;
  hdGetIntegerv(HD_CALIBRATION_STYLE, &styles);
  while (hdCheckCalibration() != HD_CALIBRATION_OK) {
    wait_seconds(0.1);
  }
  hdEnable(HD_FORCE_OUTPUT);
  hdStartScheduler();
  const HDSchedulerHandle handle =
      hdScheduleAsynchronous(gp_callback, 0, HD_DEFAULT_SCHEDULER_PRIORITY);
  while (!hdWaitForCompletion(handle, HD_WAIT_CHECK_STATUS)) {
  }
  wait_seconds(seconds);
  gp_ends = 1;
  hdWaitForCompletion(handle, HD_WAIT_INFINITE);
  check(!hdWaitForCompletion(handle, HD_WAIT_CHECK_STATUS), "its callback has exited");
  hdStopScheduler();
  hdUnschedule(handle);
  hdDisableDevice(device);
}

// SAW: schedules, starts, enables force itself after 100 calibrated ticks.
HDCallbackCode HDCALLBACK saw_callback(void* data) {
  const HHD device = *static_cast<HHD*>(data);
  static int calibrated = 0;
  double transform[16], velocity[3], spin[3], last[3], joints[3], gimbal[3], efforts[3];
  HDint buttons = 0;
  hdMakeCurrentDevice(device);
  hdBeginFrame(device);
  calibrated += hdCheckCalibration() == HD_CALIBRATION_OK ? 1 : 0;
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  hdGetDoublev(HD_CURRENT_VELOCITY, velocity);
  hdGetDoublev(HD_CURRENT_ANGULAR_VELOCITY, spin);
  hdGetDoublev(HD_LAST_FORCE, last);
  hdGetDoublev(HD_CURRENT_JOINT_ANGLES, joints);
  hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, gimbal);
  hdGetDoublev(HD_LAST_JOINT_TORQUE, efforts);
  hdGetDoublev(HD_LAST_GIMBAL_TORQUE, efforts);
  hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
  if (calibrated == 100) {
    hdEnable(HD_FORCE_OUTPUT);
  }
  if (calibrated > 100) {
    hduVecScale(last, transform + 12, -kStiffness_N_per_mm);
    hdSetDoublev(HD_CURRENT_FORCE, last);
  }
  hdEndFrame(device);
  ticks = ticks + 1;
  return error_is_there("callback") ? HD_CALLBACK_DONE : HD_CALLBACK_CONTINUE;
}

void saw(double seconds, const std::string&) {
  hdSetSchedulerRate(1000);
  HHD device = hdInitDevice("Default PHANToM");
  if (error_is_there("init")) {
    return;
  }
  const std::string serial = hdGetString(HD_DEVICE_SERIAL_NUMBER);
  check(!serial.empty(), "a serial number");
  const HDSchedulerHandle handle =
      hdScheduleAsynchronous(saw_callback, &device, HD_DEFAULT_SCHEDULER_PRIORITY);
  hdStartScheduler();
  if (error_is_there("start")) {
    return;
  }
  wait_seconds(seconds);
  hdStopScheduler();
  hdUnschedule(handle);
  error_is_there("unschedule");
}

// SG: copies state at the highest priority, forces at the lowest.
HDCallbackCode HDCALLBACK sg_force(void* data) {
  const HHD device = *static_cast<HHD*>(data);
  hdMakeCurrentDevice(device);
  if (HD_DEVICE_ERROR(hdGetError())) {
    return HD_CALLBACK_CONTINUE;
  }
  double transform[16], angles[6], force[3];
  int buttons = 0;
  hdBeginFrame(device);
  hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  hdGetDoublev(HD_CURRENT_JOINT_ANGLES, angles);
  hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, angles + 3);
  hduVecScale(force, transform + 12, -kStiffness_N_per_mm);
  hdSetDoublev(HD_CURRENT_FORCE, force);
  hdEndFrame(device);
  ticks = ticks + 1;
  return HD_CALLBACK_CONTINUE;
}

HDCallbackCode HDCALLBACK sg_copy(void*) { return HD_CALLBACK_CONTINUE; }

void sg(double seconds, const std::string&) {
  HHD device = hdInitDevice("Default Device");
  for (int k = 0; k < 10 && hdGetError().errorCode == HD_DEVICE_ALREADY_INITIATED; ++k) {
    hdDisableDevice(hdGetCurrentDevice());
    device = hdInitDevice("Default Device");
  }
  // A second one of this program gets it after it has been disabled.
  check(hdInitDevice("Default Device") == HD_INVALID_HANDLE, "one device, one handle");
  check(hdGetError().errorCode == HD_DEVICE_ALREADY_INITIATED, "already initiated");
  hdDisableDevice(hdGetCurrentDevice());
  device = hdInitDevice("Default Device");
  check(device == 0, "the first handle again");
  if (hdCheckCalibration() != HD_CALIBRATION_OK) {
    check(false, "calibrated at once");
    return;
  }
  hdEnable(HD_FORCE_OUTPUT);
  hdEnable(HD_MAX_FORCE_CLAMPING);
  hdEnable(HD_SOFTWARE_FORCE_LIMIT);
  hdStartScheduler();
  const HDSchedulerHandle copy =
      hdScheduleAsynchronous(sg_copy, &device, HD_MAX_SCHEDULER_PRIORITY);
  const HDSchedulerHandle force =
      hdScheduleAsynchronous(sg_force, &device, HD_MIN_SCHEDULER_PRIORITY);
  wait_seconds(seconds);
  hdStopScheduler();
  hdUnschedule(copy);
  hdUnschedule(force);
  hdDisableDevice(device);
  error_is_there("end");
}

struct Shape {
  const char* name;
  void (*run)(double seconds, const std::string& end);
};

const Shape kShapes[] = {{"RV", rv}, {"RG", rg},   {"UN", un}, {"HP", hp},
                         {"GP", gp}, {"SAW", saw}, {"SG", sg}};

// As programs do: what is still open is closed at exit, with errors that nobody reads.
void clean_up() {
  hdStopScheduler();
  hdDisableDevice(hdGetCurrentDevice());
}

}  // namespace

int main(int argc, char** argv) {
  atexit(clean_up);
  const std::string name = argc > 1 ? argv[1] : "";
  for (unsigned i = 0; i < sizeof kShapes / sizeof *kShapes; ++i) {
    if (name == kShapes[i].name) {
      kShapes[i].run(argc > 2 ? atof(argv[2]) : 1.0, argc > 3 ? argv[3] : "");
      printf("ticks %d\n", ticks);
      check(ticks > 0, "ticks");
      return failures == 0 ? 0 : 1;
    }
  }
  fprintf(stderr, "usage: %s SHAPE SECONDS [END]\n", argv[0]);
  return 2;
}
// NOLINTEND
