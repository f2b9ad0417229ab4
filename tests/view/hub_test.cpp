// SPDX-License-Identifier: Apache-2.0
#include "view/hub.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "view_link/little_endian.h"
#include "view_link/surface_messages.h"

namespace forcegrid::view {
namespace {

using nlohmann::json;
using view_link::FeedType;
using view_link::Frame;
using view_link::SurfaceFrame;
using view_link::SurfaceShape;
using view_link::ViewLinkError;

Frame text(FeedType type, const std::string& content) {
  return view_link::text_frame(static_cast<std::uint16_t>(type), content);
}

Frame hello() { return text(FeedType::kHello, R"({"methods":["auto","hold"],"scene":"block"})"); }

template <typename T>
Frame structs(FeedType type, const std::vector<T>& values) {
  Frame frame{static_cast<std::uint16_t>(type), 0, {}};
  view_link::append(frame.payload, std::span<const T>(values));
  return frame;
}

Frame cycle(std::uint64_t number, std::int64_t time_ns) {
  view_link::FeedCycle one;
  one.cycle = number;
  one.time_ns = time_ns;
  return structs(FeedType::kCycles, std::vector{one});
}

SurfaceShape shape(std::uint32_t epoch) {
  return {epoch, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
}

SurfaceFrame surface(std::uint32_t epoch, double time_s) {
  return {epoch, time_s, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0.5F}}};
}

struct Page : Viewer {
  Page() {
    wake = [this] { ++wakes; };
  }
  // All texts that wait; binary messages go into `binary`.
  std::vector<json> texts() {
    std::vector<json> found;
    while (const auto message = outbox.next()) {
      if (message->text) {
        found.push_back(json::parse(*message->bytes));
      } else {
        binary.push_back(*message->bytes);
      }
    }
    return found;
  }
  std::vector<std::string> types() {
    std::vector<std::string> found;
    for (const json& each : texts()) {
      found.push_back(each["type"]);
    }
    return found;
  }
  std::vector<view_link::Bytes> binary;
  int wakes = 0;
};

class HubOfPages : public testing::Test {
 protected:
  void clear() {
    for (Page* page : {&first_, &second_}) {
      page->texts();
      page->binary.clear();
      page->wakes = 0;
    }
  }
  std::vector<json> commands_;
  bool run_reads_ = true;
  Hub hub_{[this](const Frame& frame, PageCommand::What, bool) {
    if (run_reads_) {
      commands_.push_back(json::parse(view_link::text_of(frame)));
    }
    return run_reads_;
  }};
  Page first_, second_;
};

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
  EXPECT_THROW(hub_.take_surface(1, {4, 0, {}}), ViewLinkError);
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

Frame hello_with_copies(const char* methods) {
  return text(FeedType::kHello, std::string(R"({"methods":)") + methods +
                                    R"(,"largest_force_N":5,"simulator_rate_Hz":30,"copies":{)"
                                    R"("low_W_m":[-0.1,-0.1,-0.1],"high_W_m":[0.1,0.1,0.1],)"
                                    R"("cells":[20,20,20],"influence_radius_m":0.03,)"
                                    R"("unit_m":0.001,"samples_per_cell":0,"budget_reads":null,)"
                                    R"("fill_budget":1000,"requests_per_s":0}})");
}

// Cycles of 10 ms with the tool at z = -4 mm, and a sample of 2 N there.
void press(Hub& hub, std::uint64_t cycles) {
  view_link::FeedSample sample;
  sample.arrived_ns = 1'000'000'000;
  sample.time_s = 1.0;
  sample.position_W_m = {0, 0, -0.004};
  sample.force_W_N = {0, 0, 2};
  sample.contact_epoch = 1;
  sample.in_contact = 1;
  hub.take_feed(structs(FeedType::kSamples, std::vector{sample}));
  for (std::uint64_t i = 0; i < cycles; ++i) {
    view_link::FeedCycle one;
    one.cycle = i;
    one.time_ns = 1'000'000'000 + static_cast<std::int64_t>(i) * 10'000'000;
    one.arrivals_taken = 1;
    one.touching_W_m = {0, 0, -0.004};
    one.method_force_W_N[0] = {0, 0, 2};  // of hold
    hub.take_feed(structs(FeedType::kCycles, std::vector{one}));
  }
}

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

}  // namespace
}  // namespace forcegrid::view
