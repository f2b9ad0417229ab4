#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""docs/safety_case.md names tests: do they exist, and has each hazard one?
usage: safety_case_test.py SOURCE_FOLDER"""
import pathlib
import re
import sys
import unittest

ROOT = pathlib.Path(sys.argv[1])


def tests_in_sources():
    """SUITE.NAME of every GoogleTest test, those of tests/hil too, and CLASS.METHOD of those in
    Python."""
    names = set()
    for file in (ROOT / "tests").rglob("*.cpp"):
        names |= {"%s.%s" % test for test in
                  re.findall(r"^(?:TYPED_)?TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\)",
                             file.read_text(encoding="utf-8"), re.MULTILINE)}
    for file in (ROOT / "tests").rglob("*.py"):
        suite = ""
        for line in file.read_text(encoding="utf-8").splitlines():
            if match := re.match(r"class (\w+)\(", line):
                suite = match.group(1)
            elif match := re.match(r"    def (test_\w+)\(", line):
                names.add("%s.%s" % (suite, match.group(1)))
    return names


class SafetyCase(unittest.TestCase):
    TEST = re.compile(r"`([A-Z]\w*\.(?:[A-Z]|test_)\w*)`")
    COLUMNS = 5  # hazard, cause, mechanism, shown by, what remains

    def setUp(self):
        self.text = (ROOT / "docs/safety_case.md").read_text(encoding="utf-8")

    def test_names_only_tests_that_exist(self):
        known, named = tests_in_sources(), set(self.TEST.findall(self.text))
        self.assertGreater(len(known), 1000, "the sources are not read")
        self.assertGreater(len(named), 50, "the page is not read")
        for name in sorted(named):
            with self.subTest(test=name):
                self.assertIn(name, known)

    def test_shows_each_hazard_by_a_test_and_says_what_remains(self):
        rows = [[cell.strip() for cell in line.strip("|").split("|")]
                for line in self.text.splitlines() if line.startswith("| ")]
        rows = [row for row in rows if row[0] != "hazard"]
        self.assertGreater(len(rows), 20, "the page is not read")
        for row in rows:
            with self.subTest(hazard=row[0]):
                self.assertEqual(len(row), self.COLUMNS)
                self.assertTrue(self.TEST.search(row[3]), "no test shows it")
                self.assertTrue(row[4], "it does not say what remains")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
