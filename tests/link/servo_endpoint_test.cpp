// SPDX-License-Identifier: Apache-2.0
#include "link/servo_endpoint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <set>

#include "link/simulator_endpoint.h"
#include "tests/link/raw_peer.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t kSession = 0xABCDEF;

/// A servo's endpoint whose simulator is a bare socket in the test's hands.
class ServoEndpointTest : public testing::Test {
 protected:
  void TearDown() override {
    const LinkStatistics& counted = servo_.statistics();
    EXPECT_EQ(counted.received, counted.accepted + counted.dropped());
  }

  /// Sends the tool states 1..count; number n is at x = n mm at n ms.
  void send_tool_states(std::uint32_t count) {
    for (std::uint32_t n = 1; n <= count; ++n) {
      ASSERT_EQ(servo_.send(state(n)), SendStatus::kSent);
    }
  }

  static ToolState state(std::uint32_t n) {
    return {.sequence = n,
            .servo_time_ns = 1'000'000 * std::int64_t{n},
            .position_W_m = {0.001 * n, 0.0, 0.0}};
  }

  static ForceSample answer(std::uint32_t sequence, std::uint32_t echo_sequence) {
    ForceSample sample = answer_to(state(echo_sequence));
    sample.sequence = sequence;
    sample.force_W_N = {0.0, 0.0, 0.5 * echo_sequence};
    return sample;
  }

  template <typename Message>
  void simulator_sends(const Message& message, std::uint64_t session_id = kSession) {
    simulator_.send_message(servo_.local_address().port, message, session_id);
  }

  /// Sequence number of the next accepted sample; nothing if none comes.
  std::optional<std::uint32_t> next_accepted(std::chrono::milliseconds patience = 20s) {
    const auto deadline = std::chrono::steady_clock::now() + patience;
    do {
      if (const auto sample = servo_.receive()) {
        return sample->sequence;
      }
    } while (servo_.wait(deadline - std::chrono::steady_clock::now()));
    return std::nullopt;
  }

  /// Datagrams keep their order on loopback, so what was sent before the marker has been dealt
  /// with when the marker comes out.
  void expect_only_the_marker(std::uint32_t sequence, std::uint32_t echo_sequence) {
    simulator_sends(answer(sequence, echo_sequence));
    EXPECT_EQ(next_accepted(), sequence);
  }

  RawPeer simulator_;
  ServoEndpoint servo_{simulator_.address(), kSession};
};

TEST_F(ServoEndpointTest, SendsToolStatesAndQueriesOfItsSession) {
  ASSERT_EQ(servo_.send(worked::tool_state()), SendStatus::kSent);
  ASSERT_EQ(servo_.send(worked::query()), SendStatus::kSent);
  const auto state = simulator_.receive();
  ASSERT_TRUE(state && std::holds_alternative<ToolState>(state->message));
  EXPECT_EQ(state->session_id, kSession);
  EXPECT_EQ(std::get<ToolState>(state->message).position_W_m, worked::tool_state().position_W_m);
  EXPECT_EQ(simulator_.expect_message<Query>().query_id, 9U);
  EXPECT_EQ(servo_.statistics().sent, 2U);
}

TEST_F(ServoEndpointTest, AcceptsASampleThatAnswersAToolState) {
  send_tool_states(3);
  simulator_sends(answer(1, 2));
  ASSERT_TRUE(servo_.wait(20s));
  const auto sample = servo_.receive();
  ASSERT_TRUE(sample);
  EXPECT_EQ(sample->echo_sequence, 2U);
  EXPECT_EQ(sample->echo_servo_time_ns, 2'000'000);
  EXPECT_EQ(sample->force_W_N, (Vector3{0.0, 0.0, 1.0}));
  EXPECT_EQ(servo_.statistics().accepted, 1U);
  EXPECT_FALSE(servo_.receive());
}

