#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks format and code of the C++ sources: clang-format and clang-tidy (.clang-format, .clang-tidy).

usage: lint.py [--since REV] [--minutes M] [--jobs N] [--build DIR] [--under FOLDER ...] [--list]

Without --since every tracked source is checked. --since REV checks what differs from REV: a changed
header through the source of the same name, or through one source that includes it. Only findings in
changed files count. REV may be `last-merge`: the first parent of the last merge or, where there is no
merge, the commit before HEAD.

Most of a source's time goes into the headers of the standard library and of Eigen, so clang-tidy is
given one file that includes several sources, of which no two declare the same name in the same
namespace. What it finds there counts only if the source has it alone, too.

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
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
CACHE = ROOT / "build" / "lint"
CLANG_FORMAT, CLANG_TIDY = "clang-format-14", "clang-tidy-14"
# The analyzer follows paths through the functions of the main file only; alone it is soon done.
ANALYZER = ("--checks=-bugprone-*,-concurrency-*,-cppcoreguidelines-*,-misc-*,-modernize-*,"
            "-performance-*,-readability-*")
ENDINGS = (".cpp", ".h", ".c")
MOST_COLUMNS = 100
MOST_TOGETHER = 24  # sources in one run of clang-tidy, which takes 1 GB of memory with them
INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)
PLACE = re.compile(r"^(/\S+?):\d+:\d+: (?:error|warning|note)", re.MULTILINE)
COMMENT_OR_STRING = re.compile(r"//.*|/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"")
TEST = re.compile(r"^\w*TEST\w*\(\s*(\w+),\s*(\w+)\)", re.MULTILINE)
# The name that a line at file level declares: of a type, or what comes before its ( { ; [ or =.
TYPE = re.compile(r"(?:template <.*> )?(?:struct|class|union|enum class|enum|using) (\w+)(?!\w|::)")
NAME = re.compile(r"(?<!::)\b(?!noexcept\b)(\w*[a-z]\w*) ?[({;[=]")
# What changes the sources that come after it, or is changed by those before it.
ALONE = re.compile(r"^(?:int main\(|using namespace (?!std::\w+_literals)|#define(?s:.*)^#include)",
                   re.MULTILINE)


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
        sys.exit(f"lint: {path} is missing; run `make lint`, which makes it")
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


def flags_of(entry):
    """(definitions and include folders, other flags) of a compile command"""
    words = iter(entry.get("arguments") or shlex.split(entry["command"]))
    next(words)  # the compiler
    shared, own = [], []
    for word in words:
        if word == "-o":
            next(words)
        elif word == "-isystem":
            shared.append(word + next(words))
        elif word.startswith(("-I", "-D")):
            shared.append(word)
        elif word.startswith("-") and word != "-c":
            own.append(word)
    return shared, own


def settings_folder(name):
    """The folder of the .clang-tidy that holds for a file."""
    folders = pathlib.Path(name).parents
    return str(next((one for one in folders if (ROOT / one / ".clang-tidy").exists()), folders[-1]))


def declared(name):
    """The names at a source's file level, with their namespace: none may come twice in a batch.
    It errs both ways: a name too many costs time, and clang-tidy tells of one too few."""
    text = COMMENT_OR_STRING.sub("", text_of(name))
    space = re.search(r"^namespace (\w\S*) \{", text, re.MULTILINE)
    space = space[1] if space else ""
    found = {f"#{macro}" for macro in re.findall(r"^#define (\w+)", text, re.MULTILINE)}
    found.update(f"{space} {suite}_{test}" for suite, test in TEST.findall(text))
    for line in re.sub(r"\[\[.*?\]\] ?", "", text).split("\n"):
        if re.match(r"[\w:]", line) and not re.match(r"namespace |using [\w:]+;", line):
            named = TYPE.match(line) or NAME.search(line)
            found.update([f"{space} {named[1]}"] if named else [])
    return found


def stands_alone(name):
    """Whether a source must not be checked with others."""
    text = text_of(name)
    # clang-tidy looks for unused using declarations and aliases in the main file only.
    brought = re.findall(r"^ *using (?:\w*::)+(\w+);|^ *namespace (\w+) =", text, re.MULTILINE)
    unused = any(len(re.findall(rf"\b{one or other}\b", text)) < 2 for one, other in brought)
    return unused or not name.endswith(".cpp") or ALONE.search(text) is not None


def batches_of(names, entries, most):
    """The sources in lists of up to `most` that can be checked together."""
    groups, alone = {}, []
    for name in names:
        if stands_alone(name):
            alone.append([name])
            continue
        shared, own = flags_of(entries[name])
        taken = declared(name)
        values = dict(word.partition("=")[::2] for word in shared if word.startswith("-D"))
        # Beside the project's own namespaces `testing`, GoogleTest's has to be called ::testing.
        testing = any(re.search(r"^namespace \S*testing\b", text_of(path), re.MULTILINE)
                      for path in reached(name))
        batches = groups.setdefault((settings_folder(name), *own, testing), [])
        for batch, batch_taken, batch_values in batches:
            if len(batch) < most and not taken & batch_taken and all(
                    batch_values.get(key, value) == value for key, value in values.items()):
                break
        else:
            batch, batch_taken, batch_values = [], set(), {}
            batches.append((batch, batch_taken, batch_values))
        batch.append(name)
        batch_taken.update(taken)
        batch_values.update(values)
    return [batch for batches in groups.values() for batch, *_ in batches] + alone


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
    stamps = {name: CACHE / "clean" / key_of(name, entries[name]) for name in names}
    waiting = [name for name in names if not stamps[name].exists()]
    batches = batches_of(waiting, entries, max(1, min(MOST_TOGETHER, -(-len(waiting) // jobs))))
    folder = tempfile.TemporaryDirectory(dir=CACHE)  # of this run, which may not be the only one
    end = time.monotonic() + 60 * minutes if minutes else None

    def run(batch, *more):
        """clang-tidy's output for sources as one; empty: nothing found."""
        first, path = batch[0], ROOT / batch[0]
        if len(batch) > 1:
            # It lies beside a copy of the sources' .clang-tidy, within the project's folder.
            settings = settings_folder(first)
            path = pathlib.Path(folder.name) / settings / (stamps[first].name + ".cpp")
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / settings / ".clang-tidy", path.parent)
            lines = [f'#include "{ROOT / name}"  // NOLINT\n' for name in batch]
            path.write_text("".join(lines), encoding="utf-8")
        flags = list(dict.fromkeys(word for name in batch for word in flags_of(entries[name])[0]))
        # The C++ Core Guidelines are none for C.
        dialect = ["--checks=-cppcoreguidelines-*"] if first.endswith(".c") else []
        done = subprocess.run([CLANG_TIDY, "--quiet", "--warnings-as-errors=*", *dialect, *more,
                               str(path), "--", *flags, *flags_of(entries[first])[1]],
                              cwd=entries[first]["directory"], capture_output=True, text=True)
        return (done.stdout or done.stderr or f"{CLANG_TIDY} failed") if done.returncode else ""

    def check(batch):
        """[(source, findings)]; findings None: there was no time"""
        if end and time.monotonic() > end:
            return [(name, None) for name in batch]
        findings = run(batch)
        if len(batch) == 1:
            if not findings:
                stamps[batch[0]].touch()
            return [(batch[0], findings)]
        where = {os.path.relpath(path, ROOT) for path in PLACE.findall(findings)}
        again = [name for name in batch if findings and not where.isdisjoint(reached(name))]
        again = again or (batch if findings else [])
        rest = [name for name in batch if name not in again]
        if "[clang-diagnostic-error" in findings:
            print("lint: alone, as they do not compile with others:", *again, flush=True)
            done = check(rest) if rest else []
        else:
            if "-clang-analyzer-*" not in text_of(f"{settings_folder(batch[0])}/.clang-tidy"):
                again += [name for name in rest if run([name], ANALYZER)]
            clean = [name for name in rest if name not in again]
            for name in clean:
                stamps[name].touch()
            done = [(name, "") for name in clean]
        return done + [one for name in again for one in check([name])]

    bad, late, printed = set(), [], set()
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for name, findings in (one for part in pool.map(check, batches) for one in part):
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
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build" / "lint" / "cmake")
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
