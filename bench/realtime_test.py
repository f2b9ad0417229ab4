# SPDX-License-Identifier: Apache-2.0
"""Tests how bench/realtime.py evaluates cyclictest's output and the loop's cycles."""

import sys
import unittest
from pathlib import Path

import numpy

sys.path.insert(0, str(Path(__file__).parent))
import realtime  # noqa: E402


def part(late_us, missed=0, granted=True):
    values = numpy.array(late_us, dtype=float)
    return {"wakeup": values, "compute": values / 10, "io": values * 2, "missed": missed, "realtime": granted}


class Realtime(unittest.TestCase):
    def test_reads_cyclictests_histogram_with_what_is_beyond_it(self):
        text = "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000003 000002\n000017 000001\n\n" \
               "# Total: 000000003\n# Histogram Overflows: 00001\n"
        self.assertEqual(sorted(realtime.parse_histogram(text)), [3, 3, 17, realtime.LONGEST_US])

    def test_compares_the_99_9th_percentiles(self):
        latencies = [numpy.full(5000, 30.0), numpy.full(5000, 130.0)]  # a disturbance that both slices met
        near = realtime.summary(500, latencies, {"loop": [part([45.0] * 5000), part([145.0] * 5000)]})
        self.assertEqual(near["added_at_p99_9_us"], {"median": 15.0, "low": 15.0, "high": 15.0, "slices": 2})
        self.assertEqual(near["cyclictest_wanders_us"], 100.0)
        self.assertIs(near["goal_met"], True)
        self.assertEqual(near["loop"]["wakeup"]["count"], 10_000)
        far = realtime.summary(500, latencies[:1], {"loop": [part([45.0] * 9000 + [60.0] * 1000)]})
        self.assertEqual(far["added_at_p99_9_us"]["median"], 30.0)
        self.assertIs(far["goal_met"], False)

    def test_says_nothing_of_the_goal_where_the_slices_disagree(self):
        plain = [numpy.full(1000, 30.0)] * 6
        loops = [part([30.0 + more] * 1000) for more in (-40, -5, 0, 5, 10, 90)]
        result = realtime.summary(500, plain, {"loop": loops})
        self.assertEqual(result["added_at_p99_9_us"], {"median": 2.5, "low": -40.0, "high": 90.0, "slices": 6})
        self.assertIsNone(result["goal_met"])

    def test_the_interval_of_a_median_is_that_of_the_binomial_distribution(self):
        # 12 values: P(X <= 2) = 79/4096 = 1.9 %, P(X <= 3) = 7.3 %: ranks 3 and 10. 20 values: P(X <= 5) =
        # 2.1 %, P(X <= 6) = 5.8 %: ranks 6 and 15.
        twelve = realtime.median_interval(list(range(1, 13)))
        self.assertEqual((twelve["low"], twelve["high"]), (3.0, 10.0))
        twenty = realtime.median_interval(list(range(1, 21)))
        self.assertEqual((twenty["low"], twenty["high"]), (6.0, 15.0))

    def test_meets_no_goal_without_real_time_scheduling(self):
        result = realtime.summary(500, [numpy.full(1000, 30.0)], {"loop": [part([30.0] * 1000, granted=False)]})
        self.assertFalse(result["goal_met"])

    def test_counts_misses_of_both(self):
        latencies = numpy.array([10.0] * 995 + [2000.0] + [8100.0])  # 1 and 4 deadlines
        result = realtime.summary(500, [latencies], {"loop": [part([10.0] * 998, missed=2)]})
        self.assertEqual(result["cyclictest"]["missed_percent"], 0.499)  # 5 of 1002
        self.assertEqual(result["loop"]["missed_percent"], 0.2)


if __name__ == "__main__":
    unittest.main()
