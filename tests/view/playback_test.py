#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid view: a recording in a browser, the same as a file, and what is no recording.
usage: playback_test.py FORCEGRID          ends with 77 where Chromium, selenium or h5py is missing
FORCEGRID_RECORDING names a recording to show in place of a new one, 4 s of the scene `small` with its
surface; FORCEGRID_SCREENSHOTS a folder for pictures of the page."""
import math
import os
import pathlib
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import unittest
import urllib.request

import peers

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "page"))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from live_view_test import PATIENCE_S, SURFACE_OF_SMALL, wait_until
from browser import CHROMIUM, DRIVER, BrowserCase, webdriver

try:
    import h5py
    import numpy
except ImportError:
    h5py = None
if webdriver:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

FORCEGRID = ""
SECONDS = 4
METHODS = ("auto", "forcegrid", "hold")
SCREENSHOTS = os.environ.get("FORCEGRID_SCREENSHOTS", "")
# What a recording has got since there is a view of it.
NEW_COLUMNS = ("touching_W_m", "rendered_method", "damping_gain", "held_back", "arrivals_taken",
               "motor_warmth", "requests_per_s", "budget_reads")


def run(*words, **options):
    return subprocess.run([FORCEGRID, "--no-config", *map(str, words)], capture_output=True,
                          text=True, timeout=120, **options)


def record(file, out, seconds, *more):
    """Records a run. A machine that stalls may end it with a fault: then another one."""
    if os.environ.get("FORCEGRID_RECORDING"):
        shutil.copy(os.environ["FORCEGRID_RECORDING"], file)
        return
    for attempt in range(5):
        made = run("record", file, "--scene", "small", "--seconds", seconds, "--no-reference",
                   "--out", out, "--device-timeout-ms", 450, "--no-motor-check", *more)
        if made.returncode == 0:
            return
        print(f"attempt {attempt} at a recording:", made.stdout, made.stderr)
    raise AssertionError("no run of five could be recorded")


class Viewer:
    """forcegrid view FILE, and what it says on standard error."""

    def __init__(self, file, *options):
        self.process = subprocess.Popen([FORCEGRID, "--no-config", "view", str(file), *options],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.lines = []
        self.reader = threading.Thread(target=self.read)
        self.reader.start()
        self.url = wait_until(self.find_url, "the view's address", self.lines)

    def find_url(self):
        found = [re.fullmatch(r"view: (https?://127\.0\.0\.1:\d+/\?token=\w{32,})", line)
                 for line in list(self.lines)]
        return next((one[1] for one in found if one), None)

    def read(self):
        for line in self.process.stderr:
            self.lines.append(line.rstrip("\n"))

    def close(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        status = self.process.wait(PATIENCE_S)
        self.reader.join(PATIENCE_S)
        self.process.stderr.close()
        return status


class Recording:
    """What h5py reads of a file: the truth that the page is held against."""

    def __init__(self, file):
        with h5py.File(file, "r") as data:
            self.time_s = data["cycles/time_s"][:]
            self.time_s = self.time_s - self.time_s[0]
            self.position_mm = 1e3 * data["cycles/position_W_m"][:]
            self.force_N = data["cycles/sent_force_D_N"][:]
            self.method_N = data["cycles/asked_force_W_N"][:]
            self.in_contact = data["cycles/in_contact"][:]

    def cycle_at(self, time_s):
        """The first cycle at or after a time."""
        return min(int(numpy.searchsorted(self.time_s, time_s - 1e-9)), len(self.time_s) - 1)

    def touched_s(self):
        """A time in the longest touch, when the force is largest."""
        norm = numpy.linalg.norm(self.force_N, axis=1)
        return float(self.time_s[int(numpy.argmax(norm))])


def make_old(new, old):
    """The recording as an older program would have written it: without what came since."""
    shutil.copy(new, old)
    with h5py.File(old, "r+") as data:
        for name in NEW_COLUMNS:
            del data["cycles"][name]
        if "surface" in data:
            del data["surface"]
        del data.attrs["view_hello"]
        del data.attrs["names_held_back"]


class Page(BrowserCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.new = cls.path / "run.h5"
        record(cls.new, cls.path / "out", SECONDS, "--record-surface")
        cls.truth = Recording(cls.new)
        cls.old = cls.path / "old.h5"
        make_old(cls.new, cls.old)

    def tearDown(self):
        errors = [entry["message"] for entry in self.browser.get_log("browser")
                  if entry["level"] in ("SEVERE", "WARNING")
                  and "WebSocket connection" not in entry["message"]
                  and "GPU stall" not in entry["message"]]
        self.assertEqual(errors, [], "the browser's console")

    def wait_live(self, lines=()):
        wait_until(lambda: self.script("return document.body.dataset.state") == "live",
                   "a live page", lines)

    def set_value(self, name, value, event="input"):
        self.script("const one = document.getElementById(arguments[0]); one.value = arguments[1];"
                    "one.dispatchEvent(new Event(arguments[2]))", name, value, event)

    def pause(self):
        if self.view("playback")["state"] == "playing":
            self.browser.find_element(By.ID, "play").click()
        wait_until(lambda: self.view("playback")["state"] == "paused", "a pause")

    def seek(self, time_s, exported=False):
        """Goes to a time; returns the numbers of the page there."""
        time_s = round(time_s, 2)  # the slider's step
        self.set_value("play-time", time_s)
        there_s = self.truth.time_s[self.truth.cycle_at(time_s)]
        def arrived():
            now = self.view("playback")
            return now["state"] == "paused" and abs(now["time_s"] - time_s) < 1e-3
        if exported:
            wait_until(arrived, f"the time {time_s}")
            wait_until(lambda: abs(self.view("time_s") - time_s) < 0.03, "the row of that time")
        else:
            time_s = there_s
            wait_until(arrived, f"the time {time_s}")
            wait_until(lambda: abs(self.view("time_s") - there_s) < 1e-4, "the row of that time")
        return {name: self.view(name) for name in ("time_s", "position_mm", "force_N")}

    def check_numbers(self, at, tolerance_s=0.0):
        """The page's numbers are the file's, in float32."""
        cycle = self.truth.cycle_at(at["time_s"] - 1e-6)
        self.assertAlmostEqual(self.truth.time_s[cycle], at["time_s"], delta=1e-4 + tolerance_s)
        for name in ("position_mm", "force_N"):
            for axis in range(3):
                true = getattr(self.truth, name)[cycle][axis]
                self.assertAlmostEqual(at[name][axis], true, delta=1e-6 + 2e-6 * abs(true))

    def show_field(self, method=0):
        self.script("document.getElementById('layers').open = true")
        self.set_value("field-method", str(method), "change")

    def shares(self):
        field = self.view("field")
        return {name: field[name] for name in ("shown", "exact", "known", "partly")}

    def picture(self, name):
        if SCREENSHOTS:
            for theme in ("dark", "light"):
                self.script("document.documentElement.dataset.theme === arguments[0] ||"
                            "document.getElementById('theme').click()", theme)
                self.script("return new Promise((done) => setTimeout(done, 400))")
                self.browser.save_screenshot(f"{SCREENSHOTS}/{name}_{theme}.png")

    def assert_no_inside(self):
        """The menu says that the file does not have it."""
        self.assertEqual(self.browser.execute_script(
            "const box = document.getElementById('inside');"
            "return [box.disabled, document.getElementById('inside-count').textContent]"),
            [True, "(not in a recording)"])

    def test_plays_a_recording_and_goes_where_the_person_wants(self):
        viewer = Viewer(self.new)
        try:
            self.browser.get(viewer.url)
            self.wait_live(viewer.lines)
            with self.subTest("it says that it is a recording"):
                self.assertEqual(self.browser.find_element(By.ID, "state").text, "recording")
                for name in ("stop", "pause"):
                    button = self.browser.find_element(By.ID, name)
                    self.assertFalse(button.is_enabled(), name)
                    self.assertIn("recording", button.get_attribute("title"))
                self.assertEqual(self.view("vertices"), SURFACE_OF_SMALL)
                self.assertFalse(self.view("stop_acknowledged"))
                self.assert_no_inside()
            with self.subTest("it plays on by its own clock, and stands still"):
                self.pause()  # a slow browser shows the first row when the last has been played
                self.seek(0.2)
                self.browser.find_element(By.ID, "play").click()
                wait_until(lambda: self.view("time_s") > 0.4, "rows", viewer.lines)
                ActionChains(self.browser).send_keys(" ").perform()
                wait_until(lambda: self.view("playback")["state"] == "paused", "a pause")
            touched_s = self.truth.touched_s()
            self.show_field()
            with self.subTest("the numbers are the file's"):
                for time_s in (touched_s, 0.5, touched_s, 0.0, 3.0):
                    at = self.seek(time_s)
                    self.check_numbers(at)
            with self.subTest("there and back again gives the same"):
                first = self.seek(touched_s)
                self.show_field()  # forgets the slice of the time before
                wait_until(lambda: self.view("field")["shown"], "a slice", viewer.lines)
                wait_until(lambda: self.view("field")["exact"], "the servo's own field")
                field = self.shares()
                frames = self.view("frames")
                self.seek(1.0)
                self.seek(SECONDS - 0.5)
                again = self.seek(touched_s)
                for name in ("position_mm", "force_N"):
                    self.assertEqual(again[name], first[name], name)
                self.assertAlmostEqual(again["time_s"], first["time_s"], delta=1e-5)
                wait_until(lambda: self.shares() == field, "the same slice")
                # Numbers are shown as they come, a surface with the next picture.
                wait_until(lambda: self.view("frames") > frames, "a surface", viewer.lines)
            self.picture("playback")
            with self.subTest("at the end it stands still, and begins again"):
                self.set_value("play-speed", "8", "change")
                self.browser.find_element(By.ID, "play").click()
                wait_until(lambda: self.view("playback")["state"] == "paused" and
                           abs(self.view("playback")["time_s"] - self.truth.time_s[-1]) < 0.02,
                           "the end")
                self.set_value("play-speed", "0.1", "change")
                self.browser.find_element(By.ID, "play").click()
                wait_until(lambda: self.view("playback")["state"] == "playing" and
                           self.view("time_s") < 2, "the beginning")
        finally:
            self.assertEqual(viewer.close(), 128 + signal.SIGINT, viewer.lines)

    def test_plays_an_old_recording_without_what_came_since(self):
        viewer = Viewer(self.old)
        try:
            self.browser.get(viewer.url)
            self.wait_live(viewer.lines)
            self.pause()
            self.assertEqual(self.view("vertices"), 0)
            self.assertEqual([option.get_attribute("textContent") for option in self.browser.find_elements(
                By.CSS_SELECTOR, "#field-method option")][1:], list(METHODS))
            self.show_field(1)
            self.check_numbers(self.seek(self.truth.touched_s()))
            wait_until(lambda: self.view("field")["shown"], "a slice", viewer.lines)
            field = self.view("field")
            self.assertGreater(field["known"] + field["partly"], 0.0)
            # Settings, samples and forces are enough for the servo's own field.
            self.assertTrue(field["exact"])
            self.picture("playback_old")
        finally:
            viewer.close()

    def test_exports_one_file_that_needs_nothing_else(self):
        page = self.path / "run.html"
        done = run("view", self.new, "--export", page)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertLess(page.stat().st_size, 20e6)
        self.assertIn("opens in a browser without anything else", done.stdout + done.stderr)
        text = page.read_text(encoding="utf-8")
        self.assertIsNone(re.search(r"(src|href)=\"(?!data:)", text[:text.index("<body")]))
        self.browser.execute_cdp_cmd("Network.enable", {})
        self.browser.execute_cdp_cmd("Network.emulateNetworkConditions", {
            "offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0})
        try:
            self.browser.get(page.as_uri())
            self.wait_live()
            self.assertEqual(self.view("vertices"), SURFACE_OF_SMALL)
            self.assert_no_inside()
            self.pause()
            touched_s = self.truth.touched_s()
            self.show_field()
            for time_s in (touched_s, 0.5, touched_s):
                at = self.seek(time_s, exported=True)
                self.check_numbers(at)
            wait_until(lambda: self.view("field")["shown"], "a slice")
            self.assertGreater(self.view("field")["known"] + self.view("field")["partly"], 0.0)
            self.picture("playback_export")
            self.assertEqual(self.view("broken_messages"), 0)
        finally:
            self.browser.execute_cdp_cmd("Network.emulateNetworkConditions", {
                "offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1})


class Refusals(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.path = pathlib.Path(cls.folder.name)
        cls.good = cls.path / "run.h5"
        record(cls.good, cls.path / "out", 1)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def refuses(self, words, *parts, status=1, **options):
        done = run("view", *words, **options)
        self.assertEqual(done.returncode, status, done.stderr)
        self.assertNotIn("view: http", done.stderr)
        for part in parts:
            self.assertIn(part, done.stderr)

    def test_say_what_is_wrong_with_a_file(self):
        text = self.path / "text.h5"
        text.write_text("no recording", encoding="utf-8")
        other = self.path / "other.h5"
        with h5py.File(other, "w") as data:
            data["x"] = [1.0]
        empty = self.path / "empty.h5"
        shutil.copy(self.good, empty)
        with h5py.File(empty, "r+") as data:
            for column in data["cycles"].values():
                column.resize(0, axis=0)
        truncated = self.path / "truncated.h5"
        whole = self.good.read_bytes()
        truncated.write_bytes(whole[:len(whole) // 3])
        no_forces = self.path / "no_forces.h5"
        shutil.copy(self.good, no_forces)
        with h5py.File(no_forces, "r+") as data:
            del data["samples"]["force_W_N"]
        self.refuses([self.path / "nothing.h5"], "nothing.h5")
        self.refuses([text], "text.h5", "not an HDF5 file")
        self.refuses([other], "other.h5", "not a recording of forcegrid")
        self.refuses([empty], "empty.h5", "has no cycle")
        self.refuses([truncated], "truncated.h5", "damaged")
        self.refuses([no_forces], "no_forces.h5", "force_W_N", "missing")
        self.refuses([self.good, "--listen", "0.0.0.0:0"], "0.0.0.0", "--view-key FILE")
        self.refuses([], "FILE", status=2)

    def test_are_none_of_a_page_over_tls(self):
        key_file = peers.make_key_file(self.path / "view.pem")
        viewer = Viewer(self.good, "--view-key", key_file)
        try:
            self.assertTrue(viewer.url.startswith("https://"))
            with urllib.request.urlopen(viewer.url, timeout=PATIENCE_S,
                                        context=peers.unchecked_tls()) as page:
                self.assertEqual(page.status, 200)
            self.assertTrue(any("SHA-256 fingerprint" in line for line in viewer.lines), viewer.lines)
        finally:
            viewer.close()

    def test_say_what_is_wrong_with_a_key(self):
        self.refuses([self.good, "--view-key", self.path / "none.pem"], "none.pem", "openssl req")
        self.refuses([self.good, "--view-key", "view.pem", "--export", self.path / "run.html"],
                     "--view-key", status=2)

    def test_say_why_a_page_cannot_be_written(self):
        self.refuses([self.good, "--export", self.path / "none" / "run.html"], "run.html",
                     "can't be made")
        self.refuses([self.good, "--export", self.path], "no plain file")
        self.refuses([self.good, "--export", "/dev/full"], "no plain file")
        page = self.path / "large.html"
        self.refuses([self.good, "--export", page], "large.html", "can't be written",
                     preexec_fn=lambda: (signal.signal(signal.SIGXFSZ, signal.SIG_IGN),
                                         resource.setrlimit(resource.RLIMIT_FSIZE, (100000, 100000))))
        self.assertEqual(list(self.path.glob("large*")), [])
        self.refuses([self.good, "--export", page, "--export-MB", "1"], "--export-MB", status=2)


if __name__ == "__main__":
    FORCEGRID = sys.argv.pop(1)
    if None in (webdriver, CHROMIUM, DRIVER, h5py):
        print("Chromium, its driver, selenium or h5py is missing: setup/install.sh browser tests")
        sys.exit(77)
    unittest.main(verbosity=2)
