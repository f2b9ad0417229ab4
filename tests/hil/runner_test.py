#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of the runner itself: what must fail does fail, and says why."""

import contextlib
import io
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import run_guest

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
        done = self.run_guest("--guests", "1", "--only", ending, "--only", SOUND)
        self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
        self.assertIn("the guest stopped before its end", done.stdout)
        scenarios = self.results()["scenarios"]
        self.assertEqual(scenarios[ending]["status"], "unfinished")
        self.assertEqual(scenarios[SOUND]["status"], "missing")

    def test_a_fault_of_the_guests_kernel_is_a_failure_though_nothing_has_failed(self):
        complaining = "MadeToFail.TheKernelReportsAFaultOfItsOwn"
        done = self.run_guest("--only", complaining)
        self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
        self.assertIn("the guest's kernel reported a fault of its own: BUG: made to fail", done.stdout)
        self.assertEqual(self.results()["scenarios"][complaining]["status"], "passed")

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
                (["--only", SOUND], {"CLOCK": "sun"}, "CLOCK=sun: it is instructions (the default)"),
                (["--only", SOUND], {"FORCEGRID_HIL_KERNEL_DEB": "nowhere.deb"},
                 "FORCEGRID_HIL_KERNEL_DEB=nowhere.deb: no such file")):
            done = self.run_guest(*arguments, **variables)
            self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
            self.assertIn(words, done.stderr)


    def test_a_command_meets_its_devices_with_programs_of_its_own(self):
        # A program with a library beside it, which it finds by its own place below /tmp, and a script.
        own = self.folder / "own"
        own.mkdir()
        (own / "answer.c").write_text("int answer(void) { return 42; }\n", encoding="ascii")
        (own / "ask.c").write_text("int answer(void); int printf(const char*, ...);\n"
                                   'int main(void) { printf("it is %d\\n", answer()); return 0; }\n',
                                   encoding="ascii")
        subprocess.run(["gcc", "-shared", "-fPIC", "-o", own / "libanswer.so", own / "answer.c"],
                       check=True)
        subprocess.run(["gcc", "-o", own / "ask", own / "ask.c", f"-L{own}", "-lanswer",
                        "-Wl,-rpath,$ORIGIN"], check=True)
        script = own / "count"
        script.write_text("#!/bin/sh\necho nodes $(ls /dev/hidraw* | wc -l)\n", encoding="ascii")
        script.chmod(0o755)
        done = self.run_guest(
            "--device", "woodenhaptics_v2015", "woodenhaptics_teensy", "--emulator-flags=--calibrated",
            "--add", own / "ask", script, "--run",
            "ask && count && forcegrid devices && exit 7")
        self.assertEqual(done.returncode, 7, done.stdout + done.stderr)
        self.assertIn("it is 42", done.stdout)
        self.assertIn("nodes 3", done.stdout)
        self.assertIn("16c0:0486  ready", done.stdout)
        reports = json.loads((self.folder / "results/emulator.json").read_text(encoding="utf-8"))
        self.assertEqual([report["busid"] for report in reports], ["1-1", "2-1"])
        self.assertEqual([report["device"] for report in reports],
                         ["woodenhaptics_v2015", "woodenhaptics_teensy"])

    def test_what_a_session_cannot_have_is_refused_before_the_guest_starts(self):
        for arguments, words in (
                (["--run", "true", "--device", "woodenhaptic"],
                 "--device woodenhaptic: neither a file nor one of: emulated_6dof, falcon, "),
                (["--run", "true", "--add", "/no/such/program"],
                 "--add /no/such/program: no such file"),
                (["--add", "/bin/true"], "--device, --emulator-flags and --add go with --shell")):
            done = self.run_guest(*arguments)
            self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
            self.assertIn(words, done.stderr)


