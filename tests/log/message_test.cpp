// SPDX-License-Identifier: Apache-2.0
#include "log/message.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>
#include <string>

namespace forcegrid::log {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

Message message(Level level, const std::string& text, const std::string& process = "") {
  Message one{level, "servo", text, process};
  one.servo_time_ns = 12'000'000'034;
  one.utc_ns = 1'700'000'000'123'456'789;  // 2023-11-14T22:13:20Z
  return one;
}

TEST(Message, LevelsHaveNames) {
  for (const std::string& name : level_names()) {
    EXPECT_EQ(name_of(parse_level(name).value()), name);
  }
  EXPECT_EQ(parse_level("loud"), std::nullopt);
  EXPECT_EQ(parse_level(""), std::nullopt);
}

TEST(Message, OnTheConsoleIsItsTextAndAMarkWhereItMatters) {
  EXPECT_EQ(console_line(message(Level::kInfo, "The loop runs."), true), "The loop runs.");
  EXPECT_EQ(console_line(message(Level::kWarn, "no sample"), false), "Warning: no sample");
  EXPECT_EQ(console_line(message(Level::kError, "no device"), false), "forcegrid: no device");
  EXPECT_EQ(console_line(message(Level::kDebug, "pid 7"), false), "servo: pid 7");
  EXPECT_EQ(console_line(message(Level::kInfo, "ready", "run/simulator"), false),
            "[run/simulator] ready");
  EXPECT_EQ(console_line(message(Level::kWarn, "slow", "simulator"), false),
            "[simulator] Warning: slow");
  EXPECT_EQ(console_line(message(Level::kError, "no scene", "simulator"), false),
            "[simulator] no scene");
}

TEST(Message, OnlyTheMarkOfWarningsAndErrorsIsColoured) {
  EXPECT_EQ(console_line(message(Level::kWarn, "no sample"), true),
            "\033[1;33mWarning: \033[0mno sample");
  EXPECT_EQ(console_line(message(Level::kError, "no device"), true),
            "\033[1;31mforcegrid: \033[0mno device");
}

TEST(Message, InAFileHasBothTimesAndIndentedFurtherLines) {
  EXPECT_EQ(file_line(message(Level::kWarn, "one\ntwo", "simulator")),
            "2023-11-14T22:13:20.123456Z 12.000000034 warn  [simulator] servo: one\n    two");
}

TEST(Message, SaysHowOftenItCameAgain) {
  Message again = message(Level::kInfo, "solver local");
  again.repeats = 1;
  EXPECT_EQ(console_line(again, false), "solver local (1 more time)");
  again.repeats = 3;
  EXPECT_EQ(console_line(again, false), "solver local (3 more times)");
  EXPECT_THAT(file_line(again), HasSubstr("solver local (3 more times)"));
  EXPECT_EQ(json::parse(json_line(again)).at("repeats"), 3);
  EXPECT_EQ(json::parse(json_line(again)).at("message"), "solver local");
}

TEST(Message, AsJsonHasEveryField) {
  const json line = json::parse(json_line(message(Level::kError, "a \"b\"\n\t\\", "worker 1")));
  EXPECT_EQ(line, (json{{"time", "2023-11-14T22:13:20.123456Z"},
                        {"servo_time_ns", 12'000'000'034},
                        {"level", "error"},
                        {"process", "worker 1"},
                        {"component", "servo"},
                        {"message", "a \"b\"\n\t\\"}}));
}

// nlohmann::json refuses every string that is no UTF-8, and every control character in one.
TEST(Message, AsJsonIsValidWhateverTheBytes) {
  const std::uint32_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> any_byte(0, 255);
  std::uniform_int_distribution<int> lead_byte(0xC0, 0xF7);
  for (int i = 0; i < 20'000; ++i) {
    std::string text;
    for (int k = i % 9; k >= 0; --k) {
      text += static_cast<char>(i % 2 == 0 ? any_byte(random) : lead_byte(random));
      text += static_cast<char>(0x80 + any_byte(random) % 0x40);
    }
    const std::string line = json_line(message(Level::kInfo, text));
    EXPECT_THAT(line, Not(HasSubstr("\n")));
    const json parsed = json::parse(line, nullptr, false);
    ASSERT_FALSE(parsed.is_discarded()) << line;
  }
}

TEST(Message, AsJsonKeepsWhatIsUtf8) {
  for (const char* text : {"grüße", "€", "\xF0\x9F\x98\x80", "\xED\x9F\xBF", "\xEE\x80\x80",
                           "\xF4\x8F\xBF\xBF", "\xE0\xA0\x80", "\xC2\x80", "\x7F"}) {
    EXPECT_EQ(json::parse(json_line(message(Level::kInfo, text))).at("message"), text);
  }
  // Cut short, overlong, a surrogate, beyond U+10FFFF (Unicode 15, table 3-7).
  for (const char* text : {"\xC3", "\xC0\xAF", "\xE0\x80\x80", "\xED\xA0\x80", "\xF4\x90\x80\x80",
                           "\xF8\x88\x80\x80", "\x80"}) {
    EXPECT_THAT(json::parse(json_line(message(Level::kInfo, text))).at("message"),
                HasSubstr("\xEF\xBF\xBD"));
  }
}

}  // namespace
}  // namespace forcegrid::log
