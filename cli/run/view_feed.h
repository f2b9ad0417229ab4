// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/run/view_controls.h"
#include "driver/mechanism.h"
#include "forcegrid/core/method_options.h"
#include "profiles/device_profile.h"
#include "rt/percentiles.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/servo_options.h"
#include "servo_loop/servo_ports.h"
#include "view_link/feed_messages.h"
#include "view_link/frame_sender.h"

namespace forcegrid::cli {

/// What the live view shows of a run besides numbers.
struct ViewTitle {
  std::string version;  ///< of this program
  std::string device;
  std::string scene;
  std::vector<std::string> methods;     ///< in the loop's order
  std::vector<std::string> candidates;  ///< of the rendered one
  double rate_Hz = 500.0;
  double simulator_rate_Hz = 30.0;
  MethodOptions method_options;  ///< that each method got before its own
  int fill_budget = 1000;
  double requests_per_s = 0.0;
  bool emulated = false;
  std::string hand_socket;  ///< of the emulated hand; empty: there is none
  ControlFacts controls;
  /// The run is to end and to begin again with this scene.
  std::function<void(const std::string& scene)> restart = [](const std::string&) {};
  bool tour = false;  ///< the page shows the steps of a tour
  /// Place of the device among those that the view shows, from 0 on.
  std::uint16_t tool = 0;
};

/// What the live view is told first: the keys of docs/view_protocol.md, "Hello".
/// @param settings  ViewControls::settings(); none for a recording.
nlohmann::json view_hello(const ViewTitle& title, const profiles::DeviceProfile& profile,
                          const servo::WorkspaceMap& workspace,
                          const nlohmann::json& settings = nlohmann::json::array());

/// The arm as lines, at encoder counts a to f. @param mechanism  of the profile.
view_link::Frame arm_frame(const profiles::DeviceProfile& profile, driver::Mechanism& mechanism,
                           const servo::WorkspaceMap& workspace,
                           const std::array<std::int32_t, 6>& counts);

/// A cycle and a sample as they go to the live view.
view_link::FeedCycle cycle_of(const servo::CycleRecord& record);
view_link::FeedSample sample_of(const servo::ArrivedSample& arrived);

/// Sends a run's cycles and samples to the live view, and does what the person there asks for
/// (docs/view_protocol.md): stop, pause the force, move the emulated hand, ViewControls. A view
/// that is slow or gone costs the run nothing. Real-time: no. Threads: any for every function; the
/// view's commands come on a thread of its own.
class ViewFeed {
 public:
  /// Connects and says what runs.
  /// @throws view_link::ViewLinkError naming the socket.
  ViewFeed(const std::string& socket, const ViewTitle& title,
           const profiles::DeviceProfile& profile, const servo::WorkspaceMap& workspace,
           servo::ServoPorts& ports);
  ~ViewFeed();
  ViewFeed(const ViewFeed&) = delete;
  ViewFeed& operator=(const ViewFeed&) = delete;

  /// Both wait for send() unless they become many.
  void push(const servo::CycleRecord& cycle);
  void push(const servo::ArrivedSample& sample);
  /// Sends what waits, all of it together.
  void send();
  void note(const std::string& level, const std::string& component, const std::string& text);
  /// The last frames: a stop that still waits is acknowledged, and how the run ended is said.
  /// @param motors_are_off  the device has taken a zero command.
  void finish(const std::string& ended_by, int exit_status, const std::string& text,
              bool motors_are_off);

  /// From the start of a cycle to the page's report that it has drawn it.
  rt::Percentiles picture_delay_ms();
  /// ViewControls::changes().
  nlohmann::json setting_changes() { return controls_->changes(); }

 private:
  void take_command(const view_link::Frame& frame);
  void acknowledge(std::int64_t id, const char* what, bool done, const std::string& text);
  void acknowledge_what_was_done(const servo::CycleRecord& cycle);
  void queue_samples();
  void queue_cycles();
  void queue_arm();
  void take_shown(std::uint64_t cycle);
  void move_hand(std::int64_t id, const std::optional<servo::Triple>& target_W_m);

  profiles::DeviceProfile profile_;
  servo::WorkspaceMap workspace_;
  servo::ServoPorts& ports_;
  std::unique_ptr<driver::Mechanism> mechanism_;
  std::size_t methods_;
  std::string hand_socket_;
  int hand_ = -1;  ///< the socket that sends to it

  std::mutex mutex_;                                          ///< of the next ten
  std::deque<std::pair<std::uint64_t, std::int64_t>> begun_;  ///< cycles, and when each began
  rt::Percentiles picture_delay_ms_;
  std::vector<view_link::FeedCycle> cycles_;
  std::vector<view_link::FeedSample> samples_;
  std::array<std::int32_t, 6> counts_{};  ///< of the newest cycle's encoders
  std::int64_t newest_ns_ = 0;            ///< when it began
  std::int64_t last_arm_ns_ = 0;
  std::optional<std::int64_t> stop_id_;    ///< of a command that waits for the servo to obey
  std::optional<std::int64_t> pause_id_;   ///< likewise
  std::optional<std::int64_t> method_id_;  ///< likewise
  std::unique_ptr<view_link::FrameSender> sender_;
  std::unique_ptr<ViewControls> controls_;
};

}  // namespace forcegrid::cli
