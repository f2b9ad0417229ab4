// SPDX-License-Identifier: Apache-2.0
#include "link/simulator_endpoint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <thread>

#include "link/servo_endpoint.h"
#include "tests/link/raw_peer.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t kSession = 0xABCDEF;

/// A simulator's endpoint whose servo is a bare socket in the test's hands.
class SimulatorEndpointTest : public testing::Test {
 protected:
  void TearDown() override {
    const LinkStatistics& counted = simulator_.statistics();
    EXPECT_EQ(counted.received, counted.accepted + counted.dropped());
  }

  static ToolState state(std::uint32_t sequence) {
    ToolState result = worked::tool_state();
    result.sequence = sequence;
    return result;
  }
  static Query query(std::uint32_t query_id) {
    Query result = worked::query();
    result.query_id = query_id;
    return result;
  }

  template <typename Message>
  void servo_sends(const Message& message, std::uint64_t session_id = kSession) {
    servo_.send_message(simulator_.port(), message, session_id);
  }
  template <typename Message>
  void other_sends(const Message& message, std::uint64_t session_id) {
    other_.send_message(simulator_.port(), message, session_id);
  }

  RawPeer servo_;
  RawPeer other_;
  SimulatorEndpoint simulator_{"127.0.0.1:0", 1h};
};

TEST_F(SimulatorEndpointTest, GivesTheNewestToolStateOnce) {
  for (std::uint32_t n = 1; n <= 5; ++n) {
    servo_sends(state(n));
  }
  const auto news = simulator_.receive(20s);
  ASSERT_TRUE(news.tool_state);
  EXPECT_EQ(news.tool_state->sequence, 5U);
  EXPECT_TRUE(news.new_session);
  EXPECT_EQ(simulator_.statistics().superseded, 4U);
  EXPECT_FALSE(simulator_.receive(0s).tool_state);
}

TEST_F(SimulatorEndpointTest, KeepsTheWholePathButWhatCameLateOrBelongsToAnOldRun) {
  for (const std::uint32_t n : {1U, 2U, 4U, 3U, 4U, 6U}) {
    servo_sends(state(n));
  }
  servo_sends(state(7));
  ASSERT_EQ(simulator_.receive(20s).tool_state->sequence, 7U);
  for (const std::uint32_t n : {1U, 2U, 4U, 6U, 7U}) {
    const auto next = simulator_.next_tool_state();
    ASSERT_TRUE(next);
    EXPECT_EQ(next->sequence, n);
  }
  EXPECT_FALSE(simulator_.next_tool_state());

  servo_sends(state(8));
  servo_sends(state(1), kSession + 1);
  ASSERT_TRUE(simulator_.receive(20s).new_session);
  ASSERT_EQ(simulator_.next_tool_state()->sequence, 1U);
  EXPECT_FALSE(simulator_.next_tool_state()) << "the path of the run before";
}

TEST_F(SimulatorEndpointTest, OfALongPathTheOldestPartGivesWay) {
  constexpr std::uint32_t kMore = 10;
  const std::uint32_t last = kQueuedToolStates + kMore;
  for (std::uint32_t n = 1; n <= last; ++n) {
    servo_sends(state(n));
    ASSERT_TRUE(simulator_.receive(20s).tool_state);
  }
  for (std::uint32_t n = kMore + 1; n <= last; ++n) {
    ASSERT_EQ(simulator_.next_tool_state()->sequence, n);
  }
  EXPECT_FALSE(simulator_.next_tool_state());
}

