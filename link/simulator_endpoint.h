// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "link/address.h"
#include "link/key.h"
#include "link/messages.h"
#include "link/statistics.h"
#include "link/surface_patch.h"

namespace forcegrid::link {
#pragma GCC visibility push(default)

inline constexpr std::size_t kQueuedQueries = 64;
inline constexpr std::size_t kQueuedToolStates = 1024;

/// Who may use a simulator.
struct Access {
  /// Datagrams have to be sealed with one of these (sealed_channel.h), and answers are sealed with
  /// the servo's; none: not sealed, and this machine only.
  std::vector<LinkKey> keys;
  std::vector<AddressRange> allowed;  ///< from where; empty: from anywhere
};

/// The simulator's end of the link, and the C++ client library for simulators of other projects:
///
///   SimulatorEndpoint servo("127.0.0.1:24870");
///   while (running) {
///     const auto news = servo.receive(std::chrono::milliseconds(100));
///     if (news.new_session) forget_the_old_run();
///     if (news.tool_state) {
///       ForceSample sample = answer_to(*news.tool_state);   // position and echo filled in
///       sample.force_W_N = ...;
///       sample.converged = true;
///       servo.send(sample);
///     }
///     while (auto query = servo.next_query()) ...           // in idle time, if at all
///   }
///
/// The endpoint has a place for each servo that it serves at once, one by default. The first servo
/// that is heard holds its place until it says goodbye or has been silent for `silence_limit`. A
/// servo for whom there is no place, or whose tool's number is taken, is counted as foreign; it
/// gets a Refusal if it speaks version 2 of the protocol, else no answer. A new session from the
/// address of a servo takes over its place at once, and a session that has been replaced does not
/// come back. With keys a session goes on under the key that it began with. Each place has sequence
/// numbers, a path and queries of its own.
///
/// A servo is answered in the newest version that it has spoken: version 3 of the protocol if it
/// has told of poses, version 4 if it asks for sensitivities. What it sends in version 1 or 2
/// before its first answer keeps the orientation and the buttons of the tool state before.
///
/// Threads: one at a time.
class SimulatorEndpoint {
 public:
  /// Listens at `address` ("ADDR:PORT", see parse_address(); port 0 chooses a free one).
  /// @param places  how many servos are served at once, 1 to kMostTools
  /// @throws LinkError for an address beyond loopback without a key, a port in use, no socket, or
  ///   a number of places out of range.
  explicit SimulatorEndpoint(const Address& address,
                             std::chrono::nanoseconds silence_limit = std::chrono::seconds(2),
                             Access access = {}, std::size_t places = 1);
  explicit SimulatorEndpoint(std::string_view address,
                             std::chrono::nanoseconds silence_limit = std::chrono::seconds(2),
                             Access access = {}, std::size_t places = 1);
  /// Says goodbye to the servos that there are.
  ~SimulatorEndpoint();
  SimulatorEndpoint(const SimulatorEndpoint&) = delete;
  SimulatorEndpoint& operator=(const SimulatorEndpoint&) = delete;

  /// What receive() found; all empty after a time-out or a signal.
  struct News {
    std::optional<ToolState> tool_state;  ///< the newest one, if it is new since the last call
    std::size_t queries = 0;              ///< how many wait in next_query()
    bool new_session = false;             ///< another run of a servo began; forget the old one
    bool servo_ended = false;             ///< the servo said goodbye
    bool servo_failed = false;            ///< and that its device has failed; version 2 only
  };

  /// Reads all that has arrived (at most 4096 datagrams per call). If none is usable, waits up to
  /// `timeout` for the first usable one; zero or less does not wait. Queries read earlier do not
  /// count; pass zero to go on with those. Returns early, possibly empty, when a signal interrupts
  /// the wait, so that the caller can check its stop flag.
  /// Real-time: blocks up to `timeout`; no allocation or throw.
  [[nodiscard]] News receive(std::chrono::nanoseconds timeout) noexcept;
  /// The same of every place; receive() returns the first one's.
  [[nodiscard]] std::array<News, kMostTools> receive_all(std::chrono::nanoseconds timeout) noexcept;

  /// The oldest tool state of the current session that has not been fetched here, including the one
  /// that receive() gave as the newest. Together they are the tool's whole path, for objects whose
  /// force depends on it. Tool states that came after a newer one are left out. The queue holds
  /// kQueuedToolStates. When it is full the oldest is dropped, so that a simulator that does not
  /// need the path need not call this. Real-time: yes.
  [[nodiscard]] std::optional<ToolState> next_tool_state(std::size_t place = 0) noexcept;

  /// The oldest waiting query of the current session. The queue holds kQueuedQueries; when it is
  /// full the oldest is dropped and counted. Real-time: yes.
  [[nodiscard]] std::optional<Query> next_query(std::size_t place = 0) noexcept;

  /// Sends `sample` to the place's servo with the next sequence number (`sample.sequence` is not
  /// used). Samples go out in the order of the tool states that they answer.
  /// Real-time: one or two system calls that don't block; no allocation or throw.
  SendStatus send(const ForceSample& sample, std::size_t place = 0) noexcept;
  /// The same for a patch of the surface; patches have sequence numbers of their own. A simulator
  /// need not send any.
  SendStatus send(const SurfacePatch& patch, std::size_t place = 0) noexcept;
  /// The same for the other tools; kInvalid for a servo that names no tool.
  SendStatus send(const OtherTools& others, std::size_t place) noexcept;
  /// Tells a served servo that it is not served any more; kInvalid for one that names no tool.
  SendStatus send(const Refusal& refusal, std::size_t place) noexcept;

  /// Whether a servo holds the place and was heard within the silence limit. Real-time: yes.
  [[nodiscard]] bool servo_alive(std::size_t place = 0) const noexcept;
  /// The tool of the place's servo; 0 without one, and for one that names none.
  [[nodiscard]] ToolId tool(std::size_t place) const noexcept;
  /// Whether torques reach the place's servo, because it has told of poses. Real-time: yes.
  [[nodiscard]] bool knows_poses(std::size_t place = 0) const noexcept;
  /// Whether d(torque)/dP and the other tools' influences reach it. Real-time: yes.
  [[nodiscard]] bool knows_sensitivities(std::size_t place = 0) const noexcept;
  /// Sessions since the start; 0 before the first. Real-time: yes.
  [[nodiscard]] std::uint64_t session_count() const noexcept;
  [[nodiscard]] std::uint64_t session_id(std::size_t place = 0) const noexcept;  ///< 0: no servo
  /// Where this end listens, with the port that the system chose.
  [[nodiscard]] const Address& address() const noexcept;
  [[nodiscard]] std::uint16_t port() const noexcept;
  [[nodiscard]] const LinkStatistics& statistics() const noexcept;

 private:
  struct [[gnu::visibility("hidden")]] State;
  std::unique_ptr<State> state_;
};

/// A sample for the tool's pose with the echo filled in; force zero, not in contact. The
/// orientation is sent with a torque only.
/// Real-time: yes. Threads: any.
[[nodiscard]] ForceSample answer_to(const ToolState& state) noexcept;
/// An empty patch for the tool's position with the echo filled in.
[[nodiscard]] SurfacePatch patch_for(const ToolState& state) noexcept;
/// A reply for the query's position with id and echo time filled in (echo_sequence is 0 in a
/// reply).
[[nodiscard]] ForceSample answer_to(const Query& query) noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::link
