# SPDX-License-Identifier: Apache-2.0
"""What makes the page usable for everybody: names, contrast, sizes of windows."""
from layout_checks import CONTRAST, OVERLAPS, SIZES_PX
from page_case import PageCase


class Everybody(PageCase):
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
            themes.add(self.script("return document.documentElement.dataset.theme"))
            found = self.script(CONTRAST)
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
        self.script("""document.getElementById('colours').hidden = false;
            document.getElementById('field-scale').hidden = false;""")
        for width, height in SIZES_PX:
            with self.subTest(f"{width} x {height}"):
                self.size(width, height)
                found = self.wait_until(
                    lambda: self.script("return innerWidth") == width and
                    self.script(OVERLAPS), "the window keeps its size")
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
            self.script("scrollTo(0, arguments[0])", y)
            self.assertTrue(self.script(reachable), f"stop is hidden at {y}")
        self.assertLessEqual(self.script("return document.documentElement.scrollWidth"), 400)
        self.assertTrue(self.script("""
            const place = (id) => document.getElementById(id).getBoundingClientRect();
            return place('numbers').bottom <= place('stop').top;"""),
                        "stop hides the end of the page")
        known = len(self.stand_in.commands)
        self.by_id("stop").click()
        self.command("stop", known)
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not acknowledged")
