#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the wake-up latency of the servo loop with cyclictest's, idle and under load.

For each rate and load, slices alternate: cyclictest, the loop with a device that answers at once, and
(up to 1 kHz) the whole of `forcegrid record` with an emulated device over USB/IP. Neighbouring slices thus see
the same conditions, and the latency that the loop adds is the median over the pairs of slices. Needs
/usr/bin/cyclictest (rt-tests), stress-ng, python3-h5py.

    bench/realtime.py                  60 s of each, in slices of 10 s: half an hour
    bench/realtime.py --quick          4 s of each, in slices of 2 s
"""

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy

PRIORITY = 80  # rt::kServoPriority
LONGEST_US = 100_000  # end of cyclictest's histogram
GOAL_US = 20.0  # largest latency that the loop may add to cyclictest's 99.9th percentile
FASTEST_EMULATED_HZ = 1000
LOAD = ["stress-ng", "--cpu", "0", "--vm", "1", "--vm-bytes", "128M", "--hdd", "1", "--hdd-bytes", "64M",
        "--sock", "1", "--quiet"]


def percentiles(values):
    if len(values) == 0:
        sys.exit("realtime.py: a slice has no value; see its program's message above")
    p50, p99, p999 = numpy.percentile(values, [50, 99, 99.9])
    return {"p50_us": round(float(p50), 1), "p99_us": round(float(p99), 1),
            "p99_9_us": round(float(p999), 1), "max_us": round(float(numpy.max(values)), 1),
            "count": int(len(values))}


def median_interval(values, digits=1):
    """Median and its 95 % confidence interval for any distribution, from order statistics with binomial ranks.
    With fewer than six values the interval spans all of them and its confidence is lower."""
    ordered = sorted(values)
    count, rank, below = len(ordered), 0, 0.0
    while rank < count // 2 and below + math.comb(count, rank) / 2**count <= 0.025:
        below += math.comb(count, rank) / 2**count
        rank += 1
    rank = max(0, rank - 1)
    return {"median": round(float(numpy.median(ordered)), digits), "low": round(float(ordered[rank]), digits),
            "high": round(float(ordered[count - 1 - rank]), digits), "slices": count}


def run_cyclictest(rate_hz, seconds):
    """Latencies in us, one per wake-up. Those beyond cyclictest's histogram count as its end."""
    command = ["cyclictest", "-m", "-q", "-t", "1", "-p", str(PRIORITY), "-i", str(round(1e6 / rate_hz)),
               "-D", str(max(1, round(seconds))), "-h", str(LONGEST_US)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return parse_histogram(text)


def parse_histogram(text):
    latencies = []
    for line in text.splitlines():
        if line.startswith("# Histogram Overflows:"):
            latencies += [LONGEST_US] * int(line.split(":")[1].split()[0])
        elif line and line[0].isdigit():
            latency, count = line.split()[:2]
            latencies += [int(latency)] * int(count)
    return numpy.array(latencies, dtype=float)


def run_loop(command, file):
    result = subprocess.run(command, capture_output=True, text=True)
    if result.returncode not in (0, 3) or not Path(file).exists():
        sys.exit(f"realtime.py: {' '.join(command)}: {result.stderr.strip()}")
    with h5py.File(file, "r", swmr=True) as recording:
        cycles = recording["cycles"]
        return {"wakeup": cycles["wakeup_us"][:].astype(float),
                "compute": cycles["compute_us"][:].astype(float),
                "io": cycles["report_age_us"][:].astype(float),
                "missed": int(cycles["missed_deadlines"][:].sum()),
                "realtime": result.returncode == 0 and "No real-time" not in result.stderr}


def loop_commands(build, folder, rate_hz, seconds, emulated):
    """Name -> command and the file that it writes."""
    null_file = str(folder / "null.h5")
    commands = {"loop": ([str(build / "bin/forcegrid_null_loop"), null_file, str(rate_hz), str(seconds)],
                         null_file)}
    if emulated and rate_hz <= FASTEST_EMULATED_HZ:
        file = str(folder / "emulated.h5")
        commands["emulated"] = ([str(build / "bin/forcegrid"), "--no-config", "record", file, "--rate",
                                 str(rate_hz), "--seconds", str(seconds), "--scene", "small", "--method",
                                 "forcegrid", "--evaluate", "hold",
                                 "--no-reference", "--out", str(folder)], file)
    return commands


def measure(build, folder, rate_hz, seconds, slice_s, emulated):
    latencies = []
    slices = {}
    for turn in range(max(1, round(seconds / slice_s))):
        measurements = [("cyclictest", None)]
        measurements += loop_commands(build, folder, rate_hz, slice_s, emulated).items()
        # Every other round in reverse order, so that no program always follows the same one.
        for name, command in measurements if turn % 2 == 0 else reversed(measurements):
            if name == "cyclictest":
                latencies.append(run_cyclictest(rate_hz, slice_s))
            else:
                slices.setdefault(name, []).append(run_loop(*command))
    return summary(rate_hz, latencies, slices)


def added(latencies, loops, percent):
    """Latency that the loop's slices add to their neighbouring cyclictest slices, at a percentile."""
    return median_interval([numpy.percentile(loop["wakeup"], percent) - numpy.percentile(plain, percent)
                            for plain, loop in zip(latencies, loops)])


def summary(rate_hz, by_slice, slices):
    """`by_slice`: cyclictest's latencies, one array per slice; `slices`: results of run_loop(), by name."""
    period_us = 1e6 / rate_hz
    latencies = numpy.concatenate(by_slice)
    # One wake-up may miss several deadlines; the loop counts in the same way.
    skipped = float(numpy.floor(latencies / period_us).sum())
    result = {"rate_Hz": rate_hz, "cyclictest": {
        "wakeup": percentiles(latencies),
        "missed_percent": round(100.0 * skipped / (len(latencies) + skipped), 4)}}
    for name, parts in slices.items():
        joined = {key: numpy.concatenate([part[key] for part in parts]) for key in ("wakeup", "compute", "io")}
        missed = sum(part["missed"] for part in parts)
        result[name] = {key: percentiles(values) for key, values in joined.items()
                        if name != "loop" or key != "io"}  # its device has no I/O
        result[name]["missed_percent"] = round(100.0 * missed / (len(joined["wakeup"]) + missed), 4)
        result[name]["realtime"] = all(part["realtime"] for part in parts)
    for percent, key in ((50, "p50"), (99, "p99"), (99.9, "p99_9")):
        result[f"added_at_{key}_us"] = added(by_slice, slices["loop"], percent)
    between = numpy.abs(numpy.diff([numpy.percentile(plain, 99.9) for plain in by_slice]))
    result["cyclictest_wanders_us"] = round(float(numpy.median(between)), 1) if len(between) else None
    result["goal_met"] = verdict(result["added_at_p99_9_us"], result["loop"]["realtime"])
    return result


def verdict(interval, realtime):
    """True or False only if the whole interval agrees; None: this run does not decide."""
    if not realtime or interval["low"] > GOAL_US:
        return False
    return True if interval["high"] <= GOAL_US else None


def print_row(condition, result):
    def words(name, key):
        p = result[name][key]
        return f"{p['p50_us']:8.1f} {p['p99_us']:8.1f} {p['p99_9_us']:8.1f} {p['max_us']:9.1f}"
    for name in ("cyclictest", "loop", "emulated"):
        for key in ("wakeup", "compute", "io") if name != "loop" else ("wakeup", "compute"):
            if name in result and key in result[name]:
                print(f"{result['rate_Hz']:5d} Hz {condition:5s} {name:10s} {key:8s} {words(name, key)}   missed "
                      f"{result[name]['missed_percent']:.3f} %")
    said = {True: "met", False: "NOT met", None: "undecided: the interval contains the goal"}[result["goal_met"]]
    for key in ("p50", "p99", "p99_9"):
        more = result[f"added_at_{key}_us"]
        print(f"{result['rate_Hz']:5d} Hz {condition:5s} the loop adds {more['median']:+.1f} us ({more['low']:+.1f} to "
              f"{more['high']:+.1f}) at {key.replace('_', '.')}"
              + (f"; goal {GOAL_US:.0f}: {said}; cyclictest's own slices differ by "
                 f"{result['cyclictest_wanders_us']} us" if key == "p99_9" else ""), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release", type=Path, help="build folder (default %(default)s)")
    parser.add_argument("--rates", default="500,1000,4000", help="Hz, separated by commas (default %(default)s)")
    parser.add_argument("--seconds", default=60.0, type=float, help="duration of each program (default %(default)s)")
    parser.add_argument("--slice", default=10.0, type=float, help="seconds per slice (default %(default)s)")
    parser.add_argument("--no-emulated", action="store_true", help="leave the emulated device out")
    parser.add_argument("--quick", action="store_true", help="4 s of each, in slices of 2 s")
    parser.add_argument("--json", type=Path, help="file for all numbers")
    arguments = parser.parse_args()
    if arguments.quick:
        arguments.seconds, arguments.slice = 4.0, 2.0
    for program, package in (("cyclictest", "rt-tests"), ("stress-ng", "stress-ng")):
        if shutil.which(program) is None:
            sys.exit(f"realtime.py: {program} is missing; sudo apt-get install {package}")
    print(f"{'':25s} {'':8s} {'p50':>8s} {'p99':>8s} {'p99.9':>8s} {'max':>9s}   us")
    results = []
    with tempfile.TemporaryDirectory() as name:
        for rate_hz in (int(rate) for rate in arguments.rates.split(",")):
            for condition in ("idle", "load"):
                stress = subprocess.Popen(LOAD, cwd=name) if condition == "load" else None
                try:
                    result = measure(arguments.build, Path(name), rate_hz, arguments.seconds, arguments.slice,
                                     not arguments.no_emulated)
                finally:
                    if stress:
                        stress.terminate()
                        stress.wait()
                print_row(condition, result)
                results.append({"condition": condition, **result})
    if arguments.json:
        arguments.json.write_text(json.dumps({"processors": os.cpu_count(), "kernel": os.uname().version,
                                              "results": results}, indent=2) + "\n")


if __name__ == "__main__":
    main()
