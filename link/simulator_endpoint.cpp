// SPDX-License-Identifier: Apache-2.0
#include "link/simulator_endpoint.h"

#include <algorithm>
#include <array>
#include <utility>
#include <variant>

#include "link/sequence_tracker.h"
#include "link/transport.h"
#include "link/wire.h"

namespace forcegrid::link {
namespace {

constexpr int kPositionsPerCall = 4096;
constexpr std::size_t kRememberedSessions = 16;

using SteadyTime = std::chrono::steady_clock::time_point;

/// The newest `Capacity` messages; the oldest comes out first.
template <typename Message, std::size_t Capacity>
class Queue {
 public:
  /// @returns whether an older one was dropped.
  bool push(const Message& message) noexcept {
    const bool full = size_ == Capacity;
    if (full) {
      begin_ = (begin_ + 1) % Capacity;
      --size_;
    }
    messages_[(begin_ + size_) % Capacity] = message;
    ++size_;
    return full;
  }
  std::optional<Message> pop() noexcept {
    if (size_ == 0) {
      return std::nullopt;
    }
    const Message message = messages_[begin_];
    begin_ = (begin_ + 1) % Capacity;
    --size_;
    return message;
  }
  void clear() noexcept { begin_ = size_ = 0; }
  std::size_t size() const noexcept { return size_; }

 private:
  std::array<Message, Capacity> messages_{};
  std::size_t begin_ = 0;
  std::size_t size_ = 0;
};

/// Refuses what parse_address() would, for an Address that was made in another way.
Address checked_local(const Address& address, Reach reach) {
  return parse_address(to_string(address), PortZero::kAllowed, reach);
}

}  // namespace

struct SimulatorEndpoint::State {
  State(const Address& address, std::chrono::nanoseconds silence, Access access)
      : allowed(std::move(access.allowed)),
        local(checked_local(address, reach_with(access.keys))),
        transport(LinkEnd::kSimulator, local, std::move(access.keys)),
        silence_limit(silence) {
    if (silence <= std::chrono::nanoseconds::zero()) {
      throw LinkError("link at " + to_string(address) +
                      ": the silence limit must be above zero, for example 2 s");
    }
  }

  void take(const UdpSocket::Received& received, std::span<std::byte> buffer, News& news) noexcept;
  [[nodiscard]] bool may_use(const Address& sender) const noexcept;
  bool belongs_to_servo(const Address& sender, const Decoded& decoded, News& news) noexcept;
  void take(const ToolState& state, News& news) noexcept;
  void take(const Query& query) noexcept;
  /// @returns whether the message of this number is to be used; counts it otherwise.
  bool track(SequenceTracker& tracker, std::uint32_t number) noexcept;
  void end_session() noexcept;
  [[nodiscard]] bool alive() const noexcept;
  template <typename Message>
  SendStatus transmit(const Message& message) noexcept;
  /// Sends it with the next number of `count`.
  template <typename Message>
  SendStatus transmit_numbered(const Message& message, std::uint32_t& count) noexcept;

  std::vector<AddressRange> allowed;
  Address local;  ///< as requested: port 0 for any
  Transport transport;
  std::chrono::nanoseconds silence_limit;
  LinkStatistics statistics;
  std::uint64_t sent_without_servo = 0;

  std::uint64_t session_id = 0;  ///< 0: no servo
  std::uint64_t session_count = 0;
  Address servo;
  SealedPeer servo_peer;
  SteadyTime last_heard;
  std::array<std::uint64_t, kRememberedSessions> ended_sessions{};
  std::size_t next_ended = 0;

  SequenceTracker tool_states;
  SequenceTracker query_ids;
  bool tool_state_seen = false;
  std::uint32_t newest_tool_state = 0;

  Queue<Query, kQueuedQueries> queries;
  Queue<ToolState, kQueuedToolStates> path;

