// SPDX-License-Identifier: Apache-2.0
// Version 2 of the link, in which each datagram names its tool: bytes, places, refusals, and who
// is served in which version.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

#include "link/servo_endpoint.h"
#include "link/simulator_endpoint.h"
#include "tests/link/changed_datagrams.h"
#include "tests/link/counting_key.h"
#include "tests/link/raw_peer.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

using namespace std::chrono_literals;

const Bytes kTool2State = worked::from_hex(worked::kTool2StateHex);
const Bytes kOthers = worked::from_hex(worked::kOtherToolsHex);
const Bytes kRefusal = worked::from_hex(worked::kRefusalHex);

TEST(ToolsWire, WritesAndReadsTheWorkedDatagrams) {
  EXPECT_EQ(encoded(worked::tool_state(), 2), kTool2State);
  EXPECT_EQ(encoded(worked::other_tools(), 2), kOthers);
  EXPECT_EQ(encoded(worked::refusal(), 2), kRefusal);

  const Decoded state = decode(kTool2State);
  ASSERT_TRUE(std::holds_alternative<ToolState>(state.message));
  EXPECT_EQ(state.tool, 2U);
  EXPECT_EQ(std::get<ToolState>(state.message).position_W_m, worked::tool_state().position_W_m);
  const Decoded others = decode(kOthers);
  ASSERT_TRUE(std::holds_alternative<OtherTools>(others.message));
  EXPECT_EQ(others.session_id, worked::kSession);
  const auto& told = std::get<OtherTools>(others.message);
  EXPECT_EQ(told.sequence, 5U);
  ASSERT_EQ(told.count, 2U);
  EXPECT_EQ(told.tools[0].tool, 1U);
  EXPECT_TRUE(told.tools[0].in_contact);
  EXPECT_EQ(told.tools[0].age_ns, 31'250'000);
  EXPECT_EQ(told.tools[0].position_W_m, (Vector3{0.0625, 0.125, -0.015625}));
  EXPECT_EQ(told.tools[1].tool, 0U);
  EXPECT_FALSE(told.tools[1].in_contact);
  EXPECT_EQ(told.tools[1].position_W_m, (Vector3{-0.0625, 0.0, 0.25}));
  const Decoded refusal = decode(kRefusal);
  ASSERT_TRUE(std::holds_alternative<Refusal>(refusal.message));
  EXPECT_EQ(std::get<Refusal>(refusal.message).reason, Refusal::Reason::kToolTaken);
  EXPECT_EQ(std::get<Refusal>(refusal.message).most_tools, 4U);
}

TEST(ToolsWire, AVersion1DatagramHasNoTool) {
  EXPECT_EQ(decode(worked::from_hex(worked::kToolStateHex)).tool, 0U);
  EXPECT_EQ(encoded(worked::tool_state(), 0), worked::from_hex(worked::kToolStateHex));
}

TEST(ToolsWire, HoldsEachFieldToItsRange) {
  EXPECT_EQ(status_with<std::uint16_t>(kTool2State, 10, 0), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint16_t>(kTool2State, 10, kMaxToolId), WireStatus::kOk);
  EXPECT_EQ(status_with<std::uint16_t>(kTool2State, 10, kMaxToolId + 1), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint16_t>(kTool2State, 4, 1), WireStatus::kBadReserved);
  EXPECT_EQ(status_with<std::uint16_t>(kOthers, 4, 1), WireStatus::kBadType);
  EXPECT_EQ(status_with<std::uint16_t>(kRefusal, 4, 1), WireStatus::kBadType);
  EXPECT_EQ(status_with<std::uint16_t>(kOthers, 6, 8), WireStatus::kBadType);

  EXPECT_EQ(status_with<std::uint32_t>(kOthers, 24, 4), WireStatus::kOutOfRange) << "four others";
  EXPECT_EQ(status_with<std::uint32_t>(kOthers, 24, 1), WireStatus::kBadReserved) << "undeclared";
  EXPECT_EQ(status_with<std::uint32_t>(kOthers, 28, 1), WireStatus::kBadReserved);
  EXPECT_EQ(status_with<std::uint16_t>(kOthers, 32, kMaxToolId + 1), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint16_t>(kOthers, 34, 2), WireStatus::kBadReserved) << "a flag";
  EXPECT_EQ(status_with<std::uint32_t>(kOthers, 36, 1), WireStatus::kBadReserved);
  EXPECT_EQ(status_with<std::int64_t>(kOthers, 40, -1), WireStatus::kOutOfRange) << "age";
  EXPECT_EQ(status_with<double>(kOthers, 48, 10.5), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<double>(kOthers, 48, std::numeric_limits<double>::quiet_NaN()),
            WireStatus::kNotFinite);
  EXPECT_EQ(status_with<double>(kOthers, 128, 1.0), WireStatus::kBadReserved) << "a third one";
  EXPECT_EQ(status_with<std::uint32_t>(kRefusal, 12, 1), WireStatus::kBadReserved);
  EXPECT_EQ(status_with<std::uint32_t>(kRefusal, 24, 0), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint32_t>(kRefusal, 24, 3), WireStatus::kOk);
  EXPECT_EQ(status_with<std::uint32_t>(kRefusal, 24, 4), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint32_t>(kRefusal, 28, 0), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint32_t>(kRefusal, 28, 5), WireStatus::kOutOfRange);

  Bytes buffer(kMaxDatagramBytes);
  EXPECT_EQ(encode(worked::tool_state(), 1, buffer, kMaxToolId + 1).status,
            WireStatus::kOutOfRange);
  EXPECT_EQ(encode(worked::refusal(), 1, buffer, 0).status, WireStatus::kOutOfRange);
  EXPECT_EQ(encode(worked::other_tools(), 1, buffer, 0).status, WireStatus::kOutOfRange);
}

