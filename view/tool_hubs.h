// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>

#include "view/hub.h"
#include "view/messages.h"
#include "view/surfaces.h"
#include "view_link/frame.h"

namespace forcegrid::view {

/// The hubs of the tools that hold one object, each fed by a run with a device of its own. A page
/// shows the scope, the field and the controls of the tool that it has chosen, and the surfaces,
/// arms and tools of all. With one feed it is a Hub.
///
/// Each tool has a controller of its own: the first page that shows it. Stop is the program's: it
/// ends every loop, whichever tool's run it goes to. Real-time: no. Threads: one.
class ToolHubs {
 public:
  /// Hands a command to the run `peer`, see Hub::SendCommand.
  using SendCommand = std::function<bool(std::uint64_t peer, const view_link::Frame& frame,
                                         PageCommand::What what, bool newest)>;

  explicit ToolHubs(const SendCommand& send_command, Surfaces::Tell tell_simulator = {});

  /// A frame of the run `peer`, any number but 0. The object of its hello is the place of its tool,
  /// which belongs to it until it is lost. @throws ViewLinkError saying what is wrong with it.
  void take_feed(std::uint64_t peer, const view_link::Frame& frame);
  void feed_lost(std::uint64_t peer);

  /// As Hub's.
  void take_surface(std::uint64_t peer, const view_link::Frame& frame);
  void surface_lost(std::uint64_t peer);

  /// A new page shows the first tool. `viewer` stays where it is until leave().
  void join(Viewer& viewer);
  void leave(Viewer& viewer);
  void forget_viewers() noexcept;
  void take_page(Viewer& viewer, std::string_view text);

 private:
  struct Tool {
    std::unique_ptr<Hub> hub;
    std::uint64_t peer = 0;                ///< its run's; 0: none
    std::optional<std::int64_t> shown_ns;  ///< cycle in which other pages were last told of it
    SharedBytes arm;                       ///< the newest, for pages that come to show another tool
    std::optional<view_link::FeedCycle> newest;  ///< likewise
  };

  Tool* tool_of(std::uint64_t peer) noexcept;
  std::size_t number_of(const Tool& tool) const noexcept;
  Tool& begin(std::uint64_t peer, const view_link::Frame& hello);
  void choose(Viewer& viewer, std::size_t tool);
  [[nodiscard]] nlohmann::json list() const;
  [[nodiscard]] bool has_several() const;
  void say_list();
  void show_to_others(Tool& tool, const view_link::Frame& frame);
  void show_place(Tool& tool);
  void give_others(Viewer& viewer);
  template <typename Change>
  void change_others(const Tool& tool, const Change& change);

  std::shared_ptr<Surfaces> surfaces_;
  std::array<Tool, kMostTools> tools_;
};

}  // namespace forcegrid::view
