#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks the table "Who may include whom" of docs/architecture.md against every #include.
usage: rooms_test.py SOURCE_FOLDER            runs the test
       rooms_test.py SOURCE_FOLDER --table    prints the rows that the sources need"""
import collections
import graphlib
import pathlib
import re
import sys
import tempfile
import unittest

ROOT = pathlib.Path(sys.argv[1])
PAGE = "docs/architecture.md"
SOURCES = (".h", ".hpp", ".c", ".cpp", ".inc")
# They use the rooms as a user does: they may include all of them, and no room includes them.
USERS = ("bench", "examples", "tests")
# The design's rules; no row of the table may break one. A name stands for its sub-folders, too.
NEVER = (("device_emulator", "driver"), ("driver", "device_emulator"), ("driver", "forcegrid"),
         ("driver", "servo_loop"), ("simulator", "servo_loop"), ("simulator", "driver"),
         ("servo_loop", "simulator"), ("servo_loop", "device_emulator"),
         # What may run in the servo cycle or on the device's thread never logs.
         ("servo_loop", "log"), ("driver", "log"), ("forcegrid", "log"), ("rt", "log"),
         ("simulator/solver", "log"), ("simulator/kernels", "log"))
ALONE = ("forcegrid", "contact", "rt", "text")  # they include nothing of the project
ALMOST_ALONE = {"link": ("text/secret_file.h",)}  # what they may: headers without a library
LEAVES = ("cli", "compat", "bindings", "view")  # no other room includes them
# Interfaces for other programs, with include folders of their own.
INCLUDE_FOLDERS = ("bindings/c/include", "compat/openhaptics/include")
SIMULATOR_ORDER = ("simulator/mesh", "simulator/kernels", "simulator/solver", "simulator/touch",
                   "simulator/workers", "simulator")


def room_of(path):
    return path.rpartition("/")[0]


def within(room, folder):
    return room == folder or room.startswith(folder + "/")


def includes_of(root):
    """{room: {included file: an including file}} of all rooms, other rooms' files only."""
    found = collections.defaultdict(dict)
    for file in sorted(root.rglob("*")):
        path = file.relative_to(root).as_posix()
        top = path.split("/")[0]
        if file.suffix not in SOURCES or top in USERS + ("build",) or top.startswith("."):
            continue
        room = room_of(path)
        found[room]  # a room that includes nothing is a room, too
        text = file.read_text(encoding="utf-8")
        for included in re.findall(r'^\s*#\s*include\s+["<]([\w./]+)[">]', text, re.MULTILINE):
            for folder in INCLUDE_FOLDERS:
                if not (root / included).is_file() and (root / folder / included).is_file():
                    included = folder + "/" + included
            is_ours = (root / included).is_file() or (root / included.split("/")[0]).is_dir()
            if "/" in included and is_ours and room_of(included) != room:
                found[room].setdefault(included, path)
    return found


def table_of(text):
    """{room: [entries]}; an entry is a room ("rt/") or a file ("rt/clock.h")."""
    section = re.split(r"^## Who may include whom$", text, flags=re.MULTILINE)[1:]
    if not section:
        raise ValueError(PAGE + ': no section "Who may include whom"')
    table = {}
    for line in re.split(r"^## ", section[0], flags=re.MULTILINE)[0].splitlines():
        if not line.startswith("| `"):
            continue
        row = re.fullmatch(r"\| `([\w/]+)/` \| (nothing|`[\w./]+`(?: `[\w./]+`)*) \|", line)
        if not row or row.group(1) in table:
            raise ValueError(PAGE + ": not a row of the form | `room/` | `room/` `room/file.h` |, "
                             "or a second one for its room: " + line)
        table[row.group(1)] = re.findall(r"`([^`]+)`", row.group(2))
    return table


def permits(entry, included):
    return entry == included or entry == room_of(included) + "/"


def complaints(table, includes):
    """What is wrong, one sentence each."""
    for room in sorted(set(table) ^ set(includes)):
        yield ("%s/ has no row" if room in includes else "%s/ has a row but no sources") % room
    for room, entries in sorted(table.items()):
        used = includes.get(room, {})
        for included, file in sorted(used.items()):
            if not any(permits(entry, included) for entry in entries):
                yield "%s includes %s, which the row of %s/ does not permit" % (file, included, room)
        for entry in entries:
            if not any(permits(entry, included) for included in used):
                yield "the row of %s/ permits %s, which no file there uses" % (room, entry)
            if not entry.endswith("/") and room_of(entry) + "/" in entries:
                yield "the row of %s/ permits %s twice: its room is permitted" % (room, entry)
            yield from broken_rules(room, room_of(entry))
            yield from broken_loneliness(room, entry)
    graph = {room: {room_of(included) for included in used} for room, used in includes.items()}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as cycle:
        yield "rooms include each other in a circle: " + " <- ".join(cycle.args[1])


def broken_loneliness(room, entry):
    for alone, permitted in ALMOST_ALONE.items():
        if within(room, alone) and not within(room_of(entry), alone) and entry not in permitted:
            yield "%s/ may include %s alone, not %s" % (alone, " ".join(permitted), entry)


