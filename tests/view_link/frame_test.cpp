// SPDX-License-Identifier: Apache-2.0
#include "view_link/frame.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

namespace forcegrid::view_link {
namespace {

TEST(FrameBytes, AreTheWorkedOnes) {
  const Frame frame{0x0203, 0x0405, {0xaa, 0xbb, 0xcc}};
  const Bytes worked = {3, 0, 0, 0, 0x03, 0x02, 0x05, 0x04, 0xaa, 0xbb, 0xcc};
  EXPECT_EQ(bytes_of(frame), worked);
}

TEST(FrameReader, TakesFramesFromPiecesOfAnySize) {
  const std::vector<Frame> sent = {
      {1, 0, {}}, text_frame(5, "a note"), {3, 7, Bytes(1000, 0x5a)}, {2, 65535, {1}}};
  Bytes stream;
  for (const Frame& frame : sent) {
    const Bytes bytes = bytes_of(frame);
    stream.insert(stream.end(), bytes.begin(), bytes.end());
  }
  for (const std::size_t piece :
       {std::size_t{1}, std::size_t{3}, std::size_t{8}, std::size_t{500}, stream.size()}) {
    FrameReader reader(1000);
    std::vector<Frame> taken;
    for (std::size_t at = 0; at < stream.size(); at += piece) {
      reader.add(std::span(stream).subspan(at, std::min(piece, stream.size() - at)));
      while (auto frame = reader.next()) {
        taken.push_back(std::move(*frame));
      }
    }
    ASSERT_EQ(taken.size(), sent.size()) << "pieces of " << piece;
    for (std::size_t i = 0; i < sent.size(); ++i) {
      EXPECT_EQ(taken[i].type, sent[i].type);
      EXPECT_EQ(taken[i].object, sent[i].object);
      EXPECT_EQ(taken[i].payload, sent[i].payload);
    }
  }
}

TEST(FrameReader, WaitsForTheLastByte) {
  const Bytes bytes = bytes_of(text_frame(5, "abc"));
  FrameReader reader(3);
  reader.add(std::span(bytes).first(bytes.size() - 1));
  EXPECT_FALSE(reader.next());
  reader.add(std::span(bytes).last(1));
  const auto frame = reader.next();
  ASSERT_TRUE(frame);
  EXPECT_EQ(text_of(*frame), "abc");
  EXPECT_FALSE(reader.next());
}

TEST(FrameReader, RefusesAFrameThatIsTooLargeByItsHeaderAlone) {
  FrameReader reader(kLargestFeedPayload);
  // 65537 bytes, one more than is taken; none of them has come.
  reader.add(Bytes{0x01, 0x00, 0x01, 0x00, 2, 0, 0, 0});
  try {
    reader.next();
    FAIL() << "it takes the frame";
  } catch (const ViewLinkError& error) {
    EXPECT_NE(std::string(error.what()).find("65537"), std::string::npos) << error.what();
  }
}

TEST(FrameReader, TakesAFrameOfTheLargestSize) {
  FrameReader reader(kLargestFeedPayload);
  reader.add(bytes_of({2, 0, Bytes(kLargestFeedPayload, 1)}));
  const auto frame = reader.next();
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->payload.size(), kLargestFeedPayload);
}

TEST(FrameReader, WithstandsRandomBytes) {
  constexpr unsigned kSeed = 20261124;
  std::mt19937 random(kSeed);
  for (int round = 0; round < 200; ++round) {
    FrameReader reader(64);
    std::size_t given = 0, taken = 0;
    try {
      for (int piece = 0; piece < 20; ++piece) {
        Bytes bytes(random() % 40);
        // Small numbers, so that some lengths are permitted.
        std::generate(bytes.begin(), bytes.end(), [&] {
          return static_cast<std::uint8_t>(random() % 8 == 0 ? random() % 32 : 0);
        });
        given += bytes.size();
        reader.add(bytes);
        while (const auto frame = reader.next()) {
          EXPECT_LE(frame->payload.size(), 64U);
          taken += kHeaderBytes + frame->payload.size();
        }
      }
    } catch (const ViewLinkError&) {
      // Most streams of random bytes have a frame that is too large.
    }
    EXPECT_LE(taken, given) << "seed " << kSeed;
  }
}

}  // namespace
}  // namespace forcegrid::view_link
