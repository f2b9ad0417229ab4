// SPDX-License-Identifier: Apache-2.0
// The link under a key, with the programs as a user starts them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <array>
#include <atomic>
#include <cmath>
#include <csignal>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "link/udp_socket.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

class SealedRun : public ::testing::Test {
 protected:
  SealedRun() : folder_(fresh_folder("sealed_run")) { key_ = make_key("link.key"); }

  std::string make_key(const std::string& name) const {
    const std::string file = folder_ + "/" + name;
    Program keygen = Program::forcegrid({"keygen", file});
    EXPECT_EQ(keygen.wait(), 0) << keygen.standard_error();
    return file;
  }

  /// Starts `forcegrid simulate` and waits until it listens.
  static std::unique_ptr<Program> start_simulator(const std::vector<std::string>& more) {
    std::vector<std::string> command = {"simulate", "--scene", "small", "--listen", "127.0.0.1:0"};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<Program>(forcegrid::testing::forcegrid_command(command));
  }
  static std::string address_of(const Program& simulator) {
    const std::string line = simulator.wait_for_line("listening ");
    return line.substr(10, line.find(' ', 10) - 10);
  }

  std::vector<std::string> run_at(const std::string& address,
                                  const std::vector<std::string>& more) const {
    std::vector<std::string> command = {
        "run",        "--simulator", address,          "--seconds", "3",     "--calibrated",
        "--evaluate", "hold",        "--no-reference", "--out",     folder_, "--json"};
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }

  std::string folder_;
  std::string key_;
};

TEST_F(SealedRun, FeelsASimulatorThatHasTheSameKey) {
  const auto simulator = start_simulator({"--key", key_, "--allow", "127.0.0.0/8"});
  Program run = Program::forcegrid(run_at(address_of(*simulator), {"--key", key_}));
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_GT(summary.at("samples_received").get<int>(), 20);
  EXPECT_EQ(summary.at("samples_rejected"), 0);
  const json& link = summary.at("link");
  EXPECT_TRUE(link.at("clock_known").get<bool>());
  // One machine has one clock: the estimate may be off by half the round trip.
  EXPECT_GT(link.at("round_trip_s").get<double>(), 0.0);
  EXPECT_LE(std::abs(link.at("clock_offset_s").get<double>()),
            0.5 * link.at("round_trip_s").get<double>());
  EXPECT_THAT(run.standard_error(),
              AllOf(HasSubstr("quickest round trip"), HasSubstr("simulator's clock")));
}

TEST_F(SealedRun, SealsTheLinkToTheSimulatorThatItStarts) {
  Program run =
      Program::forcegrid({"run", "--scene", "small", "--seconds", "2", "--calibrated", "--evaluate",
                          "hold", "--no-reference", "--key", key_, "--out", folder_, "--json"});
  ASSERT_EQ(run.wait(), 0) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_GT(summary.at("samples_received").get<int>(), 20);
  EXPECT_TRUE(summary.at("link").at("clock_known").get<bool>());
  // The servo does not know the simulator's stream at first; that is all that may be refused.
  for (const auto& [reason, count] : summary.at("simulator").at("datagrams_dropped").items()) {
    EXPECT_EQ(reason, "seal: stale") << count;
  }
}

TEST_F(SealedRun, FeelsNothingWithAnotherKeyAndBothEndsSayWhy) {
  const auto simulator = start_simulator({"--key", key_});
  Program run =
      Program::forcegrid(run_at(address_of(*simulator), {"--key", make_key("other.key")}));
  ASSERT_EQ(run.wait(), 4) << run.standard_error();
  EXPECT_THAT(run.standard_error(), HasSubstr("is a simulator with this key there?"));
  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("samples_received"), 0);
  EXPECT_THAT(run.standard_error(),
              HasSubstr("is a simulator listening there that has this key? It "
                        "serves one servo at a time"));
  EXPECT_TRUE(simulator->wait_for_text("seal: unknown key"));
  EXPECT_TRUE(simulator->wait_for_text("give it this simulator's key"));
}

TEST_F(SealedRun, LosesNothingInAFloodOfTenTimesItsRate) {
  constexpr int kServoRate_Hz = 500;
  constexpr auto kBurst = std::chrono::milliseconds(10);
  const auto simulator = start_simulator({"--key", key_, "--json"});
  const std::string address = address_of(*simulator);
  std::atomic<bool> stop{false};
  std::atomic<std::uint64_t> sent{0};
  std::thread flood([&] {
    link::UdpSocket socket(link::parse_address("127.0.0.1:0", link::PortZero::kAllowed));
    const auto target = link::parse_address(address, link::PortZero::kRefused);
    std::array<std::byte, 180> datagram{};
    for (std::size_t i = 0; i < 4; ++i) {
      datagram[i] = static_cast<std::byte>("FGRS"[i]);
    }
    while (!stop) {
      for (int i = 0; i < kServoRate_Hz / 10; ++i) {  // each 10 ms: 10 times what the servo sends
        sent += socket.send_to(target, datagram) == 0 ? 1 : 0;
      }
      std::this_thread::sleep_for(kBurst);
    }
  });
  Program run = Program::forcegrid(run_at(address, {"--key", key_}));
  const auto status = run.wait();
  stop = true;
  flood.join();
  ASSERT_EQ(status, 0) << run.standard_error();
  const json summary = json::parse(run.standard_output());
  EXPECT_EQ(summary.at("faults"), json::array());
  EXPECT_GT(summary.at("samples_received").get<int>(), 20);
  EXPECT_EQ(summary.at("samples_rejected"), 0);
  EXPECT_EQ(summary.at("samples_overrun"), 0);
  simulator->send_signal(SIGINT);
  ASSERT_EQ(simulator->wait(), 130);
  const std::string report = simulator->standard_output();
  const json at_simulator = json::parse(report.substr(report.find('{')));
  const json& dropped = at_simulator.at("datagrams_dropped");
  EXPECT_GT(dropped.at("seal: bad version").get<std::uint64_t>(), sent / 2);
}

TEST_F(SealedRun, KeepsKeysOutOfSightAndRefusesTheirMisuse) {
  Program again = Program::forcegrid({"keygen", key_});
  EXPECT_EQ(again.wait(), 1);
  EXPECT_THAT(again.standard_error(), HasSubstr("is not overwritten"));
  ASSERT_EQ(::chmod(key_.c_str(), 0644), 0);
  for (const std::string command : {"run", "simulate"}) {
    Program open = Program::forcegrid({command, "--key", key_});
    EXPECT_EQ(open.wait(), 1);
    EXPECT_THAT(open.standard_error(), HasSubstr("chmod 600 '" + key_ + "'"));
  }
  Program far = Program::forcegrid({"run", "--simulator", "192.0.2.1:24870"});
  EXPECT_EQ(far.wait(), 1);
  EXPECT_THAT(far.standard_error(), AllOf(HasSubstr("forcegrid keygen"), HasSubstr("--key FILE")));
  Program everywhere = Program::forcegrid({"simulate", "--listen", "0.0.0.0:0"});
  EXPECT_EQ(everywhere.wait(), 1);
  EXPECT_THAT(everywhere.standard_error(), HasSubstr("forcegrid keygen"));
}

}  // namespace
}  // namespace forcegrid
