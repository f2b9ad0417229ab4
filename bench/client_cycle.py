#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a program on libHD costs the motor thread: one cycle's time beside the driver's bare loop.

Slices alternate on one emulated arm: a servo loop with a spring in its cycle (forcegrid_driver_loop), and a
program on libHD with the same spring in its callback (forcegrid_hd_spring). Both loops have the same guards,
limits and device, and both times are the loop's own, from a cycle's start to its end.

    bench/client_cycle.py                  three pairs of slices of 2 s: 20 s
    bench/client_cycle.py --seconds 10 --pairs 6 --json result.json
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

GOAL_US = 2.0  # that the session and libHD may add to a cycle, at the median
PARTS = ("p50", "p99", "p999", "max")


def output_of(command, environment):
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode != 0:
        sys.exit(f"client_cycle.py: {' '.join(map(str, command))}: {done.stdout}{done.stderr}")
    return done.stdout


def numbers(text, line):
    """Of a line 'NAME p50 1.5 p99 2.5 ...': {"p50": 1.5, ...}."""
    words = re.search(rf"^{line} (.*)$", text, re.MULTILINE).group(1).split()
    return {name: float(value) for name, value in zip(words[::2], words[1::2])}


def bare_slice(build, url, seconds, environment):
    text = output_of([build / "bin/forcegrid_driver_loop", url, str(seconds)], environment)
    return {"compute_us": numbers(text, "compute_us"), "wakeup_us": numbers(text, "wakeup_us")}


def client_slice(build, seconds, folder, environment):
    file = folder / "timing.json"
    text = output_of([build / "bin/forcegrid_hd_spring", str(seconds)],
                     {**environment, "FORCEGRID_TIMING": str(file)})
    timing = json.loads(file.read_text())
    return {"compute_us": timing["compute_us"], "wakeup_us": timing["wakeup_us"],
            "frame_us": numbers(text, "frame_us")}


def measure(build, folder, seconds, pairs):
    """@returns the slices of the bare loop and those of the client, in their order."""
    emulator = subprocess.Popen([build / "bin/forcegrid", "emulate", "--device", "woodenhaptics_v2015", "--listen",
                                 "127.0.0.1:0", "--calibrated", "--until-stdin-closes", "--quiet", "--no-config"],
                                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        words = emulator.stdout.readline().split()
        if words[:1] != ["listening"]:
            sys.exit("client_cycle.py: the emulator did not start; its message is above")
        url = f"usbip://{words[1]}/1-1"
        (folder / "forcegrid").mkdir()
        (folder / "forcegrid/openhaptics.toml").write_text(
            f'[device."Arm"]\nurl = "{url}"\ncalibrated = true\n')
        environment = {key: value for key, value in os.environ.items() if not key.startswith("FORCEGRID_HD_")}
        environment.pop("FORCEGRID_DEVICE", None)
        environment["XDG_CONFIG_HOME"] = str(folder)
        bare, client = [], []
        for pair in range(pairs):
            turns = [lambda: bare.append(bare_slice(build, url, seconds, environment)),
                     lambda: client.append(client_slice(build, seconds, folder, environment))]
            for turn in turns if pair % 2 == 0 else reversed(turns):
                turn()
        return bare, client
    finally:
        emulator.stdin.close()
        emulator.wait()


def summary(bare, client):
    def middle(slices, what, part):
        return round(median(one[what][part] for one in slices), 2)
    added = [of_client["compute_us"]["p50"] - of_bare["compute_us"]["p50"]
             for of_bare, of_client in zip(bare, client)]
    return {"bare": {what: {part: middle(bare, what, part) for part in PARTS} for what in ("compute_us", "wakeup_us")},
            "client": {what: {part: middle(client, what, part) for part in PARTS}
                       for what in ("compute_us", "wakeup_us")},
            "frame_us": {part: middle(client, "frame_us", part) for part in ("p50", "p99", "max")},
            "added_compute_p50_us": round(median(added), 2),
            "added_by_pair_us": [round(value, 2) for value in added], "goal_us": GOAL_US}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default=Path("build/release"), type=Path, help="build folder (default %(default)s)")
    parser.add_argument("--seconds", default=2.0, type=float, help="duration of a slice (default %(default)s)")
    parser.add_argument("--pairs", default=3, type=int, help="pairs of slices (default %(default)s)")
    parser.add_argument("--json", type=Path, help="file for all numbers")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        result = summary(*measure(arguments.build.resolve(), Path(name), arguments.seconds, arguments.pairs))
    for name, title in (("bare", "bare loop of the driver"), ("client", "with a program on libHD")):
        for what in ("compute_us", "wakeup_us"):
            print(f"{title:24} {what:10} " + "  ".join(f"{part} {result[name][what][part]:8.2f}" for part in PARTS))
    print(f"the program's frame: p50 {result['frame_us']['p50']:.2f} us, p99 {result['frame_us']['p99']:.2f} us")
    print(f"added to the motor thread's cycle, median: {result['added_compute_p50_us']:+.2f} us "
          f"(pairs {' '.join(f'{value:+.2f}' for value in result['added_by_pair_us'])}); goal {GOAL_US:.0f} us")
    if arguments.json:
        arguments.json.write_text(json.dumps({"processors": os.cpu_count(), "kernel": os.uname().version, **result},
                                             indent=2) + "\n")


if __name__ == "__main__":
    main()
