#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The page of the live view in a browser, before a server that stands in for the live view's.
usage: page_test.py [CLASS[.NAME_OF_TEST] ...]    ends with 77 where Chromium or selenium is
                                                  missing"""
import os
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from browser import CHROMIUM, DRIVER, webdriver
from controls_cases import Controls
from everybody_cases import Everybody
from layers_cases import Layers
from shown_cases import Shown
from stand_in_server import JAVASCRIPT

CASES = (Shown, Layers, Controls, Everybody)

if __name__ == "__main__":
    missing = [name for name, found in (
        ("python3-selenium", webdriver), ("chromium", CHROMIUM), ("chromium-driver", DRIVER),
        ("libjs-three", (JAVASCRIPT / "three/three.module.js").exists()),
        ("libjs-dygraphs", (JAVASCRIPT / "dygraphs/dygraph.js").exists())) if not found]
    if missing:
        print("skipped: not installed:", ", ".join(missing))
        sys.exit(77)
    os.environ.setdefault("HOME", "/tmp")
    unittest.main()
