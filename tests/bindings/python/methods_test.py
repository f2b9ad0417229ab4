#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid.make() against closed forms, and arrays against one call for each row."""
import threading
import time
import unittest

import numpy as np

import forcegrid
from forcegrid import Status

SPRING_N_PER_M = 100.0
ROUNDING_N = 1e-12


def taught(name, seed=4, samples=60, **options):
    """A method that has felt a spring along a path of 0.5 m/s at most."""
    method = forcegrid.make(name, **options)
    method.contact_made((0, 0, 0))
    times = np.arange(samples) / 30
    positions = 0.03 * np.column_stack((np.sin(2 * times), np.cos(3 * times), np.sin(times)))
    method.take_samples(times, positions, -SPRING_N_PER_M * positions)
    return method, times[-1]


class ClosedForms(unittest.TestCase):
    def test_hold_gives_the_newest_force(self):
        method = forcegrid.make("hold")
        self.assertIs(method.estimate(0.0, (0, 0, 0)).status, Status.UNKNOWN)
        method.contact_made()
        method.take_sample(0.1, (0.01, 0, 0), (1.0, -2.0, 0.5))
        np.testing.assert_array_equal(method.force(0.2, (0.05, 0.01, 0)), (1.0, -2.0, 0.5))
        method.take_sample(0.05, (0, 0, 0), (9.0, 9.0, 9.0))  # older: ignored
        np.testing.assert_array_equal(method.force(0.2, (0, 0, 0)), (1.0, -2.0, 0.5))
        method.contact_lost()
        np.testing.assert_array_equal(method.force(0.2, (0, 0, 0)), (0, 0, 0))

    def test_linear_follows_the_line_through_two_forces_for_a_quarter_second(self):
        method = forcegrid.make("linear")
        method.contact_made()
        method.take_sample(1.00, (0, 0, 0), (1.0, 0.0, 2.0))
        method.take_sample(1.04, (0, 0, 0), (1.2, -0.4, 2.0))
        rate = np.array((5.0, -10.0, 0.0))
        for after in (0.0, 0.01, 0.1, 0.25, 3.0):
            expected = np.array((1.2, -0.4, 2.0)) + rate * min(after, 0.25)
            np.testing.assert_allclose(method.force(1.04 + after, (0, 0, 0)), expected, rtol=0,
                                       atol=1e-11)

    def test_tangent_follows_the_stiffness(self):
        stiffness = -np.diag((100.0, 50.0, 20.0))
        stiffness[0, 1] = 7.0
        method = forcegrid.make("tangent")
        self.assertTrue(method.needs["stiffness"])
        method.contact_made()
        method.take_sample(0.0, (0.01, 0, 0), (-1.0, 0, 0), stiffness)
        step = np.array((0.001, 0.002, -0.003))
        np.testing.assert_allclose(method.force(0.001, (0.01, 0, 0) + step),
                                   (-1.0, 0, 0) + stiffness @ step, rtol=0, atol=ROUNDING_N)

    def test_auto_finds_a_spring(self):
        method, end_s = taught("auto")
        position = 0.03 * np.array((np.sin(2 * end_s), np.cos(3 * end_s), np.sin(end_s)))
        estimate = method.estimate(end_s, position + (0.001, 0, 0))
        self.assertIs(estimate.status, Status.OK)
        self.assertIn(estimate.candidate, method.candidates)
        np.testing.assert_allclose(estimate.force_W_N, -SPRING_N_PER_M * (position + (0.001, 0, 0)),
                                   rtol=0, atol=0.02)  # 1 % of the largest force


