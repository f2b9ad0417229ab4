#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Is each docs/pictures/NAME.svg what its NAME.dot gives?
usage: pictures_test.py SOURCE_FOLDER"""
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(sys.argv[1])
PICTURES = ROOT / "docs/pictures"


def drawing(svg):
    """What is drawn: without comments, which name Graphviz's version, coordinates to whole points."""
    text = re.sub(r"<!--.*?-->", "", svg.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"-?\d+\.\d+", lambda number: str(round(float(number.group()))), text).split("\n")


class Pictures(unittest.TestCase):
    def test_are_drawn_from_their_sources(self):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([PICTURES / "draw.sh", folder], check=True)
            drawn = sorted(pathlib.Path(folder).glob("*.svg"))
            self.assertGreaterEqual(len(drawn), 5)
            self.assertEqual([svg.name for svg in drawn],
                             [svg.name for svg in sorted(PICTURES.glob("*.svg"))])
            for svg in drawn:
                with self.subTest(picture=svg.name):
                    self.assertEqual(drawing(svg), drawing(PICTURES / svg.name), "run: make pictures")

    def test_show_only_arrows_between_rooms_that_include_each_other(self):
        page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
        permitted = {}
        for room, entries in re.findall(r"^\| `([\w/]+)/` \| (.*) \|$", page, re.MULTILINE):
            for entry in re.findall(r"`([\w/.]+)`", entries):
                # The picture shows top folders: any of their rooms may be the one that includes.
                for name in (room.split("/")[0], room):
                    permitted.setdefault(name, set()).update(
                        (entry.split("/")[0], entry.rpartition("/")[0]))
        for name, prefix in (("house", ""), ("simulator_rooms", "simulator/")):
            source = (PICTURES / (name + ".dot")).read_text(encoding="utf-8")
            arrows = []
            for chain in re.findall(r"^ +(\w+(?: -> \w+)+)", source, re.MULTILINE):
                rooms = [room if room == "simulator" else prefix + room for room in chain.split(" -> ")]
                arrows += zip(rooms, rooms[1:])
            self.assertGreater(len(arrows), 7)
            for who, whom in arrows:
                with self.subTest(picture=name):
                    self.assertIn(whom, permitted.get(who, ()), who + " does not include it")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