TEST_F(ServoEndpointTest, TakesTheNewestPatchThatEchoesAToolState) {
  send_tool_states(3);
  const auto patch = [](std::uint32_t echo_sequence) {
    SurfacePatch made = patch_for(state(echo_sequence));
    made.contact_epoch = echo_sequence;
    return made;
  };
  simulator_sends(patch(1));
  simulator_sends(patch(2));
  expect_only_the_marker(1, 1);
  const auto taken = servo_.next_patch();
  ASSERT_TRUE(taken);
  EXPECT_EQ(taken->contact_epoch, 2U);
  EXPECT_FALSE(servo_.next_patch()) << "given out once";

  simulator_sends(patch(2));  // again
  simulator_sends(patch(1));  // older
  simulator_sends(patch(9));  // of a tool state that was never sent
  SurfacePatch elsewhere = patch(3);
  elsewhere.position_W_m[1] = 1e-6;
  simulator_sends(elsewhere);
  SurfacePatch at_another_time = patch(3);
  at_another_time.echo_servo_time_ns += 1;
  simulator_sends(at_another_time);
  expect_only_the_marker(2, 2);
  EXPECT_FALSE(servo_.next_patch());
  EXPECT_EQ(servo_.statistics().duplicated, 1U);
  EXPECT_EQ(servo_.statistics().late, 1U);
  EXPECT_EQ(servo_.statistics().forged, 3U);
  EXPECT_EQ(servo_.statistics().accepted, 4U);
  EXPECT_EQ(servo_.patches_accepted(), 2U);
}

TEST_F(ServoEndpointTest, CountsEachKindOfMalformedDatagramAndGoesOn) {
  send_tool_states(1);
  const auto good = worked::from_hex(worked::kForceSampleHex);
  const std::uint16_t port = servo_.local_address().port;
  simulator_.send_to(port, {});
  simulator_.send_to(port, std::span(good).first(27));
  simulator_.send_to(port, std::span(good).first(211));
  simulator_.send_to(port, std::vector<std::byte>(kMaxDatagramBytes + 1, std::byte{0}));
  simulator_.send_to(port, std::vector<std::byte>(9000, std::byte{0}));
  auto corrupted = good;
  corrupted[80] ^= std::byte{4};
  simulator_.send_to(port, corrupted);
  expect_only_the_marker(1, 1);
  const LinkStatistics& counted = servo_.statistics();
  const auto malformed = [&](WireStatus status) {
    return counted.malformed[static_cast<std::size_t>(status)];
  };
  EXPECT_EQ(malformed(WireStatus::kTooShort), 2U);
  EXPECT_EQ(malformed(WireStatus::kBadLength), 3U);
  EXPECT_EQ(malformed(WireStatus::kBadChecksum), 1U);
  EXPECT_EQ(counted.malformed_total(), 6U);
  EXPECT_EQ(counted.received, 7U);
}

TEST_F(ServoEndpointTest, DropsSamplesOfAnotherSession) {
  send_tool_states(1);
  simulator_sends(answer(1, 1), kSession + 1);
  simulator_sends(Goodbye{}, kSession + 1);
  expect_only_the_marker(1, 1);
  EXPECT_EQ(servo_.statistics().foreign_session, 2U);
  EXPECT_FALSE(servo_.simulator_ended());
}

TEST_F(ServoEndpointTest, DropsSamplesFromAnotherPortEvenWithTheRightSession) {
  send_tool_states(1);
  const RawPeer forger;
  forger.send_message(servo_.local_address().port, answer(1, 1), kSession);
  expect_only_the_marker(2, 1);
  EXPECT_EQ(servo_.statistics().foreign_address, 1U);
}

TEST_F(ServoEndpointTest, DropsMessagesThatOnlyAServoSends) {
  send_tool_states(1);
  simulator_sends(state(1));
  simulator_sends(worked::query());
  expect_only_the_marker(1, 1);
  EXPECT_EQ(servo_.statistics().unexpected_type, 2U);
}

TEST_F(ServoEndpointTest, DropsAnswersToWhatWasNeverSent) {
  simulator_sends(answer(1, 0));  // before anything was sent
  send_tool_states(3);
  simulator_sends(answer(2, 4));
  simulator_sends(answer(3, 0));
  ForceSample wrong_time = answer(4, 3);
  wrong_time.echo_servo_time_ns += 1;
  simulator_sends(wrong_time);
  ForceSample elsewhere = answer(5, 3);
  elsewhere.position_W_m[1] = 0.0501;
  simulator_sends(elsewhere);
  expect_only_the_marker(6, 3);
  EXPECT_EQ(servo_.statistics().forged, 5U);
}

