// SPDX-License-Identifier: Apache-2.0
#include "link/seal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "tests/link/counting_key.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

using Bytes = std::vector<std::byte>;

StreamId counting_stream(int first) {
  StreamId stream;
  for (std::size_t i = 0; i < stream.size(); ++i) {
    stream[i] = static_cast<std::byte>(first + static_cast<int>(i));
  }
  return stream;
}

// The values of the worked examples in docs/link_protocol.md.
const StreamId kServoStream = counting_stream(0x20);
const StreamId kSimulatorStream = counting_stream(0x30);
constexpr SealedTimes kToolStateTimes = {1'501'000'000, 1'400'000'000, 1'390'000'000};
constexpr SealedTimes kHelloTimes = {1'391'000'000, 1'501'000'000, 1'390'500'000};
const Bytes kToolState = worked::from_hex(worked::kToolStateHex);
const Bytes kSealedToolState = worked::from_hex(worked::kSealedToolStateHex);
const Bytes kHello = worked::from_hex(worked::kHelloHex);

Bytes sealed(const SealedHead& head, const SealedTimes& times, const Bytes& datagram) {
  Bytes buffer(kMaxDatagramBytes);
  buffer.resize(seal(head, times, datagram, counting_key(), buffer));
  return buffer;
}

SealStatus head_status(const Bytes& bytes, LinkEnd from = LinkEnd::kServo) {
  SealedHead head;
  return read_head(bytes, from, head);
}

TEST(Seal, WritesTheWorkedToolState) {
  EXPECT_EQ(to_string(counting_key().id()), "0af94caac92e9cd0");
  EXPECT_EQ(sealed({LinkEnd::kServo, counting_key().id(), kServoStream, 5, kSimulatorStream},
                   kToolStateTimes, kToolState),
            kSealedToolState);
}

TEST(Seal, WritesTheWorkedHello) {
  EXPECT_EQ(sealed({LinkEnd::kSimulator, counting_key().id(), kSimulatorStream, 1, kServoStream},
                   kHelloTimes, {}),
            kHello);
}

TEST(Seal, ReadsTheWorkedToolState) {
  Bytes bytes = kSealedToolState;
  SealedHead head;
  ASSERT_EQ(read_head(bytes, LinkEnd::kServo, head), SealStatus::kOk);
  EXPECT_EQ(head.key_id, counting_key().id());
  EXPECT_EQ(head.stream, kServoStream);
  EXPECT_EQ(head.counter, 5U);
  EXPECT_EQ(head.heard, kSimulatorStream);
  SealedTimes times;
  const auto inside = unseal(bytes, counting_key(), times);
  ASSERT_TRUE(inside);
  EXPECT_TRUE(std::ranges::equal(*inside, kToolState));
  EXPECT_EQ(times.sent_ns, kToolStateTimes.sent_ns);
  EXPECT_EQ(times.heard_sent_ns, kToolStateTimes.heard_sent_ns);
  EXPECT_EQ(times.heard_received_ns, kToolStateTimes.heard_received_ns);
}

TEST(Seal, ShowsNothingOfWhatItCarries) {
  const auto begin = std::span(kToolState).first(4);
  EXPECT_EQ(
      std::search(kSealedToolState.begin(), kSealedToolState.end(), begin.begin(), begin.end()),
      kSealedToolState.end());
}

TEST(Seal, RefusesEveryChangedBit) {
  for (std::size_t bit = 0; bit < 8 * kSealedToolState.size(); ++bit) {
    Bytes bytes = kSealedToolState;
    bytes[bit / 8] ^= static_cast<std::byte>(1U << (bit % 8));
    SealedTimes times;
    EXPECT_FALSE(unseal(bytes, counting_key(), times)) << "bit " << bit;
    EXPECT_EQ(times.sent_ns, 0);
  }
}

TEST(Seal, RefusesEveryOtherLength) {
  for (std::size_t size = 0; size < kSealedToolState.size(); ++size) {
    Bytes bytes(kSealedToolState.begin(),
                kSealedToolState.begin() + static_cast<std::ptrdiff_t>(size));
    SealedTimes times;
    EXPECT_FALSE(unseal(bytes, counting_key(), times)) << size << " bytes";
    EXPECT_EQ(head_status(bytes) == SealStatus::kOk, size >= kSealOverheadBytes) << size;
  }
  Bytes longer = kSealedToolState;
  longer.push_back(std::byte{0});
  SealedTimes times;
  EXPECT_FALSE(unseal(longer, counting_key(), times));
}

TEST(Seal, RefusesAnotherKey) {
  Bytes bytes = kSealedToolState;
  SealedTimes times;
  EXPECT_FALSE(unseal(bytes, counting_key(1), times));
}

TEST(Seal, NamesWhatIsWrongWithAHead) {
  EXPECT_EQ(head_status({}), SealStatus::kTooShort);
  EXPECT_EQ(head_status(kToolState), SealStatus::kNotSealed);
  EXPECT_EQ(head_status(kSealedToolState, LinkEnd::kSimulator), SealStatus::kBadDirection);
  const auto with = [](std::size_t at, int value) {
    Bytes bytes = kSealedToolState;
    bytes[at] = static_cast<std::byte>(value);
    return bytes;
  };
  EXPECT_EQ(head_status(with(4, 2)), SealStatus::kBadVersion);
  EXPECT_EQ(head_status(with(5, 1)), SealStatus::kBadVersion);
  EXPECT_EQ(head_status(with(6, 3)), SealStatus::kBadDirection);
  EXPECT_EQ(head_status(with(7, 1)), SealStatus::kBadDirection);
}

TEST(Seal, WritesNothingIntoABufferThatIsTooSmall) {
  Bytes small(kToolStateBytes + kSealOverheadBytes - 1);
  EXPECT_EQ(seal({}, {}, kToolState, counting_key(), small), 0U);
  EXPECT_TRUE(std::ranges::all_of(small, [](std::byte byte) { return byte == std::byte{0}; }));
}

}  // namespace
}  // namespace forcegrid::link
