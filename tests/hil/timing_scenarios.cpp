#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <sstream>
#include <vector>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using ::testing::HasSubstr;

/// Wake-up latencies by whole microseconds, as cyclictest prints them.
struct Histogram {
  std::vector<std::uint64_t> wakeups;  ///< by latency [us]
  std::uint64_t count = 0;

  /// [us] that `share` of the wake-ups did not exceed.
  double at(double share) const {
    std::uint64_t passed = 0;
    for (std::size_t us = 0; us < wakeups.size(); ++us) {
      passed += wakeups[us];
      if (static_cast<double>(passed) >= share * static_cast<double>(count)) {
        return static_cast<double>(us);
      }
    }
    return static_cast<double>(wakeups.size());
  }
};

/// Lines of two numbers; what else cyclictest says begins with another character.
Histogram histogram_of(const std::string& text) {
  Histogram histogram;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::size_t us = 0;
    std::uint64_t count = 0;
    if (!line.empty() && line[0] >= '0' && line[0] <= '9' && words >> us >> count) {
      histogram.wakeups.resize(us + 1);
      histogram.wakeups[us] = count;
      histogram.count += count;
    }
  }
  return histogram;
}

// What this kernel on this machine can do at all, and what the servo loop makes of it, one after
// the other in the same boot: both sleep to absolute times with real-time priority 80, 500 times a
// second.
TEST(LongTiming, OfTheServoLoopBesideCyclictest) {
  constexpr double kSeconds = 4.0;
  const ShellResult cyclictest = shell(
      "cyclictest --quiet --mlockall --priority=80 --interval=2000 --duration=4 "
      "--histogram=200000");
  ASSERT_EQ(cyclictest.status, 0) << cyclictest.text;
  EXPECT_THAT(cyclictest.text, HasSubstr("# Histogram Overflows: 00000"));
  const Histogram histogram = histogram_of(cyclictest.text);
  ASSERT_GT(histogram.count, 100U) << cyclictest.text.substr(0, 1000);
  const std::pair<const char*, double> parts[] = {
      {"p50", 0.5}, {"p99", 0.99}, {"p999", 0.999}, {"max", 1.0}};
  for (const auto& [name, share] : parts) {
    measured(std::string("cyclictest_wakeup_") + name, histogram.at(share), "us");
  }

  Bench bench;
  const EndedRun felt = run("hid:1234:0006", kSeconds);
  ASSERT_EQ(felt.status, 0) << felt.text;
  for (const char* what : {"wakeup_us", "period_us", "compute_us", "report_age_us"}) {
    const std::string name(what, std::string(what).size() - 3);
    for (const auto& [part, share] : parts) {
      measured("servo_" + name + "_" + part, felt.summary.at(what).at(part).get<double>(), "us");
    }
    EXPECT_LE(felt.summary.at(what).at("p50"), felt.summary.at(what).at("max")) << what;
  }
  EXPECT_GT(felt.summary.at("wakeup_us").at("p50").get<double>(), 0.0);
  measured("servo_rate", felt.summary.at("servo_rate_Hz").get<double>(), "Hz");
  measured("missed_deadlines", felt.summary.at("missed_deadlines").get<double>(), "1");
  EXPECT_EQ(bench.end().at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
}

}  // namespace
}  // namespace forcegrid::hil