class Results(unittest.TestCase):
    """What the runner makes of the guest's words, without a guest."""

    def outcome(self, metapackage, kernel, first_us):
        measured = {f"{name}_{part}": {"value": first_us + i, "unit": "us"}
                    for _, name in run_guest.TIMING_ROWS for i, part in enumerate(run_guest.PARTS)}
        return {"metapackage": metapackage, "kernel": kernel, "date": "2026-01-02", "set": "smoke",
                "machine": "instructions",
                "scenarios": {run_guest.TIMING: {"status": "passed", "measured": measured}}}

    def test_a_set_has_what_its_kernel_can_show(self):
        names = ["A.One", "LongA.Two", "PreemptRtA.Three", "MadeToFail.Four"]
        for wanted, kernel, expected in (("smoke", "linux-image-amd64", ["A.One"]),
                                         ("full", "linux-image-amd64", ["A.One", "LongA.Two"]),
                                         ("smoke", "linux-image-rt-amd64", ["A.One", "PreemptRtA.Three"])):
            self.assertEqual(run_guest.chosen(names, wanted, None, kernel), expected)
        only = ["PreemptRtA.Three"]
        self.assertEqual(run_guest.chosen(names, "smoke", only, "linux-image-amd64"), only)

    def test_devices_hosts_and_measures_belong_to_the_scenario_that_said_them(self):
        results, ended = run_guest.read_results(
            "HIL-BEGIN A.One 1.0\nHIL-DEVICE arm\nHIL-HOST kernel\nHIL-DEVICE arm\n"
            "HIL-MEASURED x 3 us\nHIL-END A.One 0 2.5\nHIL-HOST hidraw\n"
            "HIL-BEGIN A.Two 3.0\nHIL-END A.Two 1 4.0\nHIL-DONE 5.0\n", ["A.One", "A.Two"])
        self.assertTrue(ended)
        self.assertEqual(results["A.One"]["devices"], ["arm"])
        self.assertEqual(results["A.One"]["hosts"], ["kernel"])
        self.assertEqual(results["A.One"]["measured"], {"x": {"value": 3.0, "unit": "us"}})
        self.assertEqual(results["A.One"]["seconds"], 1.5)
        self.assertEqual(results["A.Two"]["status"], "failed")
        self.assertEqual(results["A.Two"]["devices"], [])

    def test_the_table_of_timings_keeps_one_boot_of_each_kernel(self):
        with tempfile.TemporaryDirectory() as temporary:
            folder = pathlib.Path(temporary)
            said = io.StringIO()
            with contextlib.redirect_stdout(said):
                run_guest.keep_timing(self.outcome("linux-image-amd64", "6.1-amd64 #1", 7), folder)
                run_guest.keep_timing(self.outcome("linux-image-rt-amd64", "6.1-rt #1", 40), folder)
                run_guest.keep_timing(self.outcome("linux-image-amd64", "6.1-amd64 #1", 100), folder)
            self.assertIn("wake-up p50/p99/max cyclictest 100/101/103 us", said.getvalue())
            text = (folder / "timing.txt").read_text(encoding="utf-8")
            self.assertEqual([line.split()[-4:] for line in text.splitlines() if "cyclictest" in line],
                             [["100", "101", "102", "103"], ["40", "41", "42", "43"]])

    def test_no_timing_is_kept_of_a_boot_in_which_its_scenario_failed(self):
        with tempfile.TemporaryDirectory() as temporary:
            outcome = self.outcome("linux-image-amd64", "6.1-amd64 #1", 7)
            outcome["scenarios"][run_guest.TIMING]["status"] = "failed"
            run_guest.keep_timing(outcome, pathlib.Path(temporary))
            self.assertEqual(list(pathlib.Path(temporary).iterdir()), [])

    def test_results_are_kept_by_set_and_kernel_when_the_set_was_complete(self):
        with tempfile.TemporaryDirectory() as temporary:
            run, kept = pathlib.Path(temporary) / "run", pathlib.Path(temporary) / "kept"
            run.mkdir()
            kept.mkdir()
            run_guest.keep_results(self.outcome("linux-image-amd64", "6.1 #1", 7), run, kept, False)
            self.assertEqual([file.name for file in kept.iterdir()], ["results.json"])
            run_guest.keep_results(self.outcome("linux-image-amd64", "6.1 #1", 7), run, kept, True)
            self.assertEqual(sorted(file.name for file in kept.iterdir()),
                             ["results.json", "set_smoke_linux-image-amd64.json"])


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

    def test_devices_flags_and_programs_go_into_the_guest(self):
        done = self.make("-n", "hil", "SHELL=1", "DEVICE=falcon woodenhaptics_teensy",
                         "ARGS=--firmware-loaded", "ADD=/bin/true lib/")
        self.assertIn("--shell --device falcon woodenhaptics_teensy "
                      "--emulator-flags='--firmware-loaded' --add /bin/true lib/", done.stdout)
        done = self.make("-n", "hil", "COMMAND=echo 'two words'")
        self.assertIn(r"--run 'echo '\''two words'\''' --device woodenhaptics_v2015", done.stdout)

    def test_the_kernel_is_the_stock_one_or_rt_and_nothing_else(self):
        self.assertIn("--kernel linux-image-rt-amd64", self.make("-n", "hil", "KERNEL=rt").stdout)
        self.assertIn("--kernel linux-image-amd64", self.make("-n", "hil-full").stdout)
        wrong = self.make("-n", "hil", "KERNEL=fast")
        self.assertNotEqual(wrong.returncode, 0)
        self.assertIn("KERNEL=fast: it is rt", wrong.stderr)

    def test_the_rule_is_installed_and_uninstalled(self):
        with tempfile.TemporaryDirectory() as root:
            installed = pathlib.Path(root) / "etc/udev/rules.d/10-forcegrid.rules"
            done = self.make("install-udev", f"DESTDIR={root}")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(installed.read_bytes(),
                             (ROOT / "udev/10-forcegrid.rules").read_bytes())
            self.assertEqual(installed.stat().st_mode & 0o777, 0o644)
            done = self.make("uninstall-udev", f"DESTDIR={root}")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertFalse(installed.exists())


if __name__ == "__main__":
    unittest.main()
