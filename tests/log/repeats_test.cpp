// SPDX-License-Identifier: Apache-2.0
#include "log/repeats.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace forcegrid::log {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr std::int64_t kSecond_ns = 1'000'000'000;

Message at(std::int64_t time_s, const std::string& text, const std::string& process = "",
           Level level = Level::kInfo) {
  Message message{level, "test", text, process};
  message.servo_time_ns = time_s * kSecond_ns;
  return message;
}

// "text" of a message, "text +3" of a count.
std::vector<std::string> texts(const std::vector<Message>& messages) {
  std::vector<std::string> said;
  for (const Message& message : messages) {
    said.push_back(message.text +
                   (message.repeats > 0 ? " +" + std::to_string(message.repeats) : ""));
  }
  return said;
}

TEST(Repeats, OfThisProcessAreCountedUntilAnotherMessageComes) {
  Repeats repeats;
  EXPECT_THAT(texts(repeats.take(at(1, "a"))), ElementsAre("a"));
  EXPECT_THAT(texts(repeats.take(at(2, "a"))), IsEmpty());
  EXPECT_THAT(texts(repeats.take(at(3, "a"))), IsEmpty());
  EXPECT_THAT(texts(repeats.take(at(4, "b"))), ElementsAre("a +2", "b"));
  EXPECT_THAT(texts(repeats.end()), IsEmpty());
}

TEST(Repeats, ThatAlternateAreNewsEachTime) {
  Repeats repeats;
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(texts(repeats.take(at(2 * i, "lost"))), ElementsAre("lost"));
    EXPECT_THAT(texts(repeats.take(at(2 * i + 1, "back"))), ElementsAre("back"));
  }
}

TEST(Repeats, OfAChildAreCountedUntilTheEnd) {
  Repeats repeats;
  EXPECT_THAT(texts(repeats.take(at(1, "solver", "run/simulator"))), ElementsAre("solver"));
  for (int i = 2; i < 6; ++i) {
    EXPECT_THAT(texts(repeats.take(at(i, "try " + std::to_string(i)))),
                ElementsAre("try " + std::to_string(i)));
    EXPECT_THAT(texts(repeats.take(at(i, "solver", "run/simulator"))), IsEmpty());
  }
  EXPECT_THAT(texts(repeats.take(at(6, "solver", "simulator"))), ElementsAre("solver"))
      << "another child";
  EXPECT_THAT(texts(repeats.end()), ElementsAre("solver +4"));
  EXPECT_THAT(texts(repeats.end()), IsEmpty());
}

TEST(Repeats, AreSaidAfterAMinuteEvenIfNothingElseComes) {
  Repeats repeats;
  for (const std::string process : {"", "simulator"}) {
    std::vector<std::string> said;
    for (std::int64_t time_s = 0; time_s <= 125; ++time_s) {
      for (const std::string& text : texts(repeats.take(at(time_s, "full", process)))) {
        said.push_back(std::to_string(time_s) + " " + text);
      }
    }
    EXPECT_THAT(said, ElementsAre("0 full", "60 full +60", "120 full +60")) << process;
  }
}

TEST(Repeats, AddUpTheCountsOfAChild) {
  Repeats repeats;
  repeats.take(at(1, "full", "run"));
  Message count = at(2, "full", "run");
  count.repeats = 7;
  EXPECT_THAT(texts(repeats.take(count)), IsEmpty());
  EXPECT_THAT(texts(repeats.take(at(3, "full", "run"))), IsEmpty());
  EXPECT_THAT(texts(repeats.end()), ElementsAre("full +8"));
}

TEST(Repeats, DoNotHoldBackErrorsAndRawLines) {
  Repeats repeats;
  for (const std::string process : {"", "simulator"}) {
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(repeats.take(at(i, "gone", process, Level::kError)).size(), 1U);
      Message raw = at(i, "", process);
      raw.component = kRawComponent;
      EXPECT_EQ(repeats.take(raw).size(), 1U);
    }
  }
}

TEST(Repeats, RememberABoundedNumberAndLoseNoCount) {
  Repeats repeats;
  const int many = static_cast<int>(3 * Repeats::kRemembered);
  std::uint64_t said = 0;
  for (int pass = 0; pass < 2; ++pass) {
    for (int i = 0; i < many; ++i) {
      for (int twice = 0; twice < 2; ++twice) {
        for (const Message& message : repeats.take(at(1, std::to_string(i), "simulator"))) {
          said += message.repeats > 0 ? message.repeats : 1;
        }
      }
    }
  }
  for (const Message& message : repeats.end()) {
    said += message.repeats;
  }
  EXPECT_EQ(said, static_cast<std::uint64_t>(4 * many));
}

}  // namespace
}  // namespace forcegrid::log
