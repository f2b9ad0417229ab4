// SPDX-License-Identifier: Apache-2.0
// Both ends of the link with an impaired network between them, in simulated time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <optional>
#include <random>
#include <vector>

#include "link/sequence_tracker.h"
#include "link/servo_endpoint.h"
#include "link/simulator_endpoint.h"
#include "tests/link/counting_key.h"
#include "tests/support/impaired_network.h"

namespace forcegrid::link {
namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t kSeed = 8;
constexpr double kServoPeriod_s = 0.002;
constexpr int kCyclesPerAnswer = 17;  // 34 ms: a simulator at about 30 Hz
constexpr double kStiffness_N_per_m = 200.0;
constexpr double kRounding_s = 1e-6;

Vector3 position_at(double time_s) {
  return {0.02 * std::sin(5.0 * time_s), 0.01 * std::cos(7.0 * time_s), 0.0};
}

std::int64_t nanoseconds(double time_s) { return std::llround(1e9 * time_s); }

/// A servo at 500 Hz and a simulator of a spring, with the network between them.
class Session {
 public:
  Session(const Impairment& impairment, bool sealed)
      : simulator("127.0.0.1:0", 1h, access(sealed)),
        network(simulator.address(), impairment, kSeed),
        servo(network.address(), ServoEndpoint::random_session_id(),
              sealed ? counting_keys(0) : std::vector<LinkKey>{}) {}

  void run_for(double time_s) {
    const int cycles = static_cast<int>(std::lround(time_s / kServoPeriod_s));
    for (int i = 0; i < cycles; ++i) {
      cycle();
    }
  }

  void cycle() {
    ++sequence;
    const double now_s = kServoPeriod_s * sequence;
    servo.send(ToolState{.sequence = sequence,
                         .servo_time_ns = nanoseconds(now_s),
                         .position_W_m = position_at(now_s)});
    network.move_on_to(now_s);
    const auto news = simulator.receive(0ns);
    if (news.tool_state) {
      newest = news.tool_state;
    }
    if (sequence % kCyclesPerAnswer == 0 && newest) {
      answer(*newest);
      newest.reset();
    }
    network.move_on_to(now_s);
    while (const auto sample = servo.receive()) {
      take(*sample, now_s);
    }
  }

  /// Moves the network on, but neither servo nor simulator.
  void let_all_arrive() {
    const double end_s = kServoPeriod_s * sequence + 1.0;
    network.move_on_to(end_s);
    static_cast<void>(simulator.receive(0ns));
    network.move_on_to(end_s);
    while (const auto sample = servo.receive()) {
      ++taken;
    }
  }

  void answer(const ToolState& state) {
    ForceSample sample = answer_to(state);
    for (std::size_t i = 0; i < 3; ++i) {
      sample.force_W_N[i] = -kStiffness_N_per_m * state.position_W_m[i];
    }
    simulator.send(sample);
    ++answers;
  }

  void take(const ForceSample& sample, double now_s) {
    ++taken;
    EXPECT_GT(ahead_of(sample.echo_sequence, newest_echo), 0);
    newest_echo = sample.echo_sequence;
    const Vector3 position_W_m = position_at(kServoPeriod_s * sample.echo_sequence);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(sample.force_W_N[i], -kStiffness_N_per_m * position_W_m[i]);
    }
    youngest_s =
        std::min(youngest_s, now_s - 1e-9 * static_cast<double>(sample.echo_servo_time_ns));
    oldest_s = std::max(oldest_s, now_s - 1e-9 * static_cast<double>(sample.echo_servo_time_ns));
  }

  static void expect_all_counted(const LinkStatistics& counted) {
    EXPECT_EQ(counted.received, counted.accepted + counted.hellos + counted.dropped());
    EXPECT_EQ(counted.malformed_total() + counted.forged + counted.foreign_address +
                  counted.foreign_session + counted.unexpected_type,
              0U);
  }

  static Access access(bool sealed) {
    Access result;
    if (sealed) {
      result.keys = counting_keys(0);
    }
    return result;
  }

  SimulatorEndpoint simulator;
  ImpairedNetwork network;
  ServoEndpoint servo;
  std::uint32_t sequence = 0;
  std::optional<ToolState> newest;
  int answers = 0;
  int taken = 0;
  std::uint32_t newest_echo = 0;
  double youngest_s = 1e9;
  double oldest_s = 0.0;
};

class ImpairedLink : public testing::TestWithParam<Impairment> {};