TEST_F(ServoEndpointTest, AcceptsASolverThatStoppedShortOfTheTool) {
  send_tool_states(1);
  ForceSample behind = answer(1, 1);
  behind.position_W_m[2] = -0.0499;
  simulator_sends(behind);
  EXPECT_EQ(next_accepted(), 1U);
}

TEST_F(ServoEndpointTest, DropsDuplicates) {
  send_tool_states(2);
  simulator_sends(answer(1, 1));
  simulator_sends(answer(1, 1));
  simulator_sends(answer(1, 1));
  EXPECT_EQ(next_accepted(), 1U);
  expect_only_the_marker(2, 2);
  EXPECT_EQ(servo_.statistics().duplicated, 2U);
}

TEST_F(ServoEndpointTest, DropsASampleThatWasOvertaken) {
  send_tool_states(4);
  simulator_sends(answer(1, 1));
  simulator_sends(answer(3, 3));
  simulator_sends(answer(2, 2));
  EXPECT_EQ(next_accepted(), 1U);
  EXPECT_EQ(next_accepted(), 3U);
  expect_only_the_marker(4, 4);
  EXPECT_EQ(servo_.statistics().late, 1U);
  EXPECT_EQ(servo_.statistics().reordered, 1U);
  EXPECT_EQ(servo_.statistics().lost, 0U);
}

TEST_F(ServoEndpointTest, DropsANewerNumberThatAnswersAnOlderToolState) {
  send_tool_states(4);
  simulator_sends(answer(1, 3));
  simulator_sends(answer(2, 2));
  EXPECT_EQ(next_accepted(), 1U);
  expect_only_the_marker(3, 4);
  EXPECT_EQ(servo_.statistics().late, 1U);
  EXPECT_EQ(servo_.statistics().reordered, 0U);
}

TEST_F(ServoEndpointTest, AcceptsABetterAnswerToTheSameToolState) {
  send_tool_states(1);
  simulator_sends(answer(1, 1));
  simulator_sends(answer(2, 1));
  EXPECT_EQ(next_accepted(), 1U);
  EXPECT_EQ(next_accepted(), 2U);
}

TEST_F(ServoEndpointTest, CountsGapsInTheSimulatorsNumbersAsLost) {
  send_tool_states(9);
  simulator_sends(answer(1, 1));
  simulator_sends(answer(5, 9));
  EXPECT_EQ(next_accepted(), 1U);
  EXPECT_EQ(next_accepted(), 5U);
  EXPECT_EQ(servo_.statistics().lost, 3U);
}

TEST_F(ServoEndpointTest, FollowsASimulatorThatWasStartedAnew) {
  send_tool_states(5);
  simulator_sends(answer(500, 2));
  simulator_sends(answer(501, 3));
  simulator_sends(answer(1, 4));
  simulator_sends(answer(2, 5));
  for (const std::uint32_t sequence : {500U, 501U, 1U, 2U}) {
    EXPECT_EQ(next_accepted(), sequence);
  }
  EXPECT_EQ(servo_.statistics().restarts, 1U);
  EXPECT_EQ(servo_.statistics().lost, 0U);
}

TEST_F(ServoEndpointTest, AnEchoBeyondItsMemoryIsLateNotForged) {
  send_tool_states(static_cast<std::uint32_t>(kRememberedToolStates) + 1);
  simulator_sends(answer(1, 1));
  expect_only_the_marker(2, 2);
  EXPECT_EQ(servo_.statistics().late, 1U);
  EXPECT_EQ(servo_.statistics().forged, 0U);
}

TEST_F(ServoEndpointTest, AcceptsEachReplyOnceHoweverLate) {
  send_tool_states(3);
  const Query first{.query_id = 1, .servo_time_ns = 100, .position_W_m = {0.2, 0.0, 0.0}};
  const Query second{.query_id = 5, .servo_time_ns = 200, .position_W_m = {0.3, 0.0, 0.0}};
  ASSERT_EQ(servo_.send(first), SendStatus::kSent);
  ASSERT_EQ(servo_.send(second), SendStatus::kSent);
  const auto reply = [](const Query& query, std::uint32_t sequence) {
    ForceSample sample = answer_to(query);
    sample.sequence = sequence;
    return sample;
  };
  simulator_sends(answer(3, 3));
  simulator_sends(reply(second, 2));  // overtaken by the sample
  simulator_sends(reply(first, 1));
  simulator_sends(reply(first, 4));
  Query never_sent = second;
  never_sent.query_id = 4;
  simulator_sends(reply(never_sent, 5));
  ForceSample elsewhere = reply(second, 6);
  elsewhere.position_W_m[0] += 0.06;
  simulator_sends(elsewhere);
  for (const std::uint32_t sequence : {3U, 2U, 1U}) {
    EXPECT_EQ(next_accepted(), sequence);
  }
  expect_only_the_marker(7, 3);
  EXPECT_EQ(servo_.statistics().duplicated, 1U);
  EXPECT_EQ(servo_.statistics().forged, 2U);
  EXPECT_EQ(servo_.statistics().reordered, 2U);
  EXPECT_EQ(servo_.statistics().late, 0U);
}

