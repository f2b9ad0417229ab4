#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A floor at z = 0 that pushes the hand up with 400 N/m, at 1 kHz.
usage: 02_virtual_wall.py [DEVICE [SECONDS]]"""
import sys

import forcegrid

url = sys.argv[1] if len(sys.argv) > 1 else "emulated:woodenhaptics_v2015"
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 5.0
deepest_m = 0.0


def wall(state: forcegrid.State) -> tuple[float, float, float]:
    global deepest_m
    depth_m = max(0.0, -state.position_D_m[2])
    deepest_m = max(deepest_m, depth_m)
    return 0.0, 0.0, 400.0 * depth_m


with forcegrid.Device(url, emulator_motion="lissajous") as device:
    device.enable_force()  # it ramps in
    calls = device.run(wall, seconds=seconds)
    missed = device.read().missed_deadlines
print(f"deepest {1e3 * deepest_m:.2f} mm, {calls} calls, {missed} missed deadlines")
