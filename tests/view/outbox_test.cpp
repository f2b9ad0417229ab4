// SPDX-License-Identifier: Apache-2.0
#include "view/outbox.h"

#include <gtest/gtest.h>

#include <cstring>
#include <set>
#include <string>

namespace forcegrid::view {
namespace {

SharedBytes surface(std::uint8_t object, std::uint8_t number) {
  return message_of(PageType::kSurface, object, view_link::Bytes{number});
}

ScopeRow row_at(double time_s) {
  ScopeRow row;
  row.time_s = time_s;
  return row;
}

std::string text_of(const PageMessage& message) {
  return {message.bytes->begin(), message.bytes->end()};
}

std::size_t count_of(const PageMessage& message) {
  std::uint16_t count = 0;
  std::memcpy(&count, message.bytes->data() + 2, sizeof(count));
  return count;
}

double base_of(const PageMessage& message) {
  double base_s = 0.0;
  std::memcpy(&base_s, message.bytes->data() + 8, sizeof(base_s));
  return base_s;
}

TEST(Outbox, IsEmptyAtFirst) {
  Outbox outbox;
  EXPECT_FALSE(outbox.next());
}

TEST(Outbox, SendsTextsInOrderAndFirst) {
  Outbox outbox;
  outbox.add_row(row_at(1));
  outbox.set_shape(0, surface(0, 1));
  outbox.add_text("a");
  outbox.add_text("b");
  const auto first = outbox.next();
  ASSERT_TRUE(first);
  EXPECT_TRUE(first->text);
  EXPECT_EQ(text_of(*first), "a");
  EXPECT_EQ(text_of(*outbox.next()), "b");
  EXPECT_FALSE(outbox.next()->text);
}

TEST(Outbox, SendsTheLastTextAfterTheRowsAndSamples) {
  Outbox outbox;
  outbox.add_row(row_at(1));
  outbox.add_sample({});
  outbox.add_text("end", true);
  EXPECT_EQ(outbox.next()->bytes->front(), 1);
  EXPECT_EQ(outbox.next()->bytes->front(), 4);
  EXPECT_EQ(text_of(*outbox.next()), "end");
  EXPECT_FALSE(outbox.next());
}

TEST(Outbox, PutsRowsThatWaitIntoOneMessage) {
  Outbox outbox;
  for (int i = 0; i < 5; ++i) {
    outbox.add_row(row_at(0.01 * i));
  }
  const auto message = outbox.next();
  ASSERT_TRUE(message);
  EXPECT_EQ(count_of(*message), 5U);
  EXPECT_FALSE(outbox.next());
}

TEST(Outbox, KeepsTheNewestMinuteOfRows) {
  Outbox outbox;
  for (std::size_t i = 0; i < Outbox::kMostRows + 250; ++i) {
    outbox.add_row(row_at(static_cast<double>(i)));
  }
  EXPECT_EQ(outbox.dropped(), 250U);
  std::size_t rows = 0;
  double next_s = 250;
  while (const auto message = outbox.next()) {
    EXPECT_DOUBLE_EQ(base_of(*message), next_s);
    next_s += static_cast<double>(count_of(*message));
    rows += count_of(*message);
  }
  EXPECT_EQ(rows, Outbox::kMostRows);
}

TEST(Outbox, KeepsTheNewestSamples) {
  Outbox outbox;
  for (std::size_t i = 0; i < Outbox::kMostSamples + 9; ++i) {
    std::array<std::uint8_t, kSampleBytes> sample{};
    sample[0] = static_cast<std::uint8_t>(i);
    outbox.add_sample(sample);
  }
  const auto message = outbox.next();
  ASSERT_TRUE(message);
  EXPECT_EQ(count_of(*message), Outbox::kMostSamples);
  ASSERT_EQ(message->bytes->size(), 8 + kSampleBytes * Outbox::kMostSamples);
  EXPECT_EQ((*message->bytes)[8], 9);
  EXPECT_EQ(outbox.dropped(), 9U);
}

TEST(Outbox, KeepsTheNewestSurfaceOfEachObjectAndTheNewestArm) {
  Outbox outbox;
  for (std::uint8_t number = 1; number <= 9; ++number) {
    outbox.set_surface(0, surface(0, number));
    outbox.set_surface(3, surface(3, number));
    outbox.set_arm(0, message_of(PageType::kArm, 0, view_link::Bytes{number}));
  }
  EXPECT_EQ(outbox.dropped(), 24U);
  std::multiset<std::pair<int, int>> seen;
  while (const auto message = outbox.next()) {
    EXPECT_EQ(message->bytes->back(), 9);
    seen.insert({(*message->bytes)[0], (*message->bytes)[1]});
  }
  EXPECT_EQ(seen, (std::multiset<std::pair<int, int>>{{3, 0}, {3, 3}, {5, 0}}));
}

TEST(Outbox, SendsAShapeBeforeItsFrames) {
  Outbox outbox;
  outbox.set_surface(1, surface(1, 1));  // of the shape before
  outbox.set_shape(1, message_of(PageType::kShape, 1, view_link::Bytes{}));
  outbox.set_surface(1, surface(1, 2));
  EXPECT_EQ(outbox.next()->bytes->front(), 2);
  EXPECT_EQ(outbox.next()->bytes->back(), 2);
  EXPECT_FALSE(outbox.next());
}

TEST(Outbox, SendsLinesAfterShapesAndBeforeTheirFrames) {
  Outbox outbox;
  const auto message = [](PageType type, std::uint8_t number) {
    return message_of(type, 1, view_link::Bytes{number});
  };
  outbox.set_inside_lines(1, message(PageType::kInsideLines, 1));
  outbox.set_inside_frame(1, message(PageType::kInsideFrame, 1));
  outbox.set_inside_lines(1, message(PageType::kInsideLines, 2));
  outbox.set_inside_frame(1, message(PageType::kInsideFrame, 2));
  outbox.set_inside_frame(1, message(PageType::kInsideFrame, 3));
  EXPECT_EQ(outbox.dropped(), 1U);
  outbox.set_inside_lines(0, message(PageType::kInsideLines, 2));
  outbox.set_shape(2, message(PageType::kShape, 0));
  std::vector<std::pair<int, int>> sent;  // type and number
  while (const auto next = outbox.next()) {
    sent.emplace_back((*next->bytes)[0], next->bytes->back());
  }
  EXPECT_EQ(sent, (std::vector<std::pair<int, int>>{{2, 0}, {8, 2}, {8, 2}, {9, 3}}));
  outbox.set_inside_lines(1, message(PageType::kInsideLines, 1));
  outbox.set_inside_frame(1, message(PageType::kInsideFrame, 1));
  outbox.set_shape(1, message(PageType::kShape, 9));  // it has another inside
  EXPECT_EQ(outbox.next()->bytes->back(), 9);
  EXPECT_FALSE(outbox.next());
}

TEST(Outbox, TakesTurnsSoThatNoKindWaitsForEver) {
  Outbox outbox;
  std::set<int> seen;
  for (int i = 0; i < 4; ++i) {
    // Each time, everything is there anew.
    outbox.add_row(row_at(i));
    outbox.add_sample({});
    outbox.set_arm(0, message_of(PageType::kArm, 0, view_link::Bytes{}));
    outbox.set_surface(0, surface(0, 1));
    seen.insert(outbox.next()->bytes->front());
  }
  EXPECT_EQ(seen, (std::set<int>{1, 3, 4, 5}));
}

TEST(Outbox, SaysThatTextsAreNotRead) {
  Outbox outbox;
  const std::string text(1000, 'x');
  std::size_t added = 0;
  while (!outbox.overrun()) {
    outbox.add_text(text);
    added += text.size();
    ASSERT_LE(added, 2 * Outbox::kMostTextBytes);
  }
  EXPECT_GT(added, Outbox::kMostTextBytes);
  outbox.next();
  EXPECT_FALSE(outbox.overrun());
}

TEST(Outbox, ForgetsARunAndASurface) {
  Outbox outbox;
  outbox.add_row(row_at(1));
  outbox.add_sample({});
  outbox.set_arm(0, message_of(PageType::kArm, 0, view_link::Bytes{}));
  outbox.set_arm(1, message_of(PageType::kArm, 1, view_link::Bytes{}));
  outbox.set_surface(2, surface(2, 1));
  outbox.forget_run(0);
  EXPECT_EQ(outbox.next()->bytes->front(), 3);
  EXPECT_EQ(outbox.next()->bytes->at(1), 1) << "the arm of another tool stays";
  EXPECT_FALSE(outbox.next());
  outbox.set_shape(2, message_of(PageType::kShape, 2, view_link::Bytes{}));
  outbox.set_surface(2, surface(2, 1));
  outbox.forget_surface(2);
  EXPECT_FALSE(outbox.next());
}

}  // namespace
}  // namespace forcegrid::view