TEST_F(SimulatorEndpointTest, NumbersItsAnswersAndSendsThemToTheServo) {
  servo_sends(state(7));
  const auto news = simulator_.receive(20s);
  ASSERT_TRUE(news.tool_state);
  ForceSample sample = answer_to(*news.tool_state);
  sample.force_W_N = {1.0, 2.0, 3.0};
  EXPECT_EQ(simulator_.send(sample), SendStatus::kSent);
  EXPECT_EQ(simulator_.send(sample), SendStatus::kSent);
  const auto first = servo_.expect_message<ForceSample>();
  EXPECT_EQ(first.sequence, 1U);
  EXPECT_EQ(first.echo_sequence, 7U);
  EXPECT_EQ(first.echo_servo_time_ns, 1'500'000'000);
  EXPECT_EQ(first.position_W_m, worked::tool_state().position_W_m);
  EXPECT_EQ(first.force_W_N, (Vector3{1.0, 2.0, 3.0}));
  EXPECT_EQ(servo_.expect_message<ForceSample>().sequence, 2U);
}

TEST_F(SimulatorEndpointTest, SendsNothingWithoutAServoOrOutOfRange) {
  EXPECT_EQ(simulator_.send(worked::force_sample()), SendStatus::kNoPeer);
  EXPECT_EQ(simulator_.statistics().send_no_peer, 1U);
  servo_sends(state(1));
  ASSERT_TRUE(simulator_.receive(20s).tool_state);
  ForceSample sample = worked::force_sample();
  sample.force_W_N[0] = 1e6;
  EXPECT_EQ(simulator_.send(sample), SendStatus::kInvalid);
  EXPECT_EQ(simulator_.send(worked::force_sample()), SendStatus::kSent);
  EXPECT_EQ(servo_.expect_message<ForceSample>().sequence, 1U);
}

TEST_F(SimulatorEndpointTest, DropsOldAndRepeatedToolStates) {
  servo_sends(state(10));
  servo_sends(state(12));
  servo_sends(state(11));
  servo_sends(state(12));
  const auto news = simulator_.receive(20s);
  ASSERT_TRUE(news.tool_state);
  EXPECT_EQ(news.tool_state->sequence, 12U);
  EXPECT_EQ(simulator_.statistics().late, 1U);
  EXPECT_EQ(simulator_.statistics().reordered, 1U);
  EXPECT_EQ(simulator_.statistics().duplicated, 1U);
  EXPECT_EQ(simulator_.statistics().lost, 0U);
}

TEST_F(SimulatorEndpointTest, HandsOutQueriesInOrderAndOnce) {
  servo_sends(query(1));
  servo_sends(query(2));
  servo_sends(query(1));
  EXPECT_EQ(simulator_.receive(20s).queries, 2U);
  EXPECT_EQ(simulator_.next_query()->query_id, 1U);
  EXPECT_EQ(simulator_.next_query()->query_id, 2U);
  EXPECT_FALSE(simulator_.next_query());
  EXPECT_EQ(simulator_.statistics().duplicated, 1U);
}

TEST_F(SimulatorEndpointTest, KeepsTheNewestQueriesWhenTheyAreTooMany) {
  const auto count = static_cast<std::uint32_t>(kQueuedQueries) + 3;
  for (std::uint32_t id = 1; id <= count; ++id) {
    servo_sends(query(id));
  }
  EXPECT_EQ(simulator_.receive(20s).queries, kQueuedQueries);
  EXPECT_EQ(simulator_.statistics().overflowed, 3U);
  for (std::uint32_t id = 4; id <= count; ++id) {
    EXPECT_EQ(simulator_.next_query()->query_id, id);
  }
  EXPECT_FALSE(simulator_.next_query());
}

TEST_F(SimulatorEndpointTest, ServesOneServoAtATime) {
  servo_sends(state(1));
  ASSERT_TRUE(simulator_.receive(20s).tool_state);
  other_sends(state(100), kSession + 1);
  other_sends(query(100), kSession + 1);
  other_sends(Goodbye{}, kSession + 1);
  servo_sends(state(2));
  const auto news = simulator_.receive(20s);
  ASSERT_TRUE(news.tool_state);
  EXPECT_EQ(news.tool_state->sequence, 2U);
  EXPECT_FALSE(news.new_session);
  EXPECT_FALSE(news.servo_ended);
  EXPECT_EQ(news.queries, 0U);
  EXPECT_EQ(simulator_.statistics().foreign_session, 3U);
  EXPECT_EQ(simulator_.session_count(), 1U);
}

TEST_F(SimulatorEndpointTest, DropsTheRightSessionFromAnotherAddress) {
  servo_sends(state(1));
  ASSERT_TRUE(simulator_.receive(20s).tool_state);
  other_sends(state(100), kSession);
  other_sends(Goodbye{}, kSession);
  servo_sends(state(2));
  const auto news = simulator_.receive(20s);
  EXPECT_EQ(news.tool_state->sequence, 2U);
  EXPECT_FALSE(news.servo_ended);
  EXPECT_EQ(simulator_.statistics().foreign_address, 2U);
}

TEST_F(SimulatorEndpointTest, ANewRunFromTheSameAddressTakesOverForGood) {
  servo_sends(state(50));
  servo_sends(query(3));
  ASSERT_TRUE(simulator_.receive(20s).new_session);
  servo_sends(state(1), kSession + 1);
  servo_sends(state(51), kSession);  // stale, still on its way
  const auto news = simulator_.receive(20s);
  EXPECT_TRUE(news.new_session);
  ASSERT_TRUE(news.tool_state);
  EXPECT_EQ(news.tool_state->sequence, 1U);
  EXPECT_EQ(news.queries, 0U);  // those of the old run are gone
  EXPECT_EQ(simulator_.session_id(), kSession + 1);
  EXPECT_EQ(simulator_.session_count(), 2U);
  EXPECT_EQ(simulator_.statistics().foreign_session, 1U);
}

TEST_F(SimulatorEndpointTest, AnotherServoMayComeAfterAGoodbye) {
  servo_sends(state(1));
  servo_sends(Goodbye{});
  const auto ended = simulator_.receive(20s);
  EXPECT_TRUE(ended.servo_ended);
  EXPECT_FALSE(ended.tool_state);
  EXPECT_FALSE(simulator_.servo_alive());
  EXPECT_EQ(simulator_.send(worked::force_sample()), SendStatus::kNoPeer);
  other_sends(state(9), kSession + 1);
  const auto news = simulator_.receive(20s);
  EXPECT_TRUE(news.new_session);
  EXPECT_EQ(news.tool_state->sequence, 9U);
  EXPECT_TRUE(simulator_.servo_alive());
}

TEST_F(SimulatorEndpointTest, CountsMalformedDatagramsAndForeignTypes) {
  servo_.send_to(simulator_.port(), std::vector<std::byte>(1000, std::byte{1}));
  servo_.send_to(simulator_.port(), worked::from_hex("46 47 52 44 "));
  servo_sends(worked::force_sample());
  servo_sends(Goodbye{});  // of a session that never began
  servo_sends(state(1));
  const auto news = simulator_.receive(20s);
  EXPECT_TRUE(news.tool_state);
  EXPECT_FALSE(news.servo_ended);
  EXPECT_EQ(simulator_.statistics().malformed_total(), 2U);
  EXPECT_EQ(simulator_.statistics().unexpected_type, 1U);
  EXPECT_EQ(simulator_.statistics().foreign_session, 1U);
  EXPECT_EQ(simulator_.statistics().accepted, 1U);
}

TEST_F(SimulatorEndpointTest, WaitsNoLongerThanAsked) {
  const auto begin = std::chrono::steady_clock::now();
  const auto news = simulator_.receive(20ms);
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 20ms);
  EXPECT_FALSE(news.tool_state || news.new_session || news.servo_ended || news.queries != 0);
}

