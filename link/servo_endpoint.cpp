// SPDX-License-Identifier: Apache-2.0
#include "link/servo_endpoint.h"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <system_error>
#include <utility>
#include <variant>

#include "link/sequence_tracker.h"
#include "link/transport.h"
#include "link/wire.h"

namespace forcegrid::link {
namespace {

constexpr int kSamplesPerCall = 256;
// A simulator that knows a version answers an older one only to a servo whose first datagram in the
// newer one is still on its way.
constexpr std::uint32_t kTryOlderVersionEvery = 64;
constexpr int kAnswersOfOlderVersion = 3;

/// What was sent under a number, to check what comes back.
struct SentMessage {
  bool used = false;
  bool answered = false;  ///< queries only
  std::uint32_t number = 0;
  std::int64_t servo_time_ns = 0;
  Vector3 position_W_m{};
};

bool near(const Vector3& a_W_m, const Vector3& b_W_m,
          double within_m = kMaxEchoDistance_m) noexcept {
  return std::hypot(a_W_m[0] - b_W_m[0], a_W_m[1] - b_W_m[1], a_W_m[2] - b_W_m[2]) <= within_m;
}

/// Loopback for a simulator there, so that no other machine reaches the socket; else the address
/// that the system chooses.
Address local_for(const Address& simulator) noexcept {
  Address local;
  local.is_ipv6 = simulator.is_ipv6;
  if (!is_loopback(simulator)) {
    return local;
  }
  if (simulator.is_ipv6) {
    local.bytes[15] = 1;
  } else {
    local.bytes[0] = 127;
    local.bytes[3] = 1;
  }
  return local;
}

/// Refuses what parse_address() would, for an Address that was made in another way.
Address checked_simulator(const Address& address, Reach reach) {
  return parse_address(to_string(address), PortZero::kRefused, reach);
}

}  // namespace

struct ServoEndpoint::State {
  State(const Address& simulator_address, std::uint64_t session, std::vector<LinkKey> keys,
        ToolId own_tool, Content newest_content)
      : simulator(checked_simulator(simulator_address, reach_with(keys))),
        session_id(session),
        tool(own_tool),
        newest(newest_content),
        transport(LinkEnd::kServo, local_for(simulator), std::move(keys)) {
    if (session_id == 0) {
      throw LinkError("link to " + to_string(simulator) +
                      ": session id 0 is reserved; use random_session_id()");
    }
    if (own_tool > kMaxToolId) {
      throw LinkError("link to " + to_string(simulator) + ": tool number " +
                      std::to_string(own_tool) + "; give 1 to " + std::to_string(kMaxToolId) +
                      ", or 0 for a simulator's only tool");
    }
  }

  /// A version of the protocol.
  struct Speech {
    ToolId tool = 0;
    Content content = Content::kPosition;
  };
  /// What this end has to ask for.
  [[nodiscard]] Content wanted() const noexcept;
  /// Whether something is asked in this content's version, the wanted one or an older one.
  [[nodiscard]] bool asks(Content content) const noexcept;
  /// The newest one that the simulator is not known to be without.
  [[nodiscard]] Speech own_speech() const noexcept;
  /// Of the next tool state: now and then an older one.
  Speech next_speech() noexcept;
  /// Whether the datagram is in a version that the simulator was asked in; else it is counted.
  bool answers_own_speech(const Decoded& decoded) noexcept;

  template <typename Message>
  SendStatus transmit(const Message& message, Speech speech) noexcept;
  void take(const Decoded& decoded) noexcept;
  bool accept(const ForceSample& sample) noexcept;
  bool accept_sample(const ForceSample& sample) noexcept;
  bool accept_reply(const ForceSample& reply) noexcept;
  bool accept(const SurfacePatch& candidate) noexcept;
  bool echoes(std::uint32_t sequence, std::int64_t servo_time_ns, const Vector3& position_W_m,
              double within_m) noexcept;
  SequenceTracker::Arrival track(std::uint32_t sequence) noexcept;

