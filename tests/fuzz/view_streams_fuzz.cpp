// SPDX-License-Identifier: Apache-2.0
#include <nlohmann/json.hpp>
#include <string>

#include "tests/fuzz/fuzz_targets.h"
#include "view/tool_hubs.h"
#include "view_link/frame.h"
#include "view_link/inside_messages.h"
#include "view_link/surface_messages.h"

namespace forcegrid::fuzz {
namespace {

// What a page would get is a JSON object with a type, or begins with a known type.
void check_outbox(view::Outbox& outbox) {
  while (const auto message = outbox.next()) {
    if (message->text) {
      const auto text = nlohmann::json::parse(*message->bytes, nullptr, false);
      require(text.is_object() && text.contains("type"), "each text has a type");
    } else {
      require(message->bytes->size() >= 4 && message->bytes->front() >= 1 &&
                  message->bytes->front() <= 10,
              "each binary message has a known type");
    }
  }
}

void check_surface(const view_link::Frame& frame) {
  if (const auto shape = view_link::decode_shape(frame.payload)) {
    require(view_link::encode(*shape).payload.size() == frame.payload.size(),
            "a shape has one size");
  }
  if (const auto surface = view_link::decode_frame(frame.payload)) {
    require(view_link::encode(*surface).payload.size() == frame.payload.size(),
            "a surface has one size");
  }
  if (const auto lines = view_link::decode_lines(frame.payload)) {
    require(view_link::encode(*lines).payload == view_link::Bytes(frame.payload),
            "lines have one form");
    for (const view_link::Edge& edge : lines->edge) {
      require(edge[0] < lines->vertices && edge[1] < lines->vertices, "an edge has two vertices");
    }
  }
  if (const auto inside = view_link::decode_wish(frame.payload)) {
    require(view_link::encode_wish(*inside).payload.size() == frame.payload.size(),
            "a wish has one size");
  }
}

}  // namespace

// The first byte says to which socket the others come.
void view_streams(Input input) {
  if (input.empty()) {
    return;
  }
  const bool is_feed = input.front() % 2 == 0;
  view::ToolHubs hub([](auto...) { return true; },
                     [](std::uint64_t, const view_link::Frame& wish) {
                       require(view_link::decode_wish(wish.payload).has_value(),
                               "a wish can be read");
                     });
  view::Viewer page;
  view::Viewer other;  // looks at another tool: it is told of the first one, too
  page.wake = other.wake = [] {};
  hub.join(page);
  hub.join(other);
  hub.take_page(other, R"({"what":"tool","tool":1})");
  hub.take_page(page, R"({"what":"layers","blocks":false,"inside":true})");
  view_link::FrameReader reader(view_link::kLargestFeedPayload);
  try {
    reader.add(input.subspan(1));
    while (const auto frame = reader.next()) {
      if (is_feed) {
        hub.take_feed(1, *frame);
      } else {
        check_surface(*frame);
        hub.take_surface(1, *frame);
      }
      check_outbox(page.outbox);
      check_outbox(other.outbox);
    }
  } catch (const view_link::ViewLinkError&) {
    // A stream that is refused is what most inputs are.
  }
  hub.feed_lost(1);
  hub.surface_lost(1);
  check_outbox(page.outbox);
  hub.leave(page);
  hub.leave(other);
}

}  // namespace forcegrid::fuzz
