# SPDX-License-Identifier: Apache-2.0
"""Layers that a person chooses: blocks of storage, what is inside of the objects."""
from browser import webdriver
from page_case import PageCase
from stand_in_server import lines_message

if webdriver:
    from selenium.webdriver.common.keys import Keys

BOX = [(x, y, z) for x in (1, 11) for y in (2, 22) for z in (4, 44)]  # corners


class Layers(PageCase):
    def inside_text(self):
        return self.script("return document.getElementById('inside-count').textContent")

    def test_shows_the_blocks_of_storage_on_demand(self):
        self.assertEqual(self.view("blocks"), {"drawn": [], "in_use": None})
        known = len(self.stand_in.commands)
        self.check("blocks", True)
        self.assertIs(self.command("layers", known)["blocks"], True)
        self.wait_until(lambda: self.view("blocks")["drawn"] == [1, 1, 2], "no blocks are drawn")
        self.assertEqual(self.script("""return document.getElementById('blocks-count')
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
        self.script("document.getElementById('layers').open = true")
        self.assertEqual((box.accessible_name, box.get_attribute("aria-describedby")),
                         ("Inside", "inside-count"))
        known = len(self.stand_in.commands)
        box.send_keys(Keys.ENTER)  # space is stop
        self.wait_until(lambda: self.view("inside") == nothing, "the lines stay")
        self.assertIs(self.command("layers", known)["inside"], False)
        self.assertEqual(self.inside_text(), "")
        self.script("document.getElementById('layers').open = false")

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
        distances_px = self.script("""
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
