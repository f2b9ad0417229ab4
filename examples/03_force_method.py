#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A simulator of your own, too slow for a hand, felt at 1 kHz: it gives 60 forces a second, and the
method "auto" renders between them. Here it is a spring of 200 N/m.
When the simulator pauses for 0.2 s the force fades, and then comes back as the hand's motion allows.
usage: 03_force_method.py [DEVICE [SECONDS]]"""
import sys
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

import forcegrid

url = sys.argv[1] if len(sys.argv) > 1 else "emulated:woodenhaptics_v2015"
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 6.0


def simulate(position_m: NDArray[Any]) -> NDArray[Any]:
    """Put your simulator here: the force that the object exerts on a tool at this place."""
    return -200.0 * position_m


def watch(device: forcegrid.Device, over: threading.Event, errors_N: list[float],
          forces_N: list[float]) -> None:
    """Compares what is rendered with what the simulator would say, in every cycle that it sees."""
    state = device.read()
    begin_ns = state.time_ns + 3_000_000_000  # the hand comes, the force ramps in
    while not over.is_set():
        if device.wait(state.cycle, 0.1):
            device.read(out=state)
            if state.time_ns > begin_ns and state.force_gain == 1.0:
                exact_N = simulate(state.position_D_m)
                errors_N.append(float(np.linalg.norm(state.commanded_force_D_N - exact_N)))
                forces_N.append(float(np.linalg.norm(exact_N)))


answered_ns: list[int] = []


def answer(state: forcegrid.State) -> NDArray[Any]:
    answered_ns.append(state.time_ns)
    return simulate(state.position_D_m)


with forcegrid.Device(url, method="auto", emulator_motion="lissajous") as device:
    over = threading.Event()
    errors_N: list[float] = []
    forces_N: list[float] = []
    device.enable_force()
    watcher = threading.Thread(target=watch, args=(device, over, errors_N, forces_N))
    watcher.start()
    try:
        device.run(answer, rate_Hz=60, seconds=seconds)
    finally:
        over.set()
        watcher.join()
    missed = device.read().missed_deadlines
print(f"force error {100 * np.mean(errors_N) / np.mean(forces_N):.2f} % of the simulator's force, "
      f"in {len(errors_N)} cycles, {missed} missed deadlines; "
      f"longest pause of the simulator {1e-6 * max(np.diff(answered_ns)):.0f} ms")
