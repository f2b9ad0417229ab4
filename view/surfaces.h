// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <vector>

#include "view/messages.h"
#include "view/outbox.h"
#include "view_link/frame.h"

namespace forcegrid::view {

/// The surfaces that simulators send, and what is inside of the objects. Everything is checked
/// here. Simulators are told whether a page shows the inside. Real-time: no. Threads: one.
class Surfaces {
 public:
  /// Sends a frame to the simulator `peer`; one that waits for it may be replaced. Empty: nowhere.
  using Tell = std::function<void(std::uint64_t peer, const view_link::Frame& frame)>;

  explicit Surfaces(Tell tell) : tell_(std::move(tell)) {}

  /// What a frame has for pages.
  struct News {
    PageType type = PageType::kShape;
    std::size_t object = 0;
    SharedBytes message;

    /// Only for pages that show the inside.
    bool is_inside() const noexcept {
      return type == PageType::kInsideLines || type == PageType::kInsideFrame;
    }
    void put(Outbox& outbox) const;
  };
  /// A frame of the simulator `peer`, any number. An object belongs to the peer that sends its
  /// shape first. Nothing: the frame belongs to what is there no more.
  /// @throws ViewLinkError saying what is wrong with it.
  std::optional<News> take(std::uint64_t peer, const view_link::Frame& frame);

  /// The peer's connection is closed. Returns the objects that are gone.
  std::vector<std::size_t> lose(std::uint64_t peer);

  /// Whether any page shows the inside: simulators are told when it changes, new ones with their
  /// first shape.
  void wish_inside(bool wished);
  /// Nobody is told anything any more.
  void stop_telling() noexcept { tell_ = nullptr; }

  /// What a page gets when it joins, or begins to show the inside.
  void give(Outbox& outbox) const;
  void give_inside(Outbox& outbox) const;

 private:
  struct Part {  ///< a surface, or an inside
    std::uint32_t epoch = 0;
    std::size_t vertices = 0;
    SharedBytes shape;
    SharedBytes frame;
  };
  struct Object {
    std::optional<std::uint64_t> peer;
    Part surface;
    Part inside;
  };

  News take_shape(std::uint64_t peer, const view_link::Frame& frame);
  News take_lines(const view_link::Frame& frame);
  std::optional<News> take_frame(const view_link::Frame& frame, bool of_inside);
  void check_owner(std::uint64_t peer, std::size_t object) const;
  void tell(std::uint64_t peer) const;

  Tell tell_;
  std::array<Object, kMostObjects> objects_;
  std::set<std::uint64_t> peers_;  ///< that have sent a shape
  bool inside_wished_ = false;
};

}  // namespace forcegrid::view
