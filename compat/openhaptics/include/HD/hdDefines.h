/* SPDX-License-Identifier: Apache-2.0 */
/* Types, constants and macros of Forcegrid's libHD. Written from published client programs;
 * docs/openhaptics.md says what each constant does here. C89, C++98 and later. */
#ifndef FORCEGRID_HD_DEFINES_H
#define FORCEGRID_HD_DEFINES_H

/* NOLINTBEGIN: the names, and C89 or C++98, are those of the interface. */

#include <stddef.h>

#define HD_VERSION_MAJOR_NUMBER 3
#define HD_VERSION_MINOR_NUMBER 30
#define HD_VERSION_BUILD_NUMBER 0

/* The platform's own calling convention. */
#define HDCALLBACK
#define HDAPIENTRY

typedef int HDint;
typedef unsigned int HDuint;
typedef unsigned char HDboolean;
typedef unsigned short HDushort;
typedef char HDchar;
typedef long HDlong;
typedef unsigned long HDulong;
typedef float HDfloat;
typedef double HDdouble;
typedef const char* HDstring;
typedef unsigned int HDenum;
typedef unsigned int HDerror;
typedef unsigned int HHD; /* a device */
typedef unsigned int HDCallbackCode;
typedef unsigned long HDSchedulerHandle;
typedef unsigned short HDSchedulerPriority;
typedef HDCallbackCode(HDCALLBACK* HDSchedulerCallback)(void* data);

typedef enum HDWaitCode { HD_WAIT_CHECK_STATUS = 0, HD_WAIT_INFINITE = 1 } HDWaitCode;

typedef struct HDErrorInfo {
  HDerror errorCode;
  int internalErrorCode; /* errno of the system, or a fault number; 0: none */
  HHD hHD;               /* the device that was current, or that has the fault */
} HDErrorInfo;

#define HD_TRUE 1
#define HD_FALSE 0
#define HD_DEFAULT_DEVICE NULL
#define HD_INVALID_HANDLE 0xFFFFFFFF

/* Whether an HDErrorInfo tells of an error; the argument may be an assignment. */
#define HD_DEVICE_ERROR(info) ((info).errorCode != HD_SUCCESS)

/* Errors */
#define HD_SUCCESS 0x0000
#define HD_INVALID_ENUM 0x0100
#define HD_INVALID_VALUE 0x0101
#define HD_INVALID_OPERATION 0x0102
#define HD_INVALID_INPUT_TYPE 0x0103
#define HD_BAD_HANDLE 0x0104
#define HD_WARM_MOTORS 0x0200
#define HD_EXCEEDED_MAX_FORCE 0x0201
#define HD_EXCEEDED_MAX_FORCE_IMPULSE 0x0202
#define HD_EXCEEDED_MAX_VELOCITY 0x0203
#define HD_FORCE_ERROR 0x0204
#define HD_DEVICE_FAULT 0x0300
#define HD_DEVICE_ALREADY_INITIATED 0x0301
#define HD_COMM_ERROR 0x0302
#define HD_COMM_CONFIG_ERROR 0x0303
#define HD_TIMER_ERROR 0x0304
#define HD_ILLEGAL_BEGIN 0x0400
#define HD_ILLEGAL_END 0x0401
#define HD_FRAME_ERROR 0x0402
#define HD_INVALID_PRIORITY 0x0500
#define HD_SCHEDULER_FULL 0x0501
#define HD_INVALID_LICENSE 0x0600

/* Parameters: the state of this frame */
#define HD_CURRENT_BUTTONS 0x2000
#define HD_CURRENT_SAFETY_SWITCH 0x2001
#define HD_CURRENT_INKWELL_SWITCH 0x2002 /* 0: docked, 1: out */
#define HD_CURRENT_ENCODER_VALUES 0x2010
#define HD_CURRENT_PINCH_VALUE 0x2011
#define HD_LAST_PINCH_VALUE 0x2012
#define HD_CURRENT_POSITION 0x2050         /* mm */
#define HD_CURRENT_VELOCITY 0x2051         /* mm/s */
#define HD_CURRENT_TRANSFORM 0x2052        /* column-major, mm */
#define HD_CURRENT_ANGULAR_VELOCITY 0x2053 /* rad/s */
#define HD_CURRENT_JACOBIAN 0x2054         /* 6 x 6, row-major, mm/rad */
#define HD_CURRENT_JOINT_ANGLES 0x2100     /* rad */
#define HD_CURRENT_GIMBAL_ANGLES 0x2150    /* rad */

/* Parameters: the state of the frame before */
#define HD_LAST_BUTTONS 0x2200
#define HD_LAST_SAFETY_SWITCH 0x2201
#define HD_LAST_INKWELL_SWITCH 0x2202
#define HD_LAST_ENCODER_VALUES 0x2210
#define HD_LAST_POSITION 0x2250
#define HD_LAST_VELOCITY 0x2251
#define HD_LAST_TRANSFORM 0x2252
#define HD_LAST_ANGULAR_VELOCITY 0x2253
#define HD_LAST_JACOBIAN 0x2254
#define HD_LAST_JOINT_ANGLES 0x2300
#define HD_LAST_GIMBAL_ANGLES 0x2350

