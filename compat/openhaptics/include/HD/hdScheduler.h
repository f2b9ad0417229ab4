/* SPDX-License-Identifier: Apache-2.0 */
/* The servo thread and its callbacks. Every function may be called from any thread. */
#ifndef FORCEGRID_HD_SCHEDULER_H
#define FORCEGRID_HD_SCHEDULER_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#include "hdDefines.h"

#ifdef __cplusplus
extern "C" {
#endif

void HDAPIENTRY hdStartScheduler(void);
/* Returns when no callback runs any more. What is scheduled stays so. */
void HDAPIENTRY hdStopScheduler(void);
/* 500 to 4000 Hz; 1000 unless set. */
void HDAPIENTRY hdSetSchedulerRate(HDulong rate_Hz);
/* Seconds since the start of the running tick. */
HDdouble HDAPIENTRY hdGetSchedulerTimeStamp(void);

/* Runs `callback` once in the servo thread and returns when it has. */
void HDAPIENTRY hdScheduleSynchronous(HDSchedulerCallback callback, void* data, HDushort priority);
/* Runs `callback` in every tick from the next one on, until it returns HD_CALLBACK_DONE. */
HDSchedulerHandle HDAPIENTRY hdScheduleAsynchronous(HDSchedulerCallback callback, void* data,
                                                    HDushort priority);
void HDAPIENTRY hdUnschedule(HDSchedulerHandle callback);
/* HD_WAIT_CHECK_STATUS: whether it is still scheduled. HD_WAIT_INFINITE: waits until it is not. */
HDboolean HDAPIENTRY hdWaitForCompletion(HDSchedulerHandle callback, HDWaitCode wait);

#ifdef __cplusplus
}
#endif

/* NOLINTEND */

#endif