  Address simulator;
  std::uint64_t session_id;
  ToolId tool;
  Content newest;
  Transport transport;
  SealedPeer peer;
  ClockFilter clock;
  LinkStatistics statistics;

  std::array<SentMessage, kRememberedToolStates> tool_states{};
  std::array<SentMessage, kRememberedQueries> queries{};
  bool tool_state_sent = false;
  std::uint32_t newest_tool_state = 0;
  std::uint32_t newest_query = 0;  ///< 0: none yet

  SequenceTracker tracker;
  bool sample_accepted = false;
  std::uint32_t newest_sample = 0;
  std::uint32_t newest_echo = 0;
  std::optional<SurfacePatch> patch;  ///< not yet given out
  std::uint64_t patches_accepted = 0;
  std::uint32_t newest_patch_echo = 0;
  std::optional<OtherTools> others;  ///< not yet given out
  std::uint64_t others_accepted = 0;
  std::optional<std::uint32_t> newest_others;  ///< its number
  std::optional<Refusal> refusal;
  std::uint64_t refusals_accepted = 0;
  bool own_tool_answered = false;
  int answers_without_tool = 0;
  bool has_pose = false;                  ///< a tool state had an orientation or buttons
  Content answered = Content::kPosition;  ///< the newest that the simulator has answered in
  int older_answers = 0;                  ///< samples in versions older than the wanted one
  std::uint32_t unanswered_tool_states = 0;
  bool simulator_ended = false;
  bool goodbye_said = false;
};

template <typename Message>
SendStatus ServoEndpoint::State::transmit(const Message& message, Speech speech) noexcept {
  std::array<std::byte, kMaxDatagramBytes> buffer;
  const SendStatus status = transport.send(
      simulator, peer, encode(message, session_id, buffer, speech.tool, speech.content), buffer,
      statistics);
  statistics.send_no_peer = transport.socket().undelivered();
  return status;
}

Content ServoEndpoint::State::wanted() const noexcept {
  const bool more_than_positions = tool != 0 || has_pose;
  return newest == Content::kSensitivities && more_than_positions ? Content::kSensitivities
         : newest != Content::kPosition && has_pose               ? Content::kPose
                                                                  : Content::kPosition;
}

bool ServoEndpoint::State::asks(Content content) const noexcept {
  // Without a pose the next older version after 4 is 2.
  return content <= wanted() && (content != Content::kPose || has_pose);
}

ServoEndpoint::State::Speech ServoEndpoint::State::own_speech() const noexcept {
  const bool refused = answered < wanted() && older_answers >= kAnswersOfOlderVersion;
  return {tool, refused ? answered : wanted()};
}

ServoEndpoint::State::Speech ServoEndpoint::State::next_speech() noexcept {
  const Speech own = own_speech();
  std::array<Speech, 3> older{};
  std::size_t count = 0;
  if (answered < own.content && own.content == Content::kSensitivities && has_pose) {
    older[count++] = {tool, Content::kPose};
  }
  if (answered < own.content) {
    older[count++] = {tool, Content::kPosition};
  }
  // In turns, since a simulator of version 1 drops what names a tool.
  if (tool != 0 && !own_tool_answered) {
    older[count++] = {0, Content::kPosition};
  }
  if (count == 0 || ++unanswered_tool_states % kTryOlderVersionEvery != 0) {
    return own;
  }
  return older[(unanswered_tool_states / kTryOlderVersionEvery - 1) % count];
}

bool ServoEndpoint::State::answers_own_speech(const Decoded& decoded) noexcept {
  std::uint64_t& bad_version =
      statistics.malformed[static_cast<std::size_t>(WireStatus::kBadVersion)];
  if (!asks(decoded.content)) {
    ++bad_version;
    return false;
  }
  if (decoded.tool != tool) {
    const bool names_none = decoded.tool == 0;
    ++(names_none ? bad_version : statistics.foreign_session);
    answers_without_tool += names_none ? 1 : 0;
    return false;
  }
  own_tool_answered = true;
  answered = std::max(answered, decoded.content);
  return true;
}

SequenceTracker::Arrival ServoEndpoint::State::track(std::uint32_t sequence) noexcept {
  const auto arrival = tracker.observe(sequence);
  if (arrival == SequenceTracker::Arrival::kReordered) {
    ++statistics.reordered;
  }
  statistics.lost = tracker.missing();
  return arrival;
}

bool ServoEndpoint::State::accept(const ForceSample& sample) noexcept {
  return sample.query_id != 0 ? accept_reply(sample) : accept_sample(sample);
}

// Whether the message that it answers was sent, at that time and there; if not, it is counted.
bool ServoEndpoint::State::echoes(std::uint32_t sequence, std::int64_t servo_time_ns,
                                  const Vector3& position_W_m, double within_m) noexcept {
  const SentMessage& sent = tool_states[sequence % kRememberedToolStates];
  if (!sent.used || sent.number != sequence) {
    const bool forgotten = sent.used && ahead_of(newest_tool_state, sequence) >=
                                            static_cast<std::int32_t>(kRememberedToolStates);
    ++(forgotten ? statistics.late : statistics.forged);
    return false;
  }
  if (sent.servo_time_ns != servo_time_ns || !near(sent.position_W_m, position_W_m, within_m)) {
    ++statistics.forged;
    return false;
  }
  return true;
}

// Ignores the patch's own numbers: only the newest patch is of use, and a restarted simulator
// begins its numbers again.
bool ServoEndpoint::State::accept(const SurfacePatch& candidate) noexcept {
  if (!echoes(candidate.echo_sequence, candidate.echo_servo_time_ns, candidate.position_W_m, 0.0)) {
    return false;
  }
  if (patches_accepted > 0 && ahead_of(candidate.echo_sequence, newest_patch_echo) <= 0) {
    ++(candidate.echo_sequence == newest_patch_echo ? statistics.duplicated : statistics.late);
    return false;
  }
  ++patches_accepted;
  newest_patch_echo = candidate.echo_sequence;
  patch = candidate;
  return true;
}

bool ServoEndpoint::State::accept_sample(const ForceSample& sample) noexcept {
  if (!echoes(sample.echo_sequence, sample.echo_servo_time_ns, sample.position_W_m,
              kMaxEchoDistance_m)) {
    return false;
  }
  // A running simulator numbers its samples in the order of what they answer, so a newer answer
  // under an older number comes from a restarted simulator.
  const bool newer_answer = ahead_of(sample.echo_sequence, newest_echo) > 0;
  if (sample_accepted && newer_answer && ahead_of(sample.sequence, newest_sample) <= 0) {
    tracker.restart();
    sample_accepted = false;
    newest_others.reset();
    ++statistics.restarts;
  }
  switch (track(sample.sequence)) {
    case SequenceTracker::Arrival::kDuplicated:
      ++statistics.duplicated;
      return false;
    case SequenceTracker::Arrival::kTooOld:
      ++statistics.late;
      return false;
    case SequenceTracker::Arrival::kNewest:
    case SequenceTracker::Arrival::kReordered:
      break;
  }
  if (sample_accepted && (ahead_of(sample.echo_sequence, newest_echo) < 0 ||
                          ahead_of(sample.sequence, newest_sample) < 0)) {
    ++statistics.late;
    return false;
  }
  sample_accepted = true;
  newest_sample = sample.sequence;
  newest_echo = sample.echo_sequence;
  return true;
}

bool ServoEndpoint::State::accept_reply(const ForceSample& reply) noexcept {
  SentMessage& sent = queries[reply.query_id % kRememberedQueries];
  if (!sent.used || sent.number != reply.query_id) {
    const bool forgotten = sent.used && ahead_of(newest_query, reply.query_id) >=
                                            static_cast<std::int32_t>(kRememberedQueries);
    ++(forgotten ? statistics.late : statistics.forged);
    return false;
  }
  if (sent.servo_time_ns != reply.echo_servo_time_ns ||
      !near(sent.position_W_m, reply.position_W_m)) {
    ++statistics.forged;
    return false;
  }
  track(reply.sequence);
  if (sent.answered) {
    ++statistics.duplicated;
    return false;
  }
  sent.answered = true;
  return true;
}

ServoEndpoint::ServoEndpoint(const Address& simulator, std::uint64_t session_id,
                             std::vector<LinkKey> keys, ToolId tool, Content newest)
    : state_(std::make_unique<State>(simulator, session_id, std::move(keys), tool, newest)) {}

ServoEndpoint::ServoEndpoint(std::string_view simulator, std::uint64_t session_id,
                             std::vector<LinkKey> keys, ToolId tool, Content newest)
    : state_(std::make_unique<State>(parse_address(simulator, PortZero::kRefused, reach_with(keys)),
                                     session_id, std::move(keys), tool, newest)) {}

ServoEndpoint::~ServoEndpoint() { say_goodbye(); }

SendStatus ServoEndpoint::send(const ToolState& state) noexcept {
  State& own = *state_;
  if (own.tool_state_sent && ahead_of(state.sequence, own.newest_tool_state) <= 0) {
    ++own.statistics.send_invalid;
    return SendStatus::kNotRising;
  }
  own.has_pose = own.has_pose || state.has_orientation || state.has_buttons;
  const SendStatus status = own.transmit(state, own.next_speech());
  if (status == SendStatus::kSent) {
    own.tool_state_sent = true;
    own.newest_tool_state = state.sequence;
    own.tool_states[state.sequence % kRememberedToolStates] = {
        true, false, state.sequence, state.servo_time_ns, state.position_W_m};
  }
  return status;
}

SendStatus ServoEndpoint::send(const Query& query) noexcept {
  State& own = *state_;
  if (own.newest_query != 0 && ahead_of(query.query_id, own.newest_query) <= 0) {
    ++own.statistics.send_invalid;
    return SendStatus::kNotRising;
  }
  const SendStatus status = own.transmit(query, own.own_speech());
  if (status == SendStatus::kSent) {
    own.newest_query = query.query_id;
    own.queries[query.query_id % kRememberedQueries] = {true, false, query.query_id,
                                                        query.servo_time_ns, query.position_W_m};
  }
  return status;
}

// A message of this session and tool that is not a sample.
void ServoEndpoint::State::take(const Decoded& decoded) noexcept {
  if (std::holds_alternative<Goodbye>(decoded.message)) {
    ++statistics.accepted;
    simulator_ended = true;
  } else if (const auto* candidate = std::get_if<SurfacePatch>(&decoded.message)) {
    statistics.accepted += accept(*candidate) ? 1 : 0;
  } else if (const auto* told = std::get_if<OtherTools>(&decoded.message)) {
    if (newest_others && ahead_of(told->sequence, *newest_others) <= 0) {
      ++(told->sequence == *newest_others ? statistics.duplicated : statistics.late);
      return;
    }
    ++statistics.accepted;
    ++others_accepted;
    newest_others = told->sequence;
    others = *told;
  } else if (const auto* refused = std::get_if<Refusal>(&decoded.message)) {
    ++statistics.accepted;
    ++refusals_accepted;
    refusal = *refused;
  } else {
    ++statistics.unexpected_type;
  }
}

std::optional<ForceSample> ServoEndpoint::receive() noexcept {
  State& own = *state_;
  std::array<std::byte, kMaxDatagramBytes> buffer;
  for (int i = 0; i < kSamplesPerCall; ++i) {
    const UdpSocket::Received received = own.transport.socket().receive(buffer);
    own.statistics.send_no_peer = own.transport.socket().undelivered();
    if (received.kind == UdpSocket::Received::Kind::kNothing) {
      return std::nullopt;
    }
    ++own.statistics.received;
    own.statistics.overrun = own.transport.socket().overrun();
    if (received.sender != own.simulator) {
      ++own.statistics.foreign_address;
      continue;
    }
    const auto incoming = own.transport.open(received, buffer, own.statistics);
    if (!incoming) {
      continue;
    }
    if (incoming->times) {
      own.peer = incoming->peer;
      own.clock.add(*incoming->times);
      if (incoming->datagram.empty()) {
        continue;
      }
    }
    const Decoded decoded = decode(incoming->datagram);
    if (decoded.status != WireStatus::kOk) {
      ++own.statistics.malformed[static_cast<std::size_t>(decoded.status)];
      continue;
    }
    if (decoded.session_id != own.session_id) {
      ++own.statistics.foreign_session;
      continue;
    }
    if (!own.answers_own_speech(decoded)) {
      continue;
    }
    const auto* sample = std::get_if<ForceSample>(&decoded.message);
    if (sample == nullptr) {
      own.take(decoded);
    } else if (own.accept(*sample)) {
      ++own.statistics.accepted;
      own.older_answers += decoded.content < own.wanted() ? 1 : 0;
      own.simulator_ended = false;
      own.refusal.reset();
      return *sample;
    }
  }
  return std::nullopt;
}

std::optional<SurfacePatch> ServoEndpoint::next_patch() noexcept {
  return std::exchange(state_->patch, std::nullopt);
}

std::uint64_t ServoEndpoint::patches_accepted() const noexcept { return state_->patches_accepted; }

std::optional<OtherTools> ServoEndpoint::next_others() noexcept {
  return std::exchange(state_->others, std::nullopt);
}

std::uint64_t ServoEndpoint::others_accepted() const noexcept { return state_->others_accepted; }

const std::optional<Refusal>& ServoEndpoint::refusal() const noexcept { return state_->refusal; }

std::uint64_t ServoEndpoint::refusals_accepted() const noexcept {
  return state_->refusals_accepted;
}

bool ServoEndpoint::simulator_knows_one_tool() const noexcept {
  return !state_->own_tool_answered && state_->answers_without_tool >= kAnswersOfOlderVersion;
}

bool ServoEndpoint::simulator_knows_poses() const noexcept {
  return !state_->has_pose || state_->own_speech().content >= Content::kPose;
}

bool ServoEndpoint::simulator_knows_sensitivities() const noexcept {
  return state_->own_speech().content == Content::kSensitivities ||
         state_->wanted() != Content::kSensitivities;
}

bool ServoEndpoint::wait(std::chrono::nanoseconds timeout) noexcept {
  const bool readable = state_->transport.socket().wait(timeout) == UdpSocket::Wait::kReadable;
  state_->statistics.send_no_peer = state_->transport.socket().undelivered();
  return readable;
}

bool ServoEndpoint::simulator_ended() const noexcept { return state_->simulator_ended; }

void ServoEndpoint::say_goodbye(bool fault) noexcept {
  if (!state_->goodbye_said) {
    state_->goodbye_said = true;
    state_->transmit(Goodbye{fault}, state_->own_speech());
  }
}

std::uint64_t ServoEndpoint::session_id() const noexcept { return state_->session_id; }

ToolId ServoEndpoint::tool() const noexcept { return state_->tool; }

const Address& ServoEndpoint::simulator_address() const noexcept { return state_->simulator; }

const Address& ServoEndpoint::local_address() const noexcept {
  return state_->transport.socket().local_address();
}

const LinkStatistics& ServoEndpoint::statistics() const noexcept { return state_->statistics; }

ClockEstimate ServoEndpoint::clock() const noexcept { return state_->clock.estimate(); }

std::uint64_t ServoEndpoint::random_session_id() {
  std::uint64_t session_id = 0;
  while (session_id == 0) {
    if (::getrandom(&session_id, sizeof session_id, 0) != static_cast<ssize_t>(sizeof session_id) &&
        errno != EINTR) {
      throw LinkError("link: no random session id from the system: " +
                      std::generic_category().message(errno) + "; give one that no other run uses");
    }
  }
  return session_id;
}

}  // namespace forcegrid::link