TEST(ToolsWire, AGoodbyeTellsAFaultInVersion2Only) {
  const Decoded failed = decode(encoded(Goodbye{true}, 2));
  ASSERT_TRUE(std::holds_alternative<Goodbye>(failed.message));
  EXPECT_TRUE(std::get<Goodbye>(failed.message).fault);
  EXPECT_FALSE(std::get<Goodbye>(decode(encoded(Goodbye{}, 2)).message).fault);
  EXPECT_EQ(encoded(Goodbye{true}, 0), worked::from_hex(worked::kGoodbyeHex));
  EXPECT_EQ(status_with<std::uint32_t>(encoded(Goodbye{}, 2), 12, 2), WireStatus::kBadReserved);
}

/// A simulator's endpoint with two places whose servos are bare sockets in the test's hands.
class TwoPlaces : public testing::Test {
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
  template <typename Message>
  void sends(const RawPeer& servo, const Message& message, std::uint64_t session_id, ToolId tool) {
    Bytes buffer(kMaxDatagramBytes);
    const Encoded encoded = encode(message, session_id, buffer, tool);
    ASSERT_EQ(encoded.status, WireStatus::kOk);
    servo.send_to(simulator_.port(), std::span(buffer).first(encoded.size_bytes));
  }
  /// Opens the sessions 1 of tool 1 and 2 of tool 2.
  void both_begin() {
    sends(left_, state(10), 1, 1);
    sends(right_, state(500), 2, 2);
    const auto news = simulator_.receive_all(20s);
    ASSERT_TRUE(news[0].new_session && news[1].new_session);
    ASSERT_EQ(news[0].tool_state->sequence, 10U);
    ASSERT_EQ(news[1].tool_state->sequence, 500U);
  }

  RawPeer left_;
  RawPeer right_;
  RawPeer third_;
  SimulatorEndpoint simulator_{"127.0.0.1:0", 1h, {}, 2};
};

TEST_F(TwoPlaces, ServeTwoServosEachWithNumbersOfItsOwn) {
  both_begin();
  EXPECT_EQ(simulator_.tool(0), 1U);
  EXPECT_EQ(simulator_.tool(1), 2U);
  EXPECT_EQ(simulator_.statistics().lost, 0U);

  sends(left_, state(11), 1, 1);
  sends(left_, worked::query(), 1, 1);
  sends(right_, state(499), 2, 2);  // late for the right, and far ahead of the left's
  const auto news = simulator_.receive_all(20s);
  EXPECT_EQ(news[0].tool_state->sequence, 11U);
  EXPECT_EQ(news[0].queries, 1U);
  EXPECT_FALSE(news[1].tool_state);
  EXPECT_EQ(news[1].queries, 0U);
  EXPECT_EQ(simulator_.statistics().late, 1U);
  EXPECT_FALSE(simulator_.next_query(1));
  EXPECT_TRUE(simulator_.next_query(0));
  EXPECT_EQ(simulator_.next_tool_state(1)->sequence, 500U);
  EXPECT_FALSE(simulator_.next_tool_state(1));
  EXPECT_EQ(simulator_.next_tool_state(0)->sequence, 10U);

  EXPECT_EQ(simulator_.send(worked::force_sample(), 0), SendStatus::kSent);
  EXPECT_EQ(simulator_.send(worked::force_sample(), 1), SendStatus::kSent);
  EXPECT_EQ(simulator_.send(worked::other_tools(), 1), SendStatus::kSent);
  const auto to_left = left_.receive();
  ASSERT_TRUE(to_left);
  EXPECT_EQ(to_left->tool, 1U);
  EXPECT_EQ(to_left->session_id, 1U);
  EXPECT_EQ(std::get<ForceSample>(to_left->message).sequence, 1U);
  const auto to_right = right_.receive();
  ASSERT_TRUE(to_right);
  EXPECT_EQ(to_right->tool, 2U);
  EXPECT_EQ(std::get<ForceSample>(to_right->message).sequence, 1U);
  EXPECT_EQ(right_.expect_message<OtherTools>().tools[0].tool, 1U);
}

