// SPDX-License-Identifier: Apache-2.0
#include "view/messages.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "view_link/little_endian.h"

namespace forcegrid::view {
namespace {

using What = PageCommand::What;

TEST(PageCommands, AreTaken) {
  const auto stop = parse_command(R"({"id":7,"what":"stop"})");
  ASSERT_TRUE(stop);
  EXPECT_EQ(stop->what, What::kStop);
  EXPECT_EQ(stop->id, 7U);
  EXPECT_EQ(parse_command(R"({"what":"stop"})")->id, 0U);
  EXPECT_TRUE(parse_command(R"({"id":8,"what":"pause","value":true})")->pause);
  EXPECT_FALSE(parse_command(R"({"id":8,"what":"pause","value":false})")->pause);
  const auto hand = parse_command(R"({"id":9,"what":"hand","target_W_m":[0.01,-2,3e-3]})");
  ASSERT_TRUE(hand && hand->target_W_m);
  EXPECT_EQ(*hand->target_W_m, (std::array<double, 3>{0.01, -2.0, 0.003}));
  const auto let_go = parse_command(R"({"id":9,"what":"hand","target_W_m":null})");
  ASSERT_TRUE(let_go);
  EXPECT_FALSE(let_go->target_W_m);
  EXPECT_EQ(parse_command(R"({"what":"shown","cycle":16777215})")->cycle, 16'777'215U);
  EXPECT_EQ(parse_command(R"({"what":"take_control"})")->what, What::kTakeControl);
  EXPECT_EQ(parse_command(R"({"what":"tool","tool":3})")->tool, 3U);
  EXPECT_FALSE(parse_command(R"({"what":"tool","tool":4})"));
  EXPECT_FALSE(parse_command(R"({"what":"tool"})"));
  const auto play = parse_command(R"({"what":"play","value":true,"speed":0.25})");
  EXPECT_TRUE(play->play);
  EXPECT_EQ(play->speed, 0.25);
  EXPECT_EQ(parse_command(R"({"what":"seek","time_s":12.5})")->time_s, 12.5);
  const auto set = parse_command(R"({"id":3,"what":"set","name":"delay_ms","value":12.5})");
  ASSERT_TRUE(set);
  EXPECT_EQ(set->what, What::kSet);
  EXPECT_EQ(set->setting, "delay_ms");
  EXPECT_EQ(set->value, 12.5);
  EXPECT_EQ(parse_command(R"({"what":"set","name":"hand","value":"arm"})")->value, "arm");
  EXPECT_TRUE(parse_command(R"({"what":"set","name":"budget_us","value":null})")->value.is_null());
}

TEST(PageCommands, AreRefused) {
  for (const char* text : {"",
                           "stop",
                           "{}",
                           "[]",
                           "null",
                           R"({"id":1})",
                           R"({"what":"halt"})",
                           R"({"what":5})",
                           R"({"what":"stop","id":-1})",
                           R"({"what":"stop","id":1.5})",
                           R"({"what":"stop","id":"1"})",
                           R"({"what":"stop","id":9007199254740993})",
                           R"({"what":"pause"})",
                           R"({"what":"pause","value":1})",
                           R"({"what":"hand"})",
                           R"({"what":"hand","target_W_m":1})",
                           R"({"what":"hand","target_W_m":[1,2]})",
                           R"({"what":"hand","target_W_m":[1,2,3,4]})",
                           R"({"what":"hand","target_W_m":[1,2,"3"]})",
                           R"({"what":"hand","target_W_m":[1,2,11]})",
                           R"({"what":"hand","target_W_m":[1,2,1e999]})",
                           R"({"what":"hand","target_W_m":[1,2,NaN]})",
                           R"({"what":"shown"})",
                           R"({"what":"play"})",
                           R"({"what":"play","value":1,"speed":1})",
                           R"({"what":"play","value":true})",
                           R"({"what":"play","value":true,"speed":0})",
                           R"({"what":"play","value":true,"speed":101})",
                           R"({"what":"seek"})",
                           R"({"what":"seek","time_s":-1})",
                           R"({"what":"seek","time_s":"1"})",
                           R"({"what":"seek","time_s":1e10})",
                           R"({"what":"shown","cycle":-1})",
                           R"({"what":"set"})",
                           R"({"what":"set","name":"delay_ms"})",
                           R"({"what":"set","name":5,"value":1})",
                           R"({"what":"set","name":"delay_ms","value":[1]})",
                           R"({"what":"set","name":"delay_ms","value":true})",
                           R"({"what":"set","name":"delay_ms","value":1e999})",
                           R"({"what":"stop"} x)",
                           "{\"what\":\"stop\",\"text\":\"\xff\"}"}) {
    EXPECT_FALSE(parse_command(text)) << text;
  }
}

TEST(PageCommands, AreAtMostFourKilobytes) {
  const std::string stop = R"({"what":"stop"})";
  EXPECT_TRUE(parse_command(stop + std::string(kLargestPageText - stop.size(), ' ')));
  EXPECT_FALSE(parse_command(stop + std::string(kLargestPageText - stop.size() + 1, ' ')));
}

TEST(PageCommands, GoToTheRunWithTheServersId) {
  const auto json = [](const char* text) {
    return nlohmann::json::parse(command_json(*parse_command(text), 41));
  };
  EXPECT_EQ(json(R"({"id":7,"what":"stop","extra":1})"),
            nlohmann::json::parse(R"({"id":41,"what":"stop"})"));
  EXPECT_EQ(json(R"({"id":7,"what":"pause","value":true})"),
            nlohmann::json::parse(R"({"id":41,"what":"pause","value":true})"));
  EXPECT_EQ(json(R"({"id":7,"what":"hand","target_W_m":[0.1,0.2,0.3]})"),
            nlohmann::json::parse(R"({"id":41,"what":"hand","target_W_m":[0.1,0.2,0.3]})"));
  EXPECT_EQ(json(R"({"id":7,"what":"hand","target_W_m":null})"),
            nlohmann::json::parse(R"({"id":41,"what":"hand","target_W_m":null})"));
  EXPECT_EQ(json(R"({"id":7,"what":"set","name":"hand","value":"arm","extra":1})"),
            nlohmann::json::parse(R"({"id":41,"what":"set","name":"hand","value":"arm"})"));
  EXPECT_EQ(json(R"({"id":7,"what":"shown","cycle":12})"),
            nlohmann::json::parse(R"({"id":41,"what":"shown","cycle":12})"));
}

TEST(JsonObject, IsNotNestedDeep) {
  const auto nested = [](int levels) {
    return R"({"a":)" + std::string(levels, '[') + std::string(levels, ']') + "}";
  };
  EXPECT_TRUE(parse_object(nested(15)));
  EXPECT_FALSE(parse_object(nested(16)));
  EXPECT_FALSE(parse_object(nested(30'000)));
  EXPECT_TRUE(parse_object(R"({"a":")" + std::string(100, '[') + R"(\"[[[["})")) << "a text";
}

TEST(Narrowing, KeepsToTheRangeOfFloats) {
  constexpr float kMost = std::numeric_limits<float>::max();
  EXPECT_EQ(narrow(0.5), 0.5F);
  EXPECT_EQ(narrow(1e300), kMost);
  EXPECT_EQ(narrow(-1e300), -kMost);
  EXPECT_EQ(narrow(std::numeric_limits<double>::infinity()), kMost);
  EXPECT_TRUE(std::isnan(narrow(std::nan(""))));
}

TEST(SampleBytes, AreTheWorkedOnes) {
  view_link::FeedSample sample;
  sample.position_W_m = {1, 2, 3};
  sample.force_W_N = {-1, -2, -3};
  sample.contact_point_W_m = {4, 5, 6};
  sample.contact_epoch = 77;
  sample.in_contact = 1;
  const auto numbers = [&] {
    std::array<float, 12> found{};
    const auto bytes = sample_bytes(sample, 0.5);
    std::memcpy(found.data(), bytes.data(), bytes.size());
    return found;
  };
  EXPECT_EQ(numbers(), (std::array<float, 12>{1, 2, 3, -1, -2, -3, 0.5F, 1, 4, 5, 6, 77}));
  sample.requested = 1;
  EXPECT_EQ(numbers()[7], 3.0F);
}

view_link::Bytes arm(const std::vector<std::vector<float>>& lines) {
  view_link::Bytes bytes;
  view_link::append(bytes, static_cast<std::uint32_t>(lines.size()));
  for (const auto& line : lines) {
    view_link::append(bytes, static_cast<std::uint32_t>(line.size() / 3));
    view_link::append(bytes, std::span<const float>(line));
  }
  return bytes;
}

TEST(Arm, IsSoundAsLinesOfFinitePoints) {
  EXPECT_TRUE(arm_is_sound(arm({})));
  EXPECT_TRUE(arm_is_sound(arm({{0, 0, 0, 1, 1, 1}, {}, {2, 2, 2}})));
}

TEST(Arm, IsNotSoundOtherwise) {
  view_link::Bytes bytes = arm({{0, 0, 0, 1, 1, 1}, {2, 2, 2}});
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(arm_is_sound(std::span(bytes).first(size))) << size;
  }
  bytes.push_back(0);
  EXPECT_FALSE(arm_is_sound(bytes));
  EXPECT_FALSE(arm_is_sound(arm({{0, 0, std::nanf("")}})));
  EXPECT_FALSE(arm_is_sound(arm(std::vector<std::vector<float>>(1025))));
  EXPECT_FALSE(arm_is_sound(view_link::Bytes(8, 0xff)));
  EXPECT_FALSE(arm_is_sound(view_link::Bytes{1, 0, 0, 0, 0xff, 0xff, 0xff, 0xff}));
}

}  // namespace
}  // namespace forcegrid::view
