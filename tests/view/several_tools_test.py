#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid run --view with two devices, in a browser: one page shows both, and stops both.
usage: several_tools_test.py FORCEGRID [FOLDER]     pictures go to FOLDER; ends with 77 where
                                                    Chromium or selenium is missing"""
import pathlib
import sys
import time
import unittest

import live_view_test
from live_view_test import CHROMIUM, DRIVER, BrowserCase, Run, wait_until, webdriver
from layout_checks import CONTRAST, OVERLAPS, SIZES_PX

if webdriver:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import Select

FOLDER = None
ARM = "emulated:woodenhaptics_v2015"
APART_M = 0.03  # default, along y
# How far the hand moves a tool that no one drags: its own stillness and the object's pull.
STILL_MM = 3.0


class SeveralTools(BrowserCase):
    def take(self, name):
        if FOLDER:
            FOLDER.mkdir(parents=True, exist_ok=True)
            (FOLDER / (name + ".png")).write_bytes(self.browser.get_screenshot_as_png())

    def other(self):
        others = self.view("other_tools")
        return others[0] if len(others) == 1 and others[0]["position_W_m"] else None

    def choose(self, tool):
        Select(self.browser.find_element(By.ID, "tool")).select_by_value(str(tool))
        wait_until(lambda: self.view("tool") == tool and self.view("rows") > 2 and self.other(),
                   f"tool {tool}", self.felt.lines)

    def drag_shown_tool_up(self, pixels):
        x, y, z = (1e-3 * value for value in self.view("position_mm"))
        at = self.view(f"project([{x}, {y}, {z}])")
        canvas = self.browser.find_element(By.ID, "scene")
        middle = self.browser.execute_script(
            "const r = arguments[0].getBoundingClientRect();"
            "return [r.left + r.width / 2, r.top + r.height / 2]", canvas)
        ActionChains(self.browser).move_to_element_with_offset(
            canvas, round(at["x"] - middle[0]), round(at["y"] - middle[1])).click_and_hold(
            ).move_by_offset(0, -pixels).perform()

    def test_one_page_shows_both_and_stops_both(self):
      
        self.felt = run = Run("--device", ARM, "--device", ARM, "--seconds", "120", "--motion",
                              "still", "--hand", "light")
        try:
            self.browser.get(run.url)
            wait_until(lambda: self.browser.execute_script(
                "return document.body.dataset.state") == "live", "a live page", run.lines)
            self.assertEqual(sum(line.startswith("view: http") for line in run.lines), 1)
            wait_until(lambda: self.view("in_contact") and self.other()
                       and self.other()["in_contact"], "two contacts", run.lines)
            self.assertEqual(self.view("vertices"), live_view_test.SURFACE_OF_SMALL)

            with self.subTest("each stands at its place, with its arm"):
                self.assertEqual(self.view("tool"), 0)
                left_m, right = 1e-3 * self.view("position_mm")[1], self.other()
                self.assertEqual(right["tool"], 1)
                self.assertAlmostEqual(right["position_W_m"][1] - left_m, APART_M, delta=5e-3)
                wait_until(lambda: self.other()["links"] > 0, "the other arm", run.lines)

            with self.subTest("nothing covers anything, and all can be read, in every size"):
                for width, height in SIZES_PX:
                    self.size(width, height)
                    self.assertEqual(self.browser.execute_script(OVERLAPS)["found"], [],
                                     f"{width} x {height}")
                    self.assertTrue(self.browser.find_element(By.ID, "tool").is_displayed())
                for theme in ("light", "dark"):
                    self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {
                        "features": [{"name": "prefers-color-scheme", "value": theme}]})
                    for width, height in ((420, 860), (1280, 720)):
                        self.size(width, height)
                        time.sleep(0.6)  # some pictures
                        self.assertEqual(self.browser.execute_script(CONTRAST)["poor"], [], theme)
                        self.take(f"several_tools_{theme}_{width}")

            with self.subTest("the chosen tool alone follows the mouse"):
                self.choose(1)
                self.assertAlmostEqual(self.view("position_mm")[1], 15.0, delta=5.0)
                self.assertEqual(self.other()["tool"], 0)
                still_mm = [1e3 * value for value in self.other()["position_W_m"]]
                before_mm = self.view("position_mm")
                self.drag_shown_tool_up(40)
                wait_until(lambda: self.view("position_mm")[2] > before_mm[2] + 4, "the hand",
                           run.lines)
                wait_until(lambda: self.view("force_N")[2] < -0.2, "a force", run.lines)
                now_mm = [1e3 * value for value in self.other()["position_W_m"]]
                for axis in range(3):
                    self.assertAlmostEqual(now_mm[axis], still_mm[axis], delta=STILL_MM)
                self.take("several_tools_dragged")

            with self.subTest("stop ends both at zero current"):
                self.browser.find_element(By.ID, "stop").click()
                wait_until(lambda: self.view("stop_acknowledged"), "an acknowledged stop", run.lines)
                self.assertEqual(run.process.wait(live_view_test.PATIENCE_S), 3)
                for device in run.summary()["devices"]:
                    self.assertEqual(device["ended_by"], "emergency_stop")
                    self.assertTrue(device["zero_current_delivered"])
                    self.assertEqual(device["emulator"]["final_current_mA"], [0.0, 0.0, 0.0])
        finally:
            run.close()
            errors = self.console_errors("WebSocket connection")
            self.assertEqual(errors, [], "the browser's console has errors")


if __name__ == "__main__":
    live_view_test.FORCEGRID = sys.argv.pop(1)
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        FOLDER = pathlib.Path(sys.argv.pop(1))
    if webdriver is None or CHROMIUM is None or DRIVER is None:
        print("Chromium, its driver or selenium is missing: setup/install.sh browser")
        sys.exit(77)
    unittest.main(verbosity=2)
