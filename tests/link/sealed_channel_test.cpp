// SPDX-License-Identifier: Apache-2.0
#include "link/sealed_channel.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <iostream>
#include <random>
#include <set>
#include <vector>

#include "tests/link/counting_key.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

using Bytes = std::vector<std::byte>;

const Bytes kInside = worked::from_hex(worked::kToolStateHex);

Bytes seal(SealedChannel& from, const SealedPeer& to, const Bytes& inside = kInside,
           std::int64_t now_ns = 0) {
  Bytes buffer(kMaxDatagramBytes);
  buffer.resize(from.seal(to, inside, now_ns, buffer));
  return buffer;
}

SealedChannel::Opened open(SealedChannel& at, Bytes datagram, std::int64_t now_ns = 0) {
  SealedChannel::Opened opened = at.open(datagram, now_ns);
  opened.inside = {};  // it was in the copy
  return opened;
}

SealStatus status(SealedChannel& at, const Bytes& datagram) { return open(at, datagram).status; }

/// The stream that an end uses now.
Bytes stream_of(SealedChannel& end) {
  const Bytes sealed = seal(end, {});
  return {sealed.begin() + 16, sealed.begin() + 32};
}

/// A servo and a simulator that have heard each other.
struct Pair {
  SealedChannel servo{LinkEnd::kServo, counting_keys(0)};
  SealedChannel simulator{LinkEnd::kSimulator, counting_keys(0)};
  SealedPeer to_simulator;
  SealedPeer to_servo;

  void meet() {
    const auto first = open(simulator, seal(servo, to_simulator));
    ASSERT_EQ(first.status, SealStatus::kStale);
    to_servo = first.peer;
    const auto hello = open(servo, seal(simulator, to_servo, {}));
    ASSERT_EQ(hello.status, SealStatus::kHello);
    to_simulator = hello.peer;
  }
};

TEST(SealedChannel, CarriesDatagramsBothWaysAfterOneHello) {
  Pair pair;
  pair.meet();
  Bytes there = seal(pair.servo, pair.to_simulator);
  const auto opened = pair.simulator.open(there, 0);
  ASSERT_EQ(opened.status, SealStatus::kOk);
  EXPECT_TRUE(std::ranges::equal(opened.inside, kInside));
  EXPECT_EQ(status(pair.servo, seal(pair.simulator, opened.peer)), SealStatus::kOk);
}

TEST(SealedChannel, TakesNothingBeforeThePeerHasHeardItsStream) {
  Pair pair;
  EXPECT_EQ(status(pair.simulator, seal(pair.servo, {})), SealStatus::kStale);
  EXPECT_EQ(status(pair.simulator, seal(pair.servo, {})), SealStatus::kStale);
}

TEST(SealedChannel, NeverUsesANonceTwice) {
  std::set<Bytes> nonces;
  for (int start = 0; start < 50; ++start) {
    SealedChannel servo(LinkEnd::kServo, counting_keys(0));
    SealedChannel simulator(LinkEnd::kSimulator, counting_keys(0));
    for (int i = 0; i < 100; ++i) {
      for (SealedChannel* end : {&servo, &simulator}) {
        const Bytes sealed = seal(*end, {});
        EXPECT_TRUE(nonces.emplace(sealed.begin() + 16, sealed.begin() + 40).second);
      }
    }
  }
}

TEST(SealedChannel, TakesEachDatagramOnce) {
  Pair pair;
  pair.meet();
  std::vector<Bytes> sent;
  for (int i = 0; i < 500; ++i) {
    sent.push_back(seal(pair.servo, pair.to_simulator));
  }
  std::ranges::shuffle(sent, std::mt19937(3));
  for (const Bytes& datagram : sent) {
    EXPECT_EQ(status(pair.simulator, datagram), SealStatus::kOk);
  }
  for (const Bytes& datagram : sent) {
    EXPECT_EQ(status(pair.simulator, datagram), SealStatus::kReplayed);
  }
}

