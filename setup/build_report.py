#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Processor time that compiling took: of the program, of the rest and of the tests, by folder, and the
ten slowest objects. Linking, a few seconds in all, is not counted.

usage: build_report.py BUILD_FOLDER

Each object counts with its last compilation; one that came out of the compiler's cache with the time
that this took. setup/timed_compile.sh has left the times. An object of a library holds up to eight
sources (FORCEGRID_UNITY_BUILD).
"""
import collections
import pathlib
import re
import subprocess
import sys

PROGRAM = "bin/forcegrid"
SLOWEST = 10
MINUTES_AND_SECONDS = re.compile(r"(\d+)m([\d.]+)s")


def cpu_s(times):
    """User and system time of the compiler: the second line of what the shell's `times` prints."""
    return sum(60 * int(minutes) + float(seconds)
               for minutes, seconds in MINUTES_AND_SECONDS.findall(times.split("\n")[1]))


def folder_of(name):
    """simulator/mesh/CMakeFiles/forcegrid_simulator_mesh.dir/scene.cpp.o is of simulator/mesh."""
    return name.split("/CMakeFiles/")[0]


def inputs_of(build, program):
    done = subprocess.run(["ninja", "-C", str(build), "-t", "inputs", program], capture_output=True,
                          text=True)
    if done.returncode != 0:
        sys.exit(f"build_report.py: {build} has no {program}: {done.stderr.strip()}; run `make program`")
    return set(done.stdout.split("\n"))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    build = pathlib.Path(sys.argv[1])
    took = {str(path.relative_to(build))[:-len(".times")]: cpu_s(path.read_text())
            for path in build.rglob("*.o.times")}
    if not took:
        sys.exit(f"build_report.py: nothing was compiled in {build} yet; run `make program`")
    program = inputs_of(build, PROGRAM)
    print(f"program_cpu_s {sum(time for name, time in took.items() if name in program):.0f}")
    print(f"tests_cpu_s {sum(time for name, time in took.items() if name.startswith('tests/')):.0f}")
    print(f"all_cpu_s {sum(took.values()):.0f}")
    folders = collections.Counter()
    for name, time in took.items():
        folders[folder_of(name)] += time
    print("\nBy folder:")
    for folder, time in folders.most_common():
        print(f"{time:8.1f} s  {folder}")
    print(f"\nThe {SLOWEST} slowest:")
    for name in sorted(took, key=took.get, reverse=True)[:SLOWEST]:
        print(f"{took[name]:8.1f} s  {name.replace('CMakeFiles/', '')}")


if __name__ == "__main__":
    main()
