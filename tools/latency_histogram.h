#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rt/percentiles.h"

namespace forcegrid::tools {

/// Values above the bin before this one, and at most `up_to_us`.
struct LatencyBin {
  double up_to_us;  ///< infinity for the last bin
  std::uint64_t count;
};

/// Bins of 1, 2, 5, 10, ... us up to 100 ms, and one beyond; empty ones at both ends are left out.
/// Edges are met to within 0.2 %, as rt::Percentiles keeps its values.
std::vector<LatencyBin> latency_histogram(const rt::Percentiles& latency_us);

/// One line a bin: edge, count, and a bar as long as its share of all.
std::vector<std::string> histogram_lines(const std::vector<LatencyBin>& bins);

/// `width` characters where `fraction` is 1 (or more), none where it is 0 (or less).
std::string text_bar(double fraction, int width);

}  // namespace forcegrid::tools
