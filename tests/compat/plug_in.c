/* SPDX-License-Identifier: Apache-2.0 */
/* A binary plug-in that names no library: its hd* symbols come from whatever libHD its program has
 * loaded with RTLD_GLOBAL. */
#include <HD/hd.h>

int plug_in_run(void);

int plug_in_run(void) {
  HDErrorInfo error;
  HDdouble transform[16];
  HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
  if (HD_DEVICE_ERROR(error = hdGetError())) {
    return (int)error.errorCode;
  }
  hdMakeCurrentDevice(device);
  hdBeginFrame(device);
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  hdEndFrame(device);
  hdDisableDevice(device);
  return transform[15] == 1.0 ? 0 : -1;
}
