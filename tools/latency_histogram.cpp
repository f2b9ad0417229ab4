// SPDX-License-Identifier: Apache-2.0
#include "tools/latency_histogram.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

namespace forcegrid::tools {
namespace {

constexpr std::array<double, 17> kEdges_us = {1,
                                              2,
                                              5,
                                              10,
                                              20,
                                              50,
                                              100,
                                              200,
                                              500,
                                              1e3,
                                              2e3,
                                              5e3,
                                              1e4,
                                              2e4,
                                              5e4,
                                              1e5,
                                              std::numeric_limits<double>::infinity()};
constexpr int kBar = 50;

}  // namespace

std::vector<LatencyBin> latency_histogram(const rt::Percentiles& latency_us) {
  std::vector<LatencyBin> bins;
  std::uint64_t below = 0;
  for (const double edge_us : kEdges_us) {
    const std::uint64_t up_to = latency_us.count_up_to(edge_us);
    if (up_to > below || !bins.empty()) {
      bins.push_back({edge_us, up_to - below});
    }
    below = up_to;
  }
  while (!bins.empty() && bins.back().count == 0) {
    bins.pop_back();
  }
  return bins;
}

std::vector<std::string> histogram_lines(const std::vector<LatencyBin>& bins) {
  std::uint64_t all = 0;
  for (const LatencyBin& bin : bins) {
    all += bin.count;
  }
  std::vector<std::string> lines;
  for (const LatencyBin& bin : bins) {
    char text[64];
    if (std::isfinite(bin.up_to_us)) {
      std::snprintf(text, sizeof text, "<= %6.0f us %8llu ", bin.up_to_us,
                    static_cast<unsigned long long>(bin.count));
    } else {
      std::snprintf(text, sizeof text, "more         %8llu ",
                    static_cast<unsigned long long>(bin.count));
    }
    lines.push_back(text +
                    text_bar(static_cast<double>(bin.count) / static_cast<double>(all), kBar));
  }
  return lines;
}

std::string text_bar(double fraction, int width) {
  const double whole = std::clamp(fraction, 0.0, 1.0) * width;
  return std::string(static_cast<std::size_t>(std::lround(whole)), '#');
}

}  // namespace forcegrid::tools
