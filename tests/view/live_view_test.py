#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid run --view with all its processes and a browser: the surface, the hand, the controls.
usage: live_view_test.py FORCEGRID          ends with 77 where Chromium or selenium is missing"""
import json
import math
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import peers

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "page"))
from browser import CHROMIUM, DRIVER, BrowserCase, start_browser, webdriver

if webdriver:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

FORCEGRID = ""
PATIENCE_S = 30
# The scene `small` has 11 x 11 x 9 vertices, of which 9 x 9 x 7 are inside.
SURFACE_OF_SMALL = 11 * 11 * 9 - 9 * 9 * 7
# Springs join neighbours along one axis, and along both diagonals of each lattice face.
SPRINGS_OF_SMALL = (2 * 10 * 11 * 9 + 11 * 11 * 8) + 2 * (10 * 10 * 9 + 2 * 10 * 11 * 8)


class Run:
    """A run with a live view, and what it says on standard error."""

    def __init__(self, *options, view=("--view",), scheme="http", scene="small"):
        self.folder = tempfile.TemporaryDirectory()
        self.summary_file = pathlib.Path(self.folder.name) / "summary.json"
        self.process = subprocess.Popen(
            [FORCEGRID, "--no-config", "run", *view, "--scene", scene, "--no-reference",
             "--device-timeout-ms", "450", "--out", self.folder.name,
             "--json", str(self.summary_file), *options],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.lines = []
        self.reader = threading.Thread(target=self.read)
        self.reader.start()
        address = r"^view: (%s://127\.0\.0\.1:\d+/\?token=\w{32,})$" % scheme
        self.url = wait_until(lambda: self.find(address), "the view's address", self.lines)[1]

    def read(self):
        for line in self.process.stderr:
            self.lines.append(line.rstrip("\n"))

    def find(self, pattern):
        return next((found for found in (re.search(pattern, line) for line in list(self.lines))
                     if found), None)

    def place(self, pattern):
        return next(i for i, line in enumerate(self.lines) if re.search(pattern, line))

    def view_pid(self):
        children = subprocess.run(["pgrep", "-P", str(self.process.pid), "-x", "forcegrid-view"],
                                  capture_output=True, text=True)
        return int(children.stdout)

    def summary(self):
        return json.loads(self.summary_file.read_text(encoding="utf-8"))

    def close(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE_S)
        self.reader.join(PATIENCE_S)
        self.process.stderr.close()
        self.folder.cleanup()


def wait_until(wanted, what, said=()):
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        found = wanted()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"{what} did not come within {PATIENCE_S} s\n" + "\n".join(said))


class LiveView(BrowserCase):
    def open(self, run, more=""):
        self.browser.get(run.url + more)
        self.wait_live(run)

    def wait_live(self, run):
        wait_until(lambda: self.browser.execute_script("return document.body.dataset.state") == "live",
                   "a live page", run.lines)

    def set(self, run, name, value):
        """Changes a setting as its control in the page does, and waits for the answer."""
        before = self.view("settings_answered")
        sent = self.browser.execute_script("return window.forcegridView.set(...arguments)", name, value)
        self.assertIsNotNone(sent, f"{name} is not sent")
        wait_until(lambda: self.view("settings_answered") != before, f"an answer to {name}", run.lines)
        after = self.view("settings_answered")
        note = self.browser.find_element(By.ID, "newest-note").text
        self.assertEqual(after["refused"], before["refused"], f"{name}: {note}")
        self.assertEqual(self.browser.execute_script(
            "return window.forcegridView.setting(arguments[0])", name), value)

    def wait_measured(self, run, what, is_so):
        """Until the servo's own telemetry says so."""
        try:
            wait_until(lambda: is_so(self.view("measured")), what, run.lines)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.view('measured')}") from None

    def change_object(self, run, name, value):
        """Changes a setting that makes the simulator's object another one, and waits until it is."""
        epoch = self.view("contact")["epoch"]
        self.set(run, name, value)
        wait_until(lambda: self.view("contact")["epoch"] > epoch, f"another epoch by {name}", run.lines)

    def most_N(self, axis, seconds):
        """The largest force along an axis of W within some seconds."""
        end, most = time.monotonic() + seconds, 0.0
        while time.monotonic() < end:
            force = self.view("force_N")
            most = max(most, abs(force[axis] or 0.0) if force else 0.0)
            time.sleep(0.02)
        return most

    def force_N(self):
        force = self.view("force_N")
        return math.sqrt(sum(x * x for x in force)) if force and None not in force else math.nan

    def drag_tool(self, right_px, up_px):
        """Takes the tool with the mouse and holds it elsewhere."""
        x, y, z = (1e-3 * value for value in self.view("position_mm"))
        at = self.view(f"project([{x}, {y}, {z}])")
        canvas = self.browser.find_element(By.ID, "scene")
        box = self.browser.execute_script(
            "const r = arguments[0].getBoundingClientRect();"
            "return [r.left + r.width / 2, r.top + r.height / 2]", canvas)
        ActionChains(self.browser).move_to_element_with_offset(
            canvas, round(at["x"] - box[0]), round(at["y"] - box[1])).click_and_hold(
            ).move_by_offset(right_px, -up_px).perform()

    def expect_strokes_along_the_force(self):
        """The tool rests, so the slice's stroke beside it has the direction of the force on it."""
        position_m = [1e-3 * each for each in self.view("position_mm")]
        strokes = self.view("directions")
        self.assertGreater(len(strokes), 8)
        nearest = min(strokes, key=lambda stroke: math.dist(stroke[:3], position_m))
        self.assertLess(math.dist(nearest[:3], position_m), 6e-3)
        way = [tip - foot for foot, tip in zip(nearest[:3], nearest[3:])]
        force_N = self.view("force_N")
        along = sum(a * b for a, b in zip(way, force_N))
        self.assertGreater(along, 0.9 * math.hypot(*way) * math.hypot(*force_N))

    def test_shows_a_run_and_does_what_the_person_wants(self):
        run = Run("--seconds", "120", "--motion", "still", "--hand", "light")
        try:
            self.open(run)
            self.assertLess(run.place("^view: "), run.place("its first cycle is over"))
            self.assertEqual(self.view("vertices"), SURFACE_OF_SMALL)
            self.assertEqual(self.view("role"), "controller")
            wait_until(lambda: self.view("in_contact"), "contact", run.lines)

            with self.subTest("the hand follows the mouse"):
                before_mm = self.view("position_mm")
                self.drag_tool(0, 40)
                wait_until(lambda: self.view("position_mm")[2] > before_mm[2] + 4, "the hand")
                # It pulls the sticking block up, which pulls back.
                wait_until(lambda: self.force_N() > 0.3, "a force")
                self.assertLess(self.view("force_N")[2], -0.2)

            with self.subTest("a slice of the field is the servo's own"):
                self.browser.execute_script(
                    "document.getElementById('layers').open = true;"
                    "const list = document.getElementById('field-method'); list.value = '0';"
                    "list.dispatchEvent(new Event('change'))")
                wait_until(lambda: self.view("field")["shown"], "a slice")
                field = self.view("field")
                self.assertTrue(field["exact"])
                self.assertGreater(field["known"] + field["partly"], 0.0)
                self.assertGreater(field["top_N"], 0.1)

            with self.subTest("its strokes point where the force does"):
                self.expect_strokes_along_the_force()
                self.browser.execute_script("document.getElementById('field-directions').click()")
                self.assertEqual(self.view("directions"), [])

            with self.subTest("the force pauses and comes back"):
                press_p = lambda: ActionChains(self.browser).send_keys("p").perform()
                press_p()  # a click on the button would let go of the tool
                wait_until(lambda: self.force_N() < 0.01, "zero force")
                self.assertEqual(self.browser.find_element(By.ID, "pause").text, "Resume force")
                press_p()
                wait_until(lambda: self.force_N() > 0.2, "the force again")

            with self.subTest("another method is rendered"):
                self.browser.execute_script(
                    "const list = document.getElementById('rendered'); list.value = '2';"
                    "list.dispatchEvent(new Event('change'))")
                wait_until(lambda: self.view("rendered_method") == 2, "the other method", run.lines)

            with self.subTest("the servo acknowledges the stop"):
                self.browser.find_element(By.ID, "stop").click()
                wait_until(lambda: self.view("stop_acknowledged"), "the acknowledgement", run.lines)
                self.assertEqual(run.process.wait(PATIENCE_S), 3, run.lines)
                summary = run.summary()
                self.assertEqual(summary["emergency_stop"], "view")
                self.assertEqual(summary["ended_by"], "emergency_stop")
                self.assertGreater(summary["picture_delay_ms"]["pictures"], 10)
                print("picture_delay_ms", summary["picture_delay_ms"])
            errors = [entry["message"] for entry in self.browser.get_log("browser")
                      if entry["level"] == "SEVERE" and "WebSocket connection" not in entry["message"]]
            self.assertEqual(errors, [])
        finally:
            run.close()

    def test_changes_what_the_person_wants_while_the_run_goes_on(self):
        run = Run("--seconds", "240", "--motion", "lissajous", "--hand", "firm")
        try:
            self.open(run)
            wait_until(lambda: self.view("in_contact"), "contact", run.lines)
            self.wait_measured(run, "30 samples a second", lambda m: 25 < m["arrivals_per_s"] < 32)

            with self.subTest("the simulator's rate"):
                self.set(run, "simulator_rate_Hz", 10)
                self.wait_measured(run, "10 samples a second", lambda m: m["arrivals_per_s"] < 11.5
                                   and m["sample_period_ms"] > 80)
                self.set(run, "simulator_rate_Hz", 30)
                self.wait_measured(run, "30 again", lambda m: m["arrivals_per_s"] > 25)
            with self.subTest("delay and jitter of its link"):
                self.set(run, "delay_ms", 150)
                self.wait_measured(run, "samples of 150 ms", lambda m: m["sample_age_ms"] > 150)
                self.set(run, "jitter_ms", 100)
                self.wait_measured(run, "samples of 200 ms", lambda m: m["sample_age_ms"] > 200)
                self.set(run, "delay_ms", 0)
                self.set(run, "jitter_ms", 0)
                self.wait_measured(run, "young samples", lambda m: m["sample_age_ms"] < 100)
            with self.subTest("loss of its link"):
                self.set(run, "loss_percent", 70)  # 9 of 30 are left
                self.wait_measured(run, "fewer samples", lambda m: m["arrivals_per_s"] < 16)
                self.set(run, "loss_percent", 0)
                self.wait_measured(run, "all samples", lambda m: m["arrivals_per_s"] > 25)
            with self.subTest("requests a second"):
                self.set(run, "requests_per_s", 60)
                self.wait_measured(run, "60 requests", lambda m: m["requests_per_s"] == 60)
            with self.subTest("the budget of auto"):
                self.set(run, "budget_us", 20)
                self.wait_measured(run, "a budget", lambda m: 10 < m["budget_reads"] < 1e6)
                self.set(run, "budget_us", None)
                self.wait_measured(run, "no budget", lambda m: m["budget_reads"] > 1e30)
            with self.subTest("a wall and a cut"):
                free_N = self.most_N(2, 3)
                self.change_object(run, "wall_mm", 4)
                # Any 3 s have the same largest force within 4 %: 2.8 N, 5.0 N with the wall, 1.6 N
                # with the cut. A slow machine may take some of them to learn of a change.
                wait_until(lambda: self.most_N(2, 3) > free_N + 0.5, "something in the way", run.lines)
                self.assertGreater(self.most_N(2, 3), free_N + 0.5, "nothing is in the way")
                self.change_object(run, "wall_mm", None)  # or its epoch would pass for the cut's
                self.change_object(run, "cut", "yes")
                wait_until(lambda: self.most_N(2, 3) < 0.9 * free_N, "a softer object", run.lines)
                self.assertLess(self.most_N(2, 3), 0.9 * free_N, "the object is as stiff as before")
            with self.subTest("answers to the requests that a method makes when it knows little"):
                wait_until(lambda: self.view("contact")["requested"] > 0, "answers", run.lines)
                self.set(run, "requests_per_s", 0)
                self.wait_measured(run, "no requests", lambda m: m["requests_per_s"] == 0)
            with self.subTest("the hand"):
                self.set(run, "hand", "light")
            with self.subTest("what is out of range is refused"):
                before = self.view("settings_answered")
                self.view("set('delay_ms', 5000)")
                wait_until(lambda: self.view("settings_answered")["refused"] > before["refused"],
                           "a refusal", run.lines)

            run.process.send_signal(signal.SIGINT)
            self.assertEqual(run.process.wait(PATIENCE_S), 130, run.lines)
            summary = run.summary()
            changes = [(one["name"], one["value"]) for one in summary["setting_changes"]]
            self.assertEqual(changes[:3], [("simulator_rate_Hz", 10), ("simulator_rate_Hz", 30),
                                           ("delay_ms", 150)])
            self.assertEqual(changes[-1], ("hand", "light"))
            self.assertEqual(summary["emulator"]["hand"], "light")
            self.assertEqual(summary["faults"], [])
            self.assertGreater(summary["requests_made"], 0)
            # Two of the rate, six of the link, two of the wall, one cut.
            self.assertEqual(summary["simulator"]["control_changes"], 11)
            self.assertGreater(summary["simulator"]["link"]["lost_on_purpose"], 5)
            self.assertGreater(summary["simulator"]["link"]["delayed"], 5)
        finally:
            run.close()

    def test_leads_through_the_tour_and_to_another_scene(self):
        run = Run("--tour")
        try:
            self.open(run, "&step_s=600")
            steps = ["streaming", "grid", "auto", "wall", "cut", "delay"]
            for number, step in enumerate(steps):
                wait_until(lambda: self.view("tour_visited") == steps[:number + 1], step, run.lines)
                self.assertEqual(self.view("tour_step"), step)
                if step == "streaming":
                    wait_until(lambda: self.view("rendered_method") == 2, "hold", run.lines)
                time.sleep(0.5)
                self.browser.find_element(By.ID, "tour-next").click()
            wait_until(lambda: self.view("tour_step") is None, "the tour's end", run.lines)
            wait_until(lambda: self.view("rendered_method") == 0, "auto", run.lines)
            wait_until(lambda: self.view("measured")["sample_age_ms"] > 150, "the delay", run.lines)

            self.browser.execute_script("return window.forcegridView.set('scene', 'three_cubes')")
            wait_until(lambda: self.view("vertices") not in (0, SURFACE_OF_SMALL), "another object",
                       run.lines)
            self.wait_live(run)
            self.assertEqual(run.summary()["ended_by"], "scene")
            changes = [(one["name"], one["value"]) for one in run.summary()["setting_changes"]]
            for change in (("wall_mm", 12), ("wall_mm", None), ("cut", "yes"), ("cut", "no"),
                           ("delay_ms", 150), ("scene", "three_cubes")):
                self.assertIn(change, changes)
            wait_until(lambda: self.view("in_contact"), "contact with it", run.lines)
            self.browser.find_element(By.ID, "stop").click()
            self.assertEqual(run.process.wait(PATIENCE_S), 3, run.lines)
            self.assertEqual(run.summary()["scene"], "three_cubes")
        finally:
            run.close()

    def test_shows_the_springs_inside_on_demand(self):
        folder = tempfile.TemporaryDirectory()
        # The recording of the surface stands between the simulator and the view, and hands on wishes.
        run = Run("--seconds", "120", "--motion", "lissajous", "--hand", "firm", "--record-surface",
                  "--record", folder.name + "/run.h5")
        tick = lambda: self.browser.execute_script("document.getElementById('inside').click()")
        try:
            self.open(run)
            wait_until(lambda: self.view("in_contact"), "contact", run.lines)
            self.assertEqual(self.view("inside")["edges"], 0)
            self.assertFalse(self.view("inside")["opened"])
            tick()
            wait_until(lambda: self.view("inside")["edges"] > 0, "the springs", run.lines)
            shown = self.view("inside")
            self.assertEqual((shown["springs"], shown["edges"]), 2 * (SPRINGS_OF_SMALL,))
            self.assertEqual(shown["element_edges"], 0)
            self.assertTrue(shown["opened"])
            wait_until(lambda: 0 < self.view("inside")["drawn"] < SPRINGS_OF_SMALL,
                       "the springs near the section", run.lines)

            with self.subTest("they move with the vertices inside"):
                # The lattice's vertex (5, 5, 6), two layers below the middle of the top.
                height_mm = lambda: 1e3 * self.view(f"inside_vertex(0, {5 + 11 * (5 + 11 * 6)})")[2]
                least = most = height_mm()

                def has_moved():
                    nonlocal least, most
                    now = height_mm()
                    least, most = min(least, now), max(most, now)
                    return most - least > 1.0
                wait_until(has_moved, "a movement of 1 mm below the tool", run.lines)
                self.assertEqual(self.view("vertices"), SURFACE_OF_SMALL)

            with self.subTest("a cut severs some of them"):
                self.set(run, "cut", "yes")
                wait_until(lambda: 0 < self.view("inside")["springs"] < SPRINGS_OF_SMALL,
                           "the cut", run.lines)
                wait_until(lambda: self.view("inside")["edges"] == self.view("inside")["springs"],
                           "a frame of the cut object", run.lines)
                self.set(run, "cut", "no")
                wait_until(lambda: self.view("inside")["edges"] == SPRINGS_OF_SMALL,
                           "the whole object", run.lines)

            with self.subTest("they vanish, and the simulator sends them no more"):
                tick()
                wait_until(lambda: self.view("inside")["edges"] == 0, "the end of the springs")
                self.assertFalse(self.view("inside")["opened"])
                frames = self.view("frames")
                wait_until(lambda: self.view("frames") > frames + 60, "surfaces alone", run.lines)
                self.assertEqual(self.view("inside")["frames"], 0)
            run.process.send_signal(signal.SIGINT)
            self.assertEqual(run.process.wait(PATIENCE_S), 130, run.lines)
            simulator = run.summary()["simulator"]
            self.assertEqual(simulator["springs"], SPRINGS_OF_SMALL)
            self.assertGreater(simulator["surface"]["inside_frames"], 3)
            self.assertLess(simulator["surface"]["inside_frames"],
                            simulator["surface"]["frames"] - 50)
        finally:
            run.close()
            folder.cleanup()

    def test_shows_a_run_over_tls(self):
        key_file = peers.make_key_file(pathlib.Path(self.folder.name) / "view.pem")
        run = Run("--seconds", "60", view=("--view", "127.0.0.1:0", "--view-key", key_file),
                  scheme="https")
        browser = start_browser(self.folder.name, "--ignore-certificate-errors")
        try:
            browser.get(run.url)
            wait_until(lambda: browser.execute_script("return document.body.dataset.state") == "live",
                       "a live page", run.lines)
            self.assertTrue(browser.execute_script("return isSecureContext"))
            wait_until(lambda: browser.execute_script(
                "return window.forcegridView.vertices") == SURFACE_OF_SMALL, "the surface", run.lines)
            said = subprocess.run(["openssl", "x509", "-in", key_file, "-noout", "-fingerprint",
                                   "-sha256"], capture_output=True, text=True, check=True).stdout
            fingerprint = said.strip().split("=")[1]
            self.assertTrue(run.find("^view: its certificate has the SHA-256 fingerprint %s$"
                                     % fingerprint), run.lines)
            browser.find_element(By.ID, "stop").click()
            self.assertEqual(run.process.wait(PATIENCE_S), 3, run.lines)
            self.assertEqual(run.summary()["emergency_stop"], "view")
        finally:
            browser.quit()
            run.close()

    def test_changes_nothing_for_the_run_when_it_dies(self):
        run = Run("--seconds", "3")
        try:
            wait_until(lambda: run.find("its first cycle is over"), "the first cycle", run.lines)
            os.kill(run.view_pid(), signal.SIGKILL)
            self.assertEqual(run.process.wait(PATIENCE_S), 0, run.lines)
            run.reader.join(PATIENCE_S)
            self.assertTrue(run.find("the live view is gone"), run.lines)
            summary = run.summary()
            self.assertEqual(summary["ended_by"], "time")
            self.assertEqual(summary["faults"], [])
            self.assertGreater(summary["cycles"], 1000)
        finally:
            run.close()


