// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/link_thread.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <thread>

#include "link/simulator_endpoint.h"

namespace forcegrid::servo {
namespace {

using namespace std::chrono_literals;

constexpr int kPatience = 200;  ///< waits of up to 100 ms each

/// Publishes tool states until one of them has reached the simulator.
link::ToolState reach(ServoPorts& ports, link::SimulatorEndpoint& simulator,
                      std::uint32_t& sequence) {
  for (int i = 0; i < kPatience; ++i) {
    ++sequence;
    ports.tool.publish(link::ToolState{.sequence = sequence, .servo_time_ns = sequence});
    if (const auto news = simulator.receive(100ms); news.tool_state) {
      return *news.tool_state;
    }
  }
  ADD_FAILURE() << "no tool state came";
  return {};
}

// The servo pops its ring when a cycle comes; until then no more than the ring holds may wait for
// it.
TEST(LinkThread, KeepsTheToolMovingAndTheServosShareBoundedInAFloodOfSamples) {
  ServoPorts ports;
  link::SimulatorEndpoint simulator("127.0.0.1:0");
  LinkThread link(link::to_string(simulator.address()), ports);
  link.start();
  std::uint32_t sequence = 0;
  link::ToolState newest = reach(ports, simulator, sequence);
  constexpr int kPerToolState = 200;  // three rings full
  constexpr int kToolStates = 10;
  for (int i = 0; i < kToolStates; ++i) {
    for (int k = 0; k < kPerToolState; ++k) {
      ASSERT_EQ(simulator.send(link::answer_to(newest)), link::SendStatus::kSent);
    }
    newest = reach(ports, simulator, sequence);
  }
  link.stop();
  std::uint64_t waiting = 0;
  for (ArrivedSample sample; ports.samples.pop(sample);) {
    ++waiting;
  }
  EXPECT_GT(waiting, 0U);
  EXPECT_LE(waiting, 64U);
  EXPECT_GT(link.samples_lost(), 0U);
  EXPECT_EQ(link.statistics().accepted, waiting + link.samples_lost());
  EXPECT_EQ(link.statistics().received, link.statistics().accepted + link.statistics().dropped());
}

TEST(LinkThread, FallsSilentAfterAnExceptionAndKeepsItsWords) {
  ServoPorts ports;
  link::SimulatorEndpoint simulator("127.0.0.1:0");
  LinkThread link(link::to_string(simulator.address()), ports);
  link.on_sample([](const ArrivedSample&) { throw std::runtime_error("no memory for a sample"); });
  link.start();
  std::uint32_t sequence = 0;
  const link::ToolState newest = reach(ports, simulator, sequence);
  ASSERT_EQ(simulator.send(link::answer_to(newest)), link::SendStatus::kSent);
  ArrivedSample sample;
  for (int i = 0; i < kPatience && !ports.samples.pop(sample); ++i) {
    std::this_thread::sleep_for(10ms);
  }
  link.stop();
  EXPECT_EQ(link.trouble(), "no memory for a sample");
}

}  // namespace
}  // namespace forcegrid::servo
