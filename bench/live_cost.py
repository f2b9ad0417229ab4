#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures the cost of the live dashboard for the servo: `forcegrid record` with and without --live in turns.

Each pair of slices runs the same loop with an emulated device over USB/IP and a simulator, once with the
dashboard in a terminal of 80 x 24 and once without. For each pair the script takes the ratio, with / without, of
the servo's own figures. It prints the median over the pairs and its 95 % interval. Needs python3-h5py.

    bench/live_cost.py --pairs 20 --slice 5
"""

import argparse
import fcntl
import os
import pty
import struct
import subprocess
import sys
import tempfile
import termios
import threading
from pathlib import Path

import h5py
import numpy

import realtime

# Name, column, percentile. Higher percentiles depend on a few cycles per slice, that is, on the machine.
FIGURES = [("compute, median", "compute_us", 50), ("compute, p99", "compute_us", 99),
           ("wake-up, median", "wakeup_us", 50), ("wake-up, p99", "wakeup_us", 99)]


def run_in_terminal(command):
    """Runs the command; returns its exit status and the number of bytes drawn."""
    main, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    process = subprocess.Popen(command, stdin=terminal, stdout=terminal, stderr=terminal,
                               env={**os.environ, "TERM": "xterm"})
    os.close(terminal)
    drawn = [0]

    def read():
        try:
            while data := os.read(main, 65536):
                drawn[0] += len(data)
        except OSError:
            pass  # the other end is closed: the program has ended

    reader = threading.Thread(target=read)
    reader.start()
    status = process.wait()
    reader.join()
    os.close(main)
    return status, drawn[0]


def measure(build, folder, rate_hz, seconds, live):
    file = folder / "live_cost.h5"
    command = [str(build / "bin/forcegrid"), "--no-config", "record", str(file), "--rate", str(rate_hz),
               "--seconds", str(seconds), "--scene", "small", "--no-reference", "--out", str(folder)]
    status, drawn = run_in_terminal(command + (["--live"] if live else []))
    if status != 0 or not file.exists():
        sys.exit(f"live_cost.py: {' '.join(command)} ended with status {status}; run it to see why")
    with h5py.File(file, "r", swmr=True) as recording:
        cycles = recording["cycles"]
        figures = {name: float(numpy.percentile(cycles[column][:], percent)) for name, column, percent in FIGURES}
        figures["missed"] = int(cycles["missed_deadlines"][:].sum())
        figures["cycles"] = len(cycles["wakeup_us"])
    return figures, drawn


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release", type=Path, help="build folder (default %(default)s)")
    parser.add_argument("--rate", default=500, type=int, help="Hz (default %(default)s)")
    parser.add_argument("--pairs", default=12, type=int, help="of slices (default %(default)s)")
    parser.add_argument("--slice", default=5.0, type=float, help="seconds (default %(default)s)")
    arguments = parser.parse_args()
    slices = {True: [], False: []}
    drawn = {True: 0, False: 0}
    with tempfile.TemporaryDirectory() as name:
        for pair in range(arguments.pairs):
            # Alternates the order within the pairs.
            for live in (pair % 2 == 0, pair % 2 != 0):
                figures, size = measure(arguments.build, Path(name), arguments.rate, arguments.slice, live)
                slices[live].append(figures)
                drawn[live] += size
    print(f"{arguments.pairs} pairs of {arguments.slice:g} s at {arguments.rate} Hz; drawn {drawn[True]} bytes with "
          f"--live, {drawn[False]} without")
    for name, _, _ in FIGURES:
        ratio = realtime.median_interval([on[name] / off[name] for on, off in zip(slices[True], slices[False])], 3)
        us = [numpy.median([one[name] for one in slices[live]]) for live in (True, False)]
        print(f"{name:16s} with/without {ratio['median']:.3f} ({ratio['low']:.3f} to {ratio['high']:.3f})   "
              f"{us[0]:.1f} and {us[1]:.1f} us")
    for live in (True, False):
        missed, cycles = (sum(one[key] for one in slices[live]) for key in ("missed", "cycles"))
        print(f"missed {'with' if live else 'without':8s} {missed} of {missed + cycles} deadlines")


if __name__ == "__main__":
    main()
