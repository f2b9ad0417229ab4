#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Builds the offline site from docs/, the top pages and the sources that they link to.
usage: make_site.py SOURCE_FOLDER BUILD_FOLDER

mkdocs only knows pages below one folder. So the pages are copied to BUILD_FOLDER/pages, and each
link to a file outside docs/ is turned to a copy of that file: Markdown as a page, a source as a page
with its text, a folder as a page with its contents. The order of the pages is that of docs/README.md.
"""
import functools
import html
import os
import pathlib
import re
import shutil
import subprocess
import sys

ROOT, BUILD = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
PAGES, DOCS = BUILD / "pages", ROOT / "docs"
LINK = re.compile(r"(\]\()<?([^)\s>]+)>?((?: \"[^\"]*\")?\))")
LANGUAGES = {".h": "cpp", ".cpp": "cpp", ".c": "cpp", ".py": "python", ".toml": "toml", ".sh": "bash"}
PICTURES = (".svg", ".png")
# The live view, as `make test-full` has seen it: on its page, in the place of this comment.
VIEW_PICTURES = ROOT / "build/release/view_pictures"
VIEW_PLACE = "<!-- the site has pictures here -->"


def page_of(source):
    """Where the copy of a file or folder of the project lies, from PAGES."""
    inside = source.relative_to(ROOT)
    if source == DOCS / "README.md":
        return pathlib.PurePath("index.md")
    if source == ROOT / "README.md":
        return pathlib.PurePath("readme.md")
    if DOCS in source.parents and (source.suffix == ".md" or source.suffix in PICTURES):
        return source.relative_to(DOCS)
    if source.is_dir():
        return pathlib.PurePath("source") / inside / "folder.md"
    if source.suffix in PICTURES:
        return pathlib.PurePath("source") / inside
    name = inside.name if source.suffix == ".md" else inside.name + ".md"
    return pathlib.PurePath("source") / inside.parent / name


def prose_and_code(text):
    """The text in parts; every second one is a block or span of code, in which nothing is a link."""
    return re.split(r"(^ *```.*?^ *```|(?<!`)`[^`\n]+`)", text, flags=re.MULTILINE | re.DOTALL)


def view_pictures():
    """The pictures of the live view as Markdown, and their copies; nothing if none were made."""
    lines = []
    for picture in sorted(VIEW_PICTURES.glob("*.png")):
        copy = PAGES / "view_pictures" / picture.name
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(picture, copy)
        lines.append("![The live view: %s](view_pictures/%s)" % (
            picture.stem.replace("live_view_", ""), picture.name))
    return "\n\n".join(lines)


class Site:
    def __init__(self):
        self.waiting, self.made = [], set()

    def need(self, source):
        if source not in self.made:
            self.made.add(source)
            self.waiting.append(source)
        return page_of(source)

    def turn_link(self, source, match):
        target, _, anchor = match.group(2).partition("#")
        if re.match(r"\w+:", match.group(2)) or not target:
            return match.group()
        aim = (source.parent / target).resolve()
        if not aim.exists() or ROOT not in (aim, *aim.parents):
            return match.group()  # mkdocs names it
        here = page_of(source).parent
        turned = os.path.relpath(self.need(aim), here)
        return match.group(1) + turned + ("#" + anchor if anchor else "") + match.group(3)

    def page_text(self, source):
        name = source.relative_to(ROOT).as_posix()
        if source.is_dir():
            entries = sorted(entry for entry in source.iterdir()
                             if not entry.name.startswith((".", "__")))
            return "# %s/\n\n%s\n" % (name, "\n".join(
                "- `%s%s`" % (entry.name, "/" if entry.is_dir() else "") for entry in entries))
        text = source.read_text(encoding="utf-8")
        if source.suffix != ".md":
            fence = "~~~~~~~~"
            return "# %s\n\n%s%s\n%s\n%s\n" % (name, fence, LANGUAGES.get(source.suffix, "text"),
                                              text.rstrip("\n"), fence)
        text = text.replace(VIEW_PLACE, view_pictures()) if source.parent == DOCS else text
        parts = prose_and_code(text)
        turn = functools.partial(self.turn_link, source)
        # A span of code may be a link's text: `](` then begins the part after it.
        parts[::2] = [LINK.sub(turn, part) for part in parts[::2]]
        return "".join(parts)

    def make(self):
        for page in sorted(DOCS.glob("*.md")):
            self.need(page)
        self.need(ROOT / "README.md")
        while self.waiting:
            source = self.waiting.pop()
            copy = PAGES / page_of(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            if source.suffix in PICTURES:
                shutil.copyfile(source, copy)
            else:
                copy.write_text(self.page_text(source), encoding="utf-8")
        shutil.copyfile(DOCS / "site/site.css", PAGES / "site.css")


def navigation():
    """As YAML: the sections of docs/README.md with their pages."""
    lines = ["nav:", '  - "Start": index.md', '  - "Overview": readme.md']
    for line in (DOCS / "README.md").read_text(encoding="utf-8").splitlines():
        section = re.fullmatch(r"## (.+)", line)
        row = re.fullmatch(r"\| \[([^\]]*)\]\(([\w.]+\.md)\) \|.*", line)
        if section:
            lines.append('  - "%s":' % section.group(1))
        elif row and (DOCS / row.group(2)).exists():
            lines.append('    - "%s": %s' % row.groups())
    lines.append('  - "C++ interfaces": interfaces/index.html')
    return "\n".join(lines) + "\n"


def check_offline():
    """No page may load a script, a style, a font or a picture from a network."""
    loads = re.compile(r"<(?:script|img|link|iframe|object)\b[^>]*\b(?:src|href|data)=\"(?:https?:)?//[^\"]*")
    styles = re.compile(r"(?:url\(|@import )[\"']?(?:https?:)?//[^)\"';]*")
    found = ["%s: %s" % (page.relative_to(BUILD), match)
             for page in sorted(BUILD.glob("site/**/*")) if page.suffix in (".html", ".css")
             for match in (loads if page.suffix == ".html" else styles).findall(
                 page.read_text(encoding="utf-8", errors="replace"))]
    if found:
        sys.exit("these would be loaded from a network:\n" + "\n".join(found))


def check_links():
    """mkdocs checks files; this also checks the headings that links lead to."""
    def anchors(page):
        return {name for pair in re.findall(r'\bid="([^"]+)"|\bname="([^"]+)"', text_of(page)) for name in pair}

    @functools.lru_cache(None)
    def text_of(page):
        return page.read_text(encoding="utf-8", errors="replace")

    broken = []
    for page in sorted((BUILD / "site").rglob("*.html")):
        if "interfaces" in page.parts:
            continue  # Doxygen's own
        for link in re.findall(r'<a [^>]*href="([^":]+)"', text_of(page)):
            path, _, anchor = html.unescape(link).partition("#")
            aim = (page.parent / path).resolve() if path else page
            if not aim.exists() or (anchor and aim.suffix == ".html" and anchor not in anchors(aim)):
                broken.append("%s: %s" % (page.relative_to(BUILD), link))
    if broken:
        sys.exit("these links lead nowhere:\n" + "\n".join(broken))


def main():
    shutil.rmtree(PAGES, ignore_errors=True)
    shutil.rmtree(BUILD / "site", ignore_errors=True)
    BUILD.mkdir(parents=True, exist_ok=True)
    # Doxygen writes into the pages, so that mkdocs knows where the link to the interfaces leads.
    configuration = (DOCS / "site/Doxyfile").read_text(encoding="utf-8")
    configuration += "\nOUTPUT_DIRECTORY = \"%s\"\nHTML_OUTPUT = pages/interfaces\n" % BUILD
    Site().make()
    subprocess.run(["doxygen", "-"], input=configuration, text=True, cwd=ROOT, check=True)
    (BUILD / "mkdocs.yml").write_text((DOCS / "site/mkdocs.yml").read_text(encoding="utf-8") + navigation(),
                                      encoding="utf-8")
    built = subprocess.run(["mkdocs", "build", "--strict", "-f", BUILD / "mkdocs.yml"], text=True,
                           stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if built.returncode != 0:
        # Its notes list every page that is not in the navigation: the copies of sources.
        sys.exit("\n".join(line for line in built.stdout.splitlines()
                           if "INFO" not in line and not line.startswith("  - ")))
    (BUILD / "site/404.html").unlink()  # only a server would show it
    check_offline()
    check_links()
    print("open %s" % (BUILD / "site/index.html"))


if __name__ == "__main__":
    main()
