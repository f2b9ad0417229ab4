// SPDX-License-Identifier: Apache-2.0
#include "view_link/surface_messages.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>

namespace forcegrid::view_link {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Offsets in the payloads, from docs/view_protocol.md.
constexpr std::size_t kVerticesAt = 4;
constexpr std::size_t kTrianglesAt = 8;
constexpr std::size_t kShapePointsAt = 16;
constexpr std::size_t kFrameTimeAt = 12;
constexpr std::size_t kFrameLowAt = 20;
constexpr std::size_t kFrameStepAt = 32;
constexpr std::size_t kFramePositionsAt = 44;

template <typename T>
Bytes with(Bytes bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof(value));
  return bytes;
}

SurfaceShape tetrahedron() {
  return {9,
          {{0, 0, 0}, {0.1F, 0, 0}, {0, 0.2F, 0}, {0, 0, -0.05F}},
          {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}}};
}

SurfaceFrame some_frame() {
  return {9, 12.5, {{0, 0, 0}, {0.1F, 0, 0}, {0, 0.2F, 0}, {0, 0, -0.05F}}};
}

TEST(SurfaceShape, ComesBackAsItWas) {
  const SurfaceShape shape = tetrahedron();
  const Frame frame = encode(shape, 3);
  EXPECT_EQ(frame.type, 2);
  EXPECT_EQ(frame.object, 3);
  EXPECT_EQ(frame.payload.size(), kShapePointsAt + 12 * 4 + 12 * 4);
  const auto decoded = decode_shape(frame.payload);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->epoch, shape.epoch);
  EXPECT_EQ(decoded->rest_W_m, shape.rest_W_m);
  EXPECT_EQ(decoded->triangle, shape.triangle);
}

TEST(SurfaceShape, IsRefusedTruncatedOrTooLong) {
  Bytes payload = encode(tetrahedron()).payload;
  for (std::size_t size = 0; size < payload.size(); ++size) {
    EXPECT_FALSE(decode_shape(std::span(payload).first(size))) << size << " bytes";
  }
  payload.push_back(0);
  EXPECT_FALSE(decode_shape(payload));
}

TEST(SurfaceShape, IsRefusedWithACornerThatIsNoVertex) {
  const Bytes payload = encode(tetrahedron()).payload;
  const std::size_t last_corner = payload.size() - sizeof(std::uint32_t);
  EXPECT_TRUE(decode_shape(with(payload, last_corner, std::uint32_t{3})));
  EXPECT_FALSE(decode_shape(with(payload, last_corner, std::uint32_t{4})));
  EXPECT_FALSE(decode_shape(with(payload, last_corner, ~std::uint32_t{0})));
}

TEST(SurfaceShape, IsRefusedWithANumberThatIsNotFinite) {
  const Bytes payload = encode(tetrahedron()).payload;
  for (const float bad : {kNan, kInfinity, -kInfinity}) {
    EXPECT_FALSE(decode_shape(with(payload, kShapePointsAt + 20, bad)));
  }
}

TEST(SurfaceShape, IsRefusedWithCountsThatTheBytesDoNotHave) {
  const Bytes payload = encode(tetrahedron()).payload;
  for (const std::uint32_t count : {0U, 3U, 5U, kMostVertices + 1, 0x55555556U, ~0U}) {
    EXPECT_FALSE(decode_shape(with(payload, kVerticesAt, count))) << count;
    EXPECT_FALSE(decode_shape(with(payload, kTrianglesAt, count))) << count;
  }
}

TEST(SurfaceFrame, ComesBackWithinHalfAStep) {
  constexpr unsigned kSeed = 7;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<float> coordinate(-0.065F, 0.065F);
  SurfaceFrame frame{4, 0.25, {}};
  for (int vertex = 0; vertex < 2000; ++vertex) {
    // Flat in z: a step of zero.
    frame.position_W_m.push_back({coordinate(random), 3.0F + coordinate(random), 0.5F});
  }
  const auto decoded = decode_frame(encode(frame).payload);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->epoch, 4U);
  EXPECT_EQ(decoded->time_s, 0.25);
  ASSERT_EQ(decoded->position_W_m.size(), frame.position_W_m.size());
  // Half of 0.13 m / 65535, and the rounding of floats near 3 m.
  const std::array<double, 3> tolerance_m = {0.5 * 0.13 / 65535 + 2e-8, 0.5 * 0.13 / 65535 + 5e-7,
                                             0.0};
  for (std::size_t vertex = 0; vertex < frame.position_W_m.size(); ++vertex) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(decoded->position_W_m[vertex][axis], frame.position_W_m[vertex][axis],
                  tolerance_m[axis])
          << "seed " << kSeed << ", vertex " << vertex;
    }
  }
}

