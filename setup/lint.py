#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks format and code of the C++ sources: clang-format and clang-tidy (.clang-format, .clang-tidy).

usage: lint.py [--since REV] [--minutes M] [--jobs N] [--build DIR] [--under FOLDER ...] [--list]

Without --since every tracked source is checked. --since REV checks what differs from REV: a changed
header through the source of the same name, or through one source that includes it. Only findings in
changed files count. REV may be `last-merge`: the first parent of the last merge or, where there is no
merge, the commit before HEAD.

A source that was found clean is not checked again until it, one of the project's headers that it
includes, its compile command or .clang-tidy changes; build/lint keeps these results.
"""
import argparse
import concurrent.futures
import hashlib
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
CACHE = ROOT / "build" / "lint"
CLANG_FORMAT, CLANG_TIDY = "clang-format-14", "clang-tidy-14"
ENDINGS = (".cpp", ".h", ".c")
MOST_COLUMNS = 100
INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)


def git(*arguments):
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True)
    return done.stdout.split("\n")[:-1] if done.returncode == 0 else None


def tracked():
    listed = git("ls-files")
    if listed is None:
        sys.exit("lint: this is no git checkout; only tracked sources are checked")
    return [name for name in listed if name.endswith(ENDINGS) and (ROOT / name).exists()]


def revision_before(revision):
    """The commit to compare with, or None where there is no earlier commit (a shallow clone)."""
    if revision != "last-merge":
        if git("rev-parse", "--verify", "--quiet", revision + "^{commit}") is None:
            sys.exit(f"lint: {revision} is no commit here; give --since a commit, branch or tag")
        return revision
    merges = git("rev-list", "--merges", "--max-count=1", "HEAD") or []
    for candidate in [merge + "^1" for merge in merges] + ["HEAD~1"]:
        if git("rev-parse", "--verify", "--quiet", candidate + "^{commit}"):
            return candidate
    return None


def text_of(name, known={}):
    if name not in known:
        path = ROOT / name
        known[name] = path.read_text(encoding="utf-8") if path.exists() else ""
    return known[name]


def includes(name):
    """The project's headers that a file includes itself."""
    found = []
    for included in INCLUDE.findall(text_of(name)):
        beside = os.path.normpath(os.path.join(os.path.dirname(name), included))
        for path in (included, beside):
            if (ROOT / path).exists():
                found.append(path)
                break
    return found


def reached(name):
    """A file and all of the project's headers that it includes, directly or not."""
    seen, waiting = {name}, [name]
    while waiting:
        for header in includes(waiting.pop()):
            if header not in seen:
                seen.add(header)
                waiting.append(header)
    return sorted(seen)


def compile_commands(build):
    """Source -> the first of its entries; a source may be built into several programs."""
    path = build / "compile_commands.json"
    if not path.exists():
        sys.exit(f"lint: {path} is missing; run `cmake --preset release` first")
    entries = {}
    for entry in json.loads(path.read_text(encoding="utf-8")):
        name = os.path.relpath(os.path.join(entry["directory"], entry["file"]), ROOT)
        entries.setdefault(name, entry)
    return entries


def sources_for(changed, entries):
    """The sources through which the changed files are checked."""
    chosen = [name for name in changed if name in entries]
    headers = [name for name in changed if name.endswith(".h")]
    for header in headers:
        users = [name for name in entries if header in includes(name)]
        if not users:
            users = [name for name in entries if header in reached(name)]
        own = [name for name in users if pathlib.Path(name).stem == pathlib.Path(header).stem]
        if users and not set(users) & set(chosen):
            chosen.append((own or sorted(users))[0])
    return chosen


def key_of(name, entry):
    """What clang-tidy's findings in a source depend on."""
    digest = hashlib.sha256()
    command = entry.get("command") or shlex.join(entry["arguments"])
    folders = [folder for folder in pathlib.Path(name).parents]
    settings = [str(folder / ".clang-tidy") for folder in folders]
    digest.update(command.replace(str(ROOT), "").encode())
    for part in [*settings, *reached(name)]:
        digest.update(f"\0{part}\0{text_of(part)}".encode())
    return digest.hexdigest()


