// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rt/percentiles.h"

namespace forcegrid::tools {

/// Number of values above the previous bin's limit and at most `up_to_us`.
struct LatencyBin {
  double up_to_us;  ///< infinity for the last bin
  std::uint64_t count;
};

/// Makes bins with limits of 1, 2, 5, 10, ... us up to 100 ms, and one for larger values; empty
/// bins at both ends are left out. Limits are accurate to 0.2 %, the resolution of rt::Percentiles.
std::vector<LatencyBin> latency_histogram(const rt::Percentiles& latency_us);

/// Formats one line per bin: limit, count, and a bar whose length is its share of all values.
std::vector<std::string> histogram_lines(const std::vector<LatencyBin>& bins);

/// A bar of `width` characters for a `fraction` of 1 or more, empty for 0 or less.
std::string text_bar(double fraction, int width);

}  // namespace forcegrid::tools