/* Parameters: the device */
#define HD_VERSION 0x2500
#define HD_DEVICE_MODEL_TYPE 0x2501
#define HD_DEVICE_DRIVER_VERSION 0x2502
#define HD_DEVICE_VENDOR 0x2503
#define HD_DEVICE_SERIAL_NUMBER 0x2504
#define HD_DEVICE_FIRMWARE_VERSION 0x2505
#define HD_MAX_WORKSPACE_DIMENSIONS 0x2550    /* mm; xmin ymin zmin xmax ymax zmax */
#define HD_USABLE_WORKSPACE_DIMENSIONS 0x2551 /* mm, likewise */
#define HD_TABLETOP_OFFSET 0x2552             /* mm, y of the table */
#define HD_INPUT_DOF 0x2553
#define HD_OUTPUT_DOF 0x2554
#define HD_CALIBRATION_STYLE 0x2555

/* Parameters: rates and limits */
#define HD_UPDATE_RATE 0x2600                  /* Hz */
#define HD_INSTANTANEOUS_UPDATE_RATE 0x2601    /* Hz */
#define HD_NOMINAL_MAX_STIFFNESS 0x2602        /* N/mm */
#define HD_NOMINAL_MAX_FORCE 0x2603            /* N */
#define HD_NOMINAL_MAX_CONTINUOUS_FORCE 0x2604 /* N */
#define HD_MOTOR_TEMPERATURE 0x2605            /* 1: the limit */
#define HD_SOFTWARE_VELOCITY_LIMIT 0x2606      /* mm/s */
#define HD_SOFTWARE_FORCE_IMPULSE_LIMIT 0x2607
#define HD_FORCE_RAMPING_RATE 0x2608
#define HD_NOMINAL_MAX_DAMPING 0x2609 /* N s/mm */
#define HD_NOMINAL_MAX_TORQUE_STIFFNESS 0x2620
#define HD_NOMINAL_MAX_TORQUE_DAMPING 0x2621
#define HD_NOMINAL_MAX_TORQUE_FORCE 0x2622
#define HD_NOMINAL_MAX_TORQUE_CONTINUOUS_FORCE 0x2623

/* Parameters: force and torque */
#define HD_CURRENT_FORCE 0x2700          /* N */
#define HD_CURRENT_TORQUE 0x2701         /* mN m */
#define HD_JOINT_ANGLE_REFERENCES 0x2702 /* rad */
#define HD_CURRENT_JOINT_TORQUE 0x2703   /* mN m */
#define HD_CURRENT_GIMBAL_TORQUE 0x2704  /* mN m */
#define HD_CURRENT_MOTOR_DAC_VALUES 0x2750
#define HD_LAST_FORCE 0x2800
#define HD_LAST_TORQUE 0x2801
#define HD_LAST_JOINT_TORQUE 0x2802
#define HD_LAST_GIMBAL_TORQUE 0x2803
#define HD_LAST_MOTOR_DAC_VALUES 0x2850
#define HD_USER_STATUS_LIGHT 0x2900

/* Capabilities; two limits above and the status light are capabilities, too */
#define HD_FORCE_OUTPUT 0x4000
#define HD_MAX_FORCE_CLAMPING 0x4001
#define HD_FORCE_RAMPING 0x4002
#define HD_SOFTWARE_FORCE_LIMIT 0x4003
#define HD_ONE_FRAME_LIMIT 0x4004

/* Calibration */
#define HD_CALIBRATION_OK 0x5000
#define HD_CALIBRATION_NEEDS_UPDATE 0x5001
#define HD_CALIBRATION_NEEDS_MANUAL_INPUT 0x5002
#define HD_CALIBRATION_ENCODER_RESET 1
#define HD_CALIBRATION_AUTO 2
#define HD_CALIBRATION_INKWELL 4

/* Bits of HD_CURRENT_BUTTONS */
#define HD_DEVICE_BUTTON_1 1
#define HD_DEVICE_BUTTON_2 2
#define HD_DEVICE_BUTTON_3 4
#define HD_DEVICE_BUTTON_4 8

/* Values of HD_USER_STATUS_LIGHT */
#define LED_MASK 7
#define LED_STATUS_FAST_GRNYEL 0
#define LED_STATUS_SLOW_YEL 1
#define LED_STATUS_SLOW_GRN 2
#define LED_STATUS_FAST_GRN 3
#define LED_STATUS_SOLID_GRNYEL 4
#define LED_STATUS_SOLID_YEL 5
#define LED_STATUS_SOLID_GRN 6
#define LED_STATUS_FAST_YEL 7

/* Scheduler */
#define HD_MAX_SCHEDULER_PRIORITY 65535
#define HD_MIN_SCHEDULER_PRIORITY 0
#define HD_DEFAULT_SCHEDULER_PRIORITY ((HD_MAX_SCHEDULER_PRIORITY + HD_MIN_SCHEDULER_PRIORITY) / 2)
#define HD_RENDER_EFFECT_FORCE_PRIORITY (HD_MAX_SCHEDULER_PRIORITY - 1)
#define HD_CALLBACK_DONE 0
#define HD_CALLBACK_CONTINUE 1

/* NOLINTEND */

#endif
