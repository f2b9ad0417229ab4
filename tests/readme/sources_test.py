#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Does each source name its licence in its first line, or after #! in its second?
usage: sources_test.py SOURCE_FOLDER"""
import os
import pathlib
import subprocess
import sys
import unittest

ROOT = pathlib.Path(sys.argv[1])
LINE = "SPDX-License-Identifier: Apache-2.0"
ENDINGS = (".cpp", ".h", ".c", ".py", ".sh", ".cmake", ".toml", ".in", ".rules", ".dot", ".css", ".js")
NAMES = ("CMakeLists.txt", "Makefile", ".clang-format", ".clang-tidy", "packages.txt", ".ci/run",
         "guest/init")
LEFT_OUT = ("build/", "out/", "tests/fuzz/corpus/")  # made, or bytes that a parser is given


def tracked():
    """Names of the tracked files; where this is no git checkout, of all files."""
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files"], capture_output=True, text=True)
    if listed.returncode == 0 and listed.stdout:
        return listed.stdout.splitlines()
    names = []
    for folder, inner, files in os.walk(ROOT):
        inner[:] = [name for name in inner if name == ".ci" or not name.startswith(".")]
        names += [(pathlib.Path(folder) / name).relative_to(ROOT).as_posix() for name in files]
    return names


def sources():
    for name in tracked():
        if name.endswith(ENDINGS + NAMES) and not name.startswith(LEFT_OUT):
            if (ROOT / name).is_file():  # one that is deleted, and not committed yet, is not
                yield name


class Sources(unittest.TestCase):
    def test_carry_their_licence(self):
        without, seen = [], 0
        for name in sources():
            seen += 1
            with open(ROOT / name, encoding="utf-8") as file:
                first = file.readline()
                if first.startswith("#!"):
                    first = file.readline()
            if LINE not in first:
                without.append(name)
        self.assertGreater(seen, 500, "the sources are not read")
        self.assertEqual(without, [], f"begin each of these files with a comment '{LINE}'")

    def test_have_a_licence_to_name(self):
        text = (ROOT / "LICENSE").read_text(encoding="utf-8")
        self.assertIn("Apache License", text)
        self.assertIn("Version 2.0, January 2004", text)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