class Words(unittest.TestCase):
    def test_say_what_is_wrong_with_an_address(self):
        for address in ("0.0.0.0:0", "127.0.0.1", "nowhere:1"):
            done = subprocess.run([FORCEGRID, "--no-config", "run", "--view", address, "--seconds", "1"],
                                  capture_output=True, text=True, timeout=PATIENCE_S)
            self.assertNotEqual(done.returncode, 0, address)
            self.assertIn(address.split(":", maxsplit=1)[0], done.stderr)

    def test_name_the_remedy_for_an_address_that_other_machines_reach(self):
        done = self.refused("--view", "0.0.0.0:0")
        for word in ("--view-key FILE", "openssl req -x509"):
            self.assertIn(word, done.stderr)

    def test_say_what_is_wrong_with_a_key_file(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(peers.make_key_file(pathlib.Path(folder) / "view.pem"))
            file.chmod(0o644)
            done = self.refused("--view", "0.0.0.0:0", "--view-key", str(file))
            for word in (str(file), "its mode 0644", "chmod 600"):
                self.assertIn(word, done.stderr)
        self.assertIn("--view", self.refused("--view-key", "view.pem").stderr)

    def refused(self, *options):
        done = subprocess.run([FORCEGRID, "--no-config", "run", *options, "--seconds", "1"],
                              capture_output=True, text=True, timeout=PATIENCE_S)
        self.assertNotEqual(done.returncode, 0, options)
        return done


if __name__ == "__main__":
    FORCEGRID = sys.argv.pop(1)
    if webdriver is None or CHROMIUM is None or DRIVER is None:
        print("Chromium, its driver or selenium is missing: setup/install.sh browser")
        sys.exit(77)
    unittest.main(verbosity=2)
