// The link under a key through the kernel's own network emulation: the simulator in a network
// namespace of its own, as on another machine, and netem on both ends of the cable between.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using nlohmann::json;

constexpr double kSeconds = 4.0;

// Commands have their paths, else busybox's shell would take its own of that name.
void must(const std::string& command) {
  const ShellResult result = shell(command);
  ASSERT_EQ(result.status, 0) << command << ": " << result.text;
}

/// Namespace "far" with a simulator at 10.7.0.2; this side is 10.7.0.1.
class LongNetwork : public ::testing::Test {
 protected:
  void SetUp() override {
    must("/usr/bin/ip netns add far");
    must("/usr/bin/ip link add here type veth peer name there netns far");
    must("/usr/bin/ip addr add 10.7.0.1/24 dev here && /usr/bin/ip link set here up");
    must(
        "/usr/bin/ip -n far addr add 10.7.0.2/24 dev there && /usr/bin/ip -n far link set there "
        "up");
    must("rm -f /tmp/link.key && forcegrid keygen /tmp/link.key");
  }
  void TearDown() override {
    simulator_.reset();
    shell("/usr/bin/ip link del here; /usr/bin/ip netns del far");
  }

  /// Feels the far simulator while both ways are as `netem` says.
  json feel_through(const std::string& netem) {
    must("/usr/bin/tc qdisc add dev here root netem " + netem);
    must("/usr/bin/ip netns exec far /usr/bin/tc qdisc add dev there root netem " + netem);
    simulator_ = std::make_unique<Program>(std::vector<std::string>{
        "/usr/bin/ip", "netns", "exec", "far", "forcegrid", "simulate", "--scene", "small",
        "--listen", "10.7.0.2:24870", "--key", "/tmp/link.key", "--allow", "10.7.0.1"});
    simulator_->wait_for_line("listening ");
    const Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
    const EndedRun felt =
        run("hid:1234:0006", kSeconds,
            {"--calibrated", "--simulator", "10.7.0.2:24870", "--key", "/tmp/link.key"});
    EXPECT_EQ(felt.status, 0) << felt.text;
    if (!felt.summary.is_object()) {
      throw std::runtime_error("the run gave no summary");
    }
    EXPECT_EQ(felt.summary.value("faults", json()), json::array()) << felt.text;
    EXPECT_TRUE(felt.summary.value("zero_current_delivered", false));
    const json link = felt.summary.value("link", json::object());
    EXPECT_TRUE(link.value("clock_known", false));
    measured("samples", felt.summary.value("samples_received", 0.0), "1");
    measured("samples_lost", felt.summary.value("samples_lost", 0.0), "1");
    measured("round_trip", 1e3 * link.value("round_trip_s", 0.0), "ms");
    measured("clock_offset", 1e3 * link.value("clock_offset_s", 0.0), "ms");
    // One kernel has one clock.
    EXPECT_LE(std::abs(link.value("clock_offset_s", 1.0)), 0.5 * link.value("round_trip_s", 0.0));
    return felt.summary;
  }

  static double round_trip_s(const json& summary) {
    return summary.at("link").at("round_trip_s").get<double>();
  }
  static int samples(const json& summary) { return summary.at("samples_received").get<int>(); }

  std::unique_ptr<Program> simulator_;
};

// The simulator answers 30 times a second: some 120 times in a run, of which the calibration and
// the start take some.
TEST_F(LongNetwork, OfLongWaysDelaysTheForceByThem) {
  const json summary = feel_through("delay 40ms");
  EXPECT_GE(round_trip_s(summary), 0.080);
  EXPECT_GE(summary.at("sample_age_ms").at("p50").get<double>(), 80.0);
  EXPECT_GT(samples(summary), 60);
}

TEST_F(LongNetwork, WithJitterKeepsTheOrder) {
  const json summary = feel_through("delay 10ms 8ms");
  EXPECT_GE(round_trip_s(summary), 0.004);
  EXPECT_GT(samples(summary), 60);
}

TEST_F(LongNetwork, ThatLosesAFifthIsFeltThroughAndCounted) {
  const json summary = feel_through("loss 20%");
  EXPECT_GT(samples(summary), 50);
  EXPECT_GT(summary.at("samples_lost").get<int>(), 5);
}

TEST_F(LongNetwork, ThatRepeatsDatagramsHasEachOneTakenOnce) {
  const json summary = feel_through("duplicate 30%");
  EXPECT_GT(samples(summary), 60);
  EXPECT_GT(summary.at("link").at("datagrams_dropped").value("seal: replayed", 0), 5);
}

TEST_F(LongNetwork, ThatReordersDatagramsIsFeltThrough) {
  const json summary = feel_through("delay 20ms reorder 30%");
  EXPECT_GT(samples(summary), 50);
}

TEST_F(LongNetwork, OfOneMegabitASecondSuffices) {
  const json summary = feel_through("rate 1mbit");
  EXPECT_GT(samples(summary), 60);
  EXPECT_EQ(summary.at("samples_lost"), 0);
}

}  // namespace
}  // namespace forcegrid::hil
