// SPDX-License-Identifier: Apache-2.0
#include "view/tool_hubs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "tests/view/hub_pages.h"

namespace forcegrid::view {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr std::uint64_t kLeft = 11;  // peers
constexpr std::uint64_t kRight = 12;

Frame hello_of(std::uint16_t tool, const char* device) {
  Frame frame = text(FeedType::kHello, json{{"methods", {"auto"}}, {"device", device}}.dump());
  frame.object = tool;
  return frame;
}

Frame arm_at(float x_m) {
  Frame frame{static_cast<std::uint16_t>(FeedType::kArm), 0, {}};
  view_link::append(frame.payload, std::uint32_t{1});
  view_link::append(frame.payload, std::uint32_t{1});
  view_link::append(frame.payload, std::array<float, 3>{x_m, 0.0F, 0.0F});
  return frame;
}

float number_at(const view_link::Bytes& bytes, std::size_t at) {
  float number = 0.0F;
  std::memcpy(&number, bytes.data() + at, sizeof number);
  return number;
}

class HubsOfTwoTools : public testing::Test {
 protected:
  HubsOfTwoTools() {
    hubs_.take_feed(kLeft, hello_of(0, "left"));
    hubs_.take_feed(kRight, hello_of(1, "right"));
    hubs_.join(page_);
  }
  // The messages of a type that wait for the page, texts aside.
  std::vector<view_link::Bytes> waiting(PageType type) {
    page_.texts();
    std::vector<view_link::Bytes> found;
    for (const view_link::Bytes& bytes : page_.binary) {
      if (bytes[0] == static_cast<std::uint8_t>(type)) {
        found.push_back(bytes);
      }
    }
    page_.binary.clear();
    return found;
  }

