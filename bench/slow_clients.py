#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the force error of slow programs on libHD over their rate, with a force method and without.

Each point is a program of its own (forcegrid_slow_client) on an emulated arm that a hand moves on a Lissajous path:
a spring, or a ball whose force turns with the place. Their forces are known in closed form, so that the error is that
of the motors' torques against the exact force where the arm says that its tool is.

Writes into --out: slow_clients.csv (one row a point), slow_clients.svg, and looks_OBJECT_RATE_METHOD.csv, the arm's
record each 2 ms. Stretches in which the machine has held up the program are left out.

    bench/slow_clients.py --out DIR             two minutes
    bench/slow_clients.py --quick --out DIR     one spring at 30 Hz, both ways: 15 s
"""

import argparse
import csv
import os
import subprocess
import sys
from pathlib import Path

RATES_HZ = [30, 60, 100, 200]
TICKS_HZ = 1000  # as a program that computes in each tick: what remains is the way to the motors
OBJECTS = ["spring", "ball"]
METHODS = ["hold", "auto"]
TRIES = 3  # of a point, until the machine has not held up its program
COLUMNS = ["object", "rate_Hz", "method", "error_percent", "rms_N", "looks", "left_out"]
COLOURS = {"hold": "#c0392b", "auto": "#1f6fb4"}


def measure(build, folder, shape, rate_hz, method, seconds):
    """Of the tries, the one of which least was left out."""
    best, said = None, ""
    for _ in range(TRIES):
        row, said = measure_once(build, folder, shape, rate_hz, method, seconds, best)
        best = row or best
        if row and row["left_out"] == 0:
            break
    if best is None:
        sys.exit(f"slow_clients.py: {shape} at {rate_hz} Hz, {method}: {said}")
    return best


def measure_once(build, folder, shape, rate_hz, method, seconds, best):
    """@returns a row that is better than `best`, whose looks are then in their file, or None; and what was said."""
    environment = {key: value for key, value in os.environ.items() if key != "FORCEGRID_HD_METHOD"}
    if method != "hold":
        environment["FORCEGRID_HD_METHOD"] = method
    looks = folder / f"looks_{shape}_{rate_hz}_{method}.csv"
    newest = folder / "newest.csv"
    done = subprocess.run([build / "bin/forcegrid_slow_client", shape, str(rate_hz), str(seconds), newest],
                          capture_output=True, text=True, env=environment, check=False)
    words = done.stdout.split()
    if done.returncode != 0 or words[:1] != ["error_percent"]:
        newest.unlink(missing_ok=True)
        return None, done.stdout + done.stderr
    row = {"object": shape, "rate_Hz": rate_hz, "method": method, "error_percent": float(words[1]),
           "rms_N": float(words[3]), "looks": int(words[5]), "left_out": int(words[7])}
    if best is not None and row["left_out"] >= best["left_out"]:
        newest.unlink()
        return None, ""
    newest.rename(looks)
    return row, ""


def script_of(rows, picture):
    """Gnuplot's input for the picture of `rows`."""
    lines = ["set terminal svg size 720,420 background rgb 'white' font 'DejaVu Sans,12'", f"set output '{picture}'",
             "set logscale xy", "set xrange [25:1200]", "set xtics (30, 60, 100, 200, 1000)", "set yrange [0.5:20]",
             "set ytics (0.5, 1, 2, 5, 10, 20)", "set grid", "set key outside right center",
             "set xlabel 'forces of the program per second'", "set ylabel 'force error, % of the RMS force'"]
    curves = []
    for method in METHODS:
        for shape in OBJECTS:
            points = [row for row in rows if row["object"] == shape and row["method"] == method]
            if points:
                name = f"${shape}_{method}"
                lines += [f"{name} << EOD", *(f"{row['rate_Hz']} {row['error_percent']}" for row in points), "EOD"]
                title = f"{shape}, {'held' if method == 'hold' else method}"
                curves.append(f"{name} with linespoints lw 2 pt {7 if shape == 'spring' else 5} "
                              f"dt {1 if shape == 'spring' else 2} lc rgb '{COLOURS[method]}' title '{title}'")
    return "\n".join(lines + ["plot " + ", \\\n     ".join(curves)]) + "\n"


def write_rows(rows, file):
    with open(file, "w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default=Path("build/release"), type=Path, help="build folder (default %(default)s)")
    parser.add_argument("--out", required=True, type=Path, help="folder of the picture and its data")
    parser.add_argument("--seconds", default=4.0, type=float, help="measured at each point (default %(default)s)")
    parser.add_argument("--quick", action="store_true", help="one spring at 30 Hz, 2 s")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    seconds = min(arguments.seconds, 2.0) if arguments.quick else arguments.seconds
    rows = []
    for shape in OBJECTS[:1] if arguments.quick else OBJECTS:
        for rate_hz in RATES_HZ[:1] if arguments.quick else [*RATES_HZ, TICKS_HZ]:
            for method in METHODS if rate_hz != TICKS_HZ else METHODS[:1]:
                rows.append(measure(arguments.build.resolve(), arguments.out, shape, rate_hz, method, seconds))
                print("{object:6} {rate_Hz:4d} Hz {method:4}  {error_percent:6.2f} % of {rms_N:.2f} N".format(**rows[-1]),
                      flush=True)
    write_rows(rows, arguments.out / "slow_clients.csv")
    picture = arguments.out / "slow_clients.svg"
    try:
        subprocess.run(["gnuplot"], input=script_of(rows, picture), text=True, check=True)
    except FileNotFoundError:
        sys.exit("slow_clients.py: gnuplot is missing, so there is no picture; sudo apt-get install gnuplot-nox")


if __name__ == "__main__":
    main()
