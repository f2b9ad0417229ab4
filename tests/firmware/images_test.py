#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the images of `make firmware` are made of: their sizes, and what must not be in them.
usage: images_test.py SOURCE_FOLDER"""
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

ROOT = pathlib.Path(sys.argv[1])
IMAGES = ROOT / "build/firmware"
METHODS = ("grid", "rls", "kriging")
# The heap, exceptions, RTTI, threads, files and messages of the C and C++ libraries.
FORBIDDEN = re.compile(r"_?sbrk(_r)?|_(malloc|free|realloc|calloc)_r|__cxa_(throw|allocate|guard)\w*|"
                       r"_Unwind_\w*|__gxx_personality\w*|__dynamic_cast|_ZTI\w+|\w*printf\w*|"
                       r"_?f?open(_r)?|_ZSt\d+__throw\w*")


def run(*command):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def symbols(image):
    return [line.split()[-1] for line in run("arm-none-eabi-nm", str(image)).splitlines()]


class Images(unittest.TestCase):
    def printed_sizes(self):
        """{method: {key: bytes}} as firmware/sizes.py prints them."""
        found, method = {}, None
        for line in run(sys.executable, str(ROOT / "firmware/sizes.py"), str(IMAGES)).splitlines():
            key, value = line.split()
            if key == "method":
                method = value
                found[method] = {}
            else:
                found[method][key] = int(value)
        return found

    def test_fit_a_microcontroller(self):
        sizes = self.printed_sizes()
        self.assertEqual(tuple(sizes), METHODS)
        for method, size in sizes.items():
            self.assertLessEqual(size["ram_bytes"], 64 * 1024, method)
        self.assertLessEqual(sizes["grid"]["flash_bytes"], 40 * 1024)
        self.assertLessEqual(sizes["rls"]["flash_bytes"], 40 * 1024)
        self.assertLessEqual(sizes["kriging"]["flash_bytes"], 64 * 1024)

    # Section by section, as the processor's memory has them.
    def test_have_the_printed_sizes(self):
        for method, size in self.printed_sizes().items():
            flash = ram = 0
            for line in run("arm-none-eabi-objdump", "-h",
                            str(IMAGES / ("firmware_%s.elf" % method))).splitlines():
                section = re.match(r"\s*\d+ (\S+)\s+([0-9a-f]{8})\s+([0-9a-f]{8})", line)
                if section and section[1] in (".text", ".ARM.exidx", ".data", ".bss", ".stack"):
                    bytes_ = int(section[2], 16)
                    flash += bytes_ if section[1] in (".text", ".ARM.exidx", ".data") else 0
                    ram += bytes_ if int(section[3], 16) >= 0x20000000 else 0
            self.assertEqual((flash, ram), (size["flash_bytes"], size["ram_bytes"]), method)

    def test_have_no_heap_exceptions_or_type_information(self):
        for method in METHODS:
            for image in ("firmware_%s.elf" % method, "play_%s.elf" % method):
                names = symbols(IMAGES / image)
                self.assertGreater(len(names), 100)
                self.assertEqual([n for n in names if FORBIDDEN.fullmatch(n)], [], image)

    def test_compute_doubles_in_the_processor(self):
        """Doubles by software take fifty times as long."""
        for method in METHODS:
            code = run("arm-none-eabi-objdump", "-d", "--no-show-raw-insn",
                       str(IMAGES / ("firmware_%s.elf" % method)))
            self.assertIn("vmul.f64", code)
            self.assertNotRegex(code, r"bl\s+[0-9a-f]+ <__aeabi_d(mul|add|sub|div)>")


if __name__ == "__main__":
    missing = [tool for tool in ("arm-none-eabi-nm", "arm-none-eabi-size") if not shutil.which(tool)]
    if missing or not (IMAGES / "firmware_kriging.elf").is_file():
        print("skipped: `make firmware` installs the compiler and builds the images")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])
