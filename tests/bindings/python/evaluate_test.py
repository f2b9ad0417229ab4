#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid.evaluate() on traces whose answer is known, and traces as files."""
import pathlib
import tempfile
import threading
import time
import unittest

import numpy as np

import forcegrid

STIFFNESS_N_PER_M = 100.0


def trace_of_a_spring(seconds=3.0, servo_Hz=500, sample_Hz=30, speed_m_per_s=0.02):
    """A tool that moves along x at a constant speed in a spring's field."""
    servo_s = np.arange(int(seconds * servo_Hz)) / servo_Hz
    sample_s = np.arange(int(seconds * sample_Hz)) / sample_Hz

    def positions(times_s):
        return np.column_stack((speed_m_per_s * times_s, 0 * times_s, 0 * times_s + 0.01))
    return forcegrid.Trace(
        sample_time_s=sample_s, sample_position_W_m=positions(sample_s),
        sample_force_W_N=-STIFFNESS_N_PER_M * positions(sample_s),
        servo_time_s=servo_s, servo_position_W_m=positions(servo_s),
        servo_force_W_N=-STIFFNESS_N_PER_M * positions(servo_s))


class Evaluate(unittest.TestCase):
    def test_gives_hold_the_error_of_a_late_force(self):
        trace = trace_of_a_spring()
        figures = forcegrid.evaluate("hold", trace, forces=True)
        # Between two samples the held force falls behind by k v t, at most k v / 30 Hz.
        reference = np.sqrt((trace.servo_force_W_N ** 2).sum(axis=1).mean())
        self.assertAlmostEqual(figures["reference_rms_N"], reference, delta=1e-9)
        largest = figures["max_error_percent_after_1s"] / 100 * reference
        self.assertAlmostEqual(largest, STIFFNESS_N_PER_M * 0.02 / 30, delta=0.02 * 0.2)
        self.assertEqual(figures["force_W_N"].shape, trace.servo_force_W_N.shape)
        late = np.abs(figures["force_W_N"] - trace.servo_force_W_N).max()
        self.assertLessEqual(late, STIFFNESS_N_PER_M * 0.02 / 30 + 1e-9)

    def test_gives_a_linear_field_to_rls_and_auto(self):
        trace = trace_of_a_spring()
        for name in ("rls", "auto", "kriging nug=1e-6"):
            with self.subTest(method=name):
                figures = forcegrid.evaluate(name, trace)
                self.assertLess(figures["rms_error_percent_after_1s"], 1.0)
                self.assertEqual(figures["samples_taken"], 90)
                self.assertEqual(figures["cycles_not_finite"], 0)

    def test_errors_name_the_input(self):
        trace = trace_of_a_spring(0.5)
        with self.assertRaisesRegex(ValueError, "'outo' is not known"):
            forcegrid.evaluate("outo", trace)
        with self.assertRaisesRegex(ValueError, "'tangent' needs the samples' stiffness"):
            forcegrid.evaluate("tangent", trace)
        with self.assertRaisesRegex(ValueError, r"'forcegrid\+request' requests forces"):
            forcegrid.evaluate("forcegrid+request", trace)
        with self.assertRaisesRegex(forcegrid.TraceError, "nowhere.csv"):
            forcegrid.evaluate("hold", "nowhere.csv")
        rows = np.zeros((3, 3))
        with self.assertRaisesRegex(ValueError, "servo_time_s: has to rise; row 2"):
            forcegrid.Trace(sample_time_s=[0, 1, 2], sample_position_W_m=rows, sample_force_W_N=rows,
                            servo_time_s=[0, 1, 1], servo_position_W_m=rows, servo_force_W_N=rows)
        with self.assertRaisesRegex(ValueError, "sample_force_W_N: expected 3 rows, got 2"):
            forcegrid.Trace(sample_time_s=[0, 1, 2], sample_position_W_m=rows,
                            sample_force_W_N=rows[:2], servo_time_s=[0, 1, 2],
                            servo_position_W_m=rows, servo_force_W_N=rows)

    def test_releases_the_gil(self):
        trace, turns, over = trace_of_a_spring(20.0), [0], threading.Event()

        def turn():
            while not over.is_set():
                turns[0] += 1
                time.sleep(1e-4)
        other = threading.Thread(target=turn)
        other.start()
        before = turns[0]
        forcegrid.evaluate("auto", trace)
        during = turns[0] - before
        over.set()
        other.join()
        self.assertGreater(during, 3)


class Files(unittest.TestCase):
    def test_keep_every_number(self):
        trace = trace_of_a_spring(2.0)
        with tempfile.TemporaryDirectory() as folder:
            for name in ("trace.csv", "trace.csv.gz"):
                file = str(pathlib.Path(folder, name))
                trace.write(file)
                read = forcegrid.read_trace(file)
                for column in ("sample_time_s", "sample_delivered_s", "sample_position_W_m",
                               "sample_force_W_N", "servo_time_s", "servo_position_W_m",
                               "servo_force_W_N"):
                    np.testing.assert_array_equal(getattr(read, column), getattr(trace, column))
                self.assertEqual(
                    forcegrid.evaluate("rls", file)["rms_error_percent_after_1s"],
                    forcegrid.evaluate("rls", trace)["rms_error_percent_after_1s"])


if __name__ == "__main__":
    unittest.main()