TEST_P(ImpairedLink, BringsTrueForcesInOrderAndCountsTheRest) {
  const Impairment& impairment = GetParam();
  std::cout << "seed " << kSeed << "\n";
  for (const bool sealed : {false, true}) {
    SCOPED_TRACE(sealed ? "sealed" : "not sealed");
    Session session(impairment, sealed);
    session.run_for(5.0);
    session.let_all_arrive();
    Session::expect_all_counted(session.servo.statistics());
    Session::expect_all_counted(session.simulator.statistics());
    // An answer is not taken if it is lost or was overtaken: with 34 ms between answers and less
    // jitter than that, only the lost ones are missing. (A hello, or one copy of two, may be among
    // those, too.)
    const int lost = static_cast<int>(session.network.back().lost());
    EXPECT_LE(session.taken, session.answers);
    EXPECT_GE(session.taken, session.answers - lost - 1);
    EXPECT_GT(session.answers, 120);
    // There and back takes twice the delay at least; at most the jitter, what is sent in a queue of
    // the rate's and one cycle of the servo come on top of it.
    const double queue_s =
        impairment.rate_bit_per_s > 0.0
            ? 8.0 * static_cast<double>(impairment.queue_bytes + 400) / impairment.rate_bit_per_s
            : 0.0;
    EXPECT_GE(session.youngest_s, 2.0 * impairment.delay_s - kRounding_s);
    EXPECT_LE(session.oldest_s, 2.0 * (impairment.delay_s + impairment.jitter_s + queue_s) +
                                    kServoPeriod_s * (2 + kCyclesPerAnswer) + kRounding_s);
    const LinkStatistics& at_simulator = session.simulator.statistics();
    EXPECT_EQ(impairment.loss > 0.0 || session.network.there().lost() > 0, at_simulator.lost > 0);
    if (sealed && impairment.duplication > 0.0) {
      EXPECT_GT(at_simulator.seal_refused[static_cast<std::size_t>(SealStatus::kReplayed)], 0U);
    } else {
      EXPECT_EQ(at_simulator.duplicated > 0, impairment.duplication > 0.0);
    }
    if (sealed) {
      EXPECT_GT(session.servo.statistics().hellos, 0U);
      EXPECT_TRUE(session.servo.clock().known);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Link, ImpairedLink,
    testing::Values(Impairment{.name = "None"}, Impairment{.name = "Delay", .delay_s = 0.05},
                    Impairment{.name = "Jitter", .delay_s = 0.005, .jitter_s = 0.03},
                    Impairment{.name = "Loss", .loss = 0.2},
                    Impairment{.name = "Duplication", .duplication = 0.3},
                    Impairment{.name = "OneMegabit", .rate_bit_per_s = 1e6},
                    Impairment{.name = "TooLittle", .rate_bit_per_s = 5e5, .queue_bytes = 4000},
                    Impairment{.name = "All",
                               .delay_s = 0.02,
                               .jitter_s = 0.02,
                               .loss = 0.05,
                               .duplication = 0.05,
                               .rate_bit_per_s = 1e6}),
    [](const auto& test) { return test.param.name; });

TEST(LinkUnderAttack, TakesNoneOfAHundredThousandForgedAndReplayedDatagrams) {
  std::cout << "seed " << kSeed << "\n";
  Session session({}, true);
  session.run_for(2.0);
  const auto heard = session.network.heard();
  ASSERT_GT(heard.size(), 1000U);
  const LinkStatistics servo_before = session.servo.statistics();
  const LinkStatistics simulator_before = session.simulator.statistics();
  std::mt19937 random(kSeed);
  constexpr int kAttacks = 100'000;
  constexpr int kAtOnce = 100;  // fits the system's buffers, so that all of them arrive
  for (int sent = 0; sent < kAttacks;) {
    for (int i = 0; i < kAtOnce; ++i, ++sent) {
      auto datagram = heard[random() % heard.size()];
      if (i % 2 == 1) {
        datagram[random() % datagram.size()] ^= static_cast<std::byte>(1U << (random() % 8));
      }
      if (i % 4 < 2) {
        session.network.inject_to_simulator(datagram);
      } else {
        session.network.inject_to_servo(datagram);
      }
    }
    const auto news = session.simulator.receive(0ns);
    EXPECT_FALSE(news.tool_state || news.new_session || news.servo_ended || news.queries > 0);
    EXPECT_FALSE(session.servo.receive());
  }
  const LinkStatistics& servo = session.servo.statistics();
  const LinkStatistics& simulator = session.simulator.statistics();
  EXPECT_EQ(
      servo.received - servo_before.received + (simulator.received - simulator_before.received),
      static_cast<std::uint64_t>(kAttacks));
  EXPECT_EQ(servo.accepted, servo_before.accepted);
  EXPECT_EQ(simulator.accepted, simulator_before.accepted);
  EXPECT_EQ(servo.hellos, servo_before.hellos);
  Session::expect_all_counted(servo);
  Session::expect_all_counted(simulator);
  // The session has taken no harm.
  const int taken_before = session.taken;
  session.run_for(1.0);
  EXPECT_GE(session.taken - taken_before, 28);
}

TEST(LinkUnderAttack, AnOldSessionMovesNoSimulatorThatWasStartedAnew) {
  std::vector<std::vector<std::byte>> heard;
  {
    Session session({}, true);
    session.run_for(1.0);
    heard = session.network.heard();
  }
  Session session({}, true);  // the same key, both ends new
  session.run_for(0.01);
  session.newest.reset();
  for (const auto& datagram : heard) {
    session.network.inject_to_simulator(datagram);
    const auto news = session.simulator.receive(0ns);
    EXPECT_FALSE(news.tool_state || news.new_session);
  }
  EXPECT_GE(
      session.simulator.statistics().seal_refused[static_cast<std::size_t>(SealStatus::kStale)],
      500U);
}

TEST(LinkUnderAttack, AFloodCostsACallNoMoreThanItsShare) {
  constexpr std::uint64_t kPerCall = 256;
  Session session({}, true);
  session.run_for(1.0);
  const std::vector<std::byte> forged(kForceSampleBytes + kSealOverheadBytes, std::byte{'F'});
  std::uint64_t before = session.servo.statistics().received;
  for (int i = 0; i < 1000; ++i) {
    session.network.inject_to_servo(forged);
  }
  std::uint64_t flooded = 0;
  while (flooded < 1000) {
    EXPECT_FALSE(session.servo.receive());
    const std::uint64_t looked_at = session.servo.statistics().received - before;
    ASSERT_GT(looked_at, 0U);
    EXPECT_LE(looked_at, kPerCall);
    flooded += looked_at;
    before += looked_at;
  }
  EXPECT_EQ(
      session.servo.statistics().seal_refused[static_cast<std::size_t>(SealStatus::kNotSealed)],
      1000U);
}

TEST(LinkUnderAttack, WhatTheSystemDropsInAFloodIsCounted) {
  Session session({}, true);
  session.run_for(0.2);
  const std::uint64_t before = session.simulator.statistics().received;
  const std::vector<std::byte> forged(400, std::byte{'F'});
  constexpr std::uint64_t kFlood = 20'000;  // more than the system's buffer holds
  for (std::uint64_t i = 0; i < kFlood; ++i) {
    session.network.inject_to_simulator(forged);
  }
  std::uint64_t received = 0;
  do {
    received = session.simulator.statistics().received;
    static_cast<void>(session.simulator.receive(0ns));
  } while (session.simulator.statistics().received > received);
  session.network.inject_to_simulator(forged);  // brings the count of the dropped ones along
  static_cast<void>(session.simulator.receive(1s));
  const LinkStatistics& counted = session.simulator.statistics();
  EXPECT_GT(counted.overrun, 0U);
  EXPECT_EQ(counted.received - before + counted.overrun, kFlood + 1);
}

TEST(LinkWithAKey, AllowsOnlyTheAddressesGiven) {
  Access access = Session::access(true);
  access.allowed.emplace_back("127.0.0.0/30");
  SimulatorEndpoint simulator("127.0.0.1:0", 1h, std::move(access));
  ServoEndpoint servo(simulator.address(), 1, counting_keys(0));
  servo.send(ToolState{.sequence = 1});
  static_cast<void>(simulator.receive(50ms));
  EXPECT_EQ(simulator.statistics().not_allowed, 0U);
  Access elsewhere = Session::access(true);
  elsewhere.allowed.emplace_back("127.0.0.2");
  SimulatorEndpoint other("127.0.0.1:0", 1h, std::move(elsewhere));
  ServoEndpoint stranger(other.address(), 1, counting_keys(0));
  stranger.send(ToolState{.sequence = 1});
  static_cast<void>(other.receive(100ms));
  EXPECT_EQ(other.statistics().not_allowed, 1U);
  EXPECT_EQ(other.statistics().dropped(), 1U);
}

TEST(LinkWithAKey, CountsTheDatagramsOfOthers) {
  SimulatorEndpoint simulator("127.0.0.1:0", 1h, Session::access(true));
  ServoEndpoint without(simulator.address(), 1);
  ServoEndpoint with_another(simulator.address(), 1, counting_keys(5));
  without.send(ToolState{.sequence = 1});
  with_another.send(ToolState{.sequence = 1});
  EXPECT_FALSE(simulator.receive(100ms).tool_state);
  const auto& refused = simulator.statistics().seal_refused;
  EXPECT_EQ(refused[static_cast<std::size_t>(SealStatus::kNotSealed)], 1U);
  EXPECT_EQ(refused[static_cast<std::size_t>(SealStatus::kUnknownKey)], 1U);
  EXPECT_EQ(simulator.session_count(), 0U);
}

TEST(LinkWithAKey, MayLeaveThisMachine) {
  EXPECT_THROW(SimulatorEndpoint("0.0.0.0:0"), LinkError);
  EXPECT_THROW(ServoEndpoint("192.0.2.1:24870"), LinkError);
  const SimulatorEndpoint everywhere("0.0.0.0:0", 2s, Session::access(true));
  EXPECT_GT(everywhere.port(), 0);
  const ServoEndpoint far("192.0.2.1:24870", 1, counting_keys(0));
  EXPECT_EQ(far.local_address().bytes, (std::array<std::uint8_t, 16>{}));
}

}  // namespace
}  // namespace forcegrid::link
