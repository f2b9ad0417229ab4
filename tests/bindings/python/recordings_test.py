#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A recording of a short run, read by forcegrid.Recording and by h5py."""
import os
import pathlib
import subprocess
import tempfile
import unittest

import h5py
import numpy as np

import forcegrid

PROGRAM = os.environ["FORCEGRID_PROGRAM"]


class ARecording(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.file = str(pathlib.Path(cls.folder.name, "run.h5"))
        ran = subprocess.run(
            [PROGRAM, "--no-config", "run", "--device-timeout-ms", "400",
             "--device", "emulated:woodenhaptics_v2015", "--scene",
             "small", "--seconds", "3", "--record", cls.file, "--out", cls.folder.name],
            capture_output=True, text=True, timeout=100)
        if ran.returncode != 0:
            raise AssertionError(ran.stdout + ran.stderr)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_has_the_columns_that_h5py_reads(self):
        with forcegrid.Recording(self.file) as run, h5py.File(self.file, "r") as peer:
            names = []
            peer.visititems(lambda name, item: names.append(name)
                            if isinstance(item, h5py.Dataset) else None)
            self.assertEqual(sorted(run.columns), sorted(names))
            for name in names:
                with self.subTest(column=name):
                    column = run[name]
                    np.testing.assert_array_equal(column, peer[name][:len(column)])
                    self.assertEqual(column.dtype, peer[name].dtype)
                    self.assertEqual(run.meaning(name), peer[name].attrs["meaning"].decode())
            self.assertEqual(run.attribute("settings"), peer.attrs["settings"].decode())

    def test_tells_of_the_run(self):
        with forcegrid.Recording(self.file) as run:
            self.assertEqual((run.profile, run.scene), ("woodenhaptics_v2015", "small"))
            self.assertEqual(run.rate_Hz, 500.0)
            self.assertEqual(run.method_names[0], "auto")
            self.assertTrue(run.complete)
            self.assertGreater(run.cycles, 1000)
            time_s = run["time_s"]
            self.assertEqual(time_s.shape, (run.cycles,))
            self.assertTrue((np.diff(time_s) > 0).all())
            self.assertEqual(run["position_W_m"].shape, (run.cycles, 3))
            self.assertIn("cycles/time_s", run)
            self.assertNotIn("cycles/tiem_s", run)

    def test_is_a_trace_if_it_has_reference_forces(self):
        with forcegrid.Recording(self.file) as run:
            has = run.has_reference
        if has:
            figures = forcegrid.evaluate("hold", self.file)
            self.assertGreater(figures["reference_rms_N"], 0.0)
        else:
            with self.assertRaisesRegex(forcegrid.TraceError, "no reference forces"):
                forcegrid.read_trace(self.file)

    def test_outlives_its_file_as_arrays(self):
        run = forcegrid.Recording(self.file)
        position = run["position_W_m"]
        run.close()
        self.assertTrue(np.isfinite(position).all())
        with self.assertRaisesRegex(forcegrid.RecordingError, "closed"):
            run["time_s"]

    def test_errors_name_the_input(self):
        with forcegrid.Recording(self.file) as run, self.assertRaisesRegex(KeyError, "tiem_s"):
            run["tiem_s"]
        with self.assertRaisesRegex(forcegrid.RecordingError, "nowhere.h5"):
            forcegrid.Recording("nowhere.h5")
        other = str(pathlib.Path(self.folder.name, "other.h5"))
        with h5py.File(other, "w") as file:
            file["numbers"] = np.zeros(3)
        with self.assertRaisesRegex(forcegrid.RecordingError, "not a recording of forcegrid"):
            forcegrid.Recording(other)


if __name__ == "__main__":
    unittest.main()
