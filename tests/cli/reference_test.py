#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Manual pages and shell completion say what the option tables say: every key of the configuration,
which comes from the same tables by another way, is in its command's page and offered in its place.
usage: reference_test.py PROGRAM FOLDER"""
import json
import os
import re
import subprocess
import sys

PROGRAM, FOLDER = sys.argv[1:3]
failures = []


def expect(condition, message):
    if not condition:
        failures.append(message)


def output(*command, stdin=""):
    done = subprocess.run(command, input=stdin, capture_output=True, text=True, check=False)
    expect(done.returncode == 0, f"{command[:4]}: exit {done.returncode}: {done.stderr[:500]}")
    return done.stdout


def offered_by_bash(lines):
    """What bash offers at the end of each line."""
    script = output(PROGRAM, "--no-config", "completion", "bash")
    calls = "".join(
        f"COMP_LINE={quoted(line)}; COMP_POINT=${{#COMP_LINE}}; _forcegrid; "
        "printf '%s\\n' \"${COMPREPLY[@]}\" @@@\n" for line in lines)
    # In an interactive shell a colon and an equals sign divide words.
    head = "compopt() { :; }; COMP_WORDBREAKS=$' \\t\\n\"\\'><=;|&(:'\n"
    answers = output("bash", "--norc", "-u", stdin=script + head + calls).split("@@@\n")
    return [answer.split("\n")[:-1] for answer in answers[:len(lines)]]


def offered_by_zsh(lines):
    script = output(PROGRAM, "--no-config", "completion", "zsh")
    stubs = """compdef() { :; }; compset() { :; }; _message() { :; }; _files() { echo FILES; }
compadd() { print -l -- "${(P@)2}"; }
_describe() { local list=${@[-1]}; local one; for one in "${(P@)list}"; do
  one=${one//\\\\\\\\:/$'\\1'}; one=${one%%:*}; print -r -- "${one//$'\\1'/:}"; done; }
"""
    calls = "".join(f"words=({words}); CURRENT={len(words.split())}; _forcegrid; echo @@@\n"
                    for words in (re.sub(r" $", " ''", line) for line in lines))
    answers = output("zsh", "-f", stdin=stubs + script + calls).split("@@@\n")
    return [answer.split("\n")[:-1] for answer in answers[:len(lines)]]


def quoted(text):
    return "'" + text.replace("'", "'\\''") + "'"


def check_keys():
    config = json.loads(output(PROGRAM, "--no-config", "config", "--json"))
    keys = [key["key"] for key in config["keys"]]
    expect(len(keys) > 100, f"only {len(keys)} keys")
    places = {}
    for key in keys:
        *command, option = key.split(".")
        if command == ["log"]:  # options of all commands
            command, option = [], option if option == "quiet" else "log-" + option
        places.setdefault(tuple(command), set()).add("--" + option)
    output(PROGRAM, "--no-config", "man-pages", FOLDER)
    lines = [" ".join(("forcegrid", *command, "--")) for command in places]
    for shell, offers in (("bash", offered_by_bash(lines)), ("zsh", offered_by_zsh(lines))):
        for (command, options), offer in zip(places.items(), offers):
            missing = options - set(offer)
            expect(not missing, f"{shell} does not offer {missing} behind {' '.join(command)}")
            expect("--config" in offer, f"{shell} offers no --config behind {' '.join(command)}")
    for command, options in places.items():
        name = "-".join(("forcegrid", *command[:1]))
        with open(os.path.join(FOLDER, name + ".1"), encoding="utf-8") as file:
            page = file.read().replace("\\-", "-")
        for option in options:
            expect(f"\\fB{option}\\fR" in page, f"the page {name} has no {option}")


def check_words():
    """What belongs at a place, worked out by hand."""
    cases = [
        ("forcegrid cha", {"chart"}, {"run"}),
        ("forcegrid chart ", {"accuracy", "stability", "solvers"}, {"run"}),
        ("forcegrid chart accuracy --shar", {"--shard"}, {"--quick"}),
        ("forcegrid run --solver ", {"auto", "local"}, {"--rate"}),
        ("forcegrid run --solver=", {"auto", "local"}, {"--rate"}),
        ("forcegrid run --scene sm", {"small"}, {"block"}),
        ("forcegrid run --rate ", set(), {"--solver", "auto"}),
        ("forcegrid run --device emulated:fal", {"falcon"}, {"phantom_desktop"}),
        ("forcegrid emulate --device pha", {"phantom_desktop"}, {"falcon"}),
        ("forcegrid run --calibrated --sol", {"--solver"}, {"--scene"}),
        ("forcegrid-tools completion ", {"bash", "zsh"}, {"run"}),
    ]
    for (line, wanted, unwanted), offer in zip(cases, offered_by_bash([case[0] for case in cases])):
        expect(wanted <= set(offer), f"bash: '{line}': {sorted(wanted - set(offer))} missing")
        expect(not unwanted & set(offer), f"bash: '{line}': {sorted(unwanted & set(offer))} offered")


def check_format():
    pages = sorted(os.listdir(FOLDER))
    expect("forcegrid.1" in pages and "forcegrid-tools.1" in pages, f"pages: {pages}")
    for page in pages:
        done = subprocess.run(["groff", "-man", "-Tutf8", "-ww", "-z", os.path.join(FOLDER, page)],
                              capture_output=True, text=True, check=False)
        # A long word that does not fit is no fault of the page.
        faults = [line for line in done.stderr.splitlines() if line and "can't break" not in line]
        expect(done.returncode == 0 and not faults, f"{page}: {faults[:5]}")


check_keys()
check_words()
check_format()
print("\n".join(failures))
sys.exit(1 if failures else 0)
