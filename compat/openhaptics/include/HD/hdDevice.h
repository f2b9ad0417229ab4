/* SPDX-License-Identifier: Apache-2.0 */
/* Devices: open, read, command. Every function may be called from any thread and leaves errors for
 * hdGetError() of the same thread. */
#ifndef FORCEGRID_HD_DEVICE_H
#define FORCEGRID_HD_DEVICE_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#include "hdDefines.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Opens the device of this name and makes it current. HD_INVALID_HANDLE: it could not. */
HHD HDAPIENTRY hdInitDevice(HDstring name);
void HDAPIENTRY hdDisableDevice(HHD device);
HHD HDAPIENTRY hdGetCurrentDevice(void);
void HDAPIENTRY hdMakeCurrentDevice(HHD device);

/* A frame: its state does not change, and its last force is sent at the end of the tick. */
void HDAPIENTRY hdBeginFrame(HHD device);
void HDAPIENTRY hdEndFrame(HHD device);

/* Takes the newest error of this thread. */
HDErrorInfo HDAPIENTRY hdGetError(void);
HDstring HDAPIENTRY hdGetErrorString(HDerror code);

void HDAPIENTRY hdEnable(HDenum capability);
void HDAPIENTRY hdDisable(HDenum capability);
HDboolean HDAPIENTRY hdIsEnabled(HDenum capability);

void HDAPIENTRY hdGetBooleanv(HDenum parameter, HDboolean* values);
void HDAPIENTRY hdGetIntegerv(HDenum parameter, HDint* values);
void HDAPIENTRY hdGetFloatv(HDenum parameter, HDfloat* values);
void HDAPIENTRY hdGetDoublev(HDenum parameter, HDdouble* values);
void HDAPIENTRY hdGetLongv(HDenum parameter, HDlong* values);
HDstring HDAPIENTRY hdGetString(HDenum parameter);

void HDAPIENTRY hdSetBooleanv(HDenum parameter, const HDboolean* values);
void HDAPIENTRY hdSetIntegerv(HDenum parameter, const HDint* values);
void HDAPIENTRY hdSetFloatv(HDenum parameter, const HDfloat* values);
void HDAPIENTRY hdSetDoublev(HDenum parameter, const HDdouble* values);
void HDAPIENTRY hdSetLongv(HDenum parameter, const HDlong* values);

HDenum HDAPIENTRY hdCheckCalibration(void);
HDenum HDAPIENTRY hdCheckCalibrationStyle(void);
void HDAPIENTRY hdUpdateCalibration(HDenum style);
void HDAPIENTRY hdUpdateCalibrationMessage(HDenum style);

/* The current transform; there is no gimbal to scale. */
void HDAPIENTRY hdScaleGimbalAngles(HDdouble scale_x, HDdouble scale_y, HDdouble scale_z,
                                    HDdouble transform[16]);
/* Always 1: there are no licences to deploy. */
HDboolean HDAPIENTRY hdDeploymentLicense(const char* vendor, const char* application,
                                         const char* password);

#ifdef __cplusplus
}
#endif

/* NOLINTEND */

#endif
