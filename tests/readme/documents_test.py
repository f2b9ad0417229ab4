#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Documents drift: do the flags that README and docs/ show exist?
usage: documents_test.py SOURCE_FOLDER FORCEGRID"""
import functools
import pathlib
import re
import subprocess
import sys
import unittest

ROOT, PROGRAM = pathlib.Path(sys.argv[1]), sys.argv[2]
GROUPS = ("chart",)  # whose first word is a command of its own
FLAG = re.compile(r"(?<![\w-])--[a-z][\w-]*")


@functools.lru_cache(None)
def flags_of(*command):
    said = subprocess.run([PROGRAM, "--no-config", *command, "--help"], capture_output=True, text=True,
                          check=True)
    return set(FLAG.findall(said.stdout))


def commands():
    listed = subprocess.run([PROGRAM, "--help"], capture_output=True, text=True, check=True).stdout
    return re.findall(r"^  ([a-z]+) ", listed.split("Subcommands:")[1], re.MULTILINE)


def shown_commands():
    """(file, line number, command, flags) of each `forcegrid COMMAND ...` in README and docs/."""
    start = re.compile(r"forcegrid (%s)\b" % "|".join(commands()))
    for file in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
            for match in start.finditer(line):
                rest = re.split(r"[`|;&#']|forcegrid ", line[match.end():])[0]
                command = [match.group(1)]
                if command[0] in GROUPS:
                    command += rest.split()[:1]
                if len(command) > 1 or command[0] not in GROUPS:
                    yield file.name, number, command, FLAG.findall(rest)


class Documents(unittest.TestCase):
    def test_show_only_flags_that_there_are(self):
        shown = 0
        for file, number, command, flags in shown_commands():
            if command[0] in GROUPS and not re.fullmatch(r"[a-z]+", command[1]):
                continue  # "forcegrid chart ..." in a sentence
            for flag in flags:
                shown += 1
                with self.subTest(file=file, line=number, command=" ".join(command)):
                    self.assertIn(flag, flags_of(*command) | flags_of())
        self.assertGreater(shown, 50, "the documents are not read")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