  std::vector<std::pair<std::uint64_t, json>> commands_;
  std::vector<std::uint8_t> wishes_;
  ToolHubs hubs_{
      [this](std::uint64_t peer, const Frame& frame, PageCommand::What, bool) {
        commands_.emplace_back(peer, json::parse(view_link::text_of(frame)));
        return true;
      },
      [this](std::uint64_t, const Frame& wish) { wishes_.push_back(wish.payload.at(0)); }};
  Page page_;
};

TEST_F(HubsOfTwoTools, APageBeginsWithTheFirstAndIsToldOfAll) {
  const std::vector<json> told = page_.texts();
  ASSERT_EQ(told.size(), 2U);
  EXPECT_EQ(told[0]["type"], "hello");
  EXPECT_EQ(told[0]["device"], "left");
  EXPECT_EQ(told[0]["tool"], 0);
  EXPECT_EQ(told[0]["role"], "controller");
  EXPECT_EQ(told[1], (json{{"type", "tools"},
                           {"tools",
                            {{{"tool", 0}, {"device", "left"}, {"live", true}},
                             {{"tool", 1}, {"device", "right"}, {"live", true}}}}}));
}

TEST_F(HubsOfTwoTools, ItSeesTheArmAndToolOfTheOther) {
  page_.texts();
  view_link::FeedCycle one;
  one.time_ns = 1'000'000'000;
  one.position_W_m = {0.25, -0.5, 0.125};
  one.commanded_force_W_N = {0.0, 1.5, -2.0};
  one.in_contact = 1;
  hubs_.take_feed(kRight, structs(FeedType::kCycles, std::vector{view_link::FeedCycle{}, one}));
  hubs_.take_feed(kRight, arm_at(0.75F));
  const auto places = waiting(PageType::kOtherTool);
  ASSERT_EQ(places.size(), 1U);
  const view_link::Bytes& place = places.front();
  ASSERT_EQ(place.size(), 32U);
  EXPECT_EQ(place[1], 1);
  EXPECT_EQ(number_at(place, 4), 0.25F);
  EXPECT_EQ(number_at(place, 8), -0.5F);
  EXPECT_EQ(number_at(place, 12), 0.125F);
  EXPECT_EQ(number_at(place, 20), 1.5F);
  EXPECT_EQ(number_at(place, 24), -2.0F);
  EXPECT_EQ(number_at(place, 28), 1.0F);
  // What belongs to the scope of the other tool does not come.
  hubs_.take_feed(kRight, cycle(2, 5'000'000'000));
  EXPECT_TRUE(waiting(PageType::kScope).empty());
}

TEST_F(HubsOfTwoTools, ArmsComeWithTheirTools) {
  page_.texts();
  hubs_.take_feed(kLeft, arm_at(0.25F));
  hubs_.take_feed(kRight, arm_at(0.75F));
  auto arms = waiting(PageType::kArm);
  ASSERT_EQ(arms.size(), 2U);
  std::ranges::sort(arms, {}, [](const auto& arm) { return arm[1]; });
  EXPECT_EQ(number_at(arms[0], 12), 0.25F);
  EXPECT_EQ(number_at(arms[1], 12), 0.75F);
  EXPECT_EQ(arms[1][1], 1);
}

TEST_F(HubsOfTwoTools, PlacesComeSixtyTimesASecondAtMost) {
  page_.texts();
  std::size_t told = 0;
  for (std::uint64_t i = 0; i < 500; ++i) {  // one second
    hubs_.take_feed(kRight, cycle(i, static_cast<std::int64_t>(i) * 2'000'000));
    told += waiting(PageType::kOtherTool).size();
  }
  EXPECT_NEAR(static_cast<double>(told), 1.0 / 0.016, 1.0);
}

TEST_F(HubsOfTwoTools, AChosenToolIsShownAndCommanded) {
  page_.texts();
  hubs_.take_page(page_, R"({"what":"tool","tool":1})");
  const std::vector<json> told = page_.texts();
  ASSERT_FALSE(told.empty());
  EXPECT_EQ(told[0]["type"], "hello");
  EXPECT_EQ(told[0]["device"], "right");
  EXPECT_EQ(told[0]["tool"], 1);
  EXPECT_EQ(told[0]["role"], "controller");
  hubs_.take_page(page_, R"({"id":5,"what":"hand","target_W_m":[0,0,0.1]})");
  hubs_.take_page(page_, R"({"id":6,"what":"stop"})");
  ASSERT_EQ(commands_.size(), 2U);
  EXPECT_EQ(commands_[0].first, kRight);
  EXPECT_EQ(commands_[0].second["what"], "hand");
  EXPECT_EQ(commands_[1].first, kRight);
  hubs_.take_feed(kRight, cycle(1, 1'000'000'000));
  hubs_.take_feed(kRight, cycle(2, 1'020'000'000));
  EXPECT_EQ(waiting(PageType::kScope).size(), 1U);
  hubs_.take_feed(kLeft, cycle(1, 1'000'000'000));
  EXPECT_EQ(waiting(PageType::kOtherTool).size(), 1U);
}

TEST_F(HubsOfTwoTools, APageThatComesOrChoosesSeesWhereTheOthersStand) {
  hubs_.take_feed(kLeft, arm_at(0.25F));
  hubs_.take_feed(kLeft, cycle(1, 1'000'000'000));
  hubs_.take_feed(kRight, arm_at(0.75F));
  hubs_.take_feed(kRight, cycle(1, 1'000'000'000));
  page_.texts();
  page_.binary.clear();
  hubs_.take_page(page_, R"({"what":"tool","tool":1})");
  page_.texts();
  ASSERT_EQ(page_.binary.size(), 2U) << "arm and place of the left one";
  for (const view_link::Bytes& bytes : page_.binary) {
    EXPECT_EQ(bytes[1], 0);
  }
  Page late;
  hubs_.join(late);
  late.texts();
  ASSERT_EQ(late.binary.size(), 2U) << "arm and place of the right one";
  for (const view_link::Bytes& bytes : late.binary) {
    EXPECT_EQ(bytes[1], 1);
  }
  hubs_.leave(late);
}

TEST(HubsOfARecording, ShowWhereTheOthersAreWhenItStandsStill) {
  ToolHubs hubs([](auto...) { return true; });
  const auto hello = [](std::uint16_t tool) {
    Frame frame =
        text(FeedType::kHello, R"({"methods":["auto"],"recording":{"first_ns":0,"duration_s":1}})");
    frame.object = tool;
    return frame;
  };
  hubs.take_feed(kLeft, hello(0));
  hubs.take_feed(kRight, hello(1));
  Page page;
  hubs.join(page);
  view_link::FeedCycle one;
  one.position_W_m = {0.25, 0.0, 0.0};
  hubs.take_feed(kRight, structs(FeedType::kCycles, std::vector{one}));
  one.time_ns = 2'000'000;  // sooner than places are told
  one.position_W_m = {0.5, 0.0, 0.0};
  hubs.take_feed(kRight, structs(FeedType::kCycles, std::vector{one}));
  page.texts();
  ASSERT_EQ(page.binary.size(), 1U);
  EXPECT_EQ(number_at(page.binary[0], 4), 0.25F);
  page.binary.clear();
  hubs.take_feed(kRight, text(FeedType::kPlayback, R"({"state":"paused","time_s":0.002})"));
  page.texts();
  ASSERT_EQ(page.binary.size(), 1U);
  EXPECT_EQ(number_at(page.binary[0], 4), 0.5F);
  // That the left one goes elsewhere takes nothing of the right one away.
  hubs.take_feed(kRight, text(FeedType::kPlayback, R"({"state":"paused","time_s":0.002})"));
  hubs.take_feed(kLeft, text(FeedType::kPlayback,
                             R"({"state":"seeking","time_s":0,"anew":{"missed_deadlines":0}})"));
  page.binary.clear();
  page.texts();
  ASSERT_EQ(page.binary.size(), 1U);
  EXPECT_EQ(page.binary[0][1], 1);
  hubs.leave(page);
}

TEST_F(HubsOfTwoTools, EachHasAControllerOfItsOwn) {
  Page second;
  hubs_.join(second);
  EXPECT_EQ(second.texts()[0]["role"], "viewer");
  hubs_.take_page(second, R"({"what":"tool","tool":1})");
  EXPECT_EQ(second.texts()[0]["role"], "controller");
  page_.texts();
  hubs_.take_page(page_, R"({"what":"tool","tool":1})");
  EXPECT_EQ(page_.texts()[0]["role"], "viewer");
  hubs_.leave(second);
  EXPECT_EQ(page_.texts().back(),
            (json{{"type", "role"}, {"role", "viewer"}, {"control_is_free", true}}));
  hubs_.leave(page_);
}

TEST_F(HubsOfTwoTools, SurfacesStayWhenAnotherToolIsChosen) {
  hubs_.take_surface(1, view_link::encode(shape(1)));
  EXPECT_EQ(waiting(PageType::kShape).size(), 1U);
  hubs_.take_page(page_, R"({"what":"layers","blocks":false,"inside":true})");
  const std::vector<std::uint8_t> before = wishes_;
  ASSERT_EQ(before.back(), 1);
  hubs_.take_page(page_, R"({"what":"tool","tool":1})");
  EXPECT_TRUE(waiting(PageType::kShape).empty()) << "the page has it";
  EXPECT_EQ(wishes_, before) << "the simulator goes on sending the inside";
  hubs_.take_surface(1, view_link::encode(surface(1, 0.5)));
  EXPECT_EQ(waiting(PageType::kSurface).size(), 1U);
  Page late;
  hubs_.join(late);
  late.texts();
  EXPECT_FALSE(late.binary.empty());
  hubs_.surface_lost(1);
  EXPECT_EQ(page_.types(), std::vector<std::string>{"surface_lost"});
  hubs_.leave(late);
}

TEST_F(HubsOfTwoTools, ALostRunIsSaid) {
  page_.texts();
  hubs_.feed_lost(kRight);
  const std::vector<json> told = page_.texts();
  ASSERT_EQ(told.size(), 1U);
  EXPECT_EQ(told[0]["tools"][1]["live"], false);
  hubs_.take_feed(77, hello_of(1, "right again"));
  EXPECT_EQ(page_.texts().back()["tools"][1]["device"], "right again");
}

TEST_F(HubsOfTwoTools, AToolBelongsToOneRun) {
  const auto complaint_of = [this](std::uint64_t peer, const Frame& frame) {
    try {
      hubs_.take_feed(peer, frame);
    } catch (const ViewLinkError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(complaint_of(20, hello_of(1, "x")), HasSubstr("tool 1, which another run shows"));
  EXPECT_THAT(complaint_of(20, hello_of(4, "x")), HasSubstr("a hello of tool 4; there are 0 to 3"));
  EXPECT_THAT(complaint_of(20, cycle(1, 1)), HasSubstr("before the hello"));
}

TEST(HubsOfOneTool, SayNothingOfTools) {
  ToolHubs hubs([](auto...) { return true; });
  Page page;
  hubs.join(page);
  hubs.take_feed(1, hello_of(0, "alone"));
  EXPECT_THAT(page.types(), ElementsAre("waiting", "role", "hello"));
  hubs.take_page(page, R"({"what":"tool","tool":2})");
  EXPECT_THAT(page.types(), ElementsAre("waiting", "role")) << "nobody feeds it";
  hubs.leave(page);
}

}  // namespace
}  // namespace forcegrid::view
