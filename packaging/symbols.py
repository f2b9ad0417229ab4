#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the shared C++ libraries export, beside packaging/debian/*.symbols, which lists it.
usage: symbols.py FOLDER            prints how they differ; FOLDER has the libraries
       symbols.py FOLDER --write    writes the lists, after an interface was changed on purpose"""
import pathlib
import re
import subprocess
import sys

LISTS = pathlib.Path(__file__).resolve().parent / "debian"
NAMES = ("methods", "link", "servo")


def run(*command, text=None):
    return subprocess.run(command, check=True, text=True, input=text, stdout=subprocess.PIPE).stdout


def exports(library):
    """Of a library: mangled name -> (its kind, as nm has it, and its version)."""
    found = {}
    for line in run("nm", "-D", "--defined-only", str(library)).splitlines():
        kind, name = line.split()[-2:]
        name, _, version = name.partition("@@")
        found[name] = (kind, version)
    return found


def soname(library):
    return re.search(r"Library soname: \[(.*)\]", run("readelf", "-d", str(library)))[1]


def list_of(library):
    """Its list, a file, and the lines that belong there: one for each name as people write it, which
    several of the compiler's share. Those that a compiler makes where it needs them are optional."""
    own = soname(library)
    base, version = own.split(".so.")
    package = base + version
    names = exports(library)
    readable = run("c++filt", text="\n".join(names)).splitlines()
    rows = {}
    for name, (kind, tag) in zip(readable, names.values()):
        if kind == "A":  # the version itself
            rows[f" {name}@{name} {version}.0~"] = False
        else:
            row = f'"{name}@{tag}" {version}.0~'
            rows[row] = rows.get(row, True) and kind in "VWu"
    lines = [row if row.startswith(" ") else f' (c++{"|optional" if optional else ""}){row}'
             for row, optional in sorted(rows.items(), key=lambda item: item[0].lower())]
    return LISTS / f"{package}.symbols", [f"{own} {package} #MINVER#"] + lines


def main():
    folder, write = pathlib.Path(sys.argv[1]), "--write" in sys.argv[2:]
    differ = False
    for name in NAMES:
        file, lines = list_of(folder / f"libforcegrid-{name}.so")
        listed = file.read_text().splitlines() if file.exists() else []
        if write:
            file.write_text("\n".join(lines) + "\n")
        for sign, some, others in (("+", lines, listed), ("-", listed, lines)):
            for line in sorted(set(some) - set(others)):
                print(f"{file.name}: {sign}{line}")
                differ = True
    if differ and not write:
        sys.exit("symbols.py: the libraries export something else than is listed; with --write it "
                 "writes the lists")


if __name__ == "__main__":
    main()
