#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks which sources setup/lint.py gives to clang-tidy as one.
usage: lint_test.py SOURCE_FOLDER"""
import importlib.util
import pathlib
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
SPEC = importlib.util.spec_from_file_location("lint", f"{sys.argv[1]}/setup/lint.py")
lint = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(lint)


def in_namespace(space, code):
    return f"namespace {space} {{\nnamespace {{\n{code}\n}}  // namespace\n}}\n"


class Batches(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        lint.ROOT = pathlib.Path(folder.name)
        lint.text_of.__defaults__[0].clear()
        (lint.ROOT / ".clang-tidy").write_text("")

    def batches(self, texts, flags={}, most=9):
        entries = {}
        for name, text in texts.items():
            path = lint.ROOT / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            command = f"c++ -I. {flags.get(name, '')} -o {name}.o -c {name}"
            entries[name] = {"directory": str(lint.ROOT), "file": name, "command": command}
        return sorted(lint.batches_of(list(texts), entries, most))

    def test_sources_of_different_names_go_together(self):
        texts = {"a.cpp": in_namespace("p::a", "constexpr int kStep = 1;  // not kSize ="),
                 "b.cpp": in_namespace("p::b", "constexpr int kStep = 1;"),
                 "c.cpp": in_namespace("p::a", "struct Size {};\n[[nodiscard]] int kSize() {\n}")}
        self.assertEqual(self.batches(texts), [["a.cpp", "b.cpp", "c.cpp"]])

    def test_no_more_than_the_most_go_together(self):
        texts = {f"{k}.cpp": "" for k in range(5)}
        self.assertEqual([len(batch) for batch in self.batches(texts, most=2)], [2, 2, 1])

    def test_a_name_comes_once_in_a_namespace(self):
        for line in ("constexpr double kStep_m[] = {1.0};", "struct kStep_m {",
                     "void kStep_m(int) {}", "using kStep_m = int;",
                     "const std::array<int, 2> kStep_m{1, 2};"):
            texts = {"a.cpp": in_namespace("p", line),
                     "b.cpp": in_namespace("p", "constexpr int kStep_m = 1;")}
            self.assertEqual(self.batches(texts), [["a.cpp"], ["b.cpp"]], line)

    def test_a_test_and_a_macro_come_once(self):
        for line in ("TEST(Size,\n     IsRight) {}", "#define P_SIZE 1"):
            texts = {"a.cpp": in_namespace("p", line), "b.cpp": in_namespace("p", line)}
            self.assertEqual(self.batches(texts), [["a.cpp"], ["b.cpp"]], line)

    def test_what_changes_others_is_checked_alone(self):
        for text in ("int main() {}", "using namespace p;", "#define P 1\n\n#include <x.h>",
                     "using std::min;", "namespace fs = std::filesystem;"):
            texts = {"a.cpp": "", "b.cpp": text}
            self.assertEqual(self.batches(texts), [["a.cpp"], ["b.cpp"]], text)
        self.assertEqual(self.batches({"c.c": "", "d.cpp": ""}), [["c.c"], ["d.cpp"]])

    def test_a_name_that_is_brought_and_used_stays(self):
        texts = {"a.cpp": "", "b.cpp": "using std::min;\nint k = min(1, 2);"}
        self.assertEqual(self.batches(texts), [["a.cpp", "b.cpp"]])

    def test_flags_agree(self):
        texts = {"a.cpp": "", "b.cpp": "", "c.cpp": "", "d.cpp": ""}
        flags = {"a.cpp": "-DP=1", "b.cpp": "-DP=2", "c.cpp": "-isystem x -DQ",
                 "d.cpp": "-fno-rtti"}
        self.assertEqual(self.batches(texts, flags), [["a.cpp", "c.cpp"], ["b.cpp"], ["d.cpp"]])

    def test_the_same_settings_hold(self):
        (lint.ROOT / "t").mkdir()
        (lint.ROOT / "t" / ".clang-tidy").write_text("InheritParentConfig: true\n")
        texts = {"a.cpp": "", "t/b.cpp": "", "t/u/c.cpp": ""}
        self.assertEqual(self.batches(texts), [["a.cpp"], ["t/b.cpp", "t/u/c.cpp"]])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