class Arrays(unittest.TestCase):
    NAMES = ("auto", "hold", "linear", "rls", "forcegrid", "kriging")

    def test_equal_one_call_for_each_row(self):
        random = np.random.default_rng(3)
        positions = random.uniform(-0.12, 0.12, (200, 3))  # some lie outside the workspace
        positions[17] = np.nan
        for name in self.NAMES:
            with self.subTest(method=name):
                method, end_s = taught(name)
                times = end_s + random.uniform(0.0, 0.1, 200)
                forces = method.force(times, positions)
                estimates = method.estimate(times, positions)
                np.testing.assert_array_equal(forces, estimates.force_W_N)
                self.assertEqual(estimates.status[17], Status.NOT_FINITE)
                for i in range(200):
                    one = method.estimate(times[i], positions[i])
                    np.testing.assert_array_equal(one.force_W_N, forces[i])
                    self.assertEqual(one.status, estimates.status[i])
                    np.testing.assert_equal(one.uncertainty_N, estimates.uncertainty_N[i])

    def test_may_be_strided_of_another_type_and_written_into(self):
        method, end_s = taught("forcegrid")
        wide = np.linspace(-0.05, 0.05, 120, dtype=np.float32).reshape(20, 6)
        expected = method.force(end_s, np.ascontiguousarray(wide[:, ::2], dtype=float))
        np.testing.assert_array_equal(method.force(end_s, wide[:, ::2]), expected)
        out = np.empty((20, 3))
        self.assertIs(method.force(end_s, wide[:, ::2], out=out), out)
        np.testing.assert_array_equal(out, expected)

    def test_grid_says_where_it_ends(self):
        method, end_s = taught("forcegrid", workspace_W_m=((-0.04,) * 3, (0.04,) * 3), cells=10)
        status = method.estimate(end_s, [(0, 0, 0), (0.05, 0, 0)]).status
        self.assertEqual(status[1], Status.OUTSIDE)
        self.assertNotEqual(status[0], Status.OUTSIDE)

    def test_release_the_gil(self):
        method, end_s = taught("auto")
        positions = np.random.default_rng(1).uniform(-0.03, 0.03, (1_000_000, 3))
        turns, over = 0, threading.Event()

        def turn():
            nonlocal turns
            while not over.is_set():
                turns += 1
                time.sleep(1e-4)
        other = threading.Thread(target=turn)
        other.start()
        began_s, before = time.perf_counter(), turns
        method.force(end_s, positions)
        during, took_s = turns - before, time.perf_counter() - began_s
        over.set()
        other.join()
        self.assertGreater(during, 3, f"another thread stood still for {took_s:.2f} s")

    def test_one_method_may_be_shared_by_threads(self):
        method, end_s = taught("auto")
        positions = np.random.default_rng(1).uniform(-0.03, 0.03, (20_000, 3))
        expected = method.force(end_s, positions)
        failures = []

        def ask():
            for _ in range(20):
                if not np.array_equal(method.force(end_s, positions), expected):
                    failures.append("another force")
                method.force(end_s, positions[0])
                method.work()
                method.counters  # noqa: B018
        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
            self.assertFalse(thread.is_alive(), "the threads wait for each other")
        self.assertEqual(failures, [])


class Interface(unittest.TestCase):
    def test_knows_every_method(self):
        for name in forcegrid.method_names():
            with self.subTest(method=name):
                method = forcegrid.make(name, cells=12)
                self.assertEqual(method.name, name)
                self.assertGreater(method.memory_bytes, 0)
        self.assertIn("auto", forcegrid.method_names())
        self.assertEqual(forcegrid.make().name, "auto")

    def test_takes_options_as_words_and_as_arguments(self):
        self.assertEqual(forcegrid.make("forcegrid unit=m s=3").text, "forcegrid unit=m s=3")
        self.assertEqual(forcegrid.make("kriging", samples=16, spacing="2mm").text,
                         "kriging samples=16 spacing=2mm")

    def test_errors_name_the_input(self):
        with self.assertRaisesRegex(ValueError, "'outo' is not known; known methods: auto"):
            forcegrid.make("outo")
        with self.assertRaisesRegex(ValueError, "unti"):
            forcegrid.make("forcegrid", unti="m")
        with self.assertRaisesRegex(ValueError, "workspace_W_m"):
            forcegrid.make("forcegrid", workspace_W_m=((0, 0, 0), (0, 1, 1)))
        with self.assertRaisesRegex(ValueError, "cells"):
            forcegrid.make("forcegrid", cells=0)
        method = forcegrid.make("hold")
        with self.assertRaisesRegex(ValueError, r"position_W_m: expected shape \(3,\), got \(2,\)"):
            method.take_sample(0.0, (1, 2), (0, 0, 0))
        with self.assertRaisesRegex(ValueError, r"stiffness_W_N_per_m: expected shape \(3, 3\)"):
            method.take_sample(0.0, (1, 2, 3), (0, 0, 0), (1, 2))
        with self.assertRaisesRegex(ValueError, r"time_s: expected a number or shape \(4,\), got \(3,\)"):
            method.force((1, 2, 3), np.zeros((4, 3)))
        with self.assertRaisesRegex(ValueError, "force_W_N: expected 4 forces"):
            method.take_samples(np.arange(4), np.zeros((4, 3)), np.zeros((3, 3)))
        with self.assertRaisesRegex(ValueError, "out:"):
            method.force(0.0, np.zeros((4, 3)), out=np.zeros((3, 3)))
        with self.assertRaisesRegex(TypeError, "out:"):
            method.force(0.0, np.zeros((4, 3)), out=np.zeros((4, 3), dtype=np.float32))

    def test_asks_where_it_wants_a_force(self):
        method = forcegrid.make("forcegrid+request", cells=20)
        self.assertTrue(method.needs["requests"])
        method.contact_made((0, 0, 0))
        wanted = None
        for step in range(60):
            time_s, position = step / 500, np.array((step / 5000, 0, 0))
            method.observe(time_s, position)
            method.take_sample(time_s, position, -SPRING_N_PER_M * position)
            method.work(1000)
            if wanted is None:
                wanted = method.plan_request(time_s, position)
        self.assertEqual(wanted.shape, (3,))
        method.take_sample(0.2, wanted, -SPRING_N_PER_M * wanted, from_query=True)
        self.assertIsInstance(method.counters, dict)


if __name__ == "__main__":
    unittest.main()
