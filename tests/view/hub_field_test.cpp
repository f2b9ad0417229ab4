// SPDX-License-Identifier: Apache-2.0
// What the hub sends of the methods' copies, in a run and in a recording.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/view/hub_pages.h"

namespace forcegrid::view {
namespace {

using testing::ElementsAre;

std::vector<view_link::Bytes> slices(Page& page) {
  page.texts();
  std::vector<view_link::Bytes> found;
  for (const view_link::Bytes& message : page.binary) {
    if (message[0] == 6) {
      found.push_back(message);
    }
  }
  page.binary.clear();
  return found;
}

TEST(HubsField, IsSentToThePageThatAsksForIt) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  Page asks, other;
  hub.join(asks);
  hub.join(other);
  hub.take_feed(hello_with_copies(R"(["hold"])"));
  EXPECT_EQ(asks.texts().back()["field"], true);
  hub.take_page(asks, R"({"id":1,"what":"field","method":0,"points":3,"size_m":0.01})");
  press(hub, 20);
  const auto sent = slices(asks);
  ASSERT_FALSE(sent.empty());
  EXPECT_TRUE(slices(other).empty());
  view_link::Reader reader(sent.back());
  reader.take<std::array<std::uint8_t, 4>>();
  EXPECT_EQ(reader.take<std::uint16_t>(), 3);
  EXPECT_EQ(reader.take<std::uint16_t>(), 1) << "exact";
  reader.take<std::array<float, 9>>();
  for (int i = 0; i < 9; ++i) {  // hold has one force for all places
    EXPECT_EQ((reader.take<std::array<float, 5>>()[2]), 2.0F);
  }
  EXPECT_EQ(reader.left(), 0U);
  hub.take_page(asks, R"({"id":2,"what":"field","method":null})");
  press(hub, 20);
  EXPECT_TRUE(slices(asks).empty());
}

TEST(HubsField, IsNotExactWhereTheServosForceWasAnother) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  Page page;
  hub.join(page);
  hub.take_feed(hello_with_copies(R"(["hold"])"));
  press(hub, 1);
  hub.take_page(page, R"({"id":1,"what":"field","method":0,"points":2})");
  view_link::FeedCycle other;
  other.cycle = 1;
  other.time_ns = 3'000'000'000;
  other.arrivals_taken = 1;
  other.method_force_W_N[0] = {0, 0, 1.9};
  hub.take_feed(structs(FeedType::kCycles, std::vector{other}));
  const auto sent = slices(page);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0][6], 0);
}

// ---- Recordings ----

