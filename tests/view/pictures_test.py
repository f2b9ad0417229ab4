#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the live view of a run, for the documents, and whether they show what they should.
usage: pictures_test.py FORCEGRID FOLDER    ends with 77 where Chromium or selenium is missing"""
import pathlib
import sys
import tempfile
import unittest

import live_view_test
from live_view_test import CHROMIUM, DRIVER, Run, start_browser, wait_until, webdriver
from picture import Picture

FOLDER = pathlib.Path()
SCENE = "stomach"


def luminance(colour):
    return 0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2]


class Pictures(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.downloads = tempfile.TemporaryDirectory()
        cls.browser = start_browser(cls.downloads.name)
        cls.felt = Run("--evaluate", "forcegrid;hold", "--seconds", "0", scene=SCENE)
        FOLDER.mkdir(parents=True, exist_ok=True)

    @classmethod
    def tearDownClass(cls):
        cls.felt.close()
        cls.browser.quit()
        cls.downloads.cleanup()

    def view(self, name):
        return self.browser.execute_script(f"return window.forcegridView && window.forcegridView.{name}")

    def open(self, theme, width, height):
        self.browser.set_window_size(width, height)
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {
            "features": [{"name": "prefers-color-scheme", "value": theme}]})
        self.browser.get(self.felt.url)
        wait_until(lambda: self.browser.execute_script("return document.body.dataset.state") == "live",
                   "a live page", self.felt.lines)
        wait_until(lambda: self.view("in_contact") and self.view("vertices"), "contact", self.felt.lines)
        wait_until(lambda: self.view("force_N"), "a force", self.felt.lines)
        self.see_object(60)

    def see_object(self, times):
        end = self.view("frames") + times
        wait_until(lambda: self.view("frames") >= end, "the moving object", self.felt.lines)

    def take(self, name):
        """Keeps a picture of the page. Returns it, and the rectangle of the 3-D part in its pixels."""
        png = self.browser.get_screenshot_as_png()
        (FOLDER / (name + ".png")).write_bytes(png)
        box = self.browser.execute_script(
            "const box = document.querySelector('canvas').getBoundingClientRect();"
            "return [box.left, box.top, box.right, box.bottom]")
        return Picture(png), [int(side) for side in box]

    def colours(self, picture, box):
        left, top, right, bottom = box
        return {picture.at(x, y)
                for y in range(max(0, top), min(bottom, picture.height), 5)
                for x in range(max(0, left), min(right, picture.width), 5)}

    def check(self, name, dark):
        picture, box = self.take(name)
        self.assertGreater(len(self.colours(picture, box)), 100, "the shaded object")
        corner = luminance(picture.at(box[0] + 3, box[1] + 3))
        self.assertTrue(corner < 80 if dark else corner > 170, f"{name}: {corner} behind the object")

    def test_light(self):
        self.open("light", 1280, 800)
        self.check("live_view_light", dark=False)

    def test_dark_with_a_slice_of_the_field(self):
        self.open("dark", 1280, 800)
        self.browser.execute_script(
            "const list = document.getElementById('field-method'); list.value = '0';"
            "list.dispatchEvent(new Event('change'))")
        wait_until(lambda: self.view("field")["shown"], "a slice", self.felt.lines)
        self.assertTrue(self.view("field")["exact"])
        self.see_object(20)
        self.check("live_view_dark", dark=True)

    def test_narrow(self):
        self.open("light", 420, 860)
        self.check("live_view_narrow", dark=False)


if __name__ == "__main__":
    live_view_test.FORCEGRID = sys.argv.pop(1)
    FOLDER = pathlib.Path(sys.argv.pop(1))
    if webdriver is None or CHROMIUM is None or DRIVER is None:
        print("Chromium, its driver or selenium is missing: setup/install.sh browser")
        sys.exit(77)
    unittest.main(verbosity=2)