TEST_F(SimulatorEndpointTest, GarbageDoesNotEndAWait) {
  servo_.send_to(simulator_.port(), worked::from_hex("46 47 52 44 "));
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_FALSE(simulator_.receive(50ms).tool_state);
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 50ms);
  EXPECT_EQ(simulator_.statistics().malformed_total(), 1U);
}

TEST(SimulatorEndpoint, AnotherServoMayComeAfterASilence) {
  SimulatorEndpoint simulator("127.0.0.1:0", 20ms);
  const RawPeer first;
  const RawPeer second;
  first.send_message(simulator.port(), worked::tool_state(), 1);
  ASSERT_TRUE(simulator.receive(20s).new_session);
  std::this_thread::sleep_for(100ms);
  EXPECT_FALSE(simulator.servo_alive());
  second.send_message(simulator.port(), worked::tool_state(), 2);
  EXPECT_TRUE(simulator.receive(20s).new_session);
  EXPECT_EQ(simulator.session_id(), 2U);
  first.send_message(simulator.port(), worked::query(), 1);  // it does not come back
  EXPECT_EQ(simulator.receive(100ms).queries, 0U);
  EXPECT_EQ(simulator.statistics().foreign_session, 1U);
}

TEST(SimulatorEndpoint, SaysGoodbyeToItsServo) {
  const RawPeer servo;
  {
    SimulatorEndpoint simulator("127.0.0.1:0");
    servo.send_message(simulator.port(), worked::tool_state(), kSession);
    ASSERT_TRUE(simulator.receive(20s).tool_state);
  }
  const auto goodbye = servo.receive();
  ASSERT_TRUE(goodbye && std::holds_alternative<Goodbye>(goodbye->message));
  EXPECT_EQ(goodbye->session_id, kSession);
}

