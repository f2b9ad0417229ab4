// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/link_thread.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>
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

TEST(LinkThread, TellsWhereTheOtherToolsAreBesideTheSamples) {
  ServoPorts ports;
  link::SimulatorEndpoint simulator("127.0.0.1:0", 1h, {}, 2);
  LinkThread link(link::to_string(simulator.address()), ports, {}, 5);
  std::atomic<int> told = 0;
  link.on_others([&](const link::OtherTools&) { ++told; });
  link.start();
  std::uint32_t sequence = 0;
  const link::ToolState newest = reach(ports, simulator, sequence);
  EXPECT_EQ(simulator.tool(0), 5U);
  link::OtherTools others;
  others.count = 1;
  others.tools[0] = {.tool = 3, .in_contact = true, .age_ns = 7, .position_W_m = {0.0, 0.25, 0.0}};
  ASSERT_EQ(simulator.send(others, 0), link::SendStatus::kSent);
  ASSERT_EQ(simulator.send(link::answer_to(newest)), link::SendStatus::kSent);
  for (int i = 0; i < 100 * kPatience && (told == 0 || link.newest_sample_ns() == 0); ++i) {
    std::this_thread::sleep_for(1ms);
  }
  link.stop();
  EXPECT_EQ(told, 1);
  EXPECT_EQ(link.others_accepted(), 1U);
  EXPECT_EQ(link.others().tools[0].tool, 3U);
  EXPECT_EQ(link.others().tools[0].position_W_m[1], 0.25);
  EXPECT_EQ(link.samples_accepted(), 1U);
  EXPECT_EQ(link.barred(), LinkThread::Barred::kNo);
}

TEST(LinkThread, CarriesAPoseOutAndATorqueIn) {
  ServoPorts ports;
  link::SimulatorEndpoint simulator("127.0.0.1:0");
  LinkThread link(link::to_string(simulator.address()), ports);
  link.start();
  std::optional<link::ToolState> newest;
  for (std::uint32_t i = 1; i < kPatience && !(newest && newest->has_orientation); ++i) {
    ports.tool.publish(link::ToolState{.sequence = i,
                                       .servo_time_ns = i,
                                       .has_orientation = true,
                                       .has_buttons = true,
                                       .orientation_WT = {0.6, 0.0, 0.8, 0.0},
                                       .angular_velocity_W_rad_per_s = {0.0, 2.0, 0.0},
                                       .buttons = 1});
    newest = simulator.receive(100ms).tool_state;
  }
  ASSERT_TRUE(newest && newest->has_orientation);
  EXPECT_EQ(newest->orientation_WT, (link::Quaternion{0.6, 0.0, 0.8, 0.0}));
  EXPECT_EQ(newest->buttons, 1u);
  link::ForceSample answer = link::answer_to(*newest);
  answer.in_contact = true;
  answer.has_torque = true;
  answer.torque_W_Nm = {0.25, -0.5, 0.125};
  answer.orientation_WT = newest->orientation_WT;
  answer.has_rotational_stiffness = true;
  answer.rotational_stiffness_W_Nm_per_rad = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  ASSERT_EQ(simulator.send(answer), link::SendStatus::kSent);
  ArrivedSample sample;
  for (int i = 0; i < kPatience && !ports.samples.pop(sample); ++i) {
    std::this_thread::sleep_for(10ms);
  }
  link.stop();
  EXPECT_TRUE(sample.has_torque);
  EXPECT_EQ(sample.torque_W_Nm, Eigen::Vector3d(0.25, -0.5, 0.125));
  EXPECT_EQ(sample.orientation_WT_wxyz, (std::array<double, 4>{0.6, 0.0, 0.8, 0.0}));
  EXPECT_TRUE(sample.has_rotational_stiffness);
  EXPECT_EQ(sample.rotational_stiffness_W_Nm_per_rad(1, 2), 6.0);
  EXPECT_TRUE(link.simulator_knows_poses());
}

TEST(LinkThread, CarriesTheGradientAndTheInfluenceOfAnotherToolIn) {
  ServoPorts ports;
  link::SimulatorEndpoint simulator("127.0.0.1:0");
  LinkThread link(link::to_string(simulator.address()), ports, {}, 2);
  link.start();
  std::optional<link::ToolState> newest;
  for (std::uint32_t i = 1; i < kPatience && !newest; ++i) {
    ports.tool.publish(link::ToolState{.sequence = i, .servo_time_ns = i});
    newest = simulator.receive(100ms).tool_state;
  }
  ASSERT_TRUE(newest && simulator.knows_sensitivities());
  link::ForceSample answer = link::answer_to(*newest);
  answer.has_torque = answer.has_torque_gradient = true;
  answer.torque_gradient_W_N = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  answer.influence_count = 1;
  answer.influences[0] = {.tool = 5,
                          .echo_sequence = 77,
                          .position_W_m = {0.25, -0.5, 0.125},
                          .stiffness_W_N_per_m = {9, 8, 7, 6, 5, 4, 3, 2, 1}};
  ASSERT_EQ(simulator.send(answer), link::SendStatus::kSent);
  ArrivedSample sample;
  for (int i = 0; i < kPatience && !ports.samples.pop(sample); ++i) {
    std::this_thread::sleep_for(10ms);
  }
  link.stop();
  EXPECT_EQ(sample.echo_sequence, newest->sequence);
  EXPECT_TRUE(sample.has_torque_gradient);
  EXPECT_EQ(sample.torque_gradient_W_N(1, 2), 6.0);
  ASSERT_EQ(sample.influence_count, 1U);
  const ToolInfluence& other = sample.influences[0];
  EXPECT_EQ(other.tool, 5U);
  EXPECT_EQ(other.echo_sequence, 77U);
  EXPECT_EQ(other.position_W, Eigen::Vector3d(0.25, -0.5, 0.125));
  EXPECT_EQ(other.stiffness_W(0, 1), 8.0);
  EXPECT_TRUE(sample.sample.has_influence);
  EXPECT_EQ(sample.sample.influence_W, other.stiffness_W);
  EXPECT_EQ(sample.sample.other_position_W, other.position_W);
}

TEST(LinkThread, TellsWhyTheSimulatorDoesNotServeIt) {
  ServoPorts ports;
  link::SimulatorEndpoint simulator("127.0.0.1:0", 1h, {}, 2);
  LinkThread first(link::to_string(simulator.address()), ports, {}, 1);
  first.start();
  std::uint32_t sequence = 0;
  static_cast<void>(reach(ports, simulator, sequence));
  ServoPorts other_ports;
  LinkThread second(link::to_string(simulator.address()), other_ports, {}, 1);
  second.start();
  for (int i = 0; i < kPatience && second.barred() == LinkThread::Barred::kNo; ++i) {
    ++sequence;
    other_ports.tool.publish(link::ToolState{.sequence = sequence, .servo_time_ns = sequence});
    static_cast<void>(simulator.receive(100ms));
  }
  EXPECT_EQ(second.barred(), LinkThread::Barred::kToolTaken);
  EXPECT_EQ(second.most_tools(), 2U);
  second.stop();
  first.stop();
}

}  // namespace
}  // namespace forcegrid::servo
