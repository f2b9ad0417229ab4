// SPDX-License-Identifier: Apache-2.0
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "bench/ratios.h"

namespace forcegrid::bench {
namespace {

struct RatioLine {
  std::string numerator, denominator, goal;
};
struct TimeLine {
  std::string name, goal;
};
std::vector<RatioLine>& ratio_lines() {
  static std::vector<RatioLine> lines;
  return lines;
}
std::vector<TimeLine>& time_lines() {
  static std::vector<TimeLine> lines;
  return lines;
}

// Stores every repetition's time per item; the console shows only the aggregates.
class Collector : public benchmark::ConsoleReporter {
 public:
  void ReportRuns(const std::vector<Run>& runs) override {
    for (const Run& run : runs) {
      if (run.run_type == Run::RT_Iteration && !run.error_occurred) {
        const auto items = run.counters.find("items_per_second");
        if (items != run.counters.end() && items->second.value > 0.0) {
          times_ns_[run.run_name.function_name].push_back(1e9 / items->second.value);
        }
      }
    }
    if (!runs.empty() && runs.front().run_type == Run::RT_Aggregate) {
      ConsoleReporter::ReportRuns(runs);  // single repetitions would fill the screen
    }
  }
  double median_ns(const std::string& name) const {
    const auto found = times_ns_.find(name);
    if (found == times_ns_.end()) {
      return 0.0;
    }
    std::vector<double> sorted = found->second;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }

 private:
  std::map<std::string, std::vector<double>> times_ns_;
};

}  // namespace

void report_ratio(const std::string& numerator, const std::string& denominator,
                  const std::string& goal) {
  ratio_lines().push_back({numerator, denominator, goal});
}

void report_time(const std::string& name, const std::string& goal) {
  time_lines().push_back({name, goal});
}

}  // namespace forcegrid::bench

int main(int argc, char** argv) {
  // Interleaved repetitions, so that a drift of the machine's speed affects both sides of a ratio
  // equally.
  std::vector<char*> arguments(argv, argv + argc);
  std::string repetitions = "--benchmark_repetitions=9";
  std::string interleave = "--benchmark_enable_random_interleaving=true";
  std::string minimum = "--benchmark_min_time=0.05";
  arguments.insert(arguments.begin() + 1, {repetitions.data(), interleave.data(), minimum.data()});
  int count = static_cast<int>(arguments.size());
  benchmark::Initialize(&count, arguments.data());
  if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) {
    return 1;
  }
  forcegrid::bench::Collector collector;
  benchmark::RunSpecifiedBenchmarks(&collector);

  const double baseline_ns = collector.median_ns("bare_trilinear_query");
  if (baseline_ns <= 0.0) {
    return 0;  // a filter excluded the baseline: no ratios
  }
  const double scale = 4.0 / baseline_ns;
  std::printf(
      "\nTime per item, median           measured    on a core where bare_trilinear_query is 4 ns  "
      " goal\n");
  for (const auto& line : forcegrid::bench::time_lines()) {
    const double ns = collector.median_ns(line.name);
    if (ns > 0.0) {
      std::printf("%-28s %10.2f ns %18.2f ns %33s\n", line.name.c_str(), ns, ns * scale,
                  line.goal.c_str());
    }
  }
  std::printf(
      "\nRatio of medians in this run                                       value   goal\n");
  for (const auto& line : forcegrid::bench::ratio_lines()) {
    const double above = collector.median_ns(line.numerator);
    const double below = collector.median_ns(line.denominator);
    if (above > 0.0 && below > 0.0) {
      std::printf("%-28s / %-28s %9.3f   %s\n", line.numerator.c_str(), line.denominator.c_str(),
                  above / below, line.goal.c_str());
    }
  }
  return 0;
}
