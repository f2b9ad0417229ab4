/* SPDX-License-Identifier: Apache-2.0 */
/* What programs do with the C headers of libHD; compiled as C89, C11, C++98 and C++20. */
/* NOLINTBEGIN: C89. */
#include <HD/hd.h>
#include <HDU/hdu.h>
#include <HL/hl.h>
#include <HLU/hlu.h>

/* A negative array size is an error in every language. */
#define STATIC_CHECK(name, condition) typedef char check_##name[(condition) ? 1 : -1]

STATIC_CHECK(int_types, sizeof(HDint) == 4 && sizeof(HDuint) == 4 && sizeof(HDerror) == 4);
STATIC_CHECK(handles, sizeof(HHD) == 4 && sizeof(HDenum) == 4 && sizeof(HDCallbackCode) == 4);
STATIC_CHECK(small_types, sizeof(HDboolean) == 1 && sizeof(HDushort) == 2 && sizeof(HDchar) == 1);
STATIC_CHECK(long_types, sizeof(HDlong) == 8 && sizeof(HDulong) == 8);
STATIC_CHECK(real_types, sizeof(HDfloat) == 4 && sizeof(HDdouble) == 8 && sizeof(HDstring) == 8);
STATIC_CHECK(scheduler_types, sizeof(HDSchedulerHandle) == 8 && sizeof(HDSchedulerCallback) == 8);
STATIC_CHECK(priority, sizeof(HDSchedulerPriority) == 2 && sizeof(HDWaitCode) == 4);
STATIC_CHECK(error_info, sizeof(HDErrorInfo) == 12 &&
                             offsetof(HDErrorInfo, internalErrorCode) == 4 &&
                             offsetof(HDErrorInfo, hHD) == 8);
STATIC_CHECK(unsigned_long, (HDulong)-1 > 0 && (HDerror)-1 > 0 && (HDboolean)-1 > 0);
STATIC_CHECK(priorities,
             HD_DEFAULT_SCHEDULER_PRIORITY == 32767 && HD_RENDER_EFFECT_FORCE_PRIORITY == 65534);
STATIC_CHECK(version, HD_VERSION_MAJOR_NUMBER == 3 && HD_VERSION_MINOR_NUMBER == 30 &&
                          HD_VERSION_BUILD_NUMBER == 0);
#if HD_VERSION_MAJOR_NUMBER < 3
#error "usable in the preprocessor"
#endif

static HDCallbackCode HDCALLBACK shape_callback(void* data) {
  HDdouble position[3];
  const HDdouble force[3] = {0, 0, 0};
  HDErrorInfo error;
  hdBeginFrame(hdGetCurrentDevice());
  hdGetDoublev(HD_CURRENT_POSITION, position);
  hdSetDoublev(HD_CURRENT_FORCE, force);
  hdEndFrame(hdGetCurrentDevice());
  if (HD_DEVICE_ERROR(error = hdGetError())) {
    hduPrintError(stderr, &error, "shape");
    if (hduIsSchedulerError(&error) || hduIsForceError(&error)) {
      return HD_CALLBACK_DONE;
    }
  }
  *(int*)data += hduMin(1, 2) + hduMax(1, 2) + hduIsEqual(1.0, 1.0, 0.0);
  return HD_CALLBACK_CONTINUE;
}

/* Every function by its type. */
static void shape_calls(const char* name) {
  int count = 0;
  HDboolean b[6];
  HDint i[6];
  HDfloat f[36];
  HDdouble d[36];
  HDlong l[6];
  HHD device = hdInitDevice(name[0] == '\0' ? HD_DEFAULT_DEVICE : name);
  HDSchedulerHandle handle;
  HDSchedulerCallback callback = shape_callback;
  if (device == HD_INVALID_HANDLE || device == (HHD)-1 || device == (HHD)~0) {
    return;
  }
  hdMakeCurrentDevice(device);
  hdEnable(HD_FORCE_OUTPUT);
  hdDisable(HD_FORCE_OUTPUT);
  if (!hdIsEnabled(HD_FORCE_OUTPUT) && hdCheckCalibration() != HD_CALIBRATION_OK) {
    hdUpdateCalibration(hdCheckCalibrationStyle());
    hdUpdateCalibrationMessage(HD_CALIBRATION_AUTO);
  }
  hdGetBooleanv(HD_CURRENT_INKWELL_SWITCH, b);
  hdGetIntegerv(HD_CURRENT_BUTTONS, i);
  hdGetFloatv(HD_CURRENT_JACOBIAN, f);
  hdGetDoublev(HD_CURRENT_TRANSFORM, d);
  hdGetLongv(HD_CURRENT_ENCODER_VALUES, l);
  hdSetBooleanv(HD_USER_STATUS_LIGHT, b);
  hdSetIntegerv(HD_USER_STATUS_LIGHT, i);
  hdSetFloatv(HD_CURRENT_TORQUE, f);
  hdSetDoublev(HD_CURRENT_GIMBAL_TORQUE, d);
  hdSetLongv(HD_CURRENT_MOTOR_DAC_VALUES, l);
  hdScaleGimbalAngles(1, 1, 1, d);
  (void)hdDeploymentLicense("vendor", "application", "password");
  (void)hdGetString(HD_DEVICE_MODEL_TYPE);
  (void)hdGetErrorString(HD_COMM_ERROR);
  hdSetSchedulerRate(1000);
  hdStartScheduler();
  hdScheduleSynchronous(callback, &count, HD_DEFAULT_SCHEDULER_PRIORITY);
  handle = hdScheduleAsynchronous(callback, &count, HD_MAX_SCHEDULER_PRIORITY);
  if (handle != HD_INVALID_HANDLE && hdWaitForCompletion(handle, HD_WAIT_CHECK_STATUS)) {
    hdUnschedule(handle);
  }
  d[0] = hdGetSchedulerTimeStamp();
  hduVecNormalizeInPlace(d);
  hdStopScheduler();
  hdDisableDevice(device);
}
/* NOLINTEND */