TEST(SurfaceFrame, HasTheWorkedBytes) {
  // Low 0, step 1/65535 m: the values are the positions in steps.
  const SurfaceFrame frame{1, 1.0, {{0, 0, 0}, {1, 1, 1}, {0.5F, 1, 0}}};
  const Bytes payload = encode(frame).payload;
  ASSERT_EQ(payload.size(), kFramePositionsAt + 3 * 6);
  const Bytes positions(payload.begin() + kFramePositionsAt, payload.end());
  const Bytes worked = {0,    0,    0,    0,    0,    0,     // low
                        0xff, 0xff, 0xff, 0xff, 0xff, 0xff,  // high
                        0x00, 0x80, 0xff, 0xff, 0,    0};    // 32767.5 rounds away from zero
  EXPECT_EQ(positions, worked);
  const Bytes time(payload.begin() + kFrameTimeAt, payload.begin() + kFrameTimeAt + 8);
  EXPECT_EQ(time, (Bytes{0, 0, 0, 0, 0, 0, 0xf0, 0x3f}));
}

TEST(SurfaceFrame, OfNothingIsSound) {
  const auto decoded = decode_frame(encode(SurfaceFrame{2, 0.0, {}}).payload);
  ASSERT_TRUE(decoded);
  EXPECT_TRUE(decoded->position_W_m.empty());
}

TEST(SurfaceFrame, IsRefusedTruncatedOrTooLong) {
  Bytes payload = encode(some_frame()).payload;
  for (std::size_t size = 0; size < payload.size(); ++size) {
    EXPECT_FALSE(decode_frame(std::span(payload).first(size))) << size << " bytes";
  }
  payload.push_back(0);
  EXPECT_FALSE(decode_frame(payload));
}

TEST(SurfaceFrame, IsRefusedWithANumberThatIsNotFinite) {
  const Bytes payload = encode(some_frame()).payload;
  for (const float bad : {kNan, kInfinity}) {
    EXPECT_FALSE(decode_frame(with(payload, kFrameLowAt + 4, bad)));
    EXPECT_FALSE(decode_frame(with(payload, kFrameStepAt + 8, bad)));
  }
  EXPECT_FALSE(decode_frame(with(payload, kFrameTimeAt, double{kNan})));
  // Finite by themselves; position = low + step * value is not.
  constexpr float kMost = std::numeric_limits<float>::max();
  EXPECT_FALSE(decode_frame(with(payload, kFrameStepAt, kMost)));
}

TEST(SurfaceFrame, IsRefusedWithAnotherCount) {
  const Bytes payload = encode(some_frame()).payload;
  for (const std::uint32_t count : {0U, 3U, 5U, kMostVertices + 1, 0x2aaaaaabU, ~0U}) {
    EXPECT_FALSE(decode_frame(with(payload, kVerticesAt, count))) << count;
  }
}

TEST(SurfaceMessages, WithstandRandomBytes) {
  constexpr unsigned kSeed = 20261124;
  std::mt19937 random(kSeed);
  const Bytes shape = encode(tetrahedron()).payload;
  const Bytes frame = encode(some_frame()).payload;
  for (int round = 0; round < 5000; ++round) {
    Bytes bytes = round % 2 == 0 ? shape : frame;
    for (unsigned change = 0; change <= random() % 4; ++change) {
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    }
    if (const auto decoded = decode_shape(bytes)) {
      for (const Corners& corners : decoded->triangle) {
        EXPECT_LT(*std::max_element(corners.begin(), corners.end()), decoded->rest_W_m.size())
            << "seed " << kSeed;
      }
    }
    if (const auto decoded = decode_frame(bytes)) {
      for (const Point& point : decoded->position_W_m) {
        EXPECT_TRUE(std::isfinite(point[0]) && std::isfinite(point[1]) && std::isfinite(point[2]))
            << "seed " << kSeed;
      }
    }
  }
}

}  // namespace
}  // namespace forcegrid::view_link