def broken_rules(room, other):
    for who, whom in NEVER:
        if within(room, who) and within(other, whom):
            yield "%s/ may never include %s/" % (who, whom)
    for alone in ALONE:
        if within(room, alone) and not within(other, alone):
            yield "%s/ includes nothing of the project, not even %s/" % (alone, other)
    for leaf in LEAVES + USERS:
        if within(other, leaf) and not within(room, leaf):
            yield "nothing includes %s/, but %s/ may" % (leaf, room)
    order = SIMULATOR_ORDER
    if room in order and other in order and order.index(other) > order.index(room):
        yield "%s/ stands before %s/ and may not include it" % (room, other)


class Rooms(unittest.TestCase):
    def test_include_what_the_table_permits_and_all_of_it(self):
        table = table_of((ROOT / PAGE).read_text(encoding="utf-8"))
        includes = includes_of(ROOT)
        self.assertGreater(len(table), 25)
        self.assertEqual(list(complaints(table, includes)), [], "mend the include or the table; "
                         "tests/readme/rooms_test.py . --table prints the rows that the sources need")


class Checker(unittest.TestCase):
    """The check itself, on small trees."""

    def complaints(self, rows, **files):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name in ("rt/clock.h", "rt/thread.h", "driver/device.h", *files):
                path = root / name.replace("__", "/").replace("_h", ".h")
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("".join('#include "%s"\n' % i for i in files.get(name, ())))
            text = "## Who may include whom\n| `rt/` | nothing |\n| `driver/` | nothing |\n" + rows
            return list(complaints(table_of(text), includes_of(root)))

    def test_accepts_what_is_permitted_and_used(self):
        self.assertEqual(self.complaints("| `tools/` | `rt/` `driver/device.h` |\n",
                                         tools__a_h=["rt/clock.h", "driver/device.h"]), [])

    def test_finds_an_include_that_is_not_permitted(self):
        self.assertRegex(self.complaints("| `tools/` | nothing |\n", tools__a_h=["rt/clock.h"])[0],
                         "tools/a.h includes rt/clock.h")

    def test_finds_another_file_than_the_permitted_one(self):
        said = self.complaints("| `tools/` | `rt/clock.h` |\n", tools__a_h=["rt/thread.h"])
        self.assertRegex(said[0], "includes rt/thread.h")
        self.assertRegex(said[1], "permits rt/clock.h, which no file there uses")

    def test_finds_a_permission_that_nobody_uses(self):
        said = self.complaints("| `tools/` | `rt/` `driver/` |\n", tools__a_h=["rt/clock.h"])
        self.assertEqual(said, ["the row of tools/ permits driver/, which no file there uses"])

    def test_a_permission_for_a_room_is_none_for_its_sub_folders(self):
        said = self.complaints("| `tools/` | `rt/` |\n", tools__a_h=["rt/clock.h", "rt/more/more.h"])
        self.assertRegex(said[0], "includes rt/more/more.h")

    def test_finds_a_room_without_a_row(self):
        self.assertEqual(self.complaints("", tools__a_h=[]), ["tools/ has no row"])

    def test_finds_a_circle(self):
        said = self.complaints("| `tools/` | `paper/` |\n| `paper/` | `tools/` |\n",
                               tools__a_h=["paper/b.h"], paper__b_h=["tools/a.h"])
        self.assertRegex(said[-1], "in a circle: (tools|paper)")

    def test_holds_the_rules_of_the_design(self):
        said = self.complaints("| `device_emulator/` | `driver/` |\n",
                               device_emulator__a_h=["driver/device.h"])
        self.assertEqual(said, ["device_emulator/ may never include driver/"])
        self.assertTrue(list(broken_rules("forcegrid/core", "rt")))
        for room in ("servo_loop", "driver", "forcegrid/kriging", "rt", "simulator/solver"):
            self.assertTrue(list(broken_rules(room, "log")), room)
        self.assertTrue(list(broken_rules("simulator/mesh", "simulator/solver")))
        self.assertTrue(list(broken_rules("tools", "cli/run")))
        self.assertFalse(list(broken_rules("simulator/touch", "simulator/mesh")))
        self.assertFalse(list(broken_loneliness("link", "text/secret_file.h")))
        for entry in ("text/", "text/text.h", "rt/"):
            self.assertTrue(list(broken_loneliness("link", entry)), entry)

    def test_refuses_rows_in_words(self):
        for row in ("| `tools/` | all but `cli/` |\n", "| `tools/` | `rt/`, `driver/` |\n"):
            with self.assertRaises(ValueError):
                self.complaints(row)


def needed_rows():
    """The table anew: rooms in its order, files where it names files."""
    includes = includes_of(ROOT)
    try:
        table = table_of((ROOT / PAGE).read_text(encoding="utf-8"))
    except (ValueError, OSError):
        table = {}
    for room in sorted(includes, key=lambda room: (list(table) + [room]).index(room)):
        rooms, files = set(), set()
        for included in includes[room]:
            by_file = any(room_of(entry) == room_of(included) and not entry.endswith("/")
                          for entry in table.get(room, []))
            (files if by_file else rooms).add(included if by_file else room_of(included) + "/")
        yield "| `%s/` | %s |" % (room, " ".join("`%s`" % e for e in sorted(rooms | files)) or "nothing")


if __name__ == "__main__":
    if "--table" in sys.argv[2:]:
        print("\n".join(needed_rows()))
    else:
        unittest.main(argv=sys.argv[:1])