TEST_F(TwoPlaces, RefuseAThirdServoAndSayWhy) {
  both_begin();
  sends(third_, state(1), 3, 3);
  sends(left_, state(11), 1, 1);
  ASSERT_TRUE(simulator_.receive_all(20s)[0].tool_state);
  const Refusal refusal = third_.expect_message<Refusal>();
  EXPECT_EQ(refusal.reason, Refusal::Reason::kAllPlacesTaken);
  EXPECT_EQ(refusal.most_tools, 2U);
  EXPECT_EQ(simulator_.statistics().foreign_session, 1U);
  // A goodbye frees the place.
  sends(right_, Goodbye{}, 2, 2);
  sends(third_, state(2), 3, 3);
  const auto news = simulator_.receive_all(20s);
  EXPECT_TRUE(news[1].servo_ended);
  EXPECT_TRUE(news[1].new_session);
  EXPECT_EQ(simulator_.tool(1), 3U);
}

TEST_F(TwoPlaces, RefuseATakenNumberAlthoughAPlaceIsFree) {
  sends(left_, state(1), 1, 1);
  ASSERT_TRUE(simulator_.receive_all(20s)[0].tool_state);
  sends(third_, state(1), 3, 1);
  sends(left_, state(2), 1, 1);
  ASSERT_TRUE(simulator_.receive_all(20s)[0].tool_state);
  EXPECT_EQ(third_.expect_message<Refusal>().reason, Refusal::Reason::kToolTaken);
  EXPECT_EQ(simulator_.session_id(1), 0U);
}

TEST_F(TwoPlaces, OneServoEndsAndTheOtherGoesOn) {
  both_begin();
  sends(left_, Goodbye{}, 1, 1);
  sends(right_, state(501), 2, 2);
  const auto news = simulator_.receive_all(20s);
  EXPECT_TRUE(news[0].servo_ended);
  EXPECT_FALSE(news[0].servo_failed);
  EXPECT_FALSE(news[1].servo_ended);
  EXPECT_EQ(news[1].tool_state->sequence, 501U);
  EXPECT_EQ(simulator_.send(worked::force_sample(), 0), SendStatus::kNoPeer);
  EXPECT_EQ(simulator_.send(worked::force_sample(), 1), SendStatus::kSent);
}

TEST_F(TwoPlaces, OneServoFailsAndTheOtherIsTold) {
  both_begin();
  sends(left_, Goodbye{true}, 1, 1);
  sends(right_, state(501), 2, 2);
  const auto news = simulator_.receive_all(20s);
  EXPECT_TRUE(news[0].servo_failed);
  EXPECT_FALSE(news[1].servo_failed);
  const Refusal refusal = {Refusal::Reason::kOtherFault, 2};
  EXPECT_EQ(simulator_.send(refusal, 0), SendStatus::kNoPeer);
  EXPECT_EQ(simulator_.send(refusal, 1), SendStatus::kSent);
  EXPECT_EQ(right_.expect_message<Refusal>().reason, Refusal::Reason::kOtherFault);
}

TEST_F(TwoPlaces, ANewRunTakesThePlaceOfItsAddress) {
  both_begin();
  sends(right_, state(1), 22, 2);
  sends(right_, state(501), 2, 2);  // of the old run
  const auto news = simulator_.receive_all(20s);
  EXPECT_TRUE(news[1].new_session);
  EXPECT_EQ(news[1].tool_state->sequence, 1U);
  EXPECT_FALSE(news[0].new_session);
  EXPECT_EQ(simulator_.session_id(0), 1U);
  EXPECT_EQ(simulator_.session_id(1), 22U);
  EXPECT_EQ(simulator_.statistics().foreign_session, 1U);
}

