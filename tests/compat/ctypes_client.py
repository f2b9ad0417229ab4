#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A program in Python by ctypes, as those that exist: structures by value, a callback in Python that
sets the force, and an end with a callback in flight.
usage: ctypes_client.py SECONDS"""
import ctypes
import sys
import time

DOUBLES = ctypes.c_double * 3
TRANSFORM = ctypes.c_double * 16


class ErrorInfo(ctypes.Structure):
    _fields_ = [("errorCode", ctypes.c_uint), ("internalErrorCode", ctypes.c_int),
                ("hHD", ctypes.c_uint)]


hd = ctypes.CDLL("libHD.so")
hd.hdGetError.restype = ErrorInfo
hd.hdInitDevice.restype = ctypes.c_uint
hd.hdInitDevice.argtypes = [ctypes.c_char_p]
hd.hdGetString.restype = ctypes.c_char_p
hd.hdScheduleAsynchronous.restype = ctypes.c_ulong
CALLBACK = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_void_p)

state = {"ticks": 0, "position": None}


@CALLBACK
def callback(_):
    transform, force = TRANSFORM(), DOUBLES()
    device = hd.hdGetCurrentDevice()
    hd.hdMakeCurrentDevice(device)
    hd.hdBeginFrame(device)
    hd.hdGetDoublev(0x2052, transform)
    for i in range(3):
        force[i] = -0.3 * transform[12 + i]
    hd.hdSetDoublev(0x2700, force)
    hd.hdEndFrame(device)
    state["ticks"] += 1
    state["position"] = list(transform[12:15])
    return 0 if hd.hdGetError().errorCode else 1


def main():
    before = hd.hdGetCurrentDevice()
    assert hd.hdGetError().errorCode == 0, "no error before any init"
    device = hd.hdInitDevice(b"Default Device")
    error = hd.hdGetError()
    assert error.errorCode == 0, f"init: {error.errorCode:#x}"
    assert device == before, "the handle that was current before"
    print(hd.hdGetString(0x2501).decode(), hd.hdGetString(0x2503).decode())
    hd.hdEnable(0x4000)
    hd.hdStartScheduler()
    hd.hdScheduleAsynchronous(callback, None, 65535 // 2)
    time.sleep(float(sys.argv[1]))
    hd.hdStopScheduler()  # while a callback may be in flight
    hd.hdDisableDevice(device)
    print("ticks", state["ticks"], "position", state["position"])
    assert state["ticks"] > 100


if __name__ == "__main__":
    main()
