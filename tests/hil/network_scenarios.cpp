// SPDX-License-Identifier: Apache-2.0
// The link under a key through the kernel's own network emulation: the simulator in a network
// namespace of its own, as on another machine, and netem on both ends of the cable between.

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
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

constexpr int kServoRate_Hz = 500;

/// Sends what looks like sealed datagrams to some ports, each ten times as often as a servo sends,
/// for as long as it lives. From this side, whose address the far simulator allows.
class Flood {
 public:
  explicit Flood(std::vector<std::pair<std::string, int>> targets)
      : targets_(std::move(targets)), thread_([this] { run(); }) {}
  ~Flood() {
    stop_ = true;
    thread_.join();
  }
  Flood(const Flood&) = delete;
  Flood& operator=(const Flood&) = delete;

  std::uint64_t sent() const { return sent_; }

 private:
  void run() {
    const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
    std::array<char, 180> datagram{'F', 'G', 'R', 'S'};
    while (!stop_) {
      for (int i = 0; i < 10 * kServoRate_Hz / 100; ++i) {
        for (const auto& [host, port] : targets_) {
          sockaddr_in address{};
          address.sin_family = AF_INET;
          address.sin_port = htons(static_cast<std::uint16_t>(port));
          ::inet_pton(AF_INET, host.c_str(), &address.sin_addr);
          sent_ += ::sendto(socket, datagram.data(), datagram.size(), 0,
                            reinterpret_cast<const sockaddr*>(&address),
                            sizeof address) == static_cast<ssize_t>(datagram.size())
                       ? 1
                       : 0;
        }
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    ::close(socket);
  }

  std::vector<std::pair<std::string, int>> targets_;
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> sent_{0};
  std::thread thread_;
};

/// The port of the only UDP socket on this side; 0 if there is none.
int port_of_the_servo() {
  std::ifstream table("/proc/net/udp");
  std::string line;
  std::getline(table, line);  // the titles
  int port = 0;
  while (std::getline(table, line)) {
    EXPECT_EQ(port, 0) << "another socket: " << line;
    std::istringstream words(line);
    std::string number, local;
    words >> number >> local;
    port = std::stoi(local.substr(local.find(':') + 1), nullptr, 16);
  }
  return port;
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

  void start_simulator() {
    simulator_ = std::make_unique<Program>(std::vector<std::string>{
        "/usr/bin/ip", "netns", "exec", "far", "forcegrid", "simulate", "--scene", "small",
        "--listen", "10.7.0.2:24870", "--key", "/tmp/link.key", "--allow", "10.7.0.1", "--json",
        "/tmp/far.json"});
    simulator_->wait_for_line("listening ");
  }

  /// Feels the far simulator while both ways are as `netem` says.
  json feel_through(const std::string& netem, double seconds = kSeconds) {
    must("/usr/bin/tc qdisc add dev here root netem " + netem);
    must("/usr/bin/ip netns exec far /usr/bin/tc qdisc add dev there root netem " + netem);
    start_simulator();
    const Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
    const EndedRun felt =
        run("hid:1234:0006", seconds,
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
  // Datagrams that set the link up are lost, too, and each costs a part of the run.
  const json summary = feel_through("loss 20%", 2.0 * kSeconds);
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

// A stock kernel makes a wake-up late by itself now and then, where time goes by instructions, too:
// a flood that cost deadlines would cost them by the hundred.
TEST_F(LongNetwork, AFloodOfForgedDatagramsAtBothEndsCostsHardlyADeadline) {
  start_simulator();
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const std::string folder = forcegrid::testing::fresh_folder("flood");
  Program felt = Program::forcegrid(
      run_arguments("hid:1234:0006", kSeconds, folder,
                    {"--calibrated", "--simulator", "10.7.0.2:24870", "--key", "/tmp/link.key"}));
  int port = 0;
  ASSERT_TRUE(eventually([&port] { return (port = port_of_the_servo()) != 0; }))
      << shell("cat /proc/net/udp").text;
  std::uint64_t sent = 0;
  {
    const Flood flood({{"10.7.0.2", 24870}, {"10.7.0.1", port}});
    EXPECT_EQ(felt.wait(std::chrono::seconds(40)).value_or(-1), 0) << felt.standard_error();
    sent = flood.sent();
  }
  const json summary = json::parse(forcegrid::testing::text_of(folder + "/summary.json"));
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_GT(samples(summary), 60);
  constexpr auto kReached = static_cast<std::uint64_t>(0.5 * 10.0 * kServoRate_Hz * kSeconds);
  EXPECT_GT(summary.at("samples_rejected").get<std::uint64_t>(), kReached);
  simulator_->send_signal(SIGINT);
  EXPECT_EQ(simulator_->wait().value_or(-1), 128 + SIGINT);
  const json far = json::parse(forcegrid::testing::text_of("/tmp/far.json"));
  EXPECT_GT(far.at("datagrams_dropped").at("seal: bad version").get<std::uint64_t>(), kReached);
  EXPECT_EQ(bench.end().at("final_current_mA"), json({0.0, 0.0, 0.0}));
  measured("datagrams_sent", static_cast<double>(sent), "1");
  measured("refused_by_the_servo", summary.at("samples_rejected").get<double>(), "1");
  measured("missed_deadlines", summary.at("missed_deadlines").get<double>(), "1");
  measured("wakeup_p999", summary.at("wakeup_us").at("p999").get<double>(), "us");
  const char* machine = std::getenv("HIL_MACHINE");
  if (machine != nullptr && std::string(machine) == "instructions") {
    EXPECT_LE(summary.at("missed_deadlines").get<double>(), 0.005 * kServoRate_Hz * kSeconds);
  }
}

}  // namespace
}  // namespace forcegrid::hil
