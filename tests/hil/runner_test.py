#!/usr/bin/env python3
"""Tests of the runner itself: what must fail does fail, and says why."""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
PROGRAM = os.environ.get("HIL_PROGRAM", str(ROOT / "build/release/bin/forcegrid"))
SCENARIOS = os.environ.get("HIL_SCENARIOS", str(ROOT / "build/release/tests/hil_scenarios"))
CACHE = os.environ.get("HIL_CACHE", str(ROOT / "build/hil"))
SOUND = "Refusal.TheOlderW1FirmwareIsNamedAndGetsNoCommand"


class Runner(unittest.TestCase):
    """Runs run_guest.py into a results folder of its own."""

    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.temporary.name)

    def tearDown(self):
        self.temporary.cleanup()

    def run_guest(self, *arguments, cache=CACHE, path=None, **environment):
        variables = {**os.environ, **environment}
        if path is not None:
            variables["PATH"] = f"{path}:{variables['PATH']}"
        return subprocess.run(
            [sys.executable, HERE / "run_guest.py", "--program", PROGRAM, "--scenarios", SCENARIOS,
             "--cache", cache, "--results", self.folder / "results", *arguments],
            capture_output=True, text=True, check=False, env=variables)

    def results(self):
        text = (self.folder / "results/results.json").read_text(encoding="utf-8")
        return json.loads(text)

    def test_a_scenario_that_fails_or_hangs_in_the_guest_fails_on_the_host(self):
        failing = "MadeToFail.AnExpectationThatDoesNotHold"
        hanging = "MadeToFail.ItNeverEnds"
        done = self.run_guest("--limit", "20", "--only", failing, "--only", hanging, "--only", SOUND)
        self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
        scenarios = self.results()["scenarios"]
        self.assertEqual(scenarios[failing]["status"], "failed")
        self.assertEqual(scenarios[hanging]["status"], "timed out")
        self.assertEqual(scenarios[SOUND]["status"], "passed")
        self.assertIn("no such kernel", done.stdout)
        self.assertIn("1 of 3 scenarios passed", done.stdout)

    def test_a_guest_that_ends_early_is_a_failure_though_nothing_has_failed(self):
        ending = "MadeToFail.TheGuestEndsTooEarly"
        done = self.run_guest("--only", ending, "--only", SOUND)
        self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
        self.assertIn("the guest stopped before its end", done.stdout)
        scenarios = self.results()["scenarios"]
        self.assertEqual(scenarios[ending]["status"], "unfinished")
        self.assertEqual(scenarios[SOUND]["status"], "missing")

    def test_a_guest_that_takes_too_long_is_stopped(self):
        done = self.run_guest("--timeout", "1", "--only", SOUND)
        self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
        self.assertIn("did not end within 1 s and was stopped", done.stdout)
        self.assertEqual(self.results()["scenarios"][SOUND]["status"], "missing")

    def test_a_kernel_that_cannot_be_fetched_is_a_failure_with_a_remedy(self):
        for name in ("apt-get", "apt-cache"):
            program = self.folder / "bin" / name
            program.parent.mkdir(exist_ok=True)
            program.write_text("#!/bin/sh\necho 'E: Unable to locate package' >&2\nexit 100\n",
                               encoding="ascii")
            program.chmod(0o755)
        done = self.run_guest("--only", SOUND, cache=self.folder / "cache", path=self.folder / "bin",
                              FORCEGRID_HIL_KERNEL_DEB="")
        self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
        self.assertIn("can't be fetched", done.stderr)
        self.assertIn("E: Unable to locate package", done.stderr)
        self.assertIn("Remedy: ", done.stderr)

    def test_wrong_words_are_named(self):
        for arguments, variables, words in (
                (["--only", "No.Such"], {}, "no scenario No.Such"),
                (["--only", SOUND], {"ACCEL": "hvf"}, "ACCEL=hvf: it is tcg (the default) or kvm"),
                (["--only", SOUND], {"FORCEGRID_HIL_KERNEL_DEB": "nowhere.deb"},
                 "FORCEGRID_HIL_KERNEL_DEB=nowhere.deb: no such file")):
            done = self.run_guest(*arguments, **variables)
            self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
            self.assertIn(words, done.stderr)


class MakeTargets(unittest.TestCase):
    """What the Makefile makes of its words."""

    def make(self, *arguments):
        # Under `make test` the outer make's flags would be the inner one's, too.
        variables = {key: value for key, value in os.environ.items() if not key.startswith("MAKE")}
        return subprocess.run(["make", "-C", ROOT, *arguments], capture_output=True, text=True,
                              check=False, env=variables)

    def test_shell_on_the_command_line_asks_for_a_shell_in_the_guest(self):
        done = self.make("-n", "hil", "SHELL=1")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("run_guest.py --kernel linux-image-amd64 --shell", done.stdout)
        self.assertNotIn("--shell", self.make("-n", "hil").stdout)

    def test_the_rule_is_installed_and_uninstalled(self):
        with tempfile.TemporaryDirectory() as root:
            installed = pathlib.Path(root) / "etc/udev/rules.d/70-forcegrid.rules"
            done = self.make("install-udev", f"DESTDIR={root}")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(installed.read_bytes(),
                             (ROOT / "udev/70-forcegrid.rules").read_bytes())
            self.assertEqual(installed.stat().st_mode & 0o777, 0o644)
            done = self.make("uninstall-udev", f"DESTDIR={root}")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertFalse(installed.exists())


if __name__ == "__main__":
    unittest.main()
