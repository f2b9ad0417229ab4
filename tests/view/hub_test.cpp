// SPDX-License-Identifier: Apache-2.0
#include "view/hub.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "tests/view/hub_pages.h"

namespace forcegrid::view {
namespace {

using testing::ElementsAre;

TEST_F(HubOfPages, SaysThatNoRunIsThereThenWhatRuns) {
  hub_.join(first_);
  EXPECT_THAT(first_.types(), ElementsAre("waiting", "role"));
  hub_.take_feed(hello());
  EXPECT_GT(first_.wakes, 0);
  const auto texts = first_.texts();
  ASSERT_EQ(texts.size(), 1U);
  EXPECT_EQ(texts[0]["type"], "hello");
  EXPECT_EQ(texts[0]["scene"], "block");
  EXPECT_EQ(texts[0]["role"], "controller");
  EXPECT_EQ(texts[0]["columns"].size(), kScopeColumns);
  hub_.join(second_);
  EXPECT_EQ(second_.texts().at(0)["role"], "viewer");
}

TEST_F(HubOfPages, SendsRowsSamplesAndArmToAll) {
  hub_.join(first_);
  hub_.join(second_);
  hub_.take_feed(hello());
  clear();
  hub_.take_feed(cycle(1, 1'000'000'000));
  EXPECT_EQ(first_.wakes, 0) << "the bucket is not over";
  hub_.take_feed(cycle(2, 1'010'000'000));
  view_link::FeedSample sample;
  sample.arrived_ns = 1'500'000'000;
  hub_.take_feed(structs(FeedType::kSamples, std::vector{sample, sample}));
  hub_.take_feed({static_cast<std::uint16_t>(FeedType::kArm), 0, {0, 0, 0, 0}});
  for (Page* page : {&first_, &second_}) {
    EXPECT_GT(page->wakes, 0);
    EXPECT_TRUE(page->texts().empty());
    ASSERT_EQ(page->binary.size(), 3U);
    for (const auto& bytes : page->binary) {
      if (bytes[0] == 4) {
        ASSERT_EQ(bytes.size(), 8 + 2 * kSampleBytes);
        float time_s = 0;
        std::memcpy(&time_s, bytes.data() + 8 + 24, sizeof(time_s));
        EXPECT_EQ(time_s, 0.5F) << "since the first cycle";
      }
    }
  }
}

TEST_F(HubOfPages, TellsLatecomersWhatTheyMissed) {
  hub_.take_feed(hello());
  hub_.take_feed(text(FeedType::kNote, R"({"level":"warn","component":"servo","text":"x"})"));
  hub_.take_surface(1, encode(shape(5)));
  hub_.take_surface(1, encode(surface(5, 1.0)));
  hub_.join(first_);
  EXPECT_THAT(first_.types(), ElementsAre("hello", "note"));
  ASSERT_EQ(first_.binary.size(), 2U);
  EXPECT_EQ(first_.binary[0][0], 2);
  EXPECT_EQ(first_.binary[1][0], 3);
  hub_.take_feed(text(FeedType::kEnd, R"({"ended_by":"stop"})"));
  hub_.feed_lost();
  hub_.join(second_);
  EXPECT_THAT(second_.types(), ElementsAre("hello", "note", "end"));
}

TEST_F(HubOfPages, SaysHowARunEndedAfterItsLastRow) {
  hub_.join(first_);
  hub_.take_feed(hello());
  hub_.take_feed(cycle(1, 0));
  clear();
  hub_.take_feed(text(FeedType::kEnd, R"({"ended_by":"stop","exit_status":0})"));
  EXPECT_FALSE(first_.outbox.next()->text) << "the bucket that was not over";
  const auto texts = first_.texts();
  ASSERT_EQ(texts.size(), 1U);
  EXPECT_EQ(texts[0], json::parse(R"({"type":"end","ended_by":"stop","exit_status":0})"));
  hub_.feed_lost();
  EXPECT_TRUE(first_.texts().empty()) << "the end stays on the page";
}

TEST_F(HubOfPages, WaitsAgainAfterARunThatBreaksOff) {
  hub_.join(first_);
  hub_.take_feed(hello());
  hub_.take_feed(cycle(900, 5'000'000'000));
  clear();
  hub_.feed_lost();
  EXPECT_THAT(first_.types(), ElementsAre("waiting"));
  EXPECT_THROW(hub_.take_feed(cycle(1, 0)), ViewLinkError);
  hub_.take_feed(hello());
  hub_.take_feed(cycle(1, 7'000'000'000));
  hub_.take_feed(cycle(2, 7'010'000'000));
  EXPECT_THAT(first_.types(), ElementsAre("hello"));
  ASSERT_EQ(first_.binary.size(), 1U);
  double base_s = -1;
  std::memcpy(&base_s, first_.binary[0].data() + 8, sizeof(base_s));
  EXPECT_EQ(base_s, 0.0) << "time begins anew";
}

TEST_F(HubOfPages, RefusesAFeedThatBreaksTheProtocol) {
  EXPECT_THROW(hub_.take_feed(cycle(1, 0)), ViewLinkError) << "before its hello";
  for (const char* bad :
       {"", "{", "[]", "{}", R"({"methods":"auto"})", "{\"methods\":[\"\xff\"]}"}) {
    EXPECT_THROW(hub_.take_feed(text(FeedType::kHello, bad)), ViewLinkError) << bad;
  }
  hub_.take_feed(hello());
  EXPECT_THROW(hub_.take_feed(hello()), ViewLinkError);
  EXPECT_THROW(hub_.take_feed({2, 0, {}}), ViewLinkError);
  EXPECT_THROW(hub_.take_feed({2, 0, view_link::Bytes(sizeof(view_link::FeedCycle) - 1)}),
               ViewLinkError);
  EXPECT_THROW(hub_.take_feed({3, 0, view_link::Bytes(sizeof(view_link::FeedSample) + 1)}),
               ViewLinkError);
  EXPECT_THROW(hub_.take_feed({4, 0, {1}}), ViewLinkError);
  EXPECT_THROW(hub_.take_feed(text(FeedType::kNote, "note")), ViewLinkError);
  EXPECT_THROW(hub_.take_feed(text(FeedType::kAcknowledged, "{}")), ViewLinkError);
  EXPECT_THROW(hub_.take_feed(text(FeedType::kAcknowledged, R"({"id":-1})")), ViewLinkError);
  EXPECT_THROW(hub_.take_feed(text(FeedType::kCommand, "{}")), ViewLinkError);
  EXPECT_THROW(hub_.take_feed({0, 0, {}}), ViewLinkError);
  EXPECT_THROW(hub_.take_feed({99, 0, {}}), ViewLinkError);
  hub_.take_feed(text(FeedType::kEnd, "{}"));
  EXPECT_THROW(hub_.take_feed(cycle(1, 0)), ViewLinkError) << "after its end";
}

// ---- Commands ----

TEST_F(HubOfPages, ObeyStopFromAnyPageAndTheRestFromTheController) {
  hub_.join(first_);
  hub_.join(second_);
  hub_.take_feed(hello());
  clear();
  hub_.take_page(second_, R"({"id":1,"what":"stop"})");
  ASSERT_EQ(commands_.size(), 1U);
  EXPECT_EQ(commands_[0]["what"], "stop");
  for (const char* command : {R"({"id":2,"what":"pause","value":true})",
                              R"({"id":3,"what":"hand","target_W_m":[0,0,0]})"}) {
    hub_.take_page(second_, command);
    const auto texts = second_.texts();
    ASSERT_EQ(texts.size(), 1U) << command;
    EXPECT_EQ(texts[0]["type"], "acknowledged");
    EXPECT_EQ(texts[0]["done"], false);
    EXPECT_THAT(std::string(texts[0]["text"]), testing::HasSubstr("control"));
  }
  hub_.take_page(second_, R"({"id":4,"what":"shown","cycle":3})");
  EXPECT_TRUE(second_.texts().empty());
  EXPECT_EQ(commands_.size(), 1U);
  hub_.take_page(first_, R"({"id":2,"what":"pause","value":true})");
  hub_.take_page(first_, R"({"id":3,"what":"hand","target_W_m":[0,0,0]})");
  hub_.take_page(first_, R"({"id":4,"what":"shown","cycle":3})");
  EXPECT_EQ(commands_.size(), 4U);
}

TEST_F(HubOfPages, GiveEachPageTheAcknowledgementOfItsOwnCommand) {
  hub_.join(first_);
  hub_.join(second_);
  hub_.take_feed(hello());
  clear();
  hub_.take_page(first_, R"({"id":1,"what":"stop"})");
  hub_.take_page(second_, R"({"id":1,"what":"stop"})");
  ASSERT_EQ(commands_.size(), 2U);
  ASSERT_NE(commands_[0]["id"], commands_[1]["id"]);
  json acknowledgement = {{"id", commands_[1]["id"]}, {"what", "stop"}, {"done", true}};
  hub_.take_feed(text(FeedType::kAcknowledged, acknowledgement.dump()));
  EXPECT_TRUE(first_.texts().empty());
  const auto texts = second_.texts();
  ASSERT_EQ(texts.size(), 1U);
  EXPECT_EQ(texts[0]["id"], 1);
  EXPECT_EQ(texts[0]["done"], true);
  hub_.leave(first_);
  acknowledgement["id"] = commands_[0]["id"];
  hub_.take_feed(text(FeedType::kAcknowledged, acknowledgement.dump()));  // its page has left
  EXPECT_TRUE(first_.texts().empty());
}

// A hand moves 60 times a second, and only a failure is acknowledged.
TEST_F(HubOfPages, PassOnHowTheSettingsStandAlsoToLatecomers) {
  hub_.join(first_);
  hub_.take_feed(hello());
  first_.texts();
  hub_.take_page(first_, R"({"id":9,"what":"set","name":"delay_ms","value":20})");
  ASSERT_EQ(commands_.size(), 1U);
  EXPECT_EQ(commands_[0]["name"], "delay_ms");
  EXPECT_EQ(commands_[0]["value"], 20);
  hub_.take_feed(text(FeedType::kSettings, R"({"settings":[{"name":"delay_ms","value":20}]})"));
  hub_.take_feed(text(FeedType::kAcknowledged, R"({"id":1,"what":"set","done":true,"text":""})"));
  const auto told = first_.texts();
  ASSERT_EQ(told.size(), 2U);
  EXPECT_EQ(told[0]["type"], "settings");
  EXPECT_EQ(told[0]["settings"][0]["value"], 20);
  EXPECT_EQ(told[1]["id"], 9);
  hub_.join(second_);
  EXPECT_EQ(second_.texts()[0]["settings"][0]["value"], 20);
  hub_.take_page(second_, R"({"id":2,"what":"set","name":"delay_ms","value":0})");
  EXPECT_EQ(second_.texts()[0]["done"], false) << "it has no control";
  EXPECT_THROW(hub_.take_feed(text(FeedType::kSettings, R"({"settings":5})")), ViewLinkError);
}

TEST_F(HubOfPages, RememberTheNewestMoveOfTheHandAndEveryStop) {
  hub_.join(first_);
  hub_.take_feed(hello());
  clear();
  hub_.take_page(first_, R"({"id":1,"what":"stop"})");
  for (int i = 0; i < 1000; ++i) {
    hub_.take_page(first_, R"({"id":2,"what":"hand","target_W_m":[0,0,0]})");
  }
  const auto acknowledge = [&](const json& command) {
    hub_.take_feed(text(FeedType::kAcknowledged,
                        json{{"id", command["id"]}, {"done", false}, {"text", "no"}}.dump()));
    return first_.texts();
  };
  EXPECT_TRUE(acknowledge(commands_[1]).empty()) << "a newer move took its place";
  const auto of_hand = acknowledge(commands_.back());
  ASSERT_EQ(of_hand.size(), 1U);
  EXPECT_EQ(of_hand[0]["id"], 2);
  const auto of_stop = acknowledge(commands_.front());
  ASSERT_EQ(of_stop.size(), 1U);
  EXPECT_EQ(of_stop[0]["id"], 1);
}

TEST_F(HubOfPages, SayWhyACommandGoesNowhere) {
  hub_.join(first_);
  clear();
  const auto answer = [&] {
    hub_.take_page(first_, R"({"id":6,"what":"stop"})");
    const auto texts = first_.texts();
    EXPECT_EQ(texts.size(), 1U);
    EXPECT_EQ(texts.at(0)["done"], false);
    EXPECT_EQ(texts.at(0)["id"], 6);
    return std::string(texts.at(0)["text"]);
  };
  EXPECT_EQ(answer(), "no run is connected");
  hub_.take_feed(hello());
  clear();
  run_reads_ = false;
  EXPECT_EQ(answer(), "the run does not read its commands");
  hub_.take_feed(text(FeedType::kEnd, "{}"));
  clear();
  EXPECT_EQ(answer(), "the run has ended");
}

TEST_F(HubOfPages, GiveControlToTheNextThatAsks) {
  hub_.take_feed(hello());
  hub_.join(first_);
  hub_.join(second_);
  clear();
  hub_.take_page(second_, R"({"what":"take_control"})");
  EXPECT_EQ(second_.texts().at(0)["role"], "viewer");
  EXPECT_FALSE(hub_.is_controller(second_));
  hub_.leave(first_);
  const auto texts = second_.texts();
  ASSERT_EQ(texts.size(), 1U);
  EXPECT_EQ(texts[0]["role"], "viewer");
  EXPECT_EQ(texts[0]["control_is_free"], true);
  hub_.take_page(second_, R"({"what":"take_control"})");
  EXPECT_EQ(second_.texts().at(0)["role"], "controller");
  EXPECT_TRUE(hub_.is_controller(second_));
}

TEST_F(HubOfPages, RefuseWhatIsNoCommand) {
  hub_.join(first_);
  EXPECT_THROW(hub_.take_page(first_, "hello"), ViewLinkError);
  EXPECT_THROW(hub_.take_page(first_, R"({"what":"hello"})"), ViewLinkError);
}

// ---- Surfaces ----

TEST_F(HubOfPages, PassASurfaceOnAsItCame) {
  hub_.join(first_);
  clear();
  const Frame sent_shape = encode(shape(5), 2);
  const Frame sent_surface = encode(surface(5, 1.0), 2);
  hub_.take_surface(1, sent_shape);
  hub_.take_surface(1, sent_surface);
  first_.texts();
  ASSERT_EQ(first_.binary.size(), 2U);
  view_link::Bytes expected = {2, 2, 0, 0};
  expected.insert(expected.end(), sent_shape.payload.begin(), sent_shape.payload.end());
  EXPECT_EQ(first_.binary[0], expected);
  expected = {3, 2, 0, 0};
  expected.insert(expected.end(), sent_surface.payload.begin(), sent_surface.payload.end());
  EXPECT_EQ(first_.binary[1], expected);
}

TEST_F(HubOfPages, DropAFrameOfAnotherEpoch) {
  hub_.join(first_);
  hub_.take_surface(1, encode(shape(5)));
  clear();
  hub_.take_surface(1, encode(surface(4, 1.0)));
  EXPECT_FALSE(first_.outbox.next());
  hub_.take_surface(1, encode(surface(5, 1.0)));
  EXPECT_TRUE(first_.outbox.next());
}

TEST_F(HubOfPages, SayThatASurfaceIsLost) {
  hub_.join(first_);
  hub_.take_surface(1, encode(shape(5), 0));
  hub_.take_surface(2, encode(shape(5), 1));
  clear();
  hub_.surface_lost(2);
  const auto texts = first_.texts();
  ASSERT_EQ(texts.size(), 1U);
  EXPECT_EQ(texts[0], json::parse(R"({"type":"surface_lost","object":1})"));
  hub_.join(second_);
  second_.texts();
  EXPECT_EQ(second_.binary.size(), 1U) << "the other one is still there";
  hub_.take_surface(3, encode(shape(1), 1));  // another simulator may have the number now
}

TEST_F(HubOfPages, RefuseASimulatorThatBreaksTheProtocol) {
  EXPECT_THROW(hub_.take_surface(1, encode(surface(5, 1.0))), ViewLinkError) << "before its shape";
  EXPECT_THROW(hub_.take_surface(1, encode(shape(5), kMostObjects)), ViewLinkError);
  EXPECT_THROW(hub_.take_surface(1, {2, 0, {}}), ViewLinkError);
  EXPECT_THROW(hub_.take_surface(1, {1, 0, {}}), ViewLinkError);
  EXPECT_THROW(hub_.take_surface(1, {6, 0, {}}), ViewLinkError);
  EXPECT_THROW(hub_.take_surface(1, {16, 0, {1, 0, 0, 0}}), ViewLinkError) << "that is the view's";
  hub_.take_surface(1, encode(shape(5)));
  EXPECT_THROW(hub_.take_surface(2, encode(shape(5))), ViewLinkError) << "another one's object";
  EXPECT_THROW(hub_.take_surface(2, encode(surface(5, 1.0))), ViewLinkError);
  EXPECT_THROW(hub_.take_surface(1, {3, 0, view_link::Bytes(43)}), ViewLinkError);
  SurfaceFrame fewer = surface(5, 1.0);
  fewer.position_W_m.pop_back();
  EXPECT_THROW(hub_.take_surface(1, encode(fewer)), ViewLinkError);
}

TEST_F(HubOfPages, WithstandRandomFrames) {
  constexpr unsigned kSeed = 20261124;
  std::mt19937 random(kSeed);
  SCOPED_TRACE(kSeed);
  hub_.join(first_);
  const std::vector<Frame> sound = {hello(),
                                    cycle(1, 0),
                                    encode(shape(5)),
                                    encode(surface(5, 1.0)),
                                    text(FeedType::kNote, R"({"text":"a"})"),
                                    text(FeedType::kPlayback, R"({"state":"seeking"})"),
                                    text(FeedType::kAcknowledged, R"({"id":1})")};
  for (int round = 0; round < 5000; ++round) {
    Frame frame = sound[random() % sound.size()];
    if (random() % 4 == 0) {
      frame.type = static_cast<std::uint16_t>(random() % 20);
    }
    for (auto change = random() % 3; change > 0 && !frame.payload.empty(); --change) {
      frame.payload[random() % frame.payload.size()] = static_cast<std::uint8_t>(random());
    }
    try {
      if (random() % 2 == 0) {
        hub_.take_feed(frame);
      } else {
        hub_.take_surface(random() % 3, frame);
      }
    } catch (const ViewLinkError&) {
      hub_.feed_lost();
    }
    for (const json& each : first_.texts()) {
      EXPECT_TRUE(each.contains("type"));
    }
    first_.binary.clear();
  }
}

}  // namespace
}  // namespace forcegrid::view
