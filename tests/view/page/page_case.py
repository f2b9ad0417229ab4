# SPDX-License-Identifier: Apache-2.0
"""What the tests of the page share: it is in a browser, before a server that stands in for the
live view's."""
import time

from browser import BrowserCase, webdriver
from stand_in_server import StandIn

if webdriver:
    from selenium.webdriver.common.by import By

PATIENCE_S = 60
# Pictures are drawn by the processor that the other tests use, too.
PICTURES_PER_S = 10
COARSE = 0.25
STILL_TOOL_W_M = (0.02, 0.03, 0.06)


class PageCase(BrowserCase):
    stand_in = None

    @classmethod
    def tearDownClass(cls):
        super().tearDownClass()
        cls.stand_in.close()

    def setUp(self):
        self.size(1280, 720)
        self.lost_is_expected = False
        if self.stand_in is None or self.stand_in.stopped or self.stand_in.hurt:
            if self.stand_in:
                self.stand_in.close()
            type(self).stand_in = StandIn(vertices=1500, pictures_per_s=PICTURES_PER_S)
            self.browser.get(self.stand_in.address)
            self.script("window.forcegridView.fix_scale(arguments[0])", COARSE)
            self.wait_for_state("live")
        self.failed_before = self.failed_tests()

    def tearDown(self):
        expected = ("WebSocket connection",) if self.lost_is_expected else ()
        errors = self.console_errors(*expected)
        self.stand_in.hurt |= bool(errors) or self.failed_tests() > self.failed_before
        self.assertEqual(errors, [], "the browser's console has errors")

    def failed_tests(self):
        return len(self._outcome.result.failures) + len(self._outcome.result.errors)

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
        return self.script("return document.body.dataset.state")

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

    @staticmethod
    def pixel(camera, position):
        """Where a point of W is in the picture, from the matrices that the page tells."""
        def times(matrix, vector):
            return [sum(matrix[4 * column + row] * vector[column] for column in range(4))
                    for row in range(4)]
        x, y, _, w = times(camera["projection"], times(camera["view"], [*position, 1]))
        return ((x / w + 1) / 2 * camera["width"], (1 - y / w) / 2 * camera["height"])

    def in_module(self, module, text):
        """What a script returns that is given the exports of one of the page's modules."""
        return self.browser.execute_async_script(f"""const [done] = arguments;
            import('/{module}').then((module) => done((() => {{ {text} }})()),
                                     (error) => done(String(error)));""")

    def check(self, name, checked):
        """Sets a box of the menu Show."""
        self.script("""const box = document.getElementById(arguments[0]);
            if (box.checked !== arguments[1]) box.click();""", name, checked)
