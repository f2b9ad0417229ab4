// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "view/hub.h"
#include "view_link/feed_messages.h"
#include "view_link/frame.h"
#include "view_link/little_endian.h"
#include "view_link/surface_messages.h"

namespace forcegrid::view {

using nlohmann::json;
using view_link::FeedType;
using view_link::Frame;
using view_link::SurfaceFrame;
using view_link::SurfaceShape;
using view_link::ViewLinkError;

inline Frame text(FeedType type, const std::string& content) {
  return view_link::text_frame(static_cast<std::uint16_t>(type), content);
}

inline Frame hello() {
  return text(FeedType::kHello, R"({"methods":["auto","hold"],"scene":"block"})");
}

template <typename T>
Frame structs(FeedType type, const std::vector<T>& values) {
  Frame frame{static_cast<std::uint16_t>(type), 0, {}};
  view_link::append(frame.payload, std::span<const T>(values));
  return frame;
}

inline Frame cycle(std::uint64_t number, std::int64_t time_ns) {
  view_link::FeedCycle one;
  one.cycle = number;
  one.time_ns = time_ns;
  return structs(FeedType::kCycles, std::vector{one});
}

inline SurfaceShape shape(std::uint32_t epoch) {
  return {epoch, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
}

inline SurfaceFrame surface(std::uint32_t epoch, double time_s) {
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

inline Frame hello_with_copies(const char* methods) {
  return text(FeedType::kHello, std::string(R"({"methods":)") + methods +
                                    R"(,"largest_force_N":5,"simulator_rate_Hz":30,"copies":{)"
                                    R"("low_W_m":[-0.1,-0.1,-0.1],"high_W_m":[0.1,0.1,0.1],)"
                                    R"("cells":[20,20,20],"influence_radius_m":0.03,)"
                                    R"("unit_m":0.001,"samples_per_cell":0,"budget_reads":null,)"
                                    R"("fill_budget":1000,"requests_per_s":0}})");
}

// Cycles of 10 ms with the tool at z = -4 mm, and a sample of 2 N there.
inline void press(Hub& hub, std::uint64_t cycles) {
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

}  // namespace forcegrid::view