  std::uint32_t sample_sequence = 0;
  std::uint32_t patch_sequence = 0;
};

bool SimulatorEndpoint::State::alive() const noexcept {
  return session_id != 0 && std::chrono::steady_clock::now() - last_heard < silence_limit;
}

void SimulatorEndpoint::State::end_session() noexcept {
  if (session_id != 0) {
    ended_sessions[next_ended] = session_id;
    next_ended = (next_ended + 1) % kRememberedSessions;
  }
  session_id = 0;
  tool_states.restart();
  query_ids.restart();
  tool_state_seen = false;
  queries.clear();
  path.clear();
}

bool SimulatorEndpoint::State::belongs_to_servo(const Address& sender, const Decoded& decoded,
                                                News& news) noexcept {
  if (decoded.session_id == session_id) {
    if (sender != servo) {
      ++statistics.foreign_address;
      return false;
    }
    last_heard = std::chrono::steady_clock::now();
    return true;
  }
  const bool opens = std::holds_alternative<ToolState>(decoded.message) ||
                     std::holds_alternative<Query>(decoded.message);
  const bool ended = std::ranges::find(ended_sessions, decoded.session_id) != ended_sessions.end();
  if (!opens || ended || (alive() && sender != servo)) {
    ++statistics.foreign_session;
    return false;
  }
  end_session();
  session_id = decoded.session_id;
  servo = sender;
  last_heard = std::chrono::steady_clock::now();
  if (session_count++ > 0) {
    ++statistics.restarts;
  }
  news.tool_state.reset();
  news.new_session = true;
  return true;
}

bool SimulatorEndpoint::State::track(SequenceTracker& tracker, std::uint32_t number) noexcept {
  const auto arrival = tracker.observe(number);
  statistics.lost = tool_states.missing() + query_ids.missing();
  switch (arrival) {
    case SequenceTracker::Arrival::kNewest:
      return true;
    case SequenceTracker::Arrival::kReordered:
      ++statistics.reordered;
      return true;
    case SequenceTracker::Arrival::kDuplicated:
      ++statistics.duplicated;
      return false;
    case SequenceTracker::Arrival::kTooOld:
      ++statistics.late;
      return false;
  }
  return false;
}

void SimulatorEndpoint::State::take(const ToolState& state, News& news) noexcept {
  if (!track(tool_states, state.sequence)) {
    return;
  }
  if (tool_state_seen && ahead_of(state.sequence, newest_tool_state) < 0) {
    ++statistics.late;
    return;
  }
  ++statistics.accepted;
  if (news.tool_state) {
    ++statistics.superseded;
  }
  tool_state_seen = true;
  newest_tool_state = state.sequence;
  news.tool_state = state;
  path.push(state);
}

void SimulatorEndpoint::State::take(const Query& query) noexcept {
  if (!track(query_ids, query.query_id)) {
    return;
  }
  if (queries.push(query)) {
    ++statistics.overflowed;
  } else {
    ++statistics.accepted;
  }
}

bool SimulatorEndpoint::State::may_use(const Address& sender) const noexcept {
  return allowed.empty() || std::ranges::any_of(allowed, [&](const AddressRange& range) {
           return range.contains(sender);
         });
}

void SimulatorEndpoint::State::take(const UdpSocket::Received& received,
                                    std::span<std::byte> buffer, News& news) noexcept {
  ++statistics.received;
  statistics.overrun = transport.socket().overrun();
  if (!may_use(received.sender)) {
    ++statistics.not_allowed;
    return;
  }
  const auto incoming = transport.open(received, buffer, statistics);
  if (!incoming || (incoming->times && incoming->datagram.empty())) {
    return;
  }
  const Decoded decoded = decode(incoming->datagram);
  if (decoded.status != WireStatus::kOk) {
    ++statistics.malformed[static_cast<std::size_t>(decoded.status)];
    return;
  }
  if (std::holds_alternative<ForceSample>(decoded.message) ||
      std::holds_alternative<SurfacePatch>(decoded.message)) {
    ++statistics.unexpected_type;
    return;
  }
  if (!belongs_to_servo(received.sender, decoded, news)) {
    return;
  }
  servo_peer = incoming->peer;
  if (const auto* state = std::get_if<ToolState>(&decoded.message)) {
    take(*state, news);
  } else if (const auto* query = std::get_if<Query>(&decoded.message)) {
    take(*query);
  } else {
    ++statistics.accepted;
    end_session();
    news.tool_state.reset();
    news.servo_ended = true;
  }
}

template <typename Message>
SendStatus SimulatorEndpoint::State::transmit(const Message& message) noexcept {
  std::array<std::byte, kMaxDatagramBytes> buffer;
  const SendStatus status =
      transport.send(servo, servo_peer, encode(message, session_id, buffer), buffer, statistics);
  statistics.send_no_peer = sent_without_servo + transport.socket().undelivered();
  return status;
}

SimulatorEndpoint::SimulatorEndpoint(const Address& address, std::chrono::nanoseconds silence_limit,
                                     Access access)
    : state_(std::make_unique<State>(address, silence_limit, std::move(access))) {}

SimulatorEndpoint::SimulatorEndpoint(std::string_view address,
                                     std::chrono::nanoseconds silence_limit, Access access)
    : state_(std::make_unique<State>(
          parse_address(address, PortZero::kAllowed, reach_with(access.keys)), silence_limit,
          std::move(access))) {}

SimulatorEndpoint::~SimulatorEndpoint() {
  if (state_->session_id != 0) {
    state_->transmit(Goodbye{});
  }
}

SimulatorEndpoint::News SimulatorEndpoint::receive(std::chrono::nanoseconds timeout) noexcept {
  State& own = *state_;
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  std::array<std::byte, kMaxDatagramBytes> buffer;
  News news;
  for (int left = kPositionsPerCall; left > 0;) {
    const std::uint64_t accepted_before = own.statistics.accepted;
    for (; left > 0; --left) {
      const UdpSocket::Received received = own.transport.socket().receive(buffer);
      if (received.kind == UdpSocket::Received::Kind::kNothing) {
        break;
      }
      own.take(received, buffer, news);
    }
    if (own.statistics.accepted != accepted_before || left == 0) {
      break;
    }
    if (own.transport.socket().wait(deadline - std::chrono::steady_clock::now()) !=
        UdpSocket::Wait::kReadable) {
      break;
    }
  }
  own.statistics.send_no_peer = own.sent_without_servo + own.transport.socket().undelivered();
  news.queries = own.queries.size();
  return news;
}

std::optional<Query> SimulatorEndpoint::next_query() noexcept { return state_->queries.pop(); }

std::optional<ToolState> SimulatorEndpoint::next_tool_state() noexcept {
  return state_->path.pop();
}

template <typename Message>
SendStatus SimulatorEndpoint::State::transmit_numbered(const Message& message,
                                                       std::uint32_t& count) noexcept {
  if (session_id == 0) {
    statistics.send_no_peer = ++sent_without_servo + transport.socket().undelivered();
    return SendStatus::kNoPeer;
  }
  Message numbered = message;
  numbered.sequence = count + 1;
  const SendStatus status = transmit(numbered);
  if (status == SendStatus::kSent) {
    count = numbered.sequence;
  }
  return status;
}

SendStatus SimulatorEndpoint::send(const ForceSample& sample) noexcept {
  return state_->transmit_numbered(sample, state_->sample_sequence);
}

SendStatus SimulatorEndpoint::send(const SurfacePatch& patch) noexcept {
  return state_->transmit_numbered(patch, state_->patch_sequence);
}

bool SimulatorEndpoint::servo_alive() const noexcept { return state_->alive(); }

std::uint64_t SimulatorEndpoint::session_count() const noexcept { return state_->session_count; }

std::uint64_t SimulatorEndpoint::session_id() const noexcept { return state_->session_id; }

const Address& SimulatorEndpoint::address() const noexcept {
  return state_->transport.socket().local_address();
}

std::uint16_t SimulatorEndpoint::port() const noexcept { return address().port; }

const LinkStatistics& SimulatorEndpoint::statistics() const noexcept { return state_->statistics; }

ForceSample answer_to(const ToolState& state) noexcept {
  ForceSample sample;
  sample.echo_sequence = state.sequence;
  sample.echo_servo_time_ns = state.servo_time_ns;
  sample.position_W_m = state.position_W_m;
  sample.contact_point_W_m = state.position_W_m;
  return sample;
}

SurfacePatch patch_for(const ToolState& state) noexcept {
  SurfacePatch patch;
  patch.echo_sequence = state.sequence;
  patch.echo_servo_time_ns = state.servo_time_ns;
  patch.position_W_m = state.position_W_m;
  return patch;
}

ForceSample answer_to(const Query& query) noexcept {
  ForceSample sample;
  sample.query_id = query.query_id;
  sample.echo_servo_time_ns = query.servo_time_ns;
  sample.position_W_m = query.position_W_m;
  sample.contact_point_W_m = query.position_W_m;
  return sample;
}

}  // namespace forcegrid::link
