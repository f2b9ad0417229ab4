#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the coverage page: which scenarios passed on which hosts and devices.

All of it comes from results. The guest's complete runs say which devices and hosts each scenario used;
run_guest.py keeps the last run of each set and kernel. ctest's JUnit files say which tests passed
without a kernel. A scenario without a result in a run has no mark.
"""

import argparse
import json
import pathlib
import sys
import xml.etree.ElementTree as ET

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
HOSTS = {
    "kernel": "kernel: enumeration, usbhid, udev",
    "forcegrid-hidraw": "this program on hidraw",
    "forcegrid-libusb": "this program on libusb",
    "hidapi-hidraw": "independent client: hidapi on hidraw",
    "hidapi-libusb": "independent client: hidapi on libusb",
}
USER_SPACE = "user space: this program's USB/IP client, no kernel"
# The name of a test without a kernel contains one of these words; the first match is its device. The
# last entry matches every name.
DEVICE_WORDS = [("falcon", "falcon"), ("w3", "woodenhaptics_teensy"),
                ("teensy", "woodenhaptics_teensy"), ("phantom", "phantom_desktop"),
                ("", "woodenhaptics_v2015")]
SETS = ["smoke", "full"]  # the later includes the earlier


class MatrixError(Exception):
    """Says what is wrong and what to do."""


def load_runs(folder):
    """The widest complete run of each kernel, by metapackage."""
    runs = {}
    for name in SETS:
        for file in sorted(folder.glob(f"set_{name}_*.json")):
            outcome = json.loads(file.read_text(encoding="utf-8"))
            runs[outcome["metapackage"]] = outcome
    if not runs:
        raise MatrixError(f"no complete run in {folder}; run `make hil` or `make hil-full` first")
    return dict(sorted(runs.items()))


def load_tests(files):
    """(test, passed) of ctest's JUnit files, without the tests that did not run."""
    tests = []
    for file in files:
        for case in ET.parse(file).getroot().iter("testcase"):
            if case.get("status") in ("run", "fail"):
                tests.append((case.get("name"), case.get("status") == "run"))
    return sorted(tests)


def device_of(test):
    return next(device for word, device in DEVICE_WORDS if word in test.lower())


def mark(passed, failed):
    return "–" if passed + failed == 0 else f"{passed}" if failed == 0 else f"{passed}, **{failed} failed**"


def kernel_name(run):
    return f"Linux {run['kernel'].split()[0]}"


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return lines + ["| " + " | ".join(row) + " |" for row in rows]


def counts(results, device, host):
    chosen = [result["status"] == "passed" for result in results
              if device in result["devices"] and host in result["hosts"]]
    return mark(sum(chosen), len(chosen) - sum(chosen))


def page(runs, tests):
    devices = sorted({device for run in runs.values() for result in run["scenarios"].values()
                      for device in result["devices"]} | {device_of(name) for name, _ in tests})
    lines = [
        "# Coverage",
        "",
        "`make hil-matrix` writes this page from the results of the last complete runs; do not edit it.",
        "[hil.md](hil.md) says what each scenario checks.",
        "",
        *table(["run", "date", "set", "scenarios passed", "time"],
               [[kernel_name(run), run["date"], run["set"],
                 f"{sum(r['status'] == 'passed' for r in run['scenarios'].values())} of "
                 f"{len(run['scenarios'])}", f"{run['wall_seconds']:.0f} s"]
                for run in runs.values()]),
        "",
        "## Hosts and devices",
        "",
        "The number of scenarios that passed. One scenario can use several devices and hosts.",
        "",
    ]
    rows = []
    for run in runs.values():
        results = run["scenarios"].values()
        for host, words in HOSTS.items():
            row = [counts(results, device, host) for device in devices]
            if any(cell != "–" for cell in row):
                rows.append([f"{kernel_name(run)}, {words}", *row])
    if tests:
        row = []
        for device in devices:
            chosen = [passed for name, passed in tests if device_of(name) == device]
            row.append(mark(sum(chosen), len(chosen) - sum(chosen)))
        rows.append([USER_SPACE, *row])
    lines += table(["host", *devices], rows)

    lines += ["", "## Scenarios on a kernel", ""]
    names = sorted({name for run in runs.values() for name in run["scenarios"]})
    rows = []
    for name in names:
        seen = [run["scenarios"].get(name) for run in runs.values()]
        known = [result for result in seen if result]
        rows.append([
            f"`{name}`",
            ", ".join(sorted({device for result in known for device in result["devices"]})) or "–",
            ", ".join(sorted({host for result in known for host in result["hosts"]})) or "–",
            *("–" if result is None else f"{result.get('seconds', 0):.0f} s"
              if result["status"] == "passed" else f"**{result['status']}**" for result in seen)])
    lines += table(["scenario", "devices", "hosts", *(kernel_name(run) for run in runs.values())], rows)

    if tests:
        suites = {}
        for name, passed in tests:
            suites.setdefault((name.split(".")[0], device_of(name)), []).append(passed)
        lines += ["", "## Tests without a kernel", ""]
        lines += table(["suite", "device", "tests passed"],
                       [[f"`{suite}`", device, mark(sum(passed), len(passed) - sum(passed))]
                        for (suite, device), passed in suites.items()])
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--results", type=pathlib.Path, default=ROOT / "build/hil/results")
    parser.add_argument("--junit", type=pathlib.Path, action="append", default=[],
                        help="a file that `ctest --output-junit` wrote; may be repeated")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "docs/hil_matrix.md")
    arguments = parser.parse_args()
    try:
        for file in arguments.junit:
            if not file.is_file():
                raise MatrixError(f"{file}: no such file; run `ctest --output-junit {file}` first")
        text = page(load_runs(arguments.results), load_tests(arguments.junit))
    except MatrixError as error:
        print(f"matrix: {error}", file=sys.stderr)
        return 2
    arguments.out.write_text(text, encoding="utf-8")
    print(f"Wrote {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
