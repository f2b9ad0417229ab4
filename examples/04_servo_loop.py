#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A servo loop of your own around the library: read, ask a force method, command. The simulator is
a spring of 100 N/m that answers every 33rd cycle; the loop gives the method its work.
usage: 04_servo_loop.py [DEVICE [SECONDS]]"""
import sys

import forcegrid

url = sys.argv[1] if len(sys.argv) > 1 else "emulated:woodenhaptics_v2015"
cycles = int(1000 * float(sys.argv[2])) if len(sys.argv) > 2 else 5000

with forcegrid.Device(url, rate_Hz=1000, emulator_motion="lissajous") as device:
    method = forcegrid.make("auto", workspace_W_m=device.profile.workspace_D_m)
    state = device.read()
    start_m = state.position_D_m.copy()
    method.contact_made(start_m)
    device.enable_force()
    late = 0
    for cycle in range(cycles):
        if not device.wait(state.cycle, timeout_s=0.1):
            sys.exit(device.failure or "no cycle for 0.1 s")
        before = state.cycle
        device.read(out=state)
        late += state.cycle - before - 1
        time_s, tool_m = 1e-9 * state.time_ns, state.position_D_m
        if cycle % 33 == 0:
            method.take_sample(time_s, tool_m, -100.0 * (tool_m - start_m))
        method.observe(time_s, tool_m)
        device.command_force(method.force(time_s, tool_m))
        method.work(1000)
print(f"{cycles} cycles, {late} of the device's cycles missed")
