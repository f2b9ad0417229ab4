#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints what the images take of a processor's memory, as `key value` lines, three for each method:
flash_bytes (code, constants, initial values) and ram_bytes (variables, arena, stack).
usage: sizes.py FOLDER    with firmware_METHOD.elf in it"""
import pathlib
import subprocess
import sys

METHODS = ("grid", "rls", "kriging")


def sizes(image):
    """(flash, RAM) of an ELF file in bytes."""
    listed = subprocess.run(["arm-none-eabi-size", "--format=berkeley", str(image)], check=True,
                            stdout=subprocess.PIPE, text=True).stdout
    text, data, bss = (int(n) for n in listed.splitlines()[1].split()[:3])
    return text + data, data + bss


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    for method in METHODS:
        flash, ram = sizes(pathlib.Path(sys.argv[1]) / ("firmware_%s.elf" % method))
        print("method %s\nflash_bytes %d\nram_bytes %d" % (method, flash, ram))