// A player that begins at 2 s of the clock.
class HubOfARecording : public HubOfPages {
 protected:
  HubOfARecording() {
    Frame frame = hello_with_copies(R"(["hold"])");
    json facts = json::parse(view_link::text_of(frame));
    facts["recording"] = {{"first_ns", 1'000'000'000}, {"duration_s", 9.0}};
    hub_.join(first_);
    hub_.take_feed(text(FeedType::kHello, facts.dump()));
    clear();
  }
  void say(const std::string& state, double time_s, bool anew = false) {
    json playback = {{"state", state}, {"time_s", time_s}, {"speed", 1.0}};
    if (anew) {
      playback["anew"] = {{"missed_deadlines", 7}};
    }
    hub_.take_feed(text(FeedType::kPlayback, playback.dump()));
  }
  // Rows of the scope that wait: each its time and the deadlines missed so far.
  std::vector<std::pair<double, float>> rows() {
    first_.texts();
    std::vector<std::pair<double, float>> found;
    for (const view_link::Bytes& message : first_.binary) {
      if (message[0] == 1) {
        view_link::Reader reader(message);
        reader.take<std::uint16_t>();
        const auto count = reader.take<std::uint16_t>();
        reader.take<std::uint32_t>();
        const auto base_s = reader.take<double>();
        for (int row = 0; row < count; ++row) {
          const auto value = reader.take<std::array<float, kScopeColumns>>();
          found.emplace_back(base_s + value[0], value[kScopeColumns - 2]);
        }
      }
    }
    first_.binary.clear();
    return found;
  }
};

TEST_F(HubOfARecording, CountsTimeFromItsFirstCycleWhereverItBegins) {
  say("seeking", 3.0, true);
  hub_.take_feed(cycle(1000, 4'000'000'000));
  hub_.take_feed(cycle(1001, 4'002'000'000));
  say("paused", 3.002);
  const auto found = rows();
  ASSERT_EQ(found.size(), 1U) << "the bucket ends where it stands still";
  EXPECT_NEAR(found[0].first, 3.002, 1e-9);
  EXPECT_EQ(found[0].second, 7.0F) << "deadlines that were missed before";
}

TEST_F(HubOfARecording, TellsPagesNothingOfTheWayToAPlaceButThatTheyWait) {
  say("playing", 0.0);
  hub_.take_feed(cycle(1, 1'000'000'000));
  clear();
  say("seeking", 5.0, true);
  EXPECT_EQ(first_.wakes, 1);
  const auto said = first_.texts();
  ASSERT_EQ(said.size(), 1U);
  EXPECT_EQ(said[0]["type"], "playback");
  EXPECT_TRUE(said[0].contains("anew"));
  hub_.take_feed(cycle(900, 5'900'000'000));
  hub_.take_feed(cycle(901, 5'990'000'000));
  EXPECT_EQ(first_.wakes, 1);
  say("playing", 5.0);
  EXPECT_EQ(first_.wakes, 2);
  EXPECT_EQ(rows().size(), 1U);
}

TEST_F(HubOfARecording, ForgetsTheRowsThatLedElsewhere) {
  hub_.take_feed(cycle(1, 1'000'000'000));
  hub_.take_feed(cycle(2, 1'010'000'000));
  say("seeking", 0.0, true);
  say("paused", 0.0);
  EXPECT_TRUE(rows().empty());
}

TEST_F(HubOfARecording, ShowsLatecomersWhereItStands) {
  hub_.take_feed(cycle(1, 1'000'000'000));
  hub_.take_feed({static_cast<std::uint16_t>(FeedType::kArm), 0, {0, 0, 0, 0}});
  say("paused", 0.0);
  hub_.join(second_);
  EXPECT_THAT(second_.types(), ElementsAre("hello", "playback"));
  ASSERT_EQ(second_.binary.size(), 2U);
  EXPECT_EQ(second_.binary[0][0] + second_.binary[1][0], 1 + 5) << "a row and the arm";
}

TEST_F(HubOfARecording, ShowsTheFieldWhereItStands) {
  press(hub_, 20);
  say("paused", 0.19);
  clear();
  hub_.take_page(first_, R"({"id":1,"what":"field","method":0,"points":2})");
  ASSERT_EQ(slices(first_).size(), 1U) << "at once: no cycle comes";
  say("seeking", 0.1, true);
  press(hub_, 10);
  EXPECT_TRUE(slices(first_).empty());
  say("paused", 0.1);
  const auto sent = slices(first_);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0][6], 1) << "it began with the recording: exact";
}

TEST_F(HubOfARecording, ObeysTheControllerAlone) {
  hub_.join(second_);
  clear();
  hub_.take_page(first_, R"({"id":1,"what":"play","value":false,"speed":0.5})");
  hub_.take_page(first_, R"({"id":2,"what":"seek","time_s":4.5})");
  ASSERT_EQ(commands_.size(), 2U);
  EXPECT_EQ(commands_[0]["value"], false);
  EXPECT_EQ(commands_[0]["speed"], 0.5);
  EXPECT_EQ(commands_[1]["time_s"], 4.5);
  hub_.take_page(second_, R"({"id":1,"what":"seek","time_s":4.5})");
  EXPECT_EQ(commands_.size(), 2U);
  EXPECT_EQ(second_.texts().at(0)["done"], false);
}

TEST_F(HubOfARecording, RefusesAPlayerThatBreaksTheProtocol) {
  const auto refused = [&](const std::string& playback) {
    EXPECT_THROW(hub_.take_feed(text(FeedType::kPlayback, playback)), ViewLinkError) << playback;
  };
  refused("{}");
  refused(R"({"state":3})");
  refused(R"({"state":"seeking","anew":1})");
  refused(R"({"state":"seeking","anew":{}})");
  Hub of_a_run([](const Frame&, PageCommand::What, bool) { return true; });
  of_a_run.take_feed(hello());
  EXPECT_THROW(of_a_run.take_feed(text(FeedType::kPlayback, R"({"state":"paused"})")),
               ViewLinkError);
  Hub other([](const Frame&, PageCommand::What, bool) { return true; });
  EXPECT_THROW(other.take_feed(text(FeedType::kHello, R"({"methods":["hold"],"recording":{}})")),
               ViewLinkError);
}

TEST(HubsField, IsRefusedWithAReason) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  Page page;
  hub.join(page);
  hub.take_feed(hello());
  EXPECT_EQ(page.texts().back()["field"], false);
  hub.take_page(page, R"({"id":3,"what":"field","method":0})");
  const json without = page.texts().back();
  EXPECT_EQ(without["id"], 3);
  EXPECT_EQ(without["done"], false);
  Hub other([](const Frame&, PageCommand::What, bool) { return true; });
  Page asks;
  other.join(asks);
  other.take_feed(hello_with_copies(R"(["hold"])"));
  for (const char* const wrong :
       {R"({"id":4,"what":"field","method":1})", R"({"id":4,"what":"field","method":0,"normal":3})",
        R"({"id":4,"what":"field","method":0,"points":1000})",
        R"({"id":4,"what":"field","method":0,"compared":7})"}) {
    asks.texts();
    other.take_page(asks, wrong);
    const auto said = asks.texts();
    ASSERT_EQ(said.size(), 1U) << wrong;
    EXPECT_EQ(said[0]["done"], false) << wrong;
  }
  EXPECT_THROW(other.take_page(asks, R"({"id":5,"what":"field"})"), ViewLinkError);
}

TEST(HubsField, NeedsMethodsThatExist) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  EXPECT_THROW(hub.take_feed(hello_with_copies(R"(["no such method"])")), ViewLinkError);
  EXPECT_THROW(hub.take_feed(hello_with_copies("[]")), ViewLinkError);
}

// ---- Blocks of storage ----

struct Block {
  std::uint32_t method;
  std::array<float, 6> box_W_m;  // low and high corner
};
struct BlocksMessage {
  std::uint32_t in_use;
  std::vector<Block> sent;
};

std::vector<BlocksMessage> block_messages(Page& page) {
  page.texts();
  std::vector<BlocksMessage> found;
  for (const view_link::Bytes& bytes : page.binary) {
    if (bytes[0] == 7) {
      view_link::Reader reader(bytes);
      reader.take<std::uint16_t>();
      const auto count = reader.take<std::uint16_t>();
      BlocksMessage message{reader.take<std::uint32_t>(), {}};
      for (int i = 0; i < count; ++i) {
        const auto method = reader.take<std::uint32_t>();
        message.sent.push_back({method, reader.take<std::array<float, 6>>()});
      }
      EXPECT_TRUE(reader.ok());
      EXPECT_EQ(reader.left(), 0U);
      found.push_back(message);
    }
  }
  page.binary.clear();
  return found;
}

// 21 vertices 1 cm apart along each axis, so that a block is 8 cm wide and the third one has 5.
constexpr char kWithBlocks[] = R"(["hold","forcegrid storage=blocks"])";
constexpr char kShowBlocks[] = R"({"id":1,"what":"layers","blocks":true})";

TEST(HubsBlocks, AreSentToThePageThatShowsThemWhenTheyChange) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  Page asks, other;
  hub.join(asks);
  hub.join(other);
  hub.take_feed(hello_with_copies(kWithBlocks));
  EXPECT_EQ(asks.texts().back()["blocks"], true);
  hub.take_page(asks, kShowBlocks);
  auto sent = block_messages(asks);
  ASSERT_EQ(sent.size(), 1U) << "at once";
  EXPECT_EQ(sent[0].in_use, 0U);
  // The tool is at vertex (10, 10, 9.6). Vertices nearer than 3 are 8 to 12 along x and y, all in
  // the second block, and 7 to 12 along z, in the first and in the second.
  press(hub, 200);
  sent = block_messages(asks);
  ASSERT_EQ(sent.size(), 1U) << "two seconds, in which they changed once";
  EXPECT_EQ(sent[0].in_use, 2U);
  ASSERT_EQ(sent[0].sent.size(), 2U);
  for (const Block& block : sent[0].sent) {
    EXPECT_EQ(block.method, 1U) << "hold has no storage";
    const float low_z_m = block.box_W_m[2] < -0.05F ? -0.1F : -0.02F;
    const std::array<float, 6> box_W_m{-0.02F, -0.02F, low_z_m, 0.06F, 0.06F, low_z_m + 0.08F};
    EXPECT_THAT(block.box_W_m, testing::Pointwise(testing::FloatNear(1e-6F), box_W_m));
  }
  EXPECT_NE(sent[0].sent[0].box_W_m[2], sent[0].sent[1].box_W_m[2]);
  EXPECT_TRUE(block_messages(other).empty());
}

TEST(HubsBlocks, AreSentAgainToOneMorePage) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  Page first, second;
  hub.join(first);
  hub.join(second);
  hub.take_feed(hello_with_copies(kWithBlocks));
  hub.take_page(first, kShowBlocks);
  press(hub, 100);
  EXPECT_FALSE(block_messages(first).empty());
  hub.take_page(second, kShowBlocks);
  const auto sent = block_messages(second);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_GT(sent[0].in_use, 0U);
  EXPECT_EQ(block_messages(first).size(), 1U) << "harmless: the same once more";
}

TEST(HubsBlocks, EndWithTheirRun) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  Page page;
  hub.join(page);
  hub.take_feed(hello_with_copies(kWithBlocks));
  hub.take_page(page, kShowBlocks);
  press(hub, 100);
  hub.feed_lost();
  hub.take_feed(hello_with_copies(kWithBlocks));
  block_messages(page);
  press(hub, 100);
  EXPECT_TRUE(block_messages(page).empty()) << "the page has not asked the new run";
}

TEST(HubsBlocks, AreRefusedWithAReasonWithoutCopies) {
  Hub hub([](const Frame&, PageCommand::What, bool) { return true; });
  Page page;
  hub.join(page);
  hub.take_feed(hello());
  EXPECT_EQ(page.texts().back()["blocks"], false);
  hub.take_page(page, kShowBlocks);
  const auto said = page.texts();
  ASSERT_EQ(said.size(), 1U);
  EXPECT_EQ(said[0]["done"], false);
  hub.take_page(page, R"({"id":2,"what":"layers","blocks":false})");
  EXPECT_TRUE(page.texts().empty());
  EXPECT_THROW(hub.take_page(page, R"({"id":3,"what":"layers"})"), ViewLinkError);
  EXPECT_THROW(hub.take_page(page, R"({"id":3,"what":"layers","blocks":1})"), ViewLinkError);
}

TEST_F(HubOfARecording, ShowsTheBlocksOfThePlaceWhereItStands) {
  Frame frame = hello_with_copies(kWithBlocks);
  json facts = json::parse(view_link::text_of(frame));
  facts["recording"] = {{"first_ns", 1'000'000'000}, {"duration_s", 9.0}};
  hub_.feed_lost();
  hub_.take_feed(text(FeedType::kHello, facts.dump()));
  hub_.take_page(first_, kShowBlocks);
  block_messages(first_);
  say("seeking", 1.0, true);
  press(hub_, 100);
  EXPECT_TRUE(block_messages(first_).empty()) << "on its way";
  say("paused", 1.0);
  const auto sent = block_messages(first_);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_GT(sent[0].in_use, 0U);
}

}  // namespace
}  // namespace forcegrid::view
