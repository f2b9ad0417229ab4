# SPDX-License-Identifier: Apache-2.0
"""What a person does with a run: stop, pause, hand, settings, tour."""
import time

from browser import webdriver
from page_case import PICTURES_PER_S, STILL_TOOL_W_M, PageCase
from stand_in_server import HELLO, METHODS, StandIn

if webdriver:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys


class Controls(PageCase):
    def test_stops_by_the_space_bar_wherever_the_focus_is(self):
        known = len(self.stand_in.commands)
        freeze = self.by_id("freeze")
        self.script("arguments[0].focus()", freeze)
        self.script("""window.seen = [];
            const status = document.getElementById('stop-status');
            new MutationObserver(() => window.seen.push([status.textContent, status.hidden]))
                .observe(status, {childList: true});""")
        self.assertFalse(self.view("stop_acknowledged"))
        freeze.send_keys(Keys.SPACE)
        self.command("stop", known)
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not acknowledged")
        seen = self.script("return window.seen")
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
        self.assertLessEqual(self.script("return document.documentElement.scrollWidth"), 1280)
        right = "return document.getElementById('stop').getBoundingClientRect().right"
        self.assertLessEqual(self.script(right), 1280, "a long note pushes stop out")

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

    def test_stops_by_the_space_bar_while_a_number_is_typed(self):
        row = self.open_settings()
        number = row("delay_ms").find_element(By.CSS_SELECTOR, "input[type=number]")
        known = len(self.stand_in.commands)
        number.send_keys("1", Keys.SPACE)
        self.command("stop", known)
        self.wait_until(lambda: self.view("stop_acknowledged"), "stop is not acknowledged")

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
        self.script("""document.getElementById('scene').addEventListener(
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
        self.script("""for (let i = 0; i < 40; ++i) {  // a mouse of some kHz
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
        self.script("document.getElementById('settings').open = true")
        return lambda name: self.browser.find_element(By.CSS_SELECTOR, f"[data-setting={name}]")

    def close_settings(self):
        self.script("document.getElementById('settings').open = false")

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
            self.script("""const slider = arguments[0].querySelector('input[type=range]');
                slider.value = 40;
                slider.dispatchEvent(new Event('input'));
                slider.dispatchEvent(new Event('change'));""", row("requests_per_s"))
            self.wait_until(lambda: self.view("setting('requests_per_s')") == 40, "no slider")
            self.script("""const list = arguments[0].querySelector('select');
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
