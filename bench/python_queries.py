#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A million queries from one NumPy call beside the same loop in C++: prints the ratio for each method.
The goal is 1.3. Both sides learn the same samples, and their forces have to be the same.
usage: PYTHONPATH=BUILD/python python_queries.py BUILD/bin/forcegrid_python_queries [METHOD...]"""
import os
import subprocess
import sys
import time

import numpy as np

import forcegrid

POSITIONS, SAMPLES, ROUNDS = 1_000_000, 90, 15


def main():
    names = sys.argv[2:] or ["hold", "rls", "forcegrid", "kriging", "auto"]
    times = np.arange(SAMPLES) / 30
    path = 0.03 * np.column_stack((np.sin(2 * times), np.cos(3 * times), np.sin(times)))
    forces = -100.0 * path
    positions = np.random.default_rng(1).uniform(-0.03, 0.03, (POSITIONS, 3))
    print(f"{'method':<12}{'C++ ns':>8}{'new array':>11}{'ratio':>7}{'out=':>8}{'ratio':>7}")
    for name in names:
        peer = subprocess.Popen([sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        peer.stdin.write(f"{name} {SAMPLES} {POSITIONS}\n".encode()
                         + np.column_stack((times, path, forces)).tobytes()
                         + np.array([times[-1]]).tobytes() + positions.tobytes())
        method = forcegrid.make(name)
        method.contact_made((0, 0, 0))
        method.take_samples(times, path, forces)
        out, cpp_s, new_s, out_s = np.empty((POSITIONS, 3)), [], [], []
        for _ in range(ROUNDS):  # in turns: what else the machine does befalls all alike
            peer.stdin.write(b"\n")
            peer.stdin.flush()
            took_s, sum_N = map(float, peer.stdout.readline().split())
            cpp_s.append(took_s)
            began_s = time.perf_counter()
            answer = method.force(times[-1], positions)
            new_s.append(time.perf_counter() - began_s)
            began_s = time.perf_counter()
            method.force(times[-1], positions, out=out)
            out_s.append(time.perf_counter() - began_s)
            if not np.isclose(answer.sum(), sum_N, rtol=1e-9, atol=1e-6):
                sys.exit(f"{name}: Python's forces are not those of C++: {answer.sum()} and {sum_N}")
        peer.stdin.close()
        peer.wait()
        cpp_ns, new_ns, out_ns = (1e9 * min(each) / POSITIONS for each in (cpp_s, new_s, out_s))
        print(f"{name:<12}{cpp_ns:8.1f}{new_ns:11.1f}{new_ns / cpp_ns:7.2f}{out_ns:8.1f}"
              f"{out_ns / cpp_ns:7.2f}")
    print(f"smallest of {ROUNDS} rounds on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
