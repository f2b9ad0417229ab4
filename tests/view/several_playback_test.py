#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid view with the recordings of two devices of one run, in a browser and as a file.
usage: several_playback_test.py FORCEGRID [FOLDER]  pictures go to FOLDER; ends with 77 where
                                                    Chromium, selenium or h5py is missing"""
import pathlib
import shutil
import sys
import unittest

import playback_test
from playback_test import (CHROMIUM, DRIVER, BrowserCase, Recording, Viewer, h5py, numpy, run,
                           webdriver)
from live_view_test import SURFACE_OF_SMALL, wait_until
from layout_checks import CONTRAST, OVERLAPS

if webdriver:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import Select

FOLDER = None
ARM = "emulated:woodenhaptics_v2015"
SECONDS = 4
# An exported file has a place of the other tool every 16 ms, so it may lag by as much.
LAG_S = 0.020


class Clock:
    """Both recordings on the clock of the machine: time zero is the earlier first cycle."""

    def __init__(self, files):
        starts_s = []
        for file in files:
            with h5py.File(file, "r") as data:
                starts_s.append(1e-9 * int(data.attrs["start_monotonic_ns"])
                                + data["cycles/time_s"][0])
        self.tools = [Recording(file) for file in files]
        for tool, start_s in zip(self.tools, starts_s):
            tool.time_s = tool.time_s + start_s - min(starts_s)

    def position_mm(self, tool, time_s):
        recording = self.tools[tool]
        return recording.position_mm[recording.cycle_at(time_s)]

    def in_contact(self, tool, time_s):
        recording = self.tools[tool]
        return bool(recording.in_contact[recording.cycle_at(time_s)])

    def largest_move_mm(self, tool, from_s, to_s):
        """Between any of its cycles of that time and the last of them."""
        recording = self.tools[tool]
        cycles = slice(recording.cycle_at(from_s), recording.cycle_at(to_s) + 1)
        there = recording.position_mm[cycles]
        return float(abs(there - there[-1]).max())


class SeveralTools(BrowserCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        playback_test.record(cls.path / "run.h5", cls.path / "out", SECONDS, "--record-surface",
                             "--device", ARM, "--device", ARM)
        cls.files = [cls.path / f"run_device_{number}.h5" for number in (1, 2)]
        cls.clock = Clock(cls.files)

    def tearDown(self):
        self.assertEqual(self.console_errors("WebSocket connection"), [], "the browser's console")

    def other(self):
        others = self.view("other_tools")
        return others[0] if len(others) == 1 and others[0]["position_W_m"] else None

    def open(self, address, lines=()):
        self.browser.get(address)
        wait_until(lambda: self.script("return document.body.dataset.state") == "live",
                   "a live page", lines)
        wait_until(lambda: self.other(), "the other tool", lines)
        self.assertEqual(self.view("vertices"), SURFACE_OF_SMALL)
        if self.view("playback")["state"] == "playing":
            self.browser.find_element(By.ID, "play").click()
        wait_until(lambda: self.view("playback")["state"] == "paused", "a pause", lines)

    def seek(self, time_s):
        self.script("const one = document.getElementById('play-time'); one.value = arguments[0];"
                    "one.dispatchEvent(new Event('input'))", time_s)
        wait_until(lambda: self.view("playback")["state"] == "paused" and
                   abs(self.view("playback")["time_s"] - time_s) < 1e-3 and
                   abs(self.view("time_s") - time_s) < 0.03, f"the time {time_s}")

    def choose(self, tool):
        Select(self.browser.find_element(By.ID, "tool")).select_by_value(str(tool))
        wait_until(lambda: self.view("tool") == tool and self.view("rows") > 2 and self.other()
                   and self.view("playback")["state"] == "paused", f"tool {tool}")

    def check_both_are_at(self, time_s, lag_s=0.0):
        """Each where its own recording says, by the one clock."""
        shown = self.view("tool")
        wait_until(lambda: self.other()["tool"] == 1 - shown, "the other tool")
        def differences_mm():
            places_mm = {shown: self.view("position_mm"),
                         1 - shown: [1e3 * value for value in self.other()["position_W_m"]]}
            return {tool: max(abs(place_mm - self.clock.position_mm(tool, time_s)))
                    for tool, place_mm in places_mm.items()}
        # A row of the scope may have begun before this cycle, and ends with it.
        most_mm = {tool: 1e-3 + self.clock.largest_move_mm(tool, time_s - 0.01 - lag_s,
                                                           time_s + 0.004) for tool in (0, 1)}
        try:
            wait_until(lambda: all(differences_mm()[tool] <= most_mm[tool] for tool in (0, 1)) and
                       self.other()["in_contact"] == self.clock.in_contact(1 - shown, time_s),
                       f"both at their places of {time_s} s")
        except AssertionError as error:
            raise AssertionError(f"{error}: off by {differences_mm()} mm, may be {most_mm}; "
                                 f"{self.other()}") from None

    def check_page(self, lag_s=0.0):
        touched_s = round(max(tool.touched_s() for tool in self.clock.tools), 2)
        for time_s in (touched_s, 1.0, touched_s):
            self.seek(time_s)
            self.check_both_are_at(time_s, lag_s)
        self.assertEqual(self.view("tool"), 0)
        self.assertGreater(self.other()["links"], 0, "its arm")
        rows = self.view("rows")
        self.choose(1)
        # What led there is shown of the tool that was chosen, too.
        wait_until(lambda: self.view("rows") > rows / 2, "the scope's past")
        self.assertAlmostEqual(self.view("playback")["time_s"], touched_s, delta=0.01)
        self.check_both_are_at(touched_s, lag_s)
        self.assertEqual(self.view("vertices"), SURFACE_OF_SMALL)
        self.script("document.getElementById('layers').open = true; const list ="
                    "document.getElementById('field-method'); list.value = '0';"
                    "list.dispatchEvent(new Event('change'))")
        wait_until(lambda: self.view("field")["shown"], "a slice of its field")
        self.script("document.getElementById('layers').open = false")
        self.seek(1.5)
        self.check_both_are_at(1.5, lag_s)
        self.choose(0)
        self.check_both_are_at(1.5, lag_s)
        self.seek(touched_s)
        self.check_both_are_at(touched_s, lag_s)

    def take(self, name):
        for theme in ("light", "dark"):
            self.script("document.documentElement.dataset.theme === arguments[0] ||"
                        "document.getElementById('theme').click()", theme)
            self.script("return new Promise((done) => setTimeout(done, 600))")
            self.assertEqual(self.script(CONTRAST)["poor"], [], theme)
            self.assertEqual(self.script(OVERLAPS)["found"], [], theme)
            if FOLDER:
                FOLDER.mkdir(parents=True, exist_ok=True)
                self.browser.save_screenshot(str(FOLDER / f"{name}_{theme}.png"))

    def test_one_page_plays_both_on_one_clock(self):
        viewer = Viewer(self.files[1], self.files[0])  # in any order
        try:
            self.open(viewer.url, viewer.lines)
            self.assertEqual([option.text for option in Select(
                self.browser.find_element(By.ID, "tool")).options],
                ["1: woodenhaptics_v2015", "2: woodenhaptics_v2015"])
            self.check_page()
            self.take("several_playback")
            before_mm = self.other()["position_W_m"]
            self.seek(0.2)
            self.browser.find_element(By.ID, "play").click()
            wait_until(lambda: self.view("time_s") > 0.6 and
                       self.other()["position_W_m"] != before_mm, "both play on", viewer.lines)
        finally:
            viewer.close()

    def test_one_file_has_both(self):
        page = self.path / "run.html"
        done = run("view", *self.files, "--export", page)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.open(page.as_uri())
        self.check_page(LAG_S)
        self.take("several_export")
        self.assertEqual(self.view("broken_messages"), 0)

    def test_recordings_of_different_runs_are_refused(self):
        other = self.path / "other.h5"
        shutil.copy(self.files[1], other)
        with h5py.File(self.files[0], "r") as first, h5py.File(other, "r+") as data:
            # The first one's clock: both start times are of whole seconds, each its own.
            data.attrs["started_utc"] = first.attrs["started_utc"]
            data.attrs["start_monotonic_ns"] = numpy.bytes_(
                str(int(first.attrs["start_monotonic_ns"]) + 3_600_000_000_000))
        done = run("view", self.files[0], other)
        self.assertEqual(done.returncode, 1, done.stderr)
        for part in ("run_device_1.h5", "other.h5", "not of one run",
                     "their clocks began 3600 s apart"):
            self.assertIn(part, done.stderr)
        self.assertNotIn("view: http", done.stderr)


if __name__ == "__main__":
    playback_test.FORCEGRID = sys.argv.pop(1)
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        FOLDER = pathlib.Path(sys.argv.pop(1))
    if None in (webdriver, CHROMIUM, DRIVER, h5py):
        print("Chromium, its driver, selenium or h5py is missing: setup/install.sh browser tests")
        sys.exit(77)
    unittest.main(verbosity=2)
