#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of the coverage page: it says what the results say."""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent


def scenario(status, devices, hosts):
    return {"status": status, "devices": devices, "hosts": hosts, "measured": {}, "log": "",
            "seconds": 4.2}


def run(metapackage, kernel, which, scenarios):
    return {"kernel": kernel, "metapackage": metapackage, "set": which, "date": "2026-01-02",
            "wall_seconds": 100.4, "scenarios": scenarios}


class Matrix(unittest.TestCase):
    """Runs matrix.py on results made for the test."""

    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.temporary.name)
        self.out = self.folder / "matrix.md"

    def tearDown(self):
        self.temporary.cleanup()

    def add(self, outcome):
        file = self.folder / f"set_{outcome['set']}_{outcome['metapackage']}.json"
        file.write_text(json.dumps(outcome), encoding="utf-8")

    def write(self, *arguments):
        done = subprocess.run(
            [sys.executable, HERE / "matrix.py", "--results", self.folder, "--out", self.out,
             *arguments], capture_output=True, text=True, check=False)
        return done, self.out.read_text(encoding="utf-8") if self.out.exists() else ""

    def rows(self, text, start):
        return [[cell.strip() for cell in line.strip("|").split("|")]
                for line in text.splitlines() if line.startswith("| " + start)]

    def test_counts_scenarios_by_host_and_device_and_names_failures(self):
        self.add(run("linux-image-amd64", "6.1.0-9-amd64 #1", "full", {
            "A.One": scenario("passed", ["arm"], ["kernel", "forcegrid-hidraw"]),
            "A.Two": scenario("failed", ["arm"], ["forcegrid-hidraw"]),
            "B.Three": scenario("passed", ["arm", "ball"], ["hidapi-libusb"]),
        }))
        done, text = self.write()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("| Linux 6.1.0-9-amd64 | 2026-01-02 | full | 2 of 3 | 100 s |", text)
        self.assertEqual(self.rows(text, "host"), [["host", "arm", "ball"]])
        self.assertEqual(self.rows(text, "Linux 6.1.0-9-amd64, "), [
            ["Linux 6.1.0-9-amd64, kernel: enumeration, usbhid, udev", "1", "–"],
            ["Linux 6.1.0-9-amd64, this program on hidraw", "1, **1 failed**", "–"],
            ["Linux 6.1.0-9-amd64, independent client: hidapi on libusb", "1", "1"]])
        self.assertEqual(self.rows(text, "`A.Two`"), [["`A.Two`", "arm", "forcegrid-hidraw",
                                                       "**failed**"]])
        self.assertEqual(self.rows(text, "`B.Three`"), [["`B.Three`", "arm, ball", "hidapi-libusb",
                                                         "4 s"]])

    def test_the_full_set_outweighs_the_smoke_set_and_a_kernel_without_a_scenario_has_no_mark(self):
        passed = scenario("passed", ["arm"], ["kernel"])
        self.add(run("linux-image-amd64", "6.1.0-9-amd64 #1", "smoke", {"A.Old": passed}))
        self.add(run("linux-image-amd64", "6.1.0-9-amd64 #1", "full", {"A.One": passed,
                                                                      "A.Two": passed}))
        self.add(run("linux-image-rt-amd64", "6.1.0-9-rt-amd64 #1", "smoke", {"A.One": passed}))
        _, text = self.write()
        self.assertNotIn("A.Old", text)
        self.assertEqual(self.rows(text, "`A.One`"), [["`A.One`", "arm", "kernel", "4 s", "4 s"]])
        self.assertEqual(self.rows(text, "`A.Two`"), [["`A.Two`", "arm", "kernel", "4 s", "–"]])

    def test_tests_without_a_kernel_come_from_junit_by_the_device_in_their_names(self):
        self.add(run("linux-image-amd64", "6.1.0-9-amd64 #1", "smoke",
                     {"A.One": scenario("passed", ["arm"], ["kernel"])}))
        junit = self.folder / "junit.xml"
        junit.write_text(
            '<testsuite><testcase name="FalconJob.Runs" status="run"/>'
            '<testcase name="W3.CarriesReports" status="run"/>'
            '<testcase name="W2.Opens" status="run"/><testcase name="W2.Ends" status="fail"/>'
            '<testcase name="W2.Never" status="notrun"/></testsuite>', encoding="utf-8")
        done, text = self.write("--junit", junit)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.rows(text, "host"),
                         [["host", "arm", "falcon", "woodenhaptics_teensy", "woodenhaptics_v2015"]])
        self.assertEqual(self.rows(text, "user space"), [[
            "user space: this program's USB/IP client, no kernel", "–", "1", "1",
            "1, **1 failed**"]])
        self.assertEqual(self.rows(text, "`W2`"), [["`W2`", "woodenhaptics_v2015",
                                                    "1, **1 failed**"]])

    def test_no_results_is_an_error_with_a_remedy(self):
        done, text = self.write()
        self.assertEqual(done.returncode, 2)
        self.assertIn("no complete run in", done.stderr)
        self.assertIn("make hil", done.stderr)
        self.assertEqual(text, "")
        self.add(run("linux-image-amd64", "6.1.0-9-amd64 #1", "smoke", {}))
        done, _ = self.write("--junit", self.folder / "nowhere.xml")
        self.assertEqual(done.returncode, 2)
        self.assertIn("nowhere.xml: no such file", done.stderr)


if __name__ == "__main__":
    unittest.main()
