#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The example of another finite-element package behind the link, felt by an emulated arm.
usage: getfem_simulator_test.py FORCEGRID      ends with 77 where GetFEM or SciPy is missing"""
import importlib.util
import json
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import unittest

EXAMPLE = pathlib.Path(__file__).resolve().parents[2] / "examples/getfem_simulator.py"
FORCEGRID = ""
SAYS = r"([\d.]+) answers/s, within ([\d.e+-]+) % RMS of the converged force at (\d+) of (\d+) "


class GetFemSimulator(unittest.TestCase):
    def start(self, *arguments):
        simulator = subprocess.Popen([sys.executable, EXAMPLE, *arguments], text=True,
                                     stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.addCleanup(simulator.stderr.close)
        self.addCleanup(simulator.stdout.close)
        self.addCleanup(simulator.wait)
        self.addCleanup(simulator.kill)
        return simulator

    def test_is_felt_and_tells_how_far_it_was_from_its_converged_self(self):
        simulator = self.start("0")
        address = simulator.stdout.readline().split()[-1]
        with tempfile.TemporaryDirectory() as out:
            run = subprocess.run(
                [FORCEGRID, "--no-config", "run", "--simulator", address, "--seconds", "8",
                 "--device-timeout-ms", "450", "--out", out, "--json"],
                capture_output=True, text=True, timeout=60)
        self.assertEqual(run.returncode, 0, run.stderr)
        summary = json.loads(run.stdout)
        self.assertEqual(summary["faults"], [])
        self.assertEqual(summary["samples_rejected"], 0)
        self.assertGreater(summary["samples_received"], 20)
        # 250 N/m over up to 20 mm.
        self.assertGreater(max(summary["emulator"]["max_abs_current_mA"]), 50.0)
        said = simulator.stdout.readline()
        print(said, end="")
        found = re.match(SAYS, said)
        self.assertTrue(found, said)
        self.assertLess(float(found[2]), 0.5)
        simulator.send_signal(signal.SIGINT)
        self.assertEqual(simulator.wait(10), 0)
        self.assertEqual(simulator.stderr.read(), "")

    def test_says_how_it_is_used(self):
        simulator = self.start("here")
        self.assertNotEqual(simulator.wait(60), 0)
        self.assertIn("usage: getfem_simulator.py PORT", simulator.stderr.read())


if __name__ == "__main__":
    FORCEGRID = sys.argv.pop(1)
    for package in ("getfem", "scipy"):
        if importlib.util.find_spec(package) is None:
            print(f"skipped: there is no {package}; setup/install.sh fem installs it")
            sys.exit(77)
    unittest.main(verbosity=2)