TEST(SealedChannel, TakesNothingBackThatItHasSent) {
  Pair pair;
  pair.meet();
  EXPECT_EQ(status(pair.servo, seal(pair.servo, pair.to_simulator)), SealStatus::kBadDirection);
  EXPECT_EQ(status(pair.simulator, seal(pair.simulator, pair.to_servo)), SealStatus::kBadDirection);
}

TEST(SealedChannel, TakesNothingOfAnOldSessionAfterEitherEndStartedAnew) {
  Pair pair;
  pair.meet();
  const Bytes to_simulator = seal(pair.servo, pair.to_simulator);
  const Bytes to_servo = seal(pair.simulator, pair.to_servo);
  SealedChannel new_servo(LinkEnd::kServo, counting_keys(0));
  SealedChannel new_simulator(LinkEnd::kSimulator, counting_keys(0));
  EXPECT_EQ(status(new_servo, to_servo), SealStatus::kStale);
  EXPECT_EQ(status(new_simulator, to_simulator), SealStatus::kStale);
}

TEST(SealedChannel, OfAServoForgetsASimulatorThatWasReplaced) {
  Pair pair;
  pair.meet();
  const Bytes late = seal(pair.simulator, pair.to_servo);
  SealedChannel new_simulator(LinkEnd::kSimulator, counting_keys(0));
  EXPECT_EQ(status(pair.servo, seal(new_simulator, pair.to_servo)), SealStatus::kOk);
  EXPECT_EQ(status(pair.servo, late), SealStatus::kStale);
}

TEST(SealedChannel, BeginsANewStreamRatherThanForgetAPeer) {
  Pair pair;
  pair.meet();
  const Bytes taken = seal(pair.servo, pair.to_simulator);
  ASSERT_EQ(status(pair.simulator, taken), SealStatus::kOk);
  const Bytes before = stream_of(pair.simulator);
  for (std::size_t other = 1; other <= SealedChannel::kPeerStreams; ++other) {
    SealedChannel servo(LinkEnd::kServo, counting_keys(0));
    const bool fits = other < SealedChannel::kPeerStreams;
    EXPECT_EQ(status(pair.simulator, seal(servo, pair.to_simulator)),
              fits ? SealStatus::kOk : SealStatus::kStale);
    EXPECT_EQ(stream_of(pair.simulator) == before, fits);
  }
  EXPECT_EQ(status(pair.simulator, taken), SealStatus::kStale);
  pair.meet();
  EXPECT_EQ(status(pair.simulator, seal(pair.servo, pair.to_simulator)), SealStatus::kOk);
}

TEST(SealedChannel, AnswersUnderTheKeyThatThePeerUses) {
  SealedChannel simulator(LinkEnd::kSimulator, counting_keys(9, 7, 0));
  SealedChannel servo(LinkEnd::kServo, counting_keys(7));
  SealedChannel stranger(LinkEnd::kServo, counting_keys(1));
  const auto heard = open(simulator, seal(servo, {}));
  EXPECT_EQ(status(servo, seal(simulator, heard.peer, {})), SealStatus::kHello);
  EXPECT_EQ(status(simulator, seal(stranger, {})), SealStatus::kUnknownKey);
}

TEST(SealedChannel, RefusesAnotherSecretUnderTheSameId) {
  Pair pair;
  pair.meet();
  SealedChannel liar(LinkEnd::kServo, counting_keys(1));
  Bytes datagram = seal(liar, pair.to_simulator);
  std::ranges::copy(counting_key(0).id(), datagram.begin() + 8);
  EXPECT_EQ(status(pair.simulator, datagram), SealStatus::kForged);
}

TEST(SealedChannel, TellsBothEndsTheOffsetOfTheirClocks) {
  constexpr std::int64_t kOffset_ns = 5'000'000'000;  // the simulator's clock is ahead
  constexpr std::int64_t kWay_ns = 3'000'000;
  constexpr double kTolerance_s = 1e-12;  // rounding only
  Pair pair;
  pair.meet();
  const auto at_simulator = open(pair.simulator, seal(pair.servo, pair.to_simulator, kInside, 100),
                                 100 + kWay_ns + kOffset_ns);
  const std::int64_t answered_ns = 33'000'000;  // by the servo's clock
  const auto at_servo =
      open(pair.servo, seal(pair.simulator, at_simulator.peer, kInside, answered_ns + kOffset_ns),
           answered_ns + kWay_ns);
  ClockFilter filter;
  filter.add(at_servo.times);
  EXPECT_NEAR(filter.estimate().offset_s, 5.0, kTolerance_s);
  EXPECT_NEAR(filter.estimate().round_trip_s, 6e-3, kTolerance_s);
}