TEST_F(TwoPlaces, TheSessionOfAServoIsNoOneElses) {
  both_begin();
  sends(third_, state(11), 1, 1);
  sends(right_, state(12), 1, 1);
  sends(left_, state(13), 1, 2);  // its own, under another number
  sends(left_, state(14), 1, 1);
  EXPECT_EQ(simulator_.receive_all(20s)[0].tool_state->sequence, 14U);
  EXPECT_EQ(simulator_.statistics().foreign_address, 2U);
  EXPECT_EQ(simulator_.statistics().foreign_session, 1U);
  EXPECT_EQ(simulator_.tool(0), 1U);
}

TEST_F(TwoPlaces, ServeAServoOfVersion1BesideOneOfVersion2) {
  sends(left_, state(1), 1, 0);
  sends(right_, state(1), 2, 2);
  const auto news = simulator_.receive_all(20s);
  ASSERT_TRUE(news[0].tool_state && news[1].tool_state);
  EXPECT_EQ(simulator_.send(worked::force_sample(), 0), SendStatus::kSent);
  const auto answer = left_.receive();
  ASSERT_TRUE(answer && std::holds_alternative<ForceSample>(answer->message));
  EXPECT_EQ(answer->tool, 0U);
  EXPECT_EQ(simulator_.send(worked::other_tools(), 0), SendStatus::kInvalid)
      << "version 1 has no such message";
  // A second one of version 1 gets no answer at all, not even a refusal that it does not know.
  sends(third_, state(1), 3, 0);
  sends(right_, state(2), 2, 2);
  ASSERT_TRUE(simulator_.receive_all(20s)[1].tool_state);
  EXPECT_EQ(simulator_.statistics().foreign_session, 1U);
  EXPECT_FALSE(third_.receive(50));
}

TEST_F(TwoPlaces, ASessionThatBeganInVersion1MayNameItsToolLater) {
  sends(left_, state(1), 1, 0);
  sends(left_, state(2), 1, 1);
  sends(left_, state(3), 1, 0);
  const auto news = simulator_.receive_all(20s);
  EXPECT_EQ(news[0].tool_state->sequence, 3U);
  EXPECT_EQ(simulator_.tool(0), 1U);
  EXPECT_EQ(simulator_.session_count(), 1U);
  // Not if the number is another servo's.
  sends(right_, state(1), 2, 0);
  sends(right_, state(2), 2, 1);
  EXPECT_EQ(simulator_.receive_all(20s)[1].tool_state->sequence, 1U);
  EXPECT_EQ(right_.expect_message<Refusal>().reason, Refusal::Reason::kToolTaken);
}

TEST(SeveralTools, OnePlaceRefusesASecondServoOfVersion2) {
  SimulatorEndpoint simulator("127.0.0.1:0", 1h);
  ServoEndpoint first(simulator.address());
  ServoEndpoint second(simulator.address(), ServoEndpoint::random_session_id(), {}, 2);
  ASSERT_EQ(first.send(worked::tool_state()), SendStatus::kSent);
  ASSERT_TRUE(simulator.receive(20s).tool_state);
  ASSERT_EQ(second.send(worked::tool_state()), SendStatus::kSent);
  EXPECT_FALSE(simulator.receive(0s).tool_state);
  ASSERT_TRUE(second.wait(20s));
  EXPECT_FALSE(second.receive());
  ASSERT_TRUE(second.refusal());
  EXPECT_EQ(second.refusal()->reason, Refusal::Reason::kAllPlacesTaken);
  EXPECT_EQ(second.refusal()->most_tools, 1U);
  EXPECT_EQ(second.refusals_accepted(), 1U);
  EXPECT_FALSE(second.simulator_knows_one_tool());
  // Once it is served the refusal is over.
  first.say_goodbye();
  ToolState next = worked::tool_state();
  next.sequence = 8;
  ASSERT_EQ(second.send(next), SendStatus::kSent);
  const auto news = simulator.receive(20s);
  ASSERT_TRUE(news.tool_state);
  EXPECT_EQ(simulator.tool(0), 2U);
  simulator.send(answer_to(*news.tool_state));
  ASSERT_TRUE(second.wait(20s));
  EXPECT_TRUE(second.receive());
  EXPECT_FALSE(second.refusal());
}

