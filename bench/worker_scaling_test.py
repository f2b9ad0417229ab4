# SPDX-License-Identifier: Apache-2.0
"""Tests the evaluation of bench/worker_scaling.py's measurements."""

import unittest

import worker_scaling


def measured(workers, answers_per_s):
    return {"workers": workers, "answers_per_s": answers_per_s, "taken_back": 1}


class OnPaper(unittest.TestCase):
    def test_grows_with_the_workers_until_the_simulators_thread_is_busy(self):
        # 20 ms per answer: 50 per second each; 1 ms of the thread: at most 1,000 per second.
        rates = worker_scaling.on_paper([1, 2, 20, 21, 1000], 0.018, 0.002, 0.001)
        for rate, expected in zip(rates, [50.0, 100.0, 1000.0, 1000.0, 1000.0]):
            self.assertAlmostEqual(rate, expected, places=6)


class Rows(unittest.TestCase):
    def test_take_the_median_of_the_ratios_of_each_round(self):
        # In the second round the machine was half as fast; no ratio may show that.
        rounds = [[measured(1, 100.0), measured(2, 190.0)], [measured(1, 50.0), measured(2, 95.0)],
                  [measured(1, 100.0), measured(2, 150.0)]]
        one, two, *sleepers = worker_scaling.rows_of(rounds, [measured(1, 10.0), measured(4, 39.0)])
        self.assertEqual(one["ratio"], 1.0)
        self.assertAlmostEqual(two["ratio"], 1.9)
        self.assertAlmostEqual(two["ratio_low"], 1.5)
        self.assertEqual(two["taken_back"], 3)
        self.assertEqual([row["ratio"] for row in sleepers], [1.0, 3.9])


if __name__ == "__main__":
    unittest.main()
