#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The page of the live view in a browser, before a server that stands in for the live view's.
usage: page_test.py [NAME_OF_TEST ...]      ends with 77 where Chromium or selenium is missing"""
import base64
import math
import os
import pathlib
import random
import shutil
import socket
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
try:
    from selenium import webdriver
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.chrome.service import Service
except ImportError:
    webdriver = None
from picture import Picture, depth_inside, outline
from stand_in_server import COLUMNS, HELLO, JAVASCRIPT, METHODS, StandIn, lines_message, send

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
PATIENCE_S = 60
# Pictures are drawn by the processor that the other tests use, too.
PICTURES_PER_S = 10
COARSE = 0.25
STILL_TOOL_W_M = (0.02, 0.03, 0.06)
BOX = [(x, y, z) for x in (1, 11) for y in (2, 22) for z in (4, 44)]  # corners

CONTRAST = """
const canvas = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
const rgba = (colour) => {
  canvas.clearRect(0, 0, 1, 1);
  canvas.fillStyle = colour;
  canvas.fillRect(0, 0, 1, 1);
  return [...canvas.getImageData(0, 0, 1, 1).data];
};
const over = (top, below) => [0, 1, 2].map(
    (i) => top[i] * top[3] / 255 + below[i] * (1 - top[3] / 255));
