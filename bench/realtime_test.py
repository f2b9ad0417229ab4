"""What bench/realtime.py makes of cyclictest's words and of the loop's cycles."""

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
        latencies = numpy.full(10_000, 30.0)
        near = realtime.summary(500, latencies, {"loop": [part([45.0] * 5000), part([45.0] * 5000)]})
        self.assertEqual(near["added_at_p99_9_us"], 15.0)
        self.assertTrue(near["goal_met"])
        self.assertEqual(near["loop"]["wakeup"]["count"], 10_000)
        far = realtime.summary(500, latencies, {"loop": [part([45.0] * 9000 + [60.0] * 1000)]})
        self.assertEqual(far["added_at_p99_9_us"], 30.0)
        self.assertFalse(far["goal_met"])

    def test_meets_no_goal_without_real_time_scheduling(self):
        result = realtime.summary(500, numpy.full(1000, 30.0), {"loop": [part([30.0] * 1000, granted=False)]})
        self.assertFalse(result["goal_met"])

    def test_counts_misses_of_both(self):
        latencies = numpy.array([10.0] * 999 + [2000.0])
        result = realtime.summary(500, latencies, {"loop": [part([10.0] * 998, missed=2)]})
        self.assertEqual(result["cyclictest"]["missed_percent"], 0.1)
        self.assertEqual(result["loop"]["missed_percent"], 0.2)


if __name__ == "__main__":
    unittest.main()