TEST(SealedChannel, RefusesKeysThatItCanNotTellApart) {
  EXPECT_THROW(SealedChannel(LinkEnd::kServo, {}), LinkError);
  EXPECT_THROW(SealedChannel(LinkEnd::kServo, counting_keys(1, 2, 1)), LinkError);
  EXPECT_THROW(SealedChannel(LinkEnd::kServo, counting_keys(1, 2, 3, 4, 5, 6, 7, 8, 9)), LinkError);
}

/// What a stranger on the network can make of all that he has heard.
class Forger {
 public:
  Forger(std::vector<Bytes> heard, unsigned int seed) : heard_(std::move(heard)), random_(seed) {}

  Bytes next() {
    Bytes datagram = heard_[random_() % heard_.size()];
    switch (random_() % 5) {
      case 0:  // as it was
        break;
      case 1:  // bits turned over
        for (unsigned int i = 0; i <= random_() % 4; ++i) {
          datagram[random_() % datagram.size()] ^= static_cast<std::byte>(1U << (random_() % 8));
        }
        break;
      case 2:  // cut off or longer
        datagram.resize(random_() % (datagram.size() + 64));
        break;
      case 3:  // head of one, rest of another
        std::ranges::copy(std::span(heard_[random_() % heard_.size()]).first(kSealHeadBytes),
                          datagram.begin());
        break;
      default:  // a head that looks right, the rest random
        for (std::size_t i = 32; i < datagram.size(); ++i) {
          datagram[i] = static_cast<std::byte>(random_());
        }
    }
    return datagram;
  }

 private:
  std::vector<Bytes> heard_;
  std::mt19937 random_;
};

TEST(SealedChannel, TakesNoneOfAHundredThousandForgedAndReplayedDatagrams) {
  constexpr unsigned int kSeed = 20261121;
  std::cout << "seed " << kSeed << "\n";
  Pair before;  // a session that has ended
  before.meet();
  Pair pair;
  pair.meet();
  std::vector<Bytes> heard;
  for (int i = 0; i < 200; ++i) {
    heard.push_back(seal(before.servo, before.to_simulator));
    heard.push_back(seal(before.simulator, before.to_servo));
    heard.push_back(seal(pair.servo, pair.to_simulator));
    ASSERT_EQ(status(pair.simulator, heard.back()), SealStatus::kOk);
    heard.push_back(seal(pair.simulator, pair.to_servo));
    ASSERT_EQ(status(pair.servo, heard.back()), SealStatus::kOk);
  }
  Forger forger(heard, kSeed);
  std::array<int, kSealStatusCount> counts{};
  for (int i = 0; i < 100'000; ++i) {
    ++counts[static_cast<std::size_t>(
        status(i % 2 == 0 ? pair.simulator : pair.servo, forger.next()))];
  }
  const auto count = [&](SealStatus which) { return counts[static_cast<std::size_t>(which)]; };
  EXPECT_EQ(count(SealStatus::kOk), 0);
  EXPECT_EQ(count(SealStatus::kHello), 0);
  for (const SealStatus which : {SealStatus::kTooShort, SealStatus::kBadDirection,
                                 SealStatus::kForged, SealStatus::kStale, SealStatus::kReplayed}) {
    EXPECT_GT(count(which), 1000) << to_string(which);
  }
  EXPECT_EQ(status(pair.simulator, seal(pair.servo, pair.to_simulator)), SealStatus::kOk);
  EXPECT_EQ(status(pair.servo, seal(pair.simulator, pair.to_servo)), SealStatus::kOk);
}

}  // namespace
}  // namespace forcegrid::link