const background = (element) => {
  if (!element) return rgba(getComputedStyle(document.body).backgroundColor);
  const own = rgba(getComputedStyle(element).backgroundColor);
  return own[3] === 255 ? own : [...over(own, background(element.parentElement)), 255];
};
const light = (colour) => {
  const [r, g, b] = colour.map((c) => c / 255).map(
      (c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const poor = [];
let seen = 0;
for (const element of document.querySelectorAll('body *')) {
  const own = [...element.childNodes].some(
      (node) => node.nodeType === 3 && node.textContent.trim());
  if (!own || !element.checkVisibility() || element.closest(':disabled')) continue;
  const behind = background(element);
  const front = over(rgba(getComputedStyle(element).color), behind);
  const [a, b] = [light(front), light(behind)].sort((p, q) => q - p);
  seen += 1;
  const contrast = (a + 0.05) / (b + 0.05);
  if (contrast < 4.5) {
    poor.push(`${element.tagName}.${element.className} '${element.textContent}' ${contrast}`);
  }
}
return {seen, poor};
"""


# Texts and controls that cover each other, and those that leave the window at its sides. What a
# box that scrolls hides does not count, nor what lies over the page on purpose.
OVERLAPS = """
const clipped = (inside, rect) => {
  let {left, top, right, bottom} = rect;
  for (let box = inside; box; box = box.parentElement) {
    const style = getComputedStyle(box);
    if (box !== document.body && style.overflow !== 'visible') {
      const edge = box.getBoundingClientRect();
      left = Math.max(left, edge.left);
      right = Math.min(right, edge.right);
      top = Math.max(top, edge.top);
      bottom = Math.min(bottom, edge.bottom);
    }
    if (style.position === 'fixed') break;
  }
  return {left, top, right, bottom};
};
const parts = [];
const add = (inside, rect, word) => {
  const seen = clipped(inside, rect);
  if (seen.right - seen.left > 1 && seen.bottom - seen.top > 1) {
    parts.push({word, ...seen});
  }
};
const range = document.createRange();
for (const element of document.querySelectorAll('body *')) {
  if (!element.checkVisibility({checkVisibilityCSS: true}) || element.closest(
      '.chart, .hidden-word, option, dialog, .menu-list, .note-list')) continue;
  if (getComputedStyle(element.closest('.stop') || element).position === 'fixed') continue;
  if (element.matches('button, select, input, summary')) {
    add(element.parentElement, element.getBoundingClientRect(), element.id || element.textContent.trim());
  } else if (!element.closest('button, select, summary')) {
    for (const node of element.childNodes) {
      if (node.nodeType === 3 && node.data.trim()) {
        range.selectNodeContents(node);
        add(element, range.getBoundingClientRect(), node.data.trim());
      }
    }
  }
}
const found = [];
parts.forEach((a, i) => {
  if (a.left < -1 || a.right > innerWidth + 1) found.push(`${a.word} leaves the window`);
  for (const b of parts.slice(i + 1)) {
    const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (width > 1 && height > 1) {
      found.push(`'${a.word}' and '${b.word}': ${width.toFixed(0)} x ${height.toFixed(0)} px`);
    }
  }
});
return {seen: parts.length, found};
"""
# Wide, low, between two layouts, narrow.
SIZES_PX = [(1280, 720), (1920, 1080), (1024, 400), (901, 600), (861, 500), (860, 500), (640, 900),
            (480, 800), (400, 800), (320, 640)]


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


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.browser = start_browser(cls.folder.name)
        cls.stand_in = None

    @classmethod
    def tearDownClass(cls):
        cls.browser.quit()
        cls.stand_in.close()
        cls.folder.cleanup()

    def setUp(self):
        self.size(1280, 720)
        self.lost_is_expected = False
        if self.stand_in is None or self.stand_in.stopped or self.stand_in.hurt:
            if self.stand_in:
                self.stand_in.close()
            type(self).stand_in = StandIn(vertices=1500, pictures_per_s=PICTURES_PER_S)
            self.stand_in.hurt = False
            self.browser.get(self.stand_in.address)
            self.run_script("window.forcegridView.fix_scale(arguments[0])", COARSE)
            self.wait_for_state("live")
        self.failed_before = self.failed_tests()

    def tearDown(self):
        errors = [entry["message"] for entry in self.browser.get_log("browser")
                  if entry["level"] == "SEVERE"]
        if self.lost_is_expected:
            errors = [message for message in errors if "WebSocket connection" not in message]
        self.stand_in.hurt = bool(errors) or self.failed_tests() > self.failed_before
        self.assertEqual(errors, [], "the browser's console has errors")

    def failed_tests(self):
        return len(self._outcome.result.failures) + len(self._outcome.result.errors)

    def size(self, width, height):
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": False})

    def run_script(self, text, *arguments):
        return self.browser.execute_script(text, *arguments)

    def view(self, name):
        return self.run_script(f"return window.forcegridView && window.forcegridView.{name}")

    def by_id(self, name):
        return self.browser.find_element(By.ID, name)

    def wait_until(self, wanted, what):
        """`what`: a text, or what returns one when the wait was in vain."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            found = wanted()
            if found:
                return found
            time.sleep(0.03)
        return self.fail(f"waited {PATIENCE_S} s: {what() if callable(what) else what}")

    def state(self):
        return self.run_script("return document.body.dataset.state")

    def wait_for_state(self, state):
        self.wait_until(lambda: self.state() == state,
                        lambda: f"the page is {self.state()}, not {state}")

    def wait_for_frames(self, count):
        before = self.view("frames")
        self.wait_until(lambda: self.view("frames") >= before + count, "no frames are shown")

    def command(self, what, known=0):
        """The first command of a kind that comes after `known` ones."""
        found = lambda: [c for c in self.stand_in.commands[known:] if c["what"] == what]
        return self.wait_until(found, f"the page sends no {what}")[0]

    def still_tool(self):
        self.stand_in.hand = STILL_TOOL_W_M
        wanted = [1000 * x for x in STILL_TOOL_W_M]
        apart = lambda: max(abs(a - b) for a, b in zip(self.view("position_mm"), wanted))
        self.wait_until(lambda: apart() < 1e-3, "the tool does not stand still")
        self.wait_for_frames(2)

    def clear_hand(self):
        self.stand_in.hand = None

    # What is shown

    def test_shows_the_surface_the_scope_and_the_run(self):
        self.assertEqual(self.view("vertices"), len(self.stand_in.block.rest))
        self.wait_for_frames(3)
        self.assertEqual(self.view("role"), "controller")
        self.assertEqual(self.view("broken_messages"), 0)
        self.wait_until(lambda: self.view("rows") > 50, "the scope gets no rows")
        self.assertIn(HELLO["device"], self.by_id("facts").text)
        speaker = self.browser.find_element(By.CLASS_NAME, "speaker")
        self.wait_until(lambda: " speaks: " in speaker.text, "nobody speaks")
        name, _, reason = speaker.text.partition(" speaks: ")
        self.assertEqual(HELLO["candidates"].index(name), HELLO["reasons"].index(reason))
        self.assertGreater(self.view("latency")["shown_cycle"], 0)
        self.assertGreaterEqual(self.command("shown")["cycle"], 0)

    def test_draws_the_surface_where_its_vertices_are(self):
        layers = ["arm", "samples", "forces", "workspace"]
        boxes = [self.browser.find_element(By.CSS_SELECTOR, f"[data-layer={name}]")
                 for name in layers]
        self.run_script("document.getElementById('layers').open = true")
        for box in boxes:
            box.click()
        self.run_script("document.getElementById('layers').open = false")
        positions = self.stand_in.block.sheared(0.03)
        self.stand_in.hand = (0.0, 0.0, -0.02)  # inside of the block
        self.stand_in.freeze(positions)
        self.view("fix_scale(1)")
        self.wait_for_frames(4)
        camera = self.view("camera")
        huds = """document.querySelectorAll('.hud').forEach(
            (element) => { element.style.visibility = arguments[0]; })"""
        self.run_script(huds, "hidden")
        clip = {"x": camera["left"], "y": camera["top"], "width": camera["width"],
                "height": camera["height"], "scale": 1}
        shot = self.browser.execute_cdp_cmd("Page.captureScreenshot",
                                            {"format": "png", "clip": clip})
        picture = Picture(base64.b64decode(shot["data"]))
        self.run_script(huds, "visible")
        deformed = outline([self.pixel(camera, p) for p in positions])
        rest = outline([self.pixel(camera, p) for p in self.stand_in.block.rest])
        self.check_outline(picture, deformed, rest)
        corner = self.pixel(camera, max(positions, key=lambda p: p[2] * 2 + p[0] + p[1]))
        middle = self.pixel(camera, (0, 0.015, 0.015))
        near_top = picture.at(*[0.93 * c + 0.07 * m for c, m in zip(corner, middle)])
        bottom = self.pixel(camera, (0.05, 0.0, -0.045))
        self.assertGreater(colourfulness(near_top), 60, "displaced most, and grey")
        self.assertLess(colourfulness(picture.at(*bottom)), 35, "hardly displaced, and coloured")
        self.stand_in.freeze(None)
        self.view(f"fix_scale({COARSE})")
        self.clear_hand()
        self.run_script("document.getElementById('layers').open = true")
        for box in boxes:
            box.click()
        self.run_script("document.getElementById('layers').open = false")

    def check_outline(self, picture, deformed, rest):
        """Pixels are of the object inside of the deformed outline, of the background outside."""
        dice = random.Random(5)
        background = picture.at(picture.width // 2, picture.height - 3)
        points = [(dice.uniform(2, picture.width - 2), dice.uniform(2, picture.height - 2))
                  for _ in range(4000)]
        hits = {"inside": 0, "outside": 0, "only where it is deformed": 0}
        for point in points:
            depth = depth_inside(deformed, point)
            if abs(depth) < 3:
                continue
            hits["inside" if depth > 0 else "outside"] += 1
            hits["only where it is deformed"] += depth > 0 and depth_inside(rest, point) < -3
            is_object = picture.at(*point) != background
            self.assertEqual(is_object, depth > 0, f"pixel {point}: {picture.at(*point)}")
        self.assertGreater(min(hits.values()), 60, hits)

    @staticmethod
    def pixel(camera, position):
        """Where a point of W is in the picture, from the matrices that the page tells."""
        def times(matrix, vector):
            return [sum(matrix[4 * column + row] * vector[column] for column in range(4))
                    for row in range(4)]
        x, y, _, w = times(camera["projection"], times(camera["view"], [*position, 1]))
        return ((x / w + 1) / 2 * camera["width"], (1 - y / w) / 2 * camera["height"])

    def test_tells_scripts_where_points_are(self):
        camera = self.view("camera")
        x, y = self.pixel(camera, STILL_TOOL_W_M)
        told = self.run_script("return window.forcegridView.project(arguments[0])", STILL_TOOL_W_M)
        self.assertAlmostEqual(told["x"], x + camera["left"], places=3)
        self.assertAlmostEqual(told["y"], y + camera["top"], places=3)

    def test_counts_broken_messages_and_goes_on(self):
        before = self.view("broken_messages")
        whole = self.stand_in.block.frame(self.stand_in.epoch, 0.0, self.stand_in.block.quantised)
        bad = [whole[:40], whole[:-2], b"\x63" + whole[1:], b"", b"\x01\x00\xff\xff"]
        self.stand_in.loop.call_soon_threadsafe(
            lambda: [send(self.stand_in.sockets[0], 2, message) for message in bad])
        self.wait_until(lambda: self.view("broken_messages") == before + len(bad), "not counted")
        self.wait_for_frames(2)

    def test_shows_only_frames_of_the_newest_shape(self):
        self.stand_in.epoch = 77  # of its frames; no shape of this epoch was sent
        self.wait_until(lambda: self.frames_stand_still(), "frames of another epoch are shown")
        self.stand_in.loop.call_soon_threadsafe(
            lambda: send(self.stand_in.sockets[0], 2, self.stand_in.block.shape(77)))
        self.wait_for_frames(2)

    def frames_stand_still(self):
        before = self.view("frames")
        time.sleep(0.25)
        return self.view("frames") == before

    def in_module(self, module, text):
        """What a script returns that is given the exports of one of the page's modules."""
        return self.browser.execute_async_script(f"""const [done] = arguments;
            import('/{module}').then((module) => done((() => {{ {text} }})()),
                                     (error) => done(String(error)));""")

    def test_scales_colours_and_arrows_to_the_largest_of_some_seconds(self):
        ranges = self.in_module("scale.js", """const scale = new module.Scale(0.1);
            return [[0.02, 0], [2.2, 10], [6.1, 20], [2.9, 3000], [1, 5000], [1.4, 6900], [1, 7100],
                    [0, 20000], [0, 30000]].map(([value, ms]) => scale.update(value, ms));""")
        self.assertEqual(ranges, [0.1, 3, 7.5, 7.5, 3, 3, 3, 1, 0.1])

    def test_keeps_the_newest_rows_of_two_minutes(self):
        found = self.in_module("history.js", """const history = new module.History();
            history.reset(['time_s', 'force_N']);
            const rows = (first, count) => ({rows: count, columns: 2, base_s: first, values:
                Float32Array.from({length: 2 * count}, (_, i) => i % 2 ? first : (i >> 1) / 100)});
            for (let s = 0; s < 150; ++s) history.append(rows(s, 100));
            const kept = [history.rows, history.oldest_s, history.newest('force_N'),
                          history.time(history.row_at(100.004))];
            history.append(rows(3, 2));  // another run: the clock begins again
            return [...kept, history.rows, history.oldest_s, history.append({columns: 3})];""")
        for value, wanted in zip(found, [12000, 30, 149, 100.01, 2, 3]):
            self.assertAlmostEqual(value, wanted, places=5)
        self.assertIs(found[6], False, "rows with other columns are taken")

    # What the person does

    def test_stops_by_the_space_bar_wherever_the_focus_is(self):
        known = len(self.stand_in.commands)
        freeze = self.by_id("freeze")
        self.run_script("arguments[0].focus()", freeze)
        self.run_script("""window.seen = [];
            const status = document.getElementById('stop-status');
            new MutationObserver(() => window.seen.push([status.textContent, status.hidden]))
                .observe(status, {childList: true});""")
        self.assertFalse(self.view("stop_acknowledged"))
        freeze.send_keys(Keys.SPACE)
        self.command("stop", known)
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not acknowledged")
        seen = self.run_script("return window.seen")
        self.assertEqual(seen[0], ["stopping…", True], "the banner holds up the acknowledgement")
        self.assertTrue(seen[-1][0].startswith("stopped, acknowledged by the servo"), seen)
        self.assertFalse(seen[-1][1])
        self.assertEqual(freeze.get_attribute("aria-pressed"), "false",
                         "the button was pressed, too")
        self.wait_for_state("ended")
        self.wait_until(lambda: self.by_id("flags").text == "last values", "old values look new")

    def test_says_so_when_stop_is_refused(self):
        self.stand_in.refuse_stop = True
        self.by_id("stop").click()
        self.wait_until(lambda: "not stopped: the device" in self.by_id("stop-status").text,
                        "a refusal is not shown")
        self.assertFalse(self.view("stop_acknowledged"))
        self.stand_in.refuse_stop = False  # the page asks again by itself
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not repeated")

    def test_counts_a_note_that_comes_again(self):
        note = {"type": "note", "level": "warn", "component": "hand", "text": "nobody listens"}
        for _ in range(3):
            self.stand_in.say(note)
        long_text = "the last one " + 40 * "is long, "
        self.stand_in.say({**note, "level": "error", "text": long_text + "and ends"})
        newest = self.by_id("newest-note")
        self.wait_until(lambda: "the last one" in newest.text, "no note is shown")
        self.assertEqual(newest.get_attribute("data-level"), "error")
        notes = [item.get_attribute("textContent").strip()
                 for item in self.browser.find_elements(By.CSS_SELECTOR, "#note-list li")]
        self.assertEqual(notes[:2], [f"hand: {long_text}and ends",
                                     "hand: nobody listens (3 times)"])
        self.assertLessEqual(self.run_script("return document.documentElement.scrollWidth"), 1280)
        right = "return document.getElementById('stop').getBoundingClientRect().right"
        self.assertLessEqual(self.run_script(right), 1280, "a long note pushes stop out")

    def test_stops_without_a_picture_where_the_browser_has_no_webgl(self):
        add = "Page.addScriptToEvaluateOnNewDocument"
        script = self.browser.execute_cdp_cmd(add, {"source": """
            const getContext = HTMLCanvasElement.prototype.getContext;
            HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
              return /webgl/.test(kind) ? null : getContext.call(this, kind, ...rest);
            };"""})
        try:
            self.browser.get(self.stand_in.address)
            self.wait_for_state("live")
            self.assertIn("no WebGL 2", self.by_id("empty").text)
            self.wait_until(lambda: self.view("rows") > 20, "the scope gets no rows")
            self.by_id("stop").click()
            self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not acknowledged")
        finally:
            self.browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)

    def test_does_not_stop_the_next_run_for_a_stop_without_a_run(self):
        self.stand_in.stopped = True
        self.stand_in.say({"type": "end", "ended_by": "time", "exit_status": 0,
                           "text": "its time is up"})
        self.wait_for_state("ended")
        known = len(self.stand_in.commands)
        self.by_id("stop").click()
        self.assertEqual(self.by_id("stop-status").text, "the run has ended")
        self.command("stop", known)
        self.stand_in.commands.clear()
        self.stand_in.say({**HELLO, "role": "controller"})
        self.wait_for_state("waiting")
        self.assertFalse(self.by_id("stop-status").is_displayed())
        time.sleep(1.2)
        self.assertEqual([c for c in self.stand_in.commands if c["what"] == "stop"], [])

    def test_pauses_the_force_and_resumes_it(self):
        known = len(self.stand_in.commands)
        button = self.by_id("pause")
        button.click()
        self.assertIs(self.command("pause", known)["value"], True)
        self.wait_until(lambda: button.text == "Resume force", "the pause is not shown")
        self.assertEqual(button.get_attribute("aria-pressed"), "true")
        self.wait_until(lambda: "force paused" in self.by_id("flags").text, "no flag")
        self.stand_in.says_paused_by_held_back = True  # as a servo that has no column for it
        self.wait_until(lambda: self.by_id("flags").text.endswith("force paused"), "no flag")
        known = len(self.stand_in.commands)
        self.browser.find_element(By.TAG_NAME, "body").send_keys("p")
        self.assertIs(self.command("pause", known)["value"], False)
        self.wait_until(lambda: button.text == "Pause force", "the pause does not end")
        self.wait_until(lambda: "force paused" not in self.by_id("flags").text, "the flag stays")
        self.stand_in.says_paused_by_held_back = False

    def test_drags_the_hand_by_the_tool(self):
        self.still_tool()
        known = len(self.stand_in.commands)
        start = self.view(f"project({list(STILL_TOOL_W_M)})")
        self.run_script("""document.getElementById('scene').addEventListener(
            'pointerdown', (event) => { window.pointerId = event.pointerId; }, {once: true});""")
        x, y = round(start["x"]), round(start["y"])
        hand = ActionChains(self.browser, duration=8)
        hand.w3c_actions.pointer_action.move_to_location(x, y)
        hand.click_and_hold()
        for _ in range(17):
            hand.move_by_offset(5, 0).move_by_offset(0, -1)
        hand.perform()
        self.command("hand", known)
        camera, tool = self.view("camera"), STILL_TOOL_W_M
        targets = lambda: [command["target_W_m"] for command in self.stand_in.commands[known:]
                           if command["what"] == "hand"]
        end = (x + 85, y - 17)

        def arrived():
            at = self.pixel(camera, targets()[-1])
            return (abs(at[0] + camera["left"] - end[0]) < 2
                    and abs(at[1] + camera["top"] - end[1]) < 2)
        self.wait_until(arrived, "the target is not under the pointer")
        depth = lambda p: sum(camera["view"][4 * i + 2] * p[i] for i in range(3))
        for target in targets():
            self.assertAlmostEqual(depth(target), depth(tool), delta=1e-4, msg="not in the plane")
        known_targets = len(targets())
        self.run_script("""for (let i = 0; i < 40; ++i) {  // a mouse of some kHz
              document.getElementById('scene').dispatchEvent(new PointerEvent('pointermove', {
                pointerId: window.pointerId, buttons: 1, clientX: arguments[0] - i,
                clientY: arguments[1]}));
            }""", *end)
        end = (end[0] - 39, end[1])
        self.wait_until(arrived, "the newest target is not sent")
        self.assertLessEqual(len(targets()) - known_targets, 2, "more than 60 a second")
        ActionChains(self.browser).release().perform()
        self.wait_until(lambda: targets()[-1] is None, "the hand is not let go")
        self.clear_hand()

    def test_turns_the_picture_beside_the_tool_and_fits_it(self):
        before = self.view("camera")
        known = len(self.stand_in.commands)
        turn = ActionChains(self.browser)
        turn.w3c_actions.pointer_action.move_to_location(300, 600)
        turn.click_and_hold().move_by_offset(60, 0).release().perform()
        self.assertNotEqual(self.view("camera")["view"], before["view"])
        self.assertEqual([c for c in self.stand_in.commands[known:] if c["what"] == "hand"], [])
        turned = self.view("camera")["view"]
        self.by_id("scene").send_keys(Keys.ARROW_LEFT)
        self.assertNotEqual(self.view("camera")["view"], turned)
        self.browser.find_element(By.TAG_NAME, "body").send_keys("o")
        self.assertEqual(self.by_id("follow").get_attribute("aria-pressed"), "true")
        self.by_id("follow").click()
        self.by_id("fit").click()
        fitted = self.view("camera")
        corners = [self.pixel(fitted, p) for p in self.stand_in.block.rest]
        self.assertGreater(min(min(p) for p in corners), 0)
        self.assertLess(max(x for x, _ in corners), before["width"])

    def test_lets_a_viewer_stop_and_nothing_else(self):
        self.stand_in.say({"type": "role", "role": "viewer"})
        take = self.by_id("take-control")
        self.wait_until(take.is_displayed, "a viewer cannot take control")
        self.assertFalse(self.by_id("pause").is_enabled())
        self.assertTrue(self.by_id("stop").is_enabled())
        self.still_tool()
        known = len(self.stand_in.commands)
        start = self.view(f"project({list(STILL_TOOL_W_M)})")
        hand = ActionChains(self.browser, duration=50)
        hand.w3c_actions.pointer_action.move_to_location(round(start["x"]), round(start["y"]))
        hand.click_and_hold().move_by_offset(30, 0).release().perform()
        take.click()
        self.command("take_control", known)
        others = [c for c in self.stand_in.commands[known:] if c["what"] in ("hand", "pause")]
        self.assertEqual(others, [])
        self.wait_until(self.by_id("pause").is_enabled, "the role does not change")
        self.clear_hand()
        self.by_id("fit").click()

    def open_settings(self):
        self.run_script("document.getElementById('settings').open = true")
        return lambda name: self.browser.find_element(By.CSS_SELECTOR, f"[data-setting={name}]")

    def close_settings(self):
        self.run_script("document.getElementById('settings').open = false")

    def test_changes_settings_and_shows_how_the_run_says_they_stand(self):
        row = self.open_settings()
        known = len(self.stand_in.commands)
        number = row("delay_ms").find_element(By.CSS_SELECTOR, "input[type=number]")
        number.send_keys(Keys.CONTROL, "a")
        number.send_keys("150", Keys.ENTER)
        asked = self.command("set", known)
        self.assertEqual((asked["name"], asked["value"]), ("delay_ms", 150))
        self.wait_until(lambda: self.view("setting('delay_ms')") == 150, "delay is not shown")
        with self.subTest("a slider, a choice and no limit"):
            self.run_script("""const slider = arguments[0].querySelector('input[type=range]');
                slider.value = 40;
                slider.dispatchEvent(new Event('input'));
                slider.dispatchEvent(new Event('change'));""", row("requests_per_s"))
            self.wait_until(lambda: self.view("setting('requests_per_s')") == 40, "no slider")
            self.run_script("""const list = arguments[0].querySelector('select');
                list.value = 'arm'; list.dispatchEvent(new Event('change'));""", row("hand"))
            self.wait_until(lambda: self.view("setting('hand')") == "arm", "no other hand")
            no_limit = row("budget_us").find_element(By.CSS_SELECTOR, "input[type=checkbox]")
            self.assertTrue(no_limit.is_selected())
            no_limit.click()
            self.wait_until(lambda: self.view("setting('budget_us')") == 1000, "no budget")
            no_limit.click()
            self.wait_until(lambda: self.view("setting('budget_us')") is None, "still a budget")
        with self.subTest("a refusal puts back what holds"):
            number.send_keys(Keys.CONTROL, "a")
            number.send_keys("666", Keys.ENTER)
            self.wait_until(lambda: "refuses" in self.by_id("newest-note").text, "no refusal")
            self.wait_until(lambda: number.get_property("value") == "150", "it is not put back")
        with self.subTest("what can't be changed says why"):
            rate = row("simulator_rate_Hz")
            self.assertIn("did not start the simulator", rate.text)
            self.assertFalse(rate.find_element(By.CSS_SELECTOR, "input").is_enabled())
        with self.subTest("what the servo measures"):
            measured = self.by_id("settings-measured")
            self.wait_until(lambda: "requests/s" in measured.text, "nothing is measured")
            self.assertAlmostEqual(self.view("measured")["arrivals_per_s"], 60, delta=6)
            self.assertIn("no limit of the budget", measured.text)
        with self.subTest("it waits for the answer"):
            self.stand_in.answers_settings = False
            number.send_keys(Keys.CONTROL, "a")
            number.send_keys("20", Keys.ENTER)
            self.wait_until(lambda: row("delay_ms").get_attribute("aria-busy") == "true", "no wait")
            self.assertEqual(self.view("setting('delay_ms')"), 150)
            self.stand_in.answers_settings = True
        self.stand_in.hurt = True
        self.close_settings()

    def test_stops_by_the_space_bar_while_a_number_is_typed(self):
        row = self.open_settings()
        number = row("delay_ms").find_element(By.CSS_SELECTOR, "input[type=number]")
        known = len(self.stand_in.commands)
        number.send_keys("1", Keys.SPACE)
        self.command("stop", known)
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not acknowledged")

    def test_shows_a_wall_the_contact_point_and_requests(self):
        self.still_tool()
        contact = self.view("contact")
        self.assertEqual(contact["epoch"], 7)
        self.assertGreater(contact["requested"], 3)
        self.clear_hand()
        self.wait_until(lambda: self.view("contact")["point_W_m"], "no contact")
        self.assertAlmostEqual(self.view("contact")["point_W_m"][2], 0.05, places=6)
        self.assertIsNone(self.view("wall_m"))
        self.view("set('wall_mm', 14)")
        self.wait_until(lambda: self.view("wall_m") == 0.014, "there is no wall")
        self.view("set('wall_mm', null)")
        self.wait_until(lambda: self.view("wall_m") is None, "the wall stays")

    def check(self, name, checked):
        """Sets a box of the menu Show."""
        self.run_script("""const box = document.getElementById(arguments[0]);
            if (box.checked !== arguments[1]) box.click();""", name, checked)

    def test_shows_the_blocks_of_storage_on_demand(self):
        self.assertEqual(self.view("blocks"), {"drawn": [], "in_use": None})
        known = len(self.stand_in.commands)
        self.check("blocks", True)
        self.assertIs(self.command("layers", known)["blocks"], True)
        self.wait_until(lambda: self.view("blocks")["drawn"] == [1, 1, 2], "no blocks are drawn")
        self.assertEqual(self.run_script("""return document.getElementById('blocks-count')
            .textContent"""), "(5)")
        ends, inside_too = self.in_module("blocks.js", """
            const blocks = new module.Blocks();
            const one = new ArrayBuffer(28);
            new Uint32Array(one)[0] = 1;
            new Float32Array(one).set([1, 2, 4, 11, 22, 44], 1);
            blocks.show({count: 1, in_use: 1, methods: new Uint32Array(one),
                         values: new Float32Array(one)});
            return [Array.from(blocks.lines.geometry.attributes.position.array),
                    blocks.lines.children.map((child) => !child.material.depthTest &&
                        child.geometry === blocks.lines.geometry)];""")
        self.assertEqual(inside_too, [True], "the object hides what is inside of it")
        lines = {frozenset((tuple(ends[i:i + 3]), tuple(ends[i + 3:i + 6])))
                 for i in range(0, len(ends), 6)}
        self.assertEqual(lines, {frozenset((a, b)) for a in BOX for b in BOX
                                 if sum(x != y for x, y in zip(a, b)) == 1})
        known = len(self.stand_in.commands)
        self.check("blocks", False)
        self.assertIs(self.command("layers", known)["blocks"], False)
        self.assertEqual(self.view("blocks"), {"drawn": [], "in_use": None})

    def test_draws_the_compass_when_the_camera_turns(self):
        self.run_script("""
            window.compasses = 0;
            const canvas = document.getElementById('compass');
            const clear = CanvasRenderingContext2D.prototype.clearRect;
            CanvasRenderingContext2D.prototype.clearRect = function(...sides) {
              window.compasses += this.canvas === canvas ? 1 : 0;
              return clear.apply(this, sides);
            };""")
        self.wait_for_frames(8)
        self.assertEqual(self.run_script("return compasses"), 0, "the camera stands still")
        for key in (Keys.ARROW_LEFT, Keys.ARROW_RIGHT):  # and back, for the other tests
            known = self.run_script("return compasses")
            self.by_id("scene").send_keys(key)
            self.wait_until(lambda: self.run_script("return compasses") > known, "it does not turn")

    def test_tells_late_pictures_from_those_in_time(self):
        late = self.in_module("scene3d.js", """
            const scene = {intervals: [], late: false, scale_is_fixed: true};
            const judged = (times) => {
              times.forEach((ms) => module.Scene3d.prototype.judge.call(scene, ms, 0));
              return scene.late;
            };
            const in_time = Array(12).fill(33);
            return [judged(in_time), judged([...in_time.slice(1), 90]), judged(in_time),
                    judged(Array(12).fill(40)), judged(in_time.slice(1)), judged([33])];""")
        # All in time; one far too late; again in time; each a little late; not judged yet; in time.
        self.assertEqual(late, [False, True, False, True, True, False])

    def test_knows_how_long_its_parts_take(self):
        self.view("clear_times()")
        self.wait_for_frames(10)
        times = self.view("times")
        for part in ("surface", "scene", "scope", "readouts", "rows waited"):
            self.assertGreater(times[part]["times"], 0, part)
            self.assertLessEqual(times[part]["p50_ms"], times[part]["p99_ms"], part)
            self.assertLessEqual(times[part]["p99_ms"], times[part]["most_ms"], part)
        counted = self.in_module("part_times.js", """
            const times = new module.PartTimes();
            for (let ms = 1; ms <= 200; ++ms) {
              times.add('a', ms);
            }
            return [times.measure('b', () => 7), times.summary.a, times.summary.b.times];""")
        self.assertEqual((counted[0], counted[2]), (7, 1))
        self.assertEqual(counted[1], {"times": 200, "mean_ms": 100.5, "p50_ms": 101, "p99_ms": 199,
                                      "most_ms": 200})

    def inside_text(self):
        return self.run_script("return document.getElementById('inside-count').textContent")

    def test_shows_what_is_inside_on_demand(self):
        nothing = {"springs": 0, "element_edges": 0, "edges": 0, "drawn": 0, "frames": 0,
                   "length_m": 0, "opened": False}
        self.assertEqual(self.view("inside"), nothing)
        known = len(self.stand_in.commands)
        self.check("inside", True)
        self.assertEqual(
            {key: self.command("layers", known)[key] for key in ("blocks", "inside")},
            {"blocks": False, "inside": True})
        self.wait_until(lambda: self.view("inside")["edges"] == 4, "no lines are drawn")
        shown = self.view("inside")
        self.assertAlmostEqual(shown.pop("length_m"), 0.03 + 0.04 + 0.05 + 0.01, delta=4e-6)
        del shown["drawn"]  # where the tool is, and so the section, depends on the time
        self.assertEqual(shown, {"springs": 3, "element_edges": 1, "edges": 4, "frames": 1,
                                 "opened": True})
        self.assertEqual(self.inside_text(), "(3 springs, 1 edges of tetrahedra)")
        box = self.by_id("inside")
        self.run_script("document.getElementById('layers').open = true")
        self.assertEqual((box.accessible_name, box.get_attribute("aria-describedby")),
                         ("Inside", "inside-count"))
        known = len(self.stand_in.commands)
        box.send_keys(Keys.ENTER)  # space is stop
        self.wait_until(lambda: self.view("inside") == nothing, "the lines stay")
        self.assertIs(self.command("layers", known)["inside"], False)
        self.assertEqual(self.inside_text(), "")
        self.run_script("document.getElementById('layers').open = false")

    def test_draws_the_lines_at_the_section_and_near_behind_it(self):
        drawn = self.in_module("inside.js", """
            const insides = new module.Insides();
            insides.section.active = true;
            // Edges of 10 mm along x, from x = 0 on, and one of 10 mm across at each end.
            const xs = Array.from({length: 11}, (_, i) => i);
            const ends = Uint32Array.from(xs.slice(0, 10).flatMap((i) => [i, i + 1])
                .concat(xs.flatMap((i) => [i, 11 + i])));
            insides.set_lines({object: 0, epoch: 1, vertices: 22, springs: 21, element_edges: 0,
                               ends});
            const values = Uint16Array.from([0, 1].flatMap((y) => xs.flatMap((i) => [i, y, 0])));
            insides.set_frame({object: 0, epoch: 1, vertices: 22, low: [0, 0, 0],
                               step: [0.01, 0.01, 0.01], values});
            const inside = insides.objects.get(0);
            const pairs = (section) => {
              insides.section.uniform.value.set(...section);
              inside.select();
              const {array} = inside.near;
              return Array.from({length: inside.drawn}, (_, i) => [array[2 * i], array[2 * i + 1]]);
            };
            return [pairs([1, 0, 0, 0.055]), pairs([-1, 0, 0, -0.005]), pairs([1, 0, 0, 1])];""")
        # An edge's mean length is 10 mm: lines end 20 mm behind the plane, which is at x = 55 mm.
        self.assertEqual(sorted(drawn[0]),
                         sorted([[3, 4], [4, 5], [5, 6], [4, 15], [5, 16]]))
        # Seen from the other side, with the plane at x = 5 mm.
        self.assertEqual(sorted(drawn[1]),
                         sorted([[0, 1], [1, 2], [2, 3], [1, 12], [2, 13]]))
        self.assertEqual(drawn[2], [], "all are a metre behind it")

    def test_says_that_an_object_has_too_many_lines(self):
        self.check("inside", True)
        self.wait_until(lambda: self.view("inside")["edges"] == 4, "no lines are drawn")
        self.stand_in.loop.call_soon_threadsafe(
            self.stand_in.send_all, lines_message(2, 0, 400_000, 0, []))
        self.wait_until(lambda: self.view("inside")["edges"] == 0, "lines of another epoch stay")
        self.assertEqual(self.inside_text(), "(400,000 springs: too many, at most 300,000 of an "
                         "object are shown)")
        self.check("inside", False)

    def test_says_that_a_simulator_sends_no_inside(self):
        self.stand_in.sends_inside = False
        self.check("inside", True)
        self.assertEqual(self.inside_text(), "")
        self.wait_until(lambda: self.inside_text() == "(its simulator sends none)", "it waits on")
        self.stand_in.sends_inside = True
        self.check("inside", False)

    def test_has_the_words_of_its_boxes_beside_them(self):
        distances_px = self.run_script("""
            const menu = document.getElementById('layers');
            const was_open = menu.open;
            menu.open = true;
            const range = document.createRange();
            const found = [...menu.querySelectorAll('label > input[type=checkbox]')].map((box) => {
              range.selectNodeContents(box.nextSibling);
              return range.getBoundingClientRect().left - box.getBoundingClientRect().right;
            });
            menu.open = was_open;
            return found;""")
        self.assertGreaterEqual(len(distances_px), 8)
        for distance_px in distances_px:
            self.assertTrue(0 <= distance_px <= 16, distances_px)

    def test_colours_by_strain_too(self):
        rest = self.in_module("surface.js", """
            const surface = new module.Surface({object: 0, epoch: 1, vertices: 3, triangles: 1,
                rest_W_m: Float32Array.of(0, 0, 0, 0.1, 0, 0, 0, 0.1, 0),
                corners: Uint32Array.of(0, 1, 2)});
            surface.set_colouring('strain');
            // One edge grows from 0.1 m to 0.12 m, one stays, the third grows with the first.
            surface.update({epoch: 1, vertices: 3, low: [0, 0, 0], step: [1e-5, 1e-5, 1e-5],
                            values: Uint16Array.of(0, 0, 0, 12000, 0, 0, 0, 10000, 0)}, 0);
            return Array.from(surface.strains);""")
        for found, wanted in zip(rest, [0.2, 0.2, math.hypot(0.12, 0.1) / math.hypot(0.1, 0.1) - 1]):
            self.assertAlmostEqual(found, wanted, places=4)
        self.run_script("""document.getElementById('layers').open = true;
            const list = document.getElementById('colouring');
            list.value = 'strain'; list.dispatchEvent(new Event('change'));""")
        self.wait_until(lambda: "strain" in self.by_id("colours").text, "the legend stays")
        self.assertTrue(self.by_id("scale-top").text.endswith("%"))
        self.run_script("""const list = document.getElementById('colouring');
            list.value = 'displacement'; list.dispatchEvent(new Event('change'));
            document.getElementById('layers').open = false;""")

    def test_leads_through_the_tour(self):
        self.assertFalse(self.by_id("tour").is_displayed())
        self.stand_in.tour = True
        self.browser.get(self.stand_in.address)
        self.wait_for_state("live")
        self.wait_until(lambda: self.view("tour_ready"), "the first step is not set up")
        self.assertEqual(self.view("tour_step"), "streaming")
        self.assertEqual(self.by_id("tour-place").text, "Step 1 of 6")
        self.wait_until(lambda: self.stand_in.method == METHODS.index("hold"), "not hold")
        self.assertFalse(self.by_id("tour-back").is_enabled())
        steps = []
        for _ in range(5):
            self.by_id("tour-next").click()
            self.wait_until(lambda: self.view("tour_ready"), "the next step is not set up")
            steps.append(self.view("tour_step"))
            self.assertGreater(len(self.by_id("tour-text").text), 100)
        self.assertEqual(steps, ["grid", "auto", "wall", "cut", "delay"])
        self.wait_until(lambda: self.view("setting('delay_ms')") == 150, "there is no delay")
        self.assertEqual(self.view("setting('cut')"), "no")
        self.by_id("tour-back").click()
        self.wait_until(lambda: self.view("setting('cut')") == "yes", "nothing is cut")
        self.assertEqual(self.view("setting('delay_ms')"), 0)
        self.by_id("tour-stay").click()
        self.assertEqual(self.by_id("tour-stay").get_attribute("aria-pressed"), "true")
        self.by_id("tour-quit").click()
        self.assertFalse(self.by_id("tour").is_displayed())
        self.assertIsNone(self.view("tour_step"))
        self.stand_in.hurt = True

    def test_goes_on_with_the_tour_by_itself(self):
        self.stand_in.tour = True
        self.browser.get(self.stand_in.address + "&step_s=0.4")
        steps = ["streaming", "grid", "auto", "wall", "cut", "delay"]
        self.wait_until(lambda: self.view("tour_visited") == steps, "the tour does not go on")
        self.wait_until(lambda: not self.by_id("tour").is_displayed(), "the tour does not end")
        self.stand_in.hurt = True

    def test_freezes_zooms_and_follows_the_scope(self):
        self.wait_until(lambda: self.view("rows") > 100, "the scope gets no rows")
        chart = self.browser.find_element(By.CSS_SELECTOR, "[data-panel=position] .chart")
        freeze = self.by_id("freeze")
        zoom = ActionChains(self.browser, duration=100)
        zoom.move_to_element_with_offset(chart, -60, 0).click_and_hold().move_by_offset(120, 0)
        zoom.release().perform()
        self.wait_until(lambda: freeze.text == "Follow", "a zoom does not freeze the scope")
        freeze.click()
        self.wait_until(lambda: freeze.text == "Freeze", "the scope does not follow")
        chip = self.browser.find_element(By.CSS_SELECTOR, "[data-chip=energy]")
        chip.click()
        energy = self.browser.find_element(By.CSS_SELECTOR, "[data-panel=energy] .chart canvas")
        self.assertTrue(energy.is_displayed())
        chip.click()

    def test_saves_rows_as_csv_and_a_picture_as_png(self):
        self.wait_until(lambda: self.view("rows") > 100, "the scope gets no rows")
        folder = pathlib.Path(self.folder.name)
        self.by_id("freeze").click()
        self.by_id("csv").click()
        saved = self.wait_until(lambda: list(folder.glob("forcegrid_*.csv")), "no CSV is saved")[0]
        lines = [line.split(",") for line in saved.read_text().splitlines()]
        self.assertEqual(lines[0], COLUMNS)
        self.assertGreater(len(lines), 50)
        times = [float(line[0]) for line in lines[1:]]
        self.assertAlmostEqual(times[1] - times[0], 0.01, places=6)
        self.assertEqual(times, sorted(times))
        row = self.stand_in.sent_rows[round(100 * times[5])]
        for name in ("position_y_mm", "method1_z_N", "period_max_us"):
            column = COLUMNS.index(name)
            self.assertAlmostEqual(float(lines[6][column]), row[column],
                                   delta=1e-5 * abs(row[column]) + 1e-6)
        self.assertEqual(lines[6][COLUMNS.index("method3_x_N")], "", "no number stands for none")
        self.by_id("freeze").click()
        self.by_id("png").click()
        saved = self.wait_until(lambda: list(folder.glob("forcegrid_*.png")), "no PNG is saved")[0]
        main = self.browser.find_element(By.TAG_NAME, "main").rect
        self.assertEqual(int.from_bytes(saved.read_bytes()[16:20], "big"), main["width"])

    # For everybody

    def test_names_every_control(self):
        tree = self.browser.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
        roles = ("button", "checkbox", "combobox", "link", "textbox", "slider", "img", "image",
                 "figure", "application")
        controls = [(node["role"]["value"], node.get("name", {}).get("value", "").strip())
                    for node in tree if not node.get("ignored") and node["role"]["value"] in roles]
        self.assertGreater(len(controls), 20)
        self.assertEqual([role for role, name in controls if not name], [])
        self.assertTrue(any(name.startswith("Stop") for _, name in controls), controls)

    def test_has_contrast_in_both_themes(self):
        self.by_id("help-open").click()
        self.stand_in.say({"type": "note", "level": "warn", "component": "link",
                           "text": "a warning"})
        self.wait_until(lambda: "a warning" in self.by_id("newest-note").text, "no note is shown")
        themes = set()
        for _ in range(2):
            self.by_id("theme").click()
            themes.add(self.run_script("return document.documentElement.dataset.theme"))
            found = self.run_script(CONTRAST)
            self.assertGreater(found["seen"], 40)
            self.assertEqual(found["poor"], [])
        self.assertEqual(themes, {"dark", "light"})
        self.by_id("help-close").click()

    def test_lays_nothing_over_anything_else(self):
        self.still_tool()
        self.stand_in.hand = (0.02, 0.03, 0.02)
        self.wait_until(lambda: self.view("in_contact"), "no contact")
        self.stand_in.say({"type": "note", "level": "warn", "component": "link", "text":
                           "a sentence that is longer than what a narrow window can show at once"})
        self.run_script("""document.getElementById('colours').hidden = false;
            document.getElementById('field-scale').hidden = false;""")
        for width, height in SIZES_PX:
            with self.subTest(f"{width} x {height}"):
                self.size(width, height)
                found = self.wait_until(
                    lambda: self.run_script("return innerWidth") == width and
                    self.run_script(OVERLAPS), "the window keeps its size")
                self.assertGreater(found["seen"], 30)
                self.assertEqual(found["found"], [])
        self.stand_in.hurt = True

    def test_keeps_stop_in_sight_in_a_narrow_window(self):
        self.size(400, 800)
        reachable = """const at = document.getElementById('stop').getBoundingClientRect();
            const found = document.elementFromPoint(at.x + at.width / 2, at.y + at.height / 2);
            return at.left >= 0 && at.right <= innerWidth && at.bottom <= innerHeight &&
                   at.height >= 44 && found.closest('#stop') !== null;"""
        for y in (0, 100000):
            self.run_script("scrollTo(0, arguments[0])", y)
            self.assertTrue(self.run_script(reachable), f"stop is hidden at {y}")
        self.assertLessEqual(self.run_script("return document.documentElement.scrollWidth"), 400)
        self.assertTrue(self.run_script("""
            const place = (id) => document.getElementById(id).getBoundingClientRect();
            return place('numbers').bottom <= place('stop').top;"""),
                        "stop hides the end of the page")
        known = len(self.stand_in.commands)
        self.by_id("stop").click()
        self.command("stop", known)
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not acknowledged")

    def test_comes_back_when_the_server_does(self):
        self.lost_is_expected = True
        port = self.stand_in.port
        self.stand_in.close()
        self.wait_for_state("lost")
        self.by_id("stop").click()
        self.assertIn("not sent yet", self.by_id("stop-status").text)
        type(self).stand_in = StandIn(vertices=600, port=port, pictures_per_s=PICTURES_PER_S)
        self.wait_until(lambda: self.view("vertices") == len(self.stand_in.block.rest),
                        "the new surface is not shown")
        self.command("stop")
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not sent afterwards")


def colourfulness(colour):
    return max(colour) - min(colour)


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
