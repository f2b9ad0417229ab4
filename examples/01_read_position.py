#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Where the tool is, ten times a second.
usage: 01_read_position.py [DEVICE [SECONDS]]"""
import sys
import time

import forcegrid

url = sys.argv[1] if len(sys.argv) > 1 else "emulated:woodenhaptics_v2015"
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 5.0

with forcegrid.Device(url, emulator_motion="lissajous") as device:
    print(f"{device.profile.name} at {device.url}: x toward you, y to your right, z up, in mm")
    state = device.read()
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and device.health <= forcegrid.Health.UNCALIBRATED:
        device.read(out=state)  # overwrites; device.read() makes a new one
        x, y, z = 1e3 * state.position_D_m
        print(f"{x:8.2f} {y:8.2f} {z:8.2f}  buttons {state.buttons:b}")
        time.sleep(0.1)
    if device.failure:
        sys.exit(device.failure)
