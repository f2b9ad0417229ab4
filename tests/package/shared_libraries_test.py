#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The shared C++ libraries export their interface and nothing else, under their SONAME's version.
usage: shared_libraries_test.py SOURCE_FOLDER LIBRARIES_FOLDER MAJOR.MINOR"""
import pathlib
import re
import subprocess
import sys
import unittest

SOURCE, FOLDER, VERSION = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3]
sys.path.append(str(SOURCE / "packaging"))
import symbols  # noqa: E402

# A name of the project: a function, a table of virtual functions, a type.
OWN = re.compile(r"_Z(N|NK|TVN|TIN|TSN)9forcegrid")
# The names that docs/libraries.md begins with, as the compiler writes them up to their parameters.
ENTRIES = {
    "methods": ["_ZN9forcegrid17make_force_methodE", "_ZN9forcegrid12method_names",
                "_ZN9forcegrid20parse_method_variantE", "_ZTIN9forcegrid11ForceMethodE"],
    "link": ["_ZN9forcegrid4link17SimulatorEndpointC1E", "_ZN9forcegrid4link13ServoEndpointC1E",
             "_ZN9forcegrid4link7LinkKey4loadE", "_ZTIN9forcegrid4link9LinkErrorE"],
    "servo": ["_ZN9forcegrid6driver11open_deviceE", "_ZTIN9forcegrid6driver6DeviceE",
              "_ZTIN9forcegrid6driver11DeviceErrorE", "_ZN9forcegrid6driver14make_mechanismE",
              "_ZN9forcegrid6driver13ArmKinematicsC1E", "_ZN9forcegrid6driver12ForceLimiterC1E",
              "_ZN9forcegrid8profiles19load_device_profileE", "_ZN9forcegrid5servo9ServoLoopC1E",
              "_ZN9forcegrid5servo9ServoLoop3runE", "_ZN9forcegrid5servo9TelemetryC1E",
              "_ZN9forcegrid8emulator14EmulatorServerC1E",
              "_ZN9forcegrid7session13DeviceSession4openE",
              "_ZTIN9forcegrid7session12SessionErrorE"],
}
# What each may need of the others; and no library of USB or of messages for methods and the link.
NEEDS = {"methods": set(), "link": set(), "servo": {"methods", "link"}}
ELSEWHERE = re.compile(r"libusb|libhidapi|libspdlog|libfmt")


def library(name):
    return FOLDER / f"libforcegrid-{name}.so"


def needed(name):
    listed = subprocess.run(["readelf", "-d", str(library(name))], check=True, text=True,
                            stdout=subprocess.PIPE).stdout
    return re.findall(r"\(NEEDED\).*\[(.*)\]", listed)


class SharedLibraries(unittest.TestCase):
    def test_export_names_of_the_project_alone(self):
        for name in symbols.NAMES:
            with self.subTest(library=name):
                for symbol, (kind, version) in symbols.exports(library(name)).items():
                    self.assertTrue(kind == "A" or OWN.match(symbol), symbol)
                    self.assertEqual(version or symbol, f"FORCEGRID_{VERSION}")

    def test_hide_what_implements_the_interface(self):
        for name in symbols.NAMES:
            with self.subTest(library=name):
                for symbol in symbols.exports(library(name)):
                    self.assertNotRegex(symbol, r"4Impl|Endpoint5State|_GLOBAL__N_")

    def test_have_every_entry_point(self):
        for name in symbols.NAMES:
            with self.subTest(library=name):
                there = symbols.exports(library(name))
                for entry in ENTRIES[name]:
                    self.assertTrue(any(symbol.startswith(entry) for symbol in there), entry)

    def test_export_nothing_twice(self):
        seen = {}
        for name in symbols.NAMES:
            with self.subTest(library=name):
                for symbol, (kind, _) in symbols.exports(library(name)).items():
                    if kind not in "AVW":
                        self.assertNotIn(symbol, seen)
                        seen[symbol] = name

    def test_export_what_the_packages_list(self):
        for name in symbols.NAMES:
            with self.subTest(library=name):
                file, lines = symbols.list_of(library(name))
                self.assertEqual(file.read_text().splitlines(), lines,
                                 "packaging/symbols.py writes the list")

    def test_need_what_they_must(self):
        for name in symbols.NAMES:
            with self.subTest(library=name):
                own = {re.sub(r"libforcegrid-(\w+)\.so\.(.*)", r"\1 \2", file)
                       for file in needed(name) if file.startswith("libforcegrid")}
                self.assertEqual(own, {f"{other} {VERSION}" for other in NEEDS[name]})
                if name != "servo":
                    self.assertEqual([file for file in needed(name) if ELSEWHERE.search(file)], [])

    def test_have_their_names_resolved_when_they_are_loaded(self):
        for name in symbols.NAMES:
            with self.subTest(library=name):
                flags = subprocess.run(["readelf", "-d", str(library(name))], check=True, text=True,
                                       stdout=subprocess.PIPE).stdout
                self.assertRegex(flags, r"\(FLAGS\).*BIND_NOW|\(BIND_NOW\)")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
