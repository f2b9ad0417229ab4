# SPDX-License-Identifier: Apache-2.0
"""Chromium without a window. `webdriver`, `CHROMIUM` or `DRIVER` is None where it is not there."""
import pathlib
import shutil
import tempfile
import unittest

try:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service
except ImportError:
    webdriver = None

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")


def start_browser(downloads, *flags, full_rate=False):
    """Headless. All that is shown is drawn in software, beside other tests: ten times a second are
    enough for them; with full_rate as often as Chromium can."""
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars",
                 "--enable-unsafe-swiftshader", "--window-size=1280,720", "--no-first-run", *flags):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(service=Service(DRIVER), options=options)
    browser.execute_cdp_cmd("Browser.setDownloadBehavior",
                            {"behavior": "allow", "downloadPath": str(downloads)})
    if not full_rate:
        browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": """
            const request = window.requestAnimationFrame.bind(window);
            window.requestAnimationFrame = (draw) => setTimeout(() => request(draw), 100);"""})
    return browser


class BrowserCase(unittest.TestCase):
    """Tests of one class share a browser, and a folder for what it downloads."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.path = pathlib.Path(cls.folder.name)
        cls.browser = start_browser(cls.folder.name)

    @classmethod
    def tearDownClass(cls):
        cls.browser.quit()
        cls.folder.cleanup()

    def script(self, text, *arguments):
        return self.browser.execute_script(text, *arguments)

    def view(self, name, *arguments):
        """What the page tells scripts."""
        return self.script(f"return window.forcegridView && window.forcegridView.{name}",
                           *arguments)

    def size(self, width, height):
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": False})

    def console_errors(self, *expected):
        """Without those that have one of these texts."""
        return [entry["message"] for entry in self.browser.get_log("browser")
                if entry["level"] == "SEVERE"
                and not any(text in entry["message"] for text in expected)]