TEST(SeveralTools, ASimulatorOfVersion1ShowsItself) {
  const RawPeer simulator;
  ServoEndpoint servo(simulator.address(), 1, {}, 2);
  std::uint32_t number = 0;
  std::uint32_t samples = 0;
  for (int answered = 0; answered < 3;) {
    EXPECT_FALSE(servo.simulator_knows_one_tool());
    ToolState state = worked::tool_state();
    state.sequence = ++number;
    ASSERT_EQ(servo.send(state), SendStatus::kSent);
    const auto asked = simulator.receive();
    ASSERT_TRUE(asked);
    if (asked->tool != 0) {
      EXPECT_EQ(asked->tool, 2U);
      continue;  // which a simulator of version 1 drops
    }
    EXPECT_EQ(number % 64, 0U);
    ForceSample sample = answer_to(std::get<ToolState>(asked->message));
    sample.sequence = ++samples;
    simulator.send_message(servo.local_address().port, sample, 1);
    ASSERT_TRUE(servo.wait(20s));
    EXPECT_FALSE(servo.receive()) << "not the force on this tool alone";
    ++answered;
  }
  EXPECT_TRUE(servo.simulator_knows_one_tool());
  EXPECT_EQ(servo.statistics().malformed[static_cast<std::size_t>(WireStatus::kBadVersion)], 3U);
  EXPECT_EQ(servo.statistics().received,
            servo.statistics().accepted + servo.statistics().dropped());
}

TEST(SeveralTools, AServoLearnsWhereTheOthersAre) {
  SimulatorEndpoint simulator("127.0.0.1:0", 1h, {}, 2);
  ServoEndpoint servo(simulator.address(), 1, {}, 7);
  ASSERT_EQ(servo.send(worked::tool_state()), SendStatus::kSent);
  ASSERT_TRUE(simulator.receive(20s).tool_state);
  OtherTools others = worked::other_tools();
  for (const double x_m : {0.25, 0.5}) {
    others.tools[0].position_W_m[0] = x_m;
    ASSERT_EQ(simulator.send(others, 0), SendStatus::kSent);
  }
  const auto deadline = std::chrono::steady_clock::now() + 20s;
  while (servo.others_accepted() < 2 && std::chrono::steady_clock::now() < deadline) {
    servo.wait(100ms);
    EXPECT_FALSE(servo.receive());
  }
  const auto newest = servo.next_others();
  ASSERT_TRUE(newest);
  EXPECT_EQ(newest->tools[0].position_W_m[0], 0.5);
  EXPECT_EQ(newest->sequence, 2U);
  EXPECT_FALSE(servo.next_others());
}

TEST(SeveralTools, EachServoMayHaveAKeyOfItsOwn) {
  Access access;
  access.keys = counting_keys(0, 1);
  SimulatorEndpoint simulator("127.0.0.1:0", 1h, std::move(access), 2);
  ServoEndpoint left(simulator.address(), 1, counting_keys(0), 1);
  ServoEndpoint right(simulator.address(), 2, counting_keys(1), 2);
  ServoEndpoint thief(simulator.address(), 1, counting_keys(1), 1);  // the left's session
  std::uint32_t number = 0;
  bool left_served = false;
  bool right_served = false;
  const auto deadline = std::chrono::steady_clock::now() + 30s;
  while (!(left_served && right_served) && std::chrono::steady_clock::now() < deadline) {
    ToolState state = worked::tool_state();
    state.sequence = ++number;
    left.send(state);
    right.send(state);
    if (left_served) {
      thief.send(state);
    }
    const auto news = simulator.receive_all(100ms);
    for (std::size_t place = 0; place < 2; ++place) {
      if (news[place].tool_state) {
        ForceSample sample = answer_to(*news[place].tool_state);
        sample.force_W_N[0] = simulator.tool(place);
        simulator.send(sample, place);
      }
    }
    left.wait(20ms);
    right.wait(20ms);
    while (const auto sample = left.receive()) {
      left_served = true;
      EXPECT_EQ(sample->force_W_N[0], 1.0);
    }
    while (const auto sample = right.receive()) {
      right_served = true;
      EXPECT_EQ(sample->force_W_N[0], 2.0);
    }
    EXPECT_FALSE(thief.receive());
  }
  EXPECT_TRUE(left_served);
  EXPECT_TRUE(right_served);
}

TEST(SeveralTools, RefuseAnImpossibleSetUp) {
  EXPECT_THAT([] { SimulatorEndpoint("127.0.0.1:0", 1s, {}, 0); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("give 1 to 4")));
  EXPECT_THAT([] { SimulatorEndpoint("127.0.0.1:0", 1s, {}, 5); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("give 1 to 4")));
  EXPECT_THAT([] { ServoEndpoint("127.0.0.1:1", 1, {}, 1000); },
              testing::ThrowsMessage<LinkError>(testing::HasSubstr("give 1 to 999")));
}

}  // namespace
}  // namespace forcegrid::link
