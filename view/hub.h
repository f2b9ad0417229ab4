// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "view/messages.h"
#include "view/method_copies.h"
#include "view/outbox.h"
#include "view/scope_rows.h"
#include "view/surfaces.h"
#include "view_link/frame.h"

namespace forcegrid::view {

/// A page that looks on.
struct Viewer {
  Outbox outbox;
  std::function<void()> wake;  ///< called when the outbox has something; calls nothing of the hub
  std::optional<SliceWish> slice{};  ///< of the force field that it shows
  bool blocks = false;               ///< it shows the blocks of storage
  bool inside = false;               ///< it shows what is inside of the objects
  std::size_t tool = 0;              ///< whose scope, field and controls it shows, see ToolHubs
};

/// Of a hub that is one of several, one per tool.
struct HubOptions {
  std::size_t tool = 0;                ///< its place, < kMostTools
  std::shared_ptr<Surfaces> surfaces;  ///< that all show; null: the hub has its own
  /// Whether a page of another hub shows the inside of the objects; empty: there is no other.
  std::function<bool()> inside_wished_elsewhere;
};

/// What is known of the run with one tool and of the surfaces, and who is told. Everything that a
/// peer sends is checked here; a peer that breaks the protocol is reported as ViewLinkError, and
/// its connection is to be closed. It knows no sockets. Real-time: no. Threads: one.
class Hub {
 public:
  /// Hands a command to the run. `newest`: it may take the place of one of its kind that waits.
  /// False: no run is connected, or it does not read.
  using SendCommand =
      std::function<bool(const view_link::Frame& frame, PageCommand::What what, bool newest)>;

  /// @param tell_simulator  that pages show the inside of its objects, or none does any more.
  explicit Hub(SendCommand send_command, Surfaces::Tell tell_simulator = {})
      : Hub(std::move(send_command),
            {.surfaces = std::make_shared<Surfaces>(std::move(tell_simulator))}) {}
  /// @param options  with surfaces.
  Hub(SendCommand send_command, HubOptions options)
      : send_command_(std::move(send_command)), options_(std::move(options)) {}

  /// A frame of the feed. @throws ViewLinkError saying what is wrong with it.
  void take_feed(const view_link::Frame& frame);
  /// The feed's connection is closed.
  void feed_lost();

  /// A frame of the simulator `peer`, as Surfaces::take().
  /// @throws ViewLinkError saying what is wrong with it.
  void take_surface(std::uint64_t peer, const view_link::Frame& frame);
  void surface_lost(std::uint64_t peer);
  /// What the surfaces that several hubs share have for this one's pages.
  void show(const Surfaces::News& news);
  void show_lost(const std::vector<std::size_t>& objects);

  /// The first viewer is the controller. `viewer` stays where it is until leave().
  /// @param with_surfaces  false: it has them from another hub.
  void join(Viewer& viewer, bool with_surfaces = true);
  void leave(Viewer& viewer);
  /// The same for all, without telling anyone: the server ends.
  void forget_viewers() noexcept;
  /// What a page sends. @throws ViewLinkError for what is no command.
  void take_page(Viewer& viewer, std::string_view text);

  const std::vector<Viewer*>& viewers() const noexcept { return viewers_; }
  /// Of the run that is connected, or the last one; null before the first.
  const nlohmann::json& hello() const noexcept { return hello_; }
  bool is_live() const noexcept { return feed_ == Feed::kLive; }
  bool inside_wished() const noexcept;
  bool is_controller(const Viewer& viewer) const noexcept { return controller_ == &viewer; }
  /// Of the run's methods; null if the run did not say how they were made.
  const MethodCopies* copies() const noexcept { return copies_ ? &*copies_ : nullptr; }
  /// [m] Where the methods were asked in the newest cycle.
  const Eigen::Vector3d& touching_W() const noexcept { return touching_W_; }

 private:
  enum class Feed { kWaiting, kLive, kEnded };
  struct Pending {  ///< a command that the run may acknowledge
    std::uint64_t run_id;
    std::uint64_t page_id;
    PageCommand::What what;
    Viewer* viewer;
  };

  void take_hello(const view_link::Frame& frame);
  void take_cycles(const view_link::Frame& frame);
  void take_samples(const view_link::Frame& frame);
  void take_note(nlohmann::json note);
  void take_playback(nlohmann::json playback);
  void begin_anew(const nlohmann::json& playback);
  void take_acknowledgement(nlohmann::json acknowledgement);
  void take_settings(nlohmann::json settings);
  void wish_inside();
  void take_slice_wish(Viewer& viewer, const PageCommand& command);
  void send_slice(std::int64_t time_ns);
  void send_slice(Viewer& viewer);
  void take_layers(Viewer& viewer, const PageCommand& command);
  void send_blocks(std::int64_t time_ns);
  void forward(Viewer& viewer, const PageCommand& command);
  void remember(const Pending& command);
  void take_control(Viewer& viewer);
  void say(Viewer& viewer, const nlohmann::json& text, bool after_rows = false);
  void say_to_all(const nlohmann::json& text, bool after_rows = false);
  void refuse(Viewer& viewer, const PageCommand& command, const std::string& why);
  void say_hello(Viewer& viewer);
  void say_role(Viewer& viewer);
  const char* role_of(const Viewer& viewer) const noexcept;
  template <typename Change>
  void change_all(const Change& change);

  SendCommand send_command_;
  HubOptions options_;
  std::vector<Viewer*> viewers_;
  Viewer* controller_ = nullptr;
  Feed feed_ = Feed::kWaiting;
  nlohmann::json hello_;
  nlohmann::json end_;
  nlohmann::json playback_;           ///< of a recording: the newest; null: a run
  std::deque<nlohmann::json> notes_;  ///< the newest, for pages that come later
  std::optional<ScopeRows> rows_;
  std::optional<ScopeRow> newest_row_;  ///< of a recording, which may stand still for long
  SharedBytes newest_arm_;              ///< likewise
  bool quiet_ = false;                  ///< a recording is on its way to a place: pages wait for it
  std::optional<MethodCopies> copies_;  ///< of the methods; nothing: the run did not say how
  Eigen::Vector3d touching_W_ = Eigen::Vector3d::Zero();  ///< [m] of the newest cycle
  std::optional<std::int64_t> slice_ns_;                  ///< cycle of the newest slice
  std::size_t slice_turn_ = 0;
  SharedBytes newest_blocks_;              ///< of storage, that pages were sent
  std::optional<std::int64_t> blocks_ns_;  ///< cycle in which they were looked at last
  std::deque<Pending> pending_;
  std::uint64_t next_id_ = 1;
};

}  // namespace forcegrid::view
