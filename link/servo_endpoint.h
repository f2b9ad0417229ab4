// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "link/address.h"
#include "link/clock_estimate.h"
#include "link/key.h"
#include "link/messages.h"
#include "link/statistics.h"
#include "link/surface_patch.h"

namespace forcegrid::link {
#pragma GCC visibility push(default)

/// A sample's position may differ from the tool state (or query) that it answers, since a solver
/// may move its tool in steps; beyond this the sample is taken as forged.
inline constexpr double kMaxEchoDistance_m = 0.05;
/// Tool states that are remembered to check echoes: 2 s at 4 kHz. Older echoes count as late.
inline constexpr std::size_t kRememberedToolStates = 8192;
inline constexpr std::size_t kRememberedQueries = 1024;

/// The servo's end of the link: sends tool states and queries, receives checked samples.
///
/// A sample is accepted when its datagram is well-formed (wire.h), comes from the simulator's
/// address, carries this run's session id, echoes sequence and time of a tool state sent in this
/// session, lies within kMaxEchoDistance_m of it, and is newer than the newest accepted one. A
/// reply (query_id != 0) must instead match an unanswered query of the session in id, time and
/// position; it is never late. A patch of the surface must echo a tool state as a sample does,
/// state its very position, and be newer than the newest taken. Everything else is dropped and
/// counted.
///
/// A servo with a tool's number speaks version 2 of the protocol and may share the simulator with
/// others. Until it is answered in that version, every 64th tool state goes out in version 1, so
/// that a simulator that knows one tool shows itself: see simulator_knows_one_tool().
///
/// A servo whose tool states have an orientation or buttons speaks version 3 from the first of them
/// on. Until it is answered in that version, every 64th tool state goes out without them. A
/// simulator that answers three of these and nothing else gets all others without them, too: see
/// simulator_knows_poses().
///
/// A servo that asks for sensitivities speaks version 4 instead, if it has a tool's number, an
/// orientation or buttons; a simulator's only tool without these has none. Every 64th tool state
/// then goes out in the older versions in turn, the newest first, and three answers in these and
/// none in version 4 end it: see simulator_knows_sensitivities().
///
/// Threads: one at a time.
class ServoEndpoint {
 public:
  /// Opens a non-blocking socket on a free port, on loopback if the simulator is there. The
  /// simulator need not run yet.
  /// @param simulator   where it listens, see parse_address()
  /// @param session_id  not zero; random by default, so that forging is hard
  /// @param keys        datagrams are sealed with the first one, or with the one that the simulator
  ///   uses (sealed_channel.h); none: not sealed
  /// @param tool        1 to kMaxToolId, unlike the other servos'; 0: the simulator's only one
  /// @param newest      what it asks for at most; kPosition leaves orientations and buttons out
  /// @throws LinkError for an address beyond loopback without a key, port 0, session 0, a tool out
  ///   of range, or no socket.
  explicit ServoEndpoint(const Address& simulator, std::uint64_t session_id = random_session_id(),
                         std::vector<LinkKey> keys = {}, ToolId tool = 0,
                         Content newest = Content::kPose);
  explicit ServoEndpoint(std::string_view simulator, std::uint64_t session_id = random_session_id(),
                         std::vector<LinkKey> keys = {}, ToolId tool = 0,
                         Content newest = Content::kPose);
  /// Says goodbye to the simulator unless say_goodbye() has.
  ~ServoEndpoint();
  ServoEndpoint(const ServoEndpoint&) = delete;
  ServoEndpoint& operator=(const ServoEndpoint&) = delete;

  /// Sends one message. `ToolState::sequence` must rise from call to call, and so must
  /// `Query::query_id`, which starts above 0. A missing simulator (ECONNREFUSED) is only counted.
  /// Real-time: one or two system calls that don't block; no allocation, lock of ours or throw.
  SendStatus send(const ToolState& state) noexcept;
  SendStatus send(const Query& query) noexcept;

  /// The next acceptable sample or reply, if one has arrived. Reads at most 256 datagrams per
  /// call, so that a flood cannot hold up the caller.
  /// Real-time: bounded, does not block; no allocation, lock of ours or throw.
  [[nodiscard]] std::optional<ForceSample> receive() noexcept;

  /// The newest acceptable patch of the surface that receive() has come across since the last call.
  /// Real-time: as receive().
  [[nodiscard]] std::optional<SurfacePatch> next_patch() noexcept;
  /// Patches of the surface among LinkStatistics::accepted. Real-time: yes.
  [[nodiscard]] std::uint64_t patches_accepted() const noexcept;

  /// The newest message about the other tools that receive() has come across since the last call.
  /// Real-time: as receive().
  [[nodiscard]] std::optional<OtherTools> next_others() noexcept;
  /// Such messages among LinkStatistics::accepted. Real-time: yes.
  [[nodiscard]] std::uint64_t others_accepted() const noexcept;
  /// Why the simulator does not serve this servo; nothing: it has not refused since the newest
  /// sample. Real-time: yes.
  [[nodiscard]] const std::optional<Refusal>& refusal() const noexcept;
  /// Refusals among LinkStatistics::accepted. Real-time: yes.
  [[nodiscard]] std::uint64_t refusals_accepted() const noexcept;
  /// The simulator answers version 1 of the protocol and does not answer version 2, so that this
  /// servo's tool cannot be one of several. Real-time: yes.
  [[nodiscard]] bool simulator_knows_one_tool() const noexcept;

  /// Whether the simulator may get orientations and buttons and send torques: it has answered in
  /// version 3 of the protocol, or not shown yet that it only speaks an older one. True for a servo
  /// that has none to send. Real-time: yes.
  [[nodiscard]] bool simulator_knows_poses() const noexcept;
  /// The same of sensitivities and version 4.
  [[nodiscard]] bool simulator_knows_sensitivities() const noexcept;

  /// Waits until something has arrived, `timeout` has passed or a signal came. Zero or less: does
  /// not wait.
  /// @returns true when receive() has a datagram to read.
  /// Real-time: blocks up to `timeout`; for the link's thread, not for the servo's.
  bool wait(std::chrono::nanoseconds timeout) noexcept;

  /// Whether the simulator has said goodbye and nothing from it has been accepted since.
  [[nodiscard]] bool simulator_ended() const noexcept;

  /// Tells the simulator that this run ends, once.
  /// @param fault  because its device has failed; only a servo with a tool's number can say it.
  /// Real-time: as send().
  void say_goodbye(bool fault = false) noexcept;

  [[nodiscard]] std::uint64_t session_id() const noexcept;
  [[nodiscard]] ToolId tool() const noexcept;
  [[nodiscard]] const Address& simulator_address() const noexcept;
  /// Where this end receives.
  [[nodiscard]] const Address& local_address() const noexcept;
  [[nodiscard]] const LinkStatistics& statistics() const noexcept;
  /// The simulator's clock and the shortest round trip. Known only with a key, since only sealed
  /// datagrams carry the times. Real-time: yes.
  [[nodiscard]] ClockEstimate clock() const noexcept;

  /// From the system's random source, never zero. Real-time: no; may throw LinkError.
  static std::uint64_t random_session_id();

 private:
  struct [[gnu::visibility("hidden")]] State;
  std::unique_ptr<State> state_;
};

#pragma GCC visibility pop
}  // namespace forcegrid::link
