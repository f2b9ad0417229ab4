/* SPDX-License-Identifier: Apache-2.0 */
#ifndef FORCEGRID_HDU_ERROR_H
#define FORCEGRID_HDU_ERROR_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#include <HD/hdDefines.h>
#include <HD/hdDevice.h>
#include <stdio.h>

#include "hduMath.h"

/* Writes the error's text, device, code, internal code and `message`, a line each. */
FORCEGRID_HDU_FUNCTION void hduPrintError(FILE* stream, const HDErrorInfo* error,
                                          const char* message) {
  fprintf(stream, "HD error: %s\n", hdGetErrorString(error->errorCode));
  fprintf(stream, "HHD: 0x%X\n", error->hHD);
  fprintf(stream, "Error code: 0x%X\n", error->errorCode);
  fprintf(stream, "Internal error code: %d\n", error->internalErrorCode);
  fprintf(stream, "Message: %s\n", message != NULL ? message : "");
}

/* Whether the error is about forces: the program may go on. */
FORCEGRID_HDU_FUNCTION HDboolean hduIsForceError(const HDErrorInfo* error) {
  return (HDboolean)(error->errorCode >= HD_WARM_MOTORS && error->errorCode <= HD_FORCE_ERROR);
}

/* Whether the error ends what the servo thread does for the program. */
FORCEGRID_HDU_FUNCTION HDboolean hduIsSchedulerError(const HDErrorInfo* error) {
  switch (error->errorCode) {
    case HD_COMM_ERROR:
    case HD_COMM_CONFIG_ERROR:
    case HD_TIMER_ERROR:
    case HD_INVALID_PRIORITY:
    case HD_SCHEDULER_FULL:
      return HD_TRUE;
    default:
      return HD_FALSE;
  }
}

/* NOLINTEND */

#endif