def check_format(names):
    """Number of files with findings, printed as they are found."""
    bad = 0
    for start in range(0, len(names), 100):
        done = subprocess.run([CLANG_FORMAT, "--dry-run", "--Werror", *names[start:start + 100]],
                              cwd=ROOT, capture_output=True, text=True)
        at_fault = sorted(set(re.findall(r"^(\S+?):\d+:\d+: error", done.stderr, re.MULTILINE)))
        for name in at_fault:
            print(f"{name}: not formatted; run {CLANG_FORMAT} -i {name}")
        if done.returncode != 0 and not at_fault:
            sys.exit("lint: " + (done.stderr.strip() or f"{CLANG_FORMAT} failed"))
        bad += len(at_fault)
    # clang-format leaves the layout of indented comments alone, and so their length.
    for name in names:
        for number, line in enumerate(text_of(name).split("\n"), 1):
            if len(line) > MOST_COLUMNS and line.lstrip().startswith("//"):
                print(f"{name}:{number}: a comment of {len(line)} columns; {MOST_COLUMNS} at most")
                bad += 1
    return bad


def check_code(names, entries, jobs, minutes, of_interest):
    """(sources with findings, sources that there was no time for)
    of_interest: the files whose findings count; None: all."""
    (CACHE / "clean").mkdir(parents=True, exist_ok=True)
    # One entry for a source: clang-tidy would check each of several.
    database = [dict(entries[name], file=str(ROOT / name)) for name in names]
    folder = tempfile.TemporaryDirectory(dir=CACHE)  # of this run, which may not be the only one
    (pathlib.Path(folder.name) / "compile_commands.json").write_text(json.dumps(database),
                                                                     encoding="utf-8")
    end = time.monotonic() + 60 * minutes if minutes else None

    def check(name):
        stamp = CACHE / "clean" / key_of(name, entries[name])
        if stamp.exists():
            return name, ""
        if end and time.monotonic() > end:
            return name, None
        # The C++ Core Guidelines are none for C.
        dialect = ["--checks=-cppcoreguidelines-*"] if name.endswith(".c") else []
        done = subprocess.run([CLANG_TIDY, "-p", folder.name, "--quiet", "--warnings-as-errors=*",
                               *dialect, str(ROOT / name)], capture_output=True, text=True)
        if done.returncode == 0:
            stamp.touch()
            return name, ""
        return name, done.stdout or done.stderr

    bad, late, printed = set(), [], set()
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for name, findings in pool.map(check, names):
            if findings is None:
                late.append(name)
                continue
            for finding in re.split(r"(?m)^(?=/\S+:\d+:\d+: (?:error|warning))", findings):
                where = os.path.relpath(finding.split(":", 1)[0], ROOT) if finding else ""
                broken = "[clang-diagnostic" in finding or not finding.startswith("/")
                if finding and (of_interest is None or where in of_interest or broken):
                    bad.add(name)
                    if finding not in printed:  # a header's is found by all who include it
                        printed.add(finding)
                        print(finding.replace(str(ROOT) + "/", "").rstrip(), flush=True)
    return bad, late


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--since", metavar="REV", default="")
    parser.add_argument("--minutes", type=float, default=0.0, help="0: without a limit")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build" / "release")
    parser.add_argument("--under", nargs="*", default=[], metavar="FOLDER")
    parser.add_argument("--list", action="store_true", help="print the sources and stop")
    options = parser.parse_args()
    began = time.monotonic()

    names = tracked()
    if options.under:
        names = [name for name in names if name.startswith(tuple(options.under))]
    entries = compile_commands(options.build)
    since = revision_before(options.since) if options.since else None
    if since:
        changed = set(git("diff", "--name-only", since, "--"))
        names = [name for name in names if name in changed]
        sources = sources_for(names, entries)
    else:
        sources = [name for name in names if name in entries]
    if options.list:
        print("\n".join(sources))
        return 0

    unformatted = check_format(names)
    bad, late = check_code(sources, entries, options.jobs, options.minutes,
                           set(names) if since else None)
    if late:
        print(f"lint: no time left for {len(late)} of {len(sources)} sources (`make lint` checks all)")
    print(f"lint: {len(names)} files formatted, {len(sources) - len(late)} sources checked in "
          f"{time.monotonic() - began:.0f} s" + (f", against {since}" if since else "") +
          f": {unformatted + len(bad)} with findings")
    return 1 if unformatted or bad else 0


if __name__ == "__main__":
    sys.exit(main())