TEST_F(ServoEndpointTest, SendsNeitherUnusableNorRepeatedMessages) {
  ToolState bad = state(1);
  bad.position_W_m[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(servo_.send(bad), SendStatus::kInvalid);
  bad.position_W_m[0] = 10.1;
  EXPECT_EQ(servo_.send(bad), SendStatus::kInvalid);
  EXPECT_EQ(servo_.send(Query{}), SendStatus::kInvalid);
  EXPECT_EQ(servo_.send(state(2)), SendStatus::kSent);
  EXPECT_EQ(servo_.send(state(2)), SendStatus::kNotRising);
  EXPECT_EQ(servo_.send(state(1)), SendStatus::kNotRising);
  EXPECT_EQ(servo_.send(worked::query()), SendStatus::kSent);
  EXPECT_EQ(servo_.send(worked::query()), SendStatus::kNotRising);
  EXPECT_EQ(servo_.statistics().send_invalid, 6U);
  EXPECT_EQ(servo_.statistics().sent, 2U);
  EXPECT_EQ(simulator_.expect_message<ToolState>().sequence, 2U);
}

TEST_F(ServoEndpointTest, NoticesThatTheSimulatorEndsAndComesBack) {
  send_tool_states(1);
  simulator_sends(Goodbye{});
  EXPECT_EQ(next_accepted(100ms), std::nullopt);
  EXPECT_TRUE(servo_.simulator_ended());
  simulator_sends(answer(1, 1));
  EXPECT_EQ(next_accepted(), 1U);
  EXPECT_FALSE(servo_.simulator_ended());
}

TEST_F(ServoEndpointTest, AFloodOfGarbageDoesNotHoldTheCaller) {
  send_tool_states(1);
  for (int i = 0; i < 300; ++i) {
    simulator_.send_to(servo_.local_address().port, {});
  }
  EXPECT_FALSE(servo_.receive());
  EXPECT_EQ(servo_.statistics().received, 256U);
  expect_only_the_marker(1, 1);
  EXPECT_EQ(servo_.statistics().malformed_total(), 300U);
}

TEST_F(ServoEndpointTest, OnlyNewerAndUnchangedSamplesSurviveAHostileNetwork) {
  constexpr std::uint32_t kSeed = 42;
  constexpr std::uint32_t kSamples = 400;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  send_tool_states(kSamples);
  std::vector<std::vector<std::byte>> traffic;
  std::uint64_t corrupted = 0;
  for (std::uint32_t n = 1; n < kSamples; ++n) {
    std::vector<std::byte> datagram(kMaxDatagramBytes);
    datagram.resize(encode(answer(n, n), kSession, datagram).size_bytes);
    const auto fate = random() % 10;
    if (fate == 0) {
      continue;  // lost
    }
    traffic.push_back(datagram);
    if (fate == 1) {
      traffic.push_back(datagram);
    } else if (fate == 2) {
      traffic.back()[random() % datagram.size()] ^= static_cast<std::byte>(1 + random() % 255);
      ++corrupted;
    } else if (fate == 3 && traffic.size() > 5) {
      std::swap(traffic.back(), traffic[traffic.size() - 2 - random() % 4]);
    }
  }
  std::uint32_t newest = 0;
  std::size_t accepted = 0;
  for (const auto& datagram : traffic) {
    simulator_.send_to(servo_.local_address().port, datagram);
    ASSERT_TRUE(servo_.wait(20s));
    while (const auto sample = servo_.receive()) {
      ++accepted;
      EXPECT_GT(sample->sequence, newest);
      newest = sample->sequence;
      EXPECT_EQ(sample->echo_sequence, sample->sequence);
      EXPECT_EQ(sample->force_W_N, (Vector3{0.0, 0.0, 0.5 * sample->sequence}));
    }
  }
  const LinkStatistics& counted = servo_.statistics();
  EXPECT_EQ(counted.received, traffic.size());
  EXPECT_EQ(counted.accepted, accepted);
  EXPECT_EQ(counted.malformed_total(), corrupted);
  EXPECT_GT(accepted, 200U);
  EXPECT_GT(counted.late, 5U);
  EXPECT_GT(counted.duplicated, 5U);
  EXPECT_GT(counted.lost, 5U);
  EXPECT_EQ(counted.forged, 0U);
  EXPECT_EQ(counted.restarts, 0U);
}

TEST(ServoEndpoint, SaysGoodbyeOnceWhenItEnds) {
  const RawPeer simulator;
  {
    ServoEndpoint servo(simulator.address(), kSession);
    servo.say_goodbye();
  }
  const auto goodbye = simulator.receive();
  ASSERT_TRUE(goodbye && std::holds_alternative<Goodbye>(goodbye->message));
  EXPECT_EQ(goodbye->session_id, kSession);
  { ServoEndpoint servo(simulator.address(), kSession + 1); }
  EXPECT_EQ(simulator.receive()->session_id, kSession + 1);
}

TEST(ServoEndpoint, CountsAnAbsentSimulatorAndMeetsItWhenItStarts) {
  std::uint16_t port = 0;
  {
    const RawPeer gone;
    port = gone.port();
  }
  ServoEndpoint servo("127.0.0.1:" + std::to_string(port), kSession);
  ToolState state = worked::tool_state();
  for (; state.sequence < 20; ++state.sequence) {
    EXPECT_EQ(servo.send(state), SendStatus::kSent);
  }
  EXPECT_FALSE(servo.wait(1ms));  // the system's error reports are no samples
  EXPECT_FALSE(servo.receive());
  EXPECT_GT(servo.statistics().send_no_peer, 0U);
  EXPECT_EQ(servo.statistics().send_failed, 0U);
  EXPECT_EQ(servo.statistics().received, 0U);

  const RawPeer simulator(port);
  ASSERT_EQ(servo.send(state), SendStatus::kSent);
  const auto heard = simulator.expect_message<ToolState>();
  EXPECT_EQ(heard.sequence, 20U);
  ForceSample sample = answer_to(heard);
  sample.sequence = 1;
  simulator.send_message(servo.local_address().port, sample, kSession);
  ASSERT_TRUE(servo.wait(20s));
  EXPECT_TRUE(servo.receive());
}

TEST(ServoEndpoint, RefusesUnsafeOrImpossibleSetUp) {
  EXPECT_THAT([] { ServoEndpoint servo("192.168.0.7:24870"); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("could move the motors")));
  EXPECT_THAT(
      [] { ServoEndpoint servo("127.0.0.1:0"); },
      testing::ThrowsMessage<LinkError>(testing::HasSubstr("port 0 is only for listening")));
  EXPECT_THAT([] { ServoEndpoint servo("127.0.0.1:24870", 0); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("session id 0 is reserved")));
  Address elsewhere = parse_address("127.0.0.1:24870", PortZero::kRefused);
  elsewhere.bytes[0] = 10;
  EXPECT_THAT([&] { ServoEndpoint servo(elsewhere); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("could move the motors")));
}

TEST(ServoEndpoint, ListensOnLoopbackOnly) {
  ServoEndpoint servo("127.0.0.1:24870");
  EXPECT_EQ(servo.local_address().bytes, (std::array<std::uint8_t, 16>{127, 0, 0, 1}));
  EXPECT_NE(servo.local_address().port, 0);
}

TEST(ServoEndpoint, EveryRunHasASessionOfItsOwn) {
  std::set<std::uint64_t> sessions;
  for (int i = 0; i < 100; ++i) {
    sessions.insert(ServoEndpoint::random_session_id());
  }
  EXPECT_EQ(sessions.size(), 100U);
  EXPECT_FALSE(sessions.contains(0));
}

}  // namespace
}  // namespace forcegrid::link