TEST(SimulatorEndpoint, NamesTheRemedyForAPortInUse) {
  const RawPeer occupant;
  EXPECT_THAT([&] { SimulatorEndpoint simulator(occupant.address()); },
              testing::ThrowsMessage<LinkError>(testing::AllOf(
                  testing::HasSubstr(occupant.address()), testing::HasSubstr("in use"),
                  testing::HasSubstr("choose another port"))));
}

TEST(SimulatorEndpoint, RefusesUnsafeOrImpossibleSetUp) {
  for (const char* address : {"0.0.0.0:24870", "[::]:24870", "10.0.0.1:24870"}) {
    EXPECT_THAT([&] { SimulatorEndpoint simulator(address); },
                testing::ThrowsMessage<LinkError>(testing::HasSubstr("could move the motors")));
  }
  Address anywhere;  // 0.0.0.0:0, put together without the parser
  EXPECT_THAT([&] { SimulatorEndpoint simulator(anywhere); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("could move the motors")));
  EXPECT_THAT([] { SimulatorEndpoint simulator("127.0.0.1:0", 0s); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("silence limit")));
}

TEST(SimulatorEndpoint, NoticesAServoThatIsGone) {
  SimulatorEndpoint simulator("127.0.0.1:0");
  {
    const RawPeer servo;
    servo.send_message(simulator.port(), worked::tool_state(), kSession);
    ASSERT_TRUE(simulator.receive(20s).tool_state);
  }
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(simulator.send(worked::force_sample()), SendStatus::kSent);
  }
  EXPECT_FALSE(simulator.receive(1ms).tool_state);
  EXPECT_GT(simulator.statistics().send_no_peer, 0U);
  EXPECT_EQ(simulator.statistics().send_failed, 0U);
}

TEST(Link, CarriesToolStatesAndSamplesBetweenThreads) {
  SimulatorEndpoint simulator("127.0.0.1:0");
  ServoEndpoint servo(to_string(simulator.address()));
  std::atomic<bool> running = true;
  std::thread simulation([&] {
    while (running) {
      const auto news = simulator.receive(10ms);
      if (news.tool_state) {
        ForceSample sample = answer_to(*news.tool_state);
        sample.force_W_N[0] = 2.0 * sample.position_W_m[0];
        simulator.send(sample);
      }
      while (const auto query = simulator.next_query()) {
        ForceSample reply = answer_to(*query);
        reply.force_W_N[0] = 3.0 * reply.position_W_m[0];
        simulator.send(reply);
      }
    }
  });
  int samples = 0;
  int replies = 0;
  const auto deadline = std::chrono::steady_clock::now() + 30s;
  for (std::uint32_t n = 1;
       (samples < 100 || replies < 20) && std::chrono::steady_clock::now() < deadline; ++n) {
    servo.send(ToolState{.sequence = n, .servo_time_ns = n, .position_W_m = {1e-3 * (n % 9000)}});
    if (n % 4 == 0) {
      servo.send(Query{.query_id = n, .servo_time_ns = n, .position_W_m = {1e-4 * (n % 9000)}});
    }
    servo.wait(5ms);
    while (const auto sample = servo.receive()) {
      ++(sample->query_id != 0 ? replies : samples);
      const double factor = sample->query_id != 0 ? 3.0 : 2.0;
      EXPECT_EQ(sample->force_W_N[0], factor * sample->position_W_m[0]);
    }
  }
  running = false;
  simulation.join();
  EXPECT_GE(samples, 100);
  EXPECT_GE(replies, 20);
  EXPECT_EQ(servo.statistics().dropped(), 0U);
  EXPECT_EQ(simulator.statistics().foreign_session + simulator.statistics().foreign_address, 0U);
}

TEST(Link, WorksOnIpv6LoopbackOrSaysThatTheSystemLacksIt) {
  std::unique_ptr<SimulatorEndpoint> simulator;
  try {
    simulator = std::make_unique<SimulatorEndpoint>("[::1]:0");
  } catch (const LinkError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("use 127.0.0.1"));
    return;
  }
  ServoEndpoint servo(simulator->address());
  ASSERT_EQ(servo.send(worked::tool_state()), SendStatus::kSent);
  const auto news = simulator->receive(20s);
  ASSERT_TRUE(news.tool_state);
  ASSERT_EQ(simulator->send(answer_to(*news.tool_state)), SendStatus::kSent);
  ASSERT_TRUE(servo.wait(20s));
  EXPECT_TRUE(servo.receive());
}

}  // namespace
}  // namespace forcegrid::link
