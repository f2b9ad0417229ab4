#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What bench/client_cycle.py makes of the numbers of its slices."""

import unittest

import client_cycle


def times(p50):
    return {"p50": p50, "p99": p50 + 1.0, "p999": p50 + 2.0, "max": p50 + 3.0}


class Summary(unittest.TestCase):
    def test_a_programs_line_is_read_by_its_name(self):
        text = "wakeup_us p50 3.50 p99 4.25\ncompute_us p50 5.00 p99 6.00\n"
        self.assertEqual(client_cycle.numbers(text, "compute_us"), {"p50": 5.0, "p99": 6.0})

    def test_what_is_added_is_the_median_over_neighbouring_slices(self):
        bare = [{"compute_us": times(value), "wakeup_us": times(30.0)} for value in (5.0, 9.0, 6.0)]
        client = [{"compute_us": times(value), "wakeup_us": times(31.0), "frame_us": times(1.5)}
                  for value in (5.5, 9.25, 7.0)]
        result = client_cycle.summary(bare, client)
        self.assertEqual(result["added_by_pair_us"], [0.5, 0.25, 1.0])
        self.assertEqual(result["added_compute_p50_us"], 0.5)
        self.assertEqual(result["bare"]["compute_us"]["p50"], 6.0)
        self.assertEqual(result["client"]["wakeup_us"]["max"], 34.0)


if __name__ == "__main__":
    unittest.main()
