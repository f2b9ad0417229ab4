# SPDX-License-Identifier: Apache-2.0
"""What the page shows of a run: surface, scope, readouts, files."""
import base64
import math
import pathlib
import random
import time

from browser import webdriver
from page_case import COARSE, STILL_TOOL_W_M, PageCase
from picture import Picture, depth_inside, outline
from stand_in_server import COLUMNS, HELLO, send

if webdriver:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys


class Shown(PageCase):
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
        self.script("document.getElementById('layers').open = true")
        for box in boxes:
            box.click()
        self.script("document.getElementById('layers').open = false")
        positions = self.stand_in.block.sheared(0.03)
        self.stand_in.hand = (0.0, 0.0, -0.02)  # inside of the block
        self.stand_in.freeze(positions)
        self.view("fix_scale(1)")
        self.wait_for_frames(4)
        camera = self.view("camera")
        huds = """document.querySelectorAll('.hud').forEach(
            (element) => { element.style.visibility = arguments[0]; })"""
        self.script(huds, "hidden")
        clip = {"x": camera["left"], "y": camera["top"], "width": camera["width"],
                "height": camera["height"], "scale": 1}
        shot = self.browser.execute_cdp_cmd("Page.captureScreenshot",
                                            {"format": "png", "clip": clip})
        picture = Picture(base64.b64decode(shot["data"]))
        self.script(huds, "visible")
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
        self.script("document.getElementById('layers').open = true")
        for box in boxes:
            box.click()
        self.script("document.getElementById('layers').open = false")

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

    def test_tells_scripts_where_points_are(self):
        camera = self.view("camera")
        x, y = self.pixel(camera, STILL_TOOL_W_M)
        told = self.script("return window.forcegridView.project(arguments[0])", STILL_TOOL_W_M)
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
        self.stand_in.hurt = True  # the page goes on counting

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

    def test_draws_the_compass_when_the_camera_turns(self):
        self.script("""
            window.compasses = 0;
            const canvas = document.getElementById('compass');
            const clear = CanvasRenderingContext2D.prototype.clearRect;
            CanvasRenderingContext2D.prototype.clearRect = function(...sides) {
              window.compasses += this.canvas === canvas ? 1 : 0;
              return clear.apply(this, sides);
            };""")
        self.wait_for_frames(8)
        self.assertEqual(self.script("return compasses"), 0, "the camera stands still")
        for key in (Keys.ARROW_LEFT, Keys.ARROW_RIGHT):  # and back, for the other tests
            known = self.script("return compasses")
            self.by_id("scene").send_keys(key)
            self.wait_until(lambda: self.script("return compasses") > known, "it does not turn")

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
        self.script("""document.getElementById('layers').open = true;
            const list = document.getElementById('colouring');
            list.value = 'strain'; list.dispatchEvent(new Event('change'));""")
        self.wait_until(lambda: "strain" in self.by_id("colours").text, "the legend stays")
        self.assertTrue(self.by_id("scale-top").text.endswith("%"))
        self.script("""const list = document.getElementById('colouring');
            list.value = 'displacement'; list.dispatchEvent(new Event('change'));
            document.getElementById('layers').open = false;""")

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


def colourfulness(colour):
    return max(colour) - min(colour)
