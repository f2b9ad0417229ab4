#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Do the links, anchors, make targets and folders that the documents name exist?
usage: links_test.py SOURCE_FOLDER"""
import functools
import pathlib
import re
import subprocess
import sys
import unittest

ROOT = pathlib.Path(sys.argv[1]).resolve()
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(<?([^)\s>]+)>?(?: \"[^\"]*\")?\)")
HEADING = re.compile(r"^#{1,6} +(.+?) *#*$", re.MULTILINE)


def pages():
    """README.md and every other Markdown page, but not those of build folders."""
    found = [page for pattern in ("*.md", "docs/*.md", "examples/*.md", "tests/**/*.md")
             for page in sorted(ROOT.glob(pattern))]
    return [page for page in found if "build" not in page.relative_to(ROOT).parts]


def without_code(text):
    """Blocks and spans of code hold no links; `line` and `column` are not needed."""
    text = re.sub(r"^( *)(```|~~~).*?^\1\2", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"(`+)(?!`).+?(?<!`)\1(?!`)", "code", text)


def code_of(text):
    """Each line of a block and each span."""
    blocks = re.findall(r"^ *(?:```|~~~).*?\n(.*?)^ *(?:```|~~~)", text, re.MULTILINE | re.DOTALL)
    rest = re.sub(r"^ *(```|~~~).*?^ *\1", "", text, flags=re.MULTILINE | re.DOTALL)
    spans = [span for _, span in re.findall(r"(`+)(?!`)(.+?)(?<!`)\1(?!`)", rest)]
    return [line.strip() for block in blocks for line in block.splitlines()] + spans


@functools.lru_cache(None)
def anchors_of(page):
    """As GitHub makes them, and explicit ones."""
    text = page.read_text(encoding="utf-8")
    found, seen = set(re.findall(r'<a (?:id|name)="([^"]+)"', text)), {}
    blockless = re.sub(r"^( *)(```|~~~).*?^\1\2", "", text, flags=re.MULTILINE | re.DOTALL)
    for heading in HEADING.findall(blockless):
        heading = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")
        count = seen[slug] = seen.get(slug, -1) + 1
        found.add("%s-%d" % (slug, count) if count else slug)
    return found


def broken_links(page):
    """(target, why) of each."""
    for target in LINK.findall(without_code(page.read_text(encoding="utf-8"))):
        if re.match(r"(https?|mailto):", target):
            continue
        path, _, anchor = target.partition("#")
        aim = (page.parent / path).resolve() if path else page
        if ROOT not in (aim, *aim.parents):
            yield target, "leads out of the project"
        elif not aim.exists():
            yield target, "no such file or folder"
        elif anchor and aim.suffix == ".md" and anchor not in anchors_of(aim):
            yield target, "no such heading; there are: " + ", ".join(sorted(anchors_of(aim)))


def make_targets():
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z][\w-]*):(?!=)", text, re.MULTILINE))


def named_targets(page):
    for code in code_of(page.read_text(encoding="utf-8")):
        for words in re.findall(r"(?:^|&& |; )(?:sudo )?make((?: [\w./=\"<>-]+)*)", code):
            for word in words.split():
                if "=" in word or not re.fullmatch(r"[a-z][a-z-]*", word):
                    break  # NAME=value ends the targets
                yield word


class Links(unittest.TestCase):
    def test_lead_somewhere(self):
        self.assertGreater(len(pages()), 25)
        for page in pages():
            for target, why in broken_links(page):
                with self.subTest(page=str(page.relative_to(ROOT)), link=target):
                    self.fail(why)

    def test_name_targets_that_make_has(self):
        named = 0
        for page in pages():
            for target in named_targets(page):
                named += 1
                with self.subTest(page=str(page.relative_to(ROOT))):
                    self.assertIn(target, make_targets())
        self.assertGreater(named, 15, "the documents are not read")


class Index(unittest.TestCase):
    def test_names_each_page_once(self):
        index = (ROOT / "docs/README.md").read_text(encoding="utf-8")
        listed = [target.partition("#")[0] for target in
                  re.findall(r"^\| \[[^\]]*\]\(([^)]+)\) \|", index, re.MULTILINE)]
        for page in sorted((ROOT / "docs").glob("*.md")):
            if page.name != "README.md":
                with self.subTest(page=page.name):
                    self.assertEqual(listed.count(page.name), 1)


class Readme(unittest.TestCase):
    text = (ROOT / "README.md").read_text(encoding="utf-8")

    def test_can_be_read_in_five_minutes(self):
        self.assertLessEqual(len(self.text.splitlines()), 160)

    def test_has_a_line_for_each_folder(self):
        rows = re.findall(r"^\| (\[\w+/\].*) \| (.*) \|$", self.text, re.MULTILINE)
        listed = {folder for folders, _ in rows for folder in re.findall(r"\[(\w+)/\]", folders)}
        tracked = subprocess.run(["git", "-C", ROOT, "ls-tree", "-d", "--name-only", "HEAD"],
                                 capture_output=True, text=True)
        folders = tracked.stdout.split() or [entry.name for entry in ROOT.iterdir() if entry.is_dir()]
        hidden = {name for name in folders if name.startswith(".") or name in ("build", "out")}
        self.assertEqual(listed, set(folders) - hidden)
        for folder, description in rows:
            with self.subTest(folder=folder):
                self.assertLessEqual(len(description.split()), 8)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
