// SPDX-License-Identifier: Apache-2.0
#include "view_link/inside_messages.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>

namespace forcegrid::view_link {
namespace {

// Offsets in the payload, from docs/view_protocol.md.
constexpr std::size_t kVerticesAt = 4;
constexpr std::size_t kSpringsAt = 8;
constexpr std::size_t kElementEdgesAt = 12;
constexpr std::size_t kEdgesAt = 16;
constexpr std::size_t kFirstEdgeAt = 20;

template <typename T>
Bytes with(Bytes bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof(value));
  return bytes;
}

// Two springs, and three edges of an element.
InsideLines some_lines() { return {7, 4, 2, 3, {{0, 1}, {1, 2}, {0, 2}, {2, 3}, {3, 0}}}; }

TEST(InsideLines, HaveTheWorkedBytes) {
  const InsideLines lines{0x01020304, 3, 1, 1, {{0, 1}, {2, 1}}};
  const Frame frame = encode(lines, 2);
  EXPECT_EQ(frame.type, 4);
  EXPECT_EQ(frame.object, 2);
  EXPECT_EQ(frame.payload, (Bytes{4, 3, 2, 1, 3, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0,  //
                                  0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0}));
}

TEST(InsideLines, ComeBackAsTheyWere) {
  const InsideLines lines = some_lines();
  const auto decoded = decode_lines(encode(lines).payload);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->epoch, lines.epoch);
  EXPECT_EQ(decoded->vertices, lines.vertices);
  EXPECT_EQ(decoded->springs, lines.springs);
  EXPECT_EQ(decoded->element_edges, lines.element_edges);
  EXPECT_EQ(decoded->edge, lines.edge);
}

TEST(InsideLines, AreRefusedTruncatedOrTooLong) {
  Bytes payload = encode(some_lines()).payload;
  ASSERT_EQ(payload.size(), kFirstEdgeAt + 5 * 8);
  for (std::size_t size = 0; size < payload.size(); ++size) {
    EXPECT_FALSE(decode_lines(std::span(payload).first(size))) << size << " bytes";
  }
  payload.push_back(0);
  EXPECT_FALSE(decode_lines(payload));
}

TEST(InsideLines, AreRefusedWithAnEndThatIsNoVertex) {
  const Bytes payload = encode(some_lines()).payload;
  for (std::size_t at = kFirstEdgeAt; at < payload.size(); at += 4) {
    EXPECT_TRUE(decode_lines(with(payload, at, std::uint32_t{3}))) << at;
    EXPECT_FALSE(decode_lines(with(payload, at, std::uint32_t{4}))) << at;
    EXPECT_FALSE(decode_lines(with(payload, at, ~std::uint32_t{0}))) << at;
  }
}

TEST(InsideLines, AreRefusedWithCountsThatTheBytesDoNotHave) {
  const Bytes payload = encode(some_lines()).payload;
  for (const std::uint32_t count : {1U, 4U, 6U, kMostEdges, kMostEdges + 1, 0x20000005U, ~0U}) {
    EXPECT_FALSE(decode_lines(with(payload, kSpringsAt, count))) << count;
    EXPECT_FALSE(decode_lines(with(payload, kElementEdgesAt, count))) << count;
    EXPECT_FALSE(decode_lines(with(payload, kEdgesAt, count))) << count;
  }
  EXPECT_FALSE(decode_lines(with(payload, kVerticesAt, kMostVertices + 1)));
}

TEST(InsideLines, OfAnObjectWithTooManyAreItsCountsAlone) {
  // The sum of the counts is beyond 32 bits.
  InsideLines lines{1, 0, ~0U, ~0U, {}};
  const auto decoded = decode_lines(encode(lines).payload);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->springs, ~0U);
  EXPECT_TRUE(decoded->edge.empty());
  lines = {1, 0, kMostEdges, 1, {}};
  EXPECT_TRUE(decode_lines(encode(lines).payload));
  lines = {1, 0, kMostEdges, 0, {}};
  EXPECT_FALSE(decode_lines(encode(lines).payload)) << "that many are sent";
}

TEST(InsideLines, MayBeTheMostThatAreShown) {
  InsideLines lines{1, 2, 100'000, 200'000, {}};
  lines.edge.assign(kMostEdges, {0, 1});
  EXPECT_TRUE(decode_lines(encode(lines).payload));
  lines.springs += 1;
  lines.edge.push_back({0, 1});
  EXPECT_FALSE(decode_lines(encode(lines).payload));
}

TEST(InsideLines, WithstandRandomBytes) {
  constexpr unsigned kSeed = 20261125;
  std::mt19937 random(kSeed);
  const Bytes sound = encode(some_lines()).payload;
  int taken = 0;
  for (int round = 0; round < 5000; ++round) {
    Bytes bytes = sound;
    bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random() % 8);
    if (const auto decoded = decode_lines(bytes)) {
      ++taken;
      for (const Edge& edge : decoded->edge) {
        EXPECT_LT(std::max(edge[0], edge[1]), decoded->vertices) << "seed " << kSeed;
      }
    }
  }
  EXPECT_GT(taken, 100) << "seed " << kSeed;
}

TEST(InsideFrame, HasTheFormOfASurfaces) {
  const SurfaceFrame vertices{7, 1.5, {{0, 0, 0}, {1, 2, 3}}};
  const Frame frame = encode_inside(vertices, 1);
  EXPECT_EQ(frame.type, 5);
  EXPECT_EQ(frame.object, 1);
  EXPECT_EQ(frame.payload, encode(vertices, 1).payload);
}

TEST(InsideWish, HasTheWorkedBytesAndIgnoresBitsThatItDoesNotKnow) {
  EXPECT_EQ(encode_wish(true).type, 16);
  EXPECT_EQ(encode_wish(true).payload, (Bytes{1, 0, 0, 0}));
  EXPECT_EQ(encode_wish(false).payload, (Bytes{0, 0, 0, 0}));
  EXPECT_EQ(decode_wish(Bytes{1, 0, 0, 0}), true);
  EXPECT_EQ(decode_wish(Bytes{0, 0, 0, 0}), false);
  EXPECT_EQ(decode_wish(Bytes{0xfe, 0xff, 0, 0}), false);
  EXPECT_EQ(decode_wish(Bytes{0xff, 0xff, 0, 0}), true);
  EXPECT_FALSE(decode_wish(Bytes{1, 0, 0}));
  EXPECT_FALSE(decode_wish(Bytes{1, 0, 0, 0, 0}));
  EXPECT_FALSE(decode_wish({}));
}

}  // namespace
}  // namespace forcegrid::view_link
