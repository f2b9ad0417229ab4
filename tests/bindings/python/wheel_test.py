#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The wheel beside its specification, and a program that uses nothing but what pip installs of it.
usage: wheel_test.py SOURCE_FOLDER VERSION"""
import base64
import csv
import email
import hashlib
import importlib.metadata
import os
import pathlib
import subprocess
import sys
import sysconfig
import tempfile
import unittest
import zipfile

import forcegrid

ROOT, VERSION = pathlib.Path(sys.argv[1]), sys.argv[2]
PACKAGE = pathlib.Path(forcegrid.__file__).parent
INFO = f"forcegrid-{VERSION}.dist-info/"


class Wheel(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.wheel = pathlib.Path(self.make(self.folder / "wheel"))

    def make(self, out):
        return subprocess.run(
            [sys.executable, str(ROOT / "bindings/python/make_wheel.py"), str(PACKAGE),
             str(ROOT / "profiles"), str(ROOT / "LICENSE"), VERSION, str(out)],
            check=True, text=True, stdout=subprocess.PIPE).stdout.strip()

    def test_records_every_file(self):
        with zipfile.ZipFile(self.wheel) as archive:
            self.assertIsNone(archive.testzip())
            names = archive.namelist()
            rows = list(csv.reader(archive.read(INFO + "RECORD").decode().splitlines()))
            self.assertEqual([row[0] for row in rows], names)
            self.assertEqual(rows[-1], [INFO + "RECORD", "", ""])
            for name, digest, size in rows[:-1]:
                data = archive.read(name)
                self.assertEqual(int(size), len(data))
                self.assertEqual(digest, "sha256=" + base64.urlsafe_b64encode(
                    hashlib.sha256(data).digest()).rstrip(b"=").decode())
        self.assertEqual(len(names), len(set(names)))
        profiles = {"forcegrid/share/profiles/" + file.name
                    for file in (ROOT / "profiles").glob("*.toml")}
        self.assertLess(profiles | {"forcegrid/py.typed", "forcegrid/_core.pyi"}, set(names))
        # At the end of the archive, so that an installer can change it.
        self.assertEqual([name.startswith(INFO) for name in names], sorted(
            name.startswith(INFO) for name in names))

    # https://packaging.python.org/en/latest/specifications/binary-distribution-format
    def test_has_the_name_and_the_tags_of_the_specification(self):
        # As the module's own name says: cpython-311-x86_64-linux-gnu.
        _, python, machine, system, _ = sysconfig.get_config_var("SOABI").split("-")
        tag = f"cp{python}-cp{python}-{system}_{machine}"
        self.assertEqual(self.wheel.name, f"forcegrid-{VERSION}-{tag}.whl")
        with zipfile.ZipFile(self.wheel) as archive:
            wheel = email.message_from_bytes(archive.read(INFO + "WHEEL"))
        self.assertEqual({key: wheel.get_all(key) for key in wheel.keys() if key != "Generator"},
                         {"Wheel-Version": ["1.0"], "Root-Is-Purelib": ["false"], "Tag": [tag]})
        self.assertRegex(VERSION, r"^\d+\.\d+\.\d+$")

    # https://packaging.python.org/en/latest/specifications/core-metadata
    def test_has_the_metadata_of_the_specification(self):
        with zipfile.ZipFile(self.wheel) as archive:
            metadata = email.message_from_bytes(archive.read(INFO + "METADATA"))
        self.assertEqual(metadata.defects, [])
        for key, value in {"Metadata-Version": "2.1", "Name": "forcegrid", "Version": VERSION,
                           "License": "Apache-2.0", "Requires-Dist": "numpy>=1.24",
                           "Requires-Python": "==%d.%d.*" % sys.version_info[:2]}.items():
            self.assertEqual(metadata.get_all(key), [value])
        self.assertRegex(metadata["Summary"], r"^\S.*$")
        self.assertEqual(set(metadata.keys()) - {"Classifier"},
                         {"Metadata-Version", "Name", "Version", "Summary", "License",
                          "Requires-Dist", "Requires-Python"})

    def test_is_the_same_twice(self):
        again = pathlib.Path(self.make(self.folder / "again"))
        self.assertEqual(again.read_bytes(), self.wheel.read_bytes())

    def test_works_by_itself_where_pip_has_installed_it(self):
        site = self.folder / "site"
        subprocess.run([sys.executable, "-m", "pip", "install", "--isolated", "--no-index",
                        "--no-deps", "--no-cache-dir", "--disable-pip-version-check", "--quiet",
                        "--root-user-action=ignore", "--target", str(site), str(self.wheel)],
                       check=True, cwd="/")
        said = subprocess.run(
            [sys.executable, "-c",
             "import forcegrid, importlib.metadata as metadata\n"
             "print(forcegrid.__file__, forcegrid.load_profile('vintage').file,\n"
             "      forcegrid.__version__, metadata.version('forcegrid'))\n"
             "print(forcegrid.make('hold').name, type(forcegrid.SimulatorLink(port=0)).__name__)"],
            check=True, text=True, stdout=subprocess.PIPE, cwd="/",
            env={**os.environ, "PYTHONPATH": str(site)}).stdout.split()
        self.assertEqual(said, [str(site / "forcegrid/__init__.py"),
                                str(site / "forcegrid/share/profiles/vintage.toml"),
                                VERSION, VERSION, "hold", "SimulatorLink"])
        installed = importlib.metadata.PathDistribution(site / INFO)
        self.assertEqual(installed.requires, ["numpy>=1.24"])
        for file in installed.files:
            self.assertTrue(file.locate().is_file(), file)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
