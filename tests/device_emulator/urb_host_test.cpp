// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/urb_host.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <string>
#include <vector>

namespace forcegrid::emulator {
namespace {

using Bytes = std::vector<std::uint8_t>;
using testing::ElementsAreArray;

constexpr UsbEndpoint kIn{0x81, UsbTransferType::kBulk, 64};
constexpr UsbEndpoint kOut{0x02, UsbTransferType::kBulk, 64};

/// Bytes 0, 1, 2, ... of which the 257th is 0 again.
Bytes counting(std::size_t size) {
  Bytes bytes(size);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  return bytes;
}

Urb out_urb(std::uint32_t sequence, const Bytes& data) {
  Urb urb;
  urb.sequence = sequence;
  urb.endpoint = kOut;
  urb.data = data;
  return urb;
}

Urb in_urb(std::uint32_t sequence, std::size_t buffer_bytes) {
  Urb urb;
  urb.sequence = sequence;
  urb.endpoint = kIn;
  urb.buffer_bytes = buffer_bytes;
  return urb;
}

struct Reply {
  std::uint32_t sequence;
  std::int32_t status;
  std::uint32_t actual_bytes;
  Bytes data;
};

class UrbHostTest : public testing::Test {
 protected:
  std::uint32_t word(std::size_t at) const {
    return (static_cast<std::uint32_t>(replies_.at(at)) << 24) |
           (static_cast<std::uint32_t>(replies_.at(at + 1)) << 16) |
           (static_cast<std::uint32_t>(replies_.at(at + 2)) << 8) | replies_.at(at + 3);
  }
  /// The replies written since the last call; `in` says which of them carry data.
  std::vector<Reply> replies(bool in) {
    std::vector<Reply> result;
    std::size_t at = 0;
    while (at < replies_.size()) {
      EXPECT_EQ(word(at), 3U) << "RET_SUBMIT";
      Reply reply{word(at + 4), static_cast<std::int32_t>(word(at + 20)), word(at + 24), {}};
      at += 48;
      if (in) {
        const auto begin = replies_.begin() + static_cast<std::ptrdiff_t>(at);
        reply.data.assign(begin, begin + reply.actual_bytes);
        at += reply.actual_bytes;
      }
      result.push_back(reply);
    }
    replies_.clear();
    return result;
  }
  std::vector<Urb> pending_;
  std::vector<std::uint8_t> replies_;
  UrbHost host_{pending_, replies_};
};

TEST_F(UrbHostTest, AnOutTransferGoesInPacketsAndEndsWithTheLast) {
  const Bytes data = counting(150);
  pending_ = {out_urb(7, data)};
  Bytes taken;
  for (const std::size_t expected : {64U, 64U, 22U}) {
    const auto packet = host_.out_packet(0x02);
    ASSERT_TRUE(packet.has_value());
    ASSERT_EQ(packet->size(), expected);
    taken.insert(taken.end(), packet->begin(), packet->end());
    EXPECT_TRUE(replies_.empty());
    host_.take_out(0x02);
  }
  EXPECT_THAT(taken, ElementsAreArray(data));
  const auto done = replies(false);
  ASSERT_EQ(done.size(), 1U);
  EXPECT_EQ(done[0].sequence, 7U);
  EXPECT_EQ(done[0].status, 0);
  EXPECT_EQ(done[0].actual_bytes, 150U);
  EXPECT_FALSE(host_.out_packet(0x02).has_value());
}

TEST_F(UrbHostTest, AnOutPacketThatIsNotTakenStays) {
  pending_ = {out_urb(1, counting(3))};
  EXPECT_EQ(host_.out_packet(0x02)->size(), 3U);
  EXPECT_EQ(host_.out_packet(0x02)->size(), 3U);
  EXPECT_TRUE(replies_.empty());
}

TEST_F(UrbHostTest, TheLargestTransferIsMadeOfWholePackets) {
  pending_ = {out_urb(1, counting(65536))};
  int packets = 0;
  while (host_.out_packet(0x02)) {
    ASSERT_EQ(host_.out_packet(0x02)->size(), 64U);
    host_.take_out(0x02);
    ++packets;
  }
  EXPECT_EQ(packets, 1024);
  EXPECT_EQ(replies(false).at(0).actual_bytes, 65536U);
}

TEST_F(UrbHostTest, EmptyPacketsCarryEmptyTransfersAndFollowWholeOnesOnRequest) {
  pending_ = {out_urb(1, {}), out_urb(2, counting(64)), out_urb(3, counting(64))};
  pending_[2].zero_packet = true;
  std::vector<std::size_t> sizes;
  while (const auto packet = host_.out_packet(0x02)) {
    sizes.push_back(packet->size());
    host_.take_out(0x02);
  }
  EXPECT_THAT(sizes, testing::ElementsAre(0, 64, 64, 0));
  const auto done = replies(false);
  ASSERT_EQ(done.size(), 3U);
  EXPECT_EQ(done[2].actual_bytes, 64U);
}

TEST_F(UrbHostTest, AShortPacketEndsAnInTransfer) {
  pending_ = {in_urb(5, 512), in_urb(6, 512)};
  const Bytes whole = counting(64);
  const Bytes part = counting(10);
  EXPECT_TRUE(host_.give_in(0x81, whole));
  EXPECT_TRUE(replies_.empty());
  EXPECT_TRUE(host_.give_in(0x81, part));
  const auto done = replies(true);
  ASSERT_EQ(done.size(), 1U);
  EXPECT_EQ(done[0].sequence, 5U);
  EXPECT_EQ(done[0].status, 0);
  Bytes expected = whole;
  expected.insert(expected.end(), part.begin(), part.end());
  EXPECT_THAT(done[0].data, ElementsAreArray(expected));
  EXPECT_TRUE(host_.wants_in(0x81)) << "the second one has not begun";
  EXPECT_TRUE(host_.give_in(0x81, {}));
  EXPECT_EQ(replies(true).at(0).actual_bytes, 0U);
  EXPECT_FALSE(host_.wants_in(0x81));
}

TEST_F(UrbHostTest, AFullBufferEndsAnInTransfer) {
  pending_ = {in_urb(5, 128)};
  const Bytes whole = counting(64);
  EXPECT_TRUE(host_.give_in(0x81, whole));
  EXPECT_TRUE(host_.give_in(0x81, whole));
  EXPECT_EQ(replies(true).at(0).actual_bytes, 128U);
}

TEST_F(UrbHostTest, APacketBeyondTheBufferIsBabbleAndStaysWithTheDevice) {
  pending_ = {in_urb(5, 70), in_urb(6, 64)};
  const Bytes whole = counting(64);
  EXPECT_TRUE(host_.give_in(0x81, whole));
  EXPECT_FALSE(host_.give_in(0x81, whole));
  const auto babbled = replies(true);
  ASSERT_EQ(babbled.size(), 1U);
  EXPECT_EQ(babbled[0].sequence, 5U);
  EXPECT_EQ(babbled[0].status, -75) << "-EOVERFLOW";
  EXPECT_EQ(babbled[0].actual_bytes, 64U) << "what came before it";
  EXPECT_TRUE(host_.give_in(0x81, whole));
  EXPECT_EQ(replies(true).at(0).status, 0);
}

TEST_F(UrbHostTest, AShortTransferIsAnErrorOnlyWhereTheClientSaysSo) {
  pending_ = {in_urb(5, 64), in_urb(6, 64)};
  pending_[0].short_is_error = true;
  pending_[1].short_is_error = true;
  EXPECT_TRUE(host_.give_in(0x81, counting(2)));
  EXPECT_TRUE(host_.give_in(0x81, counting(64)));
  const auto done = replies(true);
  EXPECT_EQ(done.at(0).status, -121) << "-EREMOTEIO";
  EXPECT_EQ(done.at(1).status, 0);
}

TEST_F(UrbHostTest, EndpointsHaveQueuesOfTheirOwn) {
  pending_ = {out_urb(1, counting(1)), in_urb(2, 64), out_urb(3, counting(2))};
  EXPECT_TRUE(host_.wants_in(0x81));
  EXPECT_FALSE(host_.wants_in(0x82));
  EXPECT_FALSE(host_.out_packet(0x01).has_value());
  host_.fail_all(0x02, -32);
  const auto failed = replies(false);
  ASSERT_EQ(failed.size(), 2U);
  EXPECT_EQ(failed[0].sequence, 1U);
  EXPECT_EQ(failed[1].sequence, 3U);
  EXPECT_EQ(failed[1].status, -32);
  EXPECT_EQ(failed[1].actual_bytes, 0U);
  EXPECT_TRUE(host_.wants_in(0x81));
}

}  // namespace
}  // namespace forcegrid::emulator
