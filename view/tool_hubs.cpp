// SPDX-License-Identifier: Apache-2.0
#include "view/tool_hubs.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

namespace forcegrid::view {
namespace {

using nlohmann::json;
using view_link::FeedType;
using view_link::Frame;
using view_link::ViewLinkError;

constexpr std::int64_t kOtherTool_ns = 16'000'000;  // between two places of a tool

bool is_of(FeedType type, const Frame& frame) {
  return frame.type == static_cast<std::uint16_t>(type);
}

}  // namespace

ToolHubs::ToolHubs(const SendCommand& send_command, Surfaces::Tell tell_simulator)
    : surfaces_(std::make_shared<Surfaces>(std::move(tell_simulator))) {
  for (std::size_t k = 0; k < tools_.size(); ++k) {
    Tool& tool = tools_[k];
    const auto elsewhere = [this, &tool] {
      return std::ranges::any_of(tools_, [&tool](const Tool& other) {
        return &other != &tool && other.hub->inside_wished();
      });
    };
    tool.hub = std::make_unique<Hub>(
        [send_command, &tool](const Frame& frame, PageCommand::What what, bool newest) {
          return tool.peer != 0 && send_command(tool.peer, frame, what, newest);
        },
        HubOptions{.tool = k, .surfaces = surfaces_, .inside_wished_elsewhere = elsewhere});
  }
}

std::size_t ToolHubs::number_of(const Tool& tool) const noexcept {
  return static_cast<std::size_t>(&tool - tools_.data());
}

// ---- The feeds ----

ToolHubs::Tool* ToolHubs::tool_of(std::uint64_t peer) noexcept {
  const auto found =
      std::ranges::find_if(tools_, [peer](const Tool& tool) { return tool.peer == peer; });
  return found == tools_.end() ? nullptr : &*found;
}

ToolHubs::Tool& ToolHubs::begin(std::uint64_t peer, const Frame& hello) {
  if (!is_of(FeedType::kHello, hello)) {
    throw ViewLinkError("a frame of type " + std::to_string(hello.type) + " before the hello");
  }
  if (hello.object >= tools_.size()) {
    throw ViewLinkError("a hello of tool " + std::to_string(hello.object) + "; there are 0 to " +
                        std::to_string(tools_.size() - 1));
  }
  Tool& tool = tools_[hello.object];
  if (tool.peer != 0) {
    throw ViewLinkError("a hello of tool " + std::to_string(hello.object) +
                        ", which another run shows");
  }
  tool.peer = peer;
  return tool;
}

void ToolHubs::take_feed(std::uint64_t peer, const Frame& frame) {
  Tool* known = tool_of(peer);
  Tool& tool = known != nullptr ? *known : begin(peer, frame);
  tool.hub->take_feed(frame);
  if (is_of(FeedType::kHello, frame)) {
    tool.shown_ns.reset();
    tool.arm = nullptr;
    tool.newest.reset();
    say_list();
  } else {
    show_to_others(tool, frame);
  }
}

void ToolHubs::feed_lost(std::uint64_t peer) {
  if (Tool* const tool = tool_of(peer)) {
    tool->peer = 0;
    tool->hub->feed_lost();
    say_list();
  }
}

template <typename Change>
void ToolHubs::change_others(const Tool& tool, const Change& change) {
  for (const Tool& other : tools_) {
    if (&other == &tool) {
      continue;
    }
    for (Viewer* viewer : other.hub->viewers()) {
      change(viewer->outbox);
      viewer->wake();
    }
  }
}

// Its hub has checked the frame.
void ToolHubs::show_to_others(Tool& tool, const Frame& frame) {
  const std::size_t number = number_of(tool);
  if (is_of(FeedType::kArm, frame)) {
    tool.arm = message_of(PageType::kArm, static_cast<std::uint8_t>(number), frame.payload);
    change_others(tool, [&](Outbox& outbox) { outbox.set_arm(number, tool.arm); });
  } else if (is_of(FeedType::kCycles, frame)) {
    view_link::FeedCycle& newest = tool.newest.emplace();
    std::memcpy(&newest, frame.payload.data() + frame.payload.size() - sizeof newest,
                sizeof newest);
    const auto since_ns = static_cast<std::int64_t>(
        static_cast<std::uint64_t>(newest.time_ns) -
        static_cast<std::uint64_t>(tool.shown_ns.value_or(0)));  // of times that may be any
    if (!tool.shown_ns || since_ns < 0 || since_ns >= kOtherTool_ns) {
      show_place(tool);
    }
  } else if (is_of(FeedType::kPlayback, frame) && tool.newest) {
    show_place(tool);  // a recording that stands still sends no cycle that would
  }
}

void ToolHubs::show_place(Tool& tool) {
  const std::size_t number = number_of(tool);
  tool.shown_ns = tool.newest->time_ns;
  const SharedBytes place = other_tool_message(number, *tool.newest);
  change_others(tool, [&](Outbox& outbox) { outbox.set_other_tool(number, place); });
}

// What a page that comes would have been told of the tools beside the one that it shows.
void ToolHubs::give_others(Viewer& viewer) {
  for (const Tool& tool : tools_) {
    const std::size_t number = number_of(tool);
    if (number == viewer.tool || tool.peer == 0) {
      continue;
    }
    if (tool.arm) {
      viewer.outbox.set_arm(number, tool.arm);
    }
    if (tool.newest) {
      viewer.outbox.set_other_tool(number, other_tool_message(number, *tool.newest));
    }
  }
  viewer.wake();
}

// ---- Surfaces ----

void ToolHubs::take_surface(std::uint64_t peer, const Frame& frame) {
  if (const auto news = surfaces_->take(peer, frame)) {
    for (const Tool& tool : tools_) {
      tool.hub->show(*news);
    }
  }
}

void ToolHubs::surface_lost(std::uint64_t peer) {
  const std::vector<std::size_t> objects = surfaces_->lose(peer);
  for (const Tool& tool : tools_) {
    tool.hub->show_lost(objects);
  }
}

// ---- Pages ----

bool ToolHubs::has_several() const {
  return std::ranges::count_if(tools_,
                               [](const Tool& tool) { return tool.hub->hello().is_object(); }) > 1;
}

// Those that had a run, and whether it is there.
json ToolHubs::list() const {
  json tools = json::array();
  for (std::size_t k = 0; k < tools_.size(); ++k) {
    const json& hello = tools_[k].hub->hello();
    if (hello.is_object()) {
      tools.push_back(
          {{"tool", k}, {"device", hello.value("device", "")}, {"live", tools_[k].hub->is_live()}});
    }
  }
  return {{"type", "tools"}, {"tools", tools}};
}

// Where there is one tool, there is nothing to choose.
void ToolHubs::say_list() {
  if (!has_several()) {
    return;
  }
  const std::string text = list().dump();
  for (const Tool& tool : tools_) {
    for (Viewer* viewer : tool.hub->viewers()) {
      viewer->outbox.add_text(text, true);
      viewer->wake();
    }
  }
}

void ToolHubs::join(Viewer& viewer) {
  viewer.tool = 0;
  tools_[0].hub->join(viewer);
  if (has_several()) {
    viewer.outbox.add_text(list().dump());
    give_others(viewer);
  }
}

void ToolHubs::leave(Viewer& viewer) { tools_[viewer.tool].hub->leave(viewer); }

void ToolHubs::forget_viewers() noexcept {
  for (const Tool& tool : tools_) {
    tool.hub->forget_viewers();
  }
}

// What the page showed of the tool before is dropped; the surfaces stay.
void ToolHubs::choose(Viewer& viewer, std::size_t tool) {
  if (tool == viewer.tool) {
    return;
  }
  Hub& before = *tools_[viewer.tool].hub;
  viewer.slice.reset();
  viewer.blocks = false;
  viewer.outbox.forget_run(viewer.tool);
  viewer.tool = tool;
  tools_[tool].hub->join(viewer, false);  // first, so that a simulator need not stop what it sends
  give_others(viewer);
  before.leave(viewer);
}

void ToolHubs::take_page(Viewer& viewer, std::string_view text) {
  const std::optional<PageCommand> command = parse_command(text);
  if (command && command->what == PageCommand::What::kTool) {
    choose(viewer, command->tool);
  } else {
    tools_[viewer.tool].hub->take_page(viewer, text);
  }
}

}  // namespace forcegrid::view
