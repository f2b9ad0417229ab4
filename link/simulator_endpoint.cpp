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
constexpr std::size_t kRememberedSessions = 16 * kMostTools;

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

/// A servo that is served, and what it has sent.
struct Place {
  std::uint64_t session_id = 0;  ///< 0: no servo
  ToolId tool = 0;               ///< 0: it names none
  Content content = Content::kPosition;
  Address servo;
  SealedPeer peer;
  SteadyTime last_heard;

  SequenceTracker tool_states;
  SequenceTracker query_ids;
  bool tool_state_seen = false;
  ToolState newest_tool_state;

  Queue<Query, kQueuedQueries> queries;
  Queue<ToolState, kQueuedToolStates> path;

  std::uint32_t sample_sequence = 0;
  std::uint32_t patch_sequence = 0;
  std::uint32_t others_sequence = 0;
};

/// `state` of a version without poses, with the pose that was told last.
ToolState with_pose_of(const ToolState& last, const ToolState& state) noexcept {
  ToolState posed = last;
  posed.sequence = state.sequence;
  posed.servo_time_ns = state.servo_time_ns;
  posed.position_W_m = state.position_W_m;
  posed.velocity_W_m_per_s = state.velocity_W_m_per_s;
  return posed;
}

bool opens_a_session(const Decoded& decoded) noexcept {
  return std::holds_alternative<ToolState>(decoded.message) ||
         std::holds_alternative<Query>(decoded.message);
}

}  // namespace

struct SimulatorEndpoint::State {
  using AllNews = std::array<News, kMostTools>;

  State(const Address& address, std::chrono::nanoseconds silence, Access access,
        std::size_t place_count)
      : allowed(std::move(access.allowed)),
        local(checked_local(address, reach_with(access.keys))),
        transport(LinkEnd::kSimulator, local, std::move(access.keys)),
        silence_limit(silence),
        places(place_count) {
    if (place_count == 0 || place_count > kMostTools) {
      throw LinkError("link at " + to_string(address) + ": " + std::to_string(place_count) +
                      " places for servos; give 1 to " + std::to_string(kMostTools));
    }
    if (silence <= std::chrono::nanoseconds::zero()) {
      throw LinkError("link at " + to_string(address) +
                      ": the silence limit must be above zero, for example 2 s");
    }
  }

  void take(const UdpSocket::Received& received, std::span<std::byte> buffer,
            AllNews& news) noexcept;
  [[nodiscard]] bool may_use(const Address& sender) const noexcept;
  /// The place whose servo has sent this, perhaps just taken; null: it is refused, and counted.
  Place* place_of(const Address& sender, const Decoded& decoded, const SealedPeer& peer,
                  AllNews& news) noexcept;
  /// The place that a new session may have; null: it is refused.
  Place* place_for(const Address& sender, const Decoded& decoded, const SealedPeer& peer) noexcept;
  /// The place of another living servo with this tool.
  [[nodiscard]] bool taken(ToolId tool, const Place* but) const noexcept;
  void refuse(const Address& sender, const Decoded& decoded, const SealedPeer& peer,
              Refusal::Reason reason) noexcept;
  void take(const ToolState& state, Content content, Place& place, News& news) noexcept;
  void take(const Query& query, Place& place) noexcept;
  /// @returns whether the message of this number is to be used; counts it otherwise.
  bool track(SequenceTracker& tracker, std::uint32_t number) noexcept;
  void end_session(Place& place) noexcept;
  [[nodiscard]] bool alive(const Place& place) const noexcept;
  template <typename Message>
  SendStatus transmit(const Message& message, const Place& place) noexcept;
  /// Sends it with the next number of `count`.
  template <typename Message>
  SendStatus transmit_numbered(const Message& message, const Place& place,
                               std::uint32_t& count) noexcept;

  std::vector<AddressRange> allowed;
  Address local;  ///< as requested: port 0 for any
  Transport transport;
  std::chrono::nanoseconds silence_limit;
  LinkStatistics statistics;
  std::uint64_t sent_without_servo = 0;

  std::uint64_t session_count = 0;
  std::vector<Place> places;
  std::array<std::uint64_t, kRememberedSessions> ended_sessions{};
  std::size_t next_ended = 0;
};

bool SimulatorEndpoint::State::alive(const Place& place) const noexcept {
  return place.session_id != 0 &&
         std::chrono::steady_clock::now() - place.last_heard < silence_limit;
}

void SimulatorEndpoint::State::end_session(Place& place) noexcept {
  if (place.session_id != 0) {
    ended_sessions[next_ended] = place.session_id;
    next_ended = (next_ended + 1) % kRememberedSessions;
  }
  place.session_id = 0;
  place.tool = 0;
  place.content = Content::kPosition;
  place.tool_states.restart();
  place.query_ids.restart();
  place.tool_state_seen = false;
  place.newest_tool_state = {};
  place.queries.clear();
  place.path.clear();
}

bool SimulatorEndpoint::State::taken(ToolId tool, const Place* but) const noexcept {
  return std::ranges::any_of(places, [&](const Place& place) {
    return &place != but && place.tool == tool && alive(place);
  });
}

void SimulatorEndpoint::State::refuse(const Address& sender, const Decoded& decoded,
                                      const SealedPeer& peer, Refusal::Reason reason) noexcept {
  ++statistics.foreign_session;
  if (decoded.tool == 0) {
    return;
  }
  std::array<std::byte, kMaxDatagramBytes> buffer;
  const Refusal refusal = {reason, static_cast<std::uint32_t>(places.size())};
  static_cast<void>(transport.send(
      sender, peer, encode(refusal, decoded.session_id, buffer, decoded.tool, decoded.content),
      buffer, statistics));
}

Place* SimulatorEndpoint::State::place_for(const Address& sender, const Decoded& decoded,
                                           const SealedPeer& peer) noexcept {
  const bool ended = std::ranges::find(ended_sessions, decoded.session_id) != ended_sessions.end();
  if (!opens_a_session(decoded) || ended) {
    ++statistics.foreign_session;
    return nullptr;
  }
  const auto of_sender = std::ranges::find_if(
      places, [&](const Place& place) { return place.session_id != 0 && place.servo == sender; });
  const auto of_tool = std::ranges::find_if(places, [&](const Place& place) {
    return place.session_id != 0 && place.tool == decoded.tool;
  });
  const auto without_servo =
      std::ranges::find_if(places, [](const Place& place) { return place.session_id == 0; });
  const auto silent =
      std::ranges::find_if(places, [this](const Place& place) { return !alive(place); });
  const Place* const own = of_sender == places.end() ? nullptr : &*of_sender;
  if (places.size() > 1 && taken(decoded.tool, own)) {
    refuse(sender, decoded, peer, Refusal::Reason::kToolTaken);
    return nullptr;
  }
  for (const auto candidate : {of_sender, of_tool, without_servo, silent}) {
    if (candidate != places.end() && (candidate == of_sender || !alive(*candidate))) {
      return &*candidate;
    }
  }
  refuse(sender, decoded, peer, Refusal::Reason::kAllPlacesTaken);
  return nullptr;
}

Place* SimulatorEndpoint::State::place_of(const Address& sender, const Decoded& decoded,
                                          const SealedPeer& peer, AllNews& news) noexcept {
  const auto known = std::ranges::find_if(
      places, [&](const Place& place) { return place.session_id == decoded.session_id; });
  if (known != places.end()) {
    if (sender != known->servo || peer.key_index != known->peer.key_index) {
      ++statistics.foreign_address;
      return nullptr;
    }
    // A servo tries older versions now and then until it is answered in its own.
    if (decoded.tool != 0 && decoded.tool != known->tool) {
      if (known->tool != 0 || taken(decoded.tool, &*known)) {
        refuse(sender, decoded, peer, Refusal::Reason::kToolTaken);
        return nullptr;
      }
      known->tool = decoded.tool;
    }
    known->content = std::max(known->content, decoded.content);
    known->last_heard = std::chrono::steady_clock::now();
    return &*known;
  }
  Place* const place = place_for(sender, decoded, peer);
  if (place == nullptr) {
    return nullptr;
  }
  end_session(*place);
  place->session_id = decoded.session_id;
  place->tool = decoded.tool;
  place->content = decoded.content;
  place->servo = sender;
  place->last_heard = std::chrono::steady_clock::now();
  if (session_count++ > 0) {
    ++statistics.restarts;
  }
  News& of_place = news[static_cast<std::size_t>(place - places.data())];
  of_place.tool_state.reset();
  of_place.new_session = true;
  return place;
}

bool SimulatorEndpoint::State::track(SequenceTracker& tracker, std::uint32_t number) noexcept {
  const auto arrival = tracker.observe(number);
  statistics.lost = 0;
  for (const Place& place : places) {
    statistics.lost += place.tool_states.missing() + place.query_ids.missing();
  }
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

void SimulatorEndpoint::State::take(const ToolState& state, Content content, Place& place,
                                    News& news) noexcept {
  if (!track(place.tool_states, state.sequence)) {
    return;
  }
  if (place.tool_state_seen && ahead_of(state.sequence, place.newest_tool_state.sequence) < 0) {
    ++statistics.late;
    return;
  }
  ++statistics.accepted;
  if (news.tool_state) {
    ++statistics.superseded;
  }
  place.tool_state_seen = true;
  place.newest_tool_state =
      content == Content::kPosition ? with_pose_of(place.newest_tool_state, state) : state;
  news.tool_state = place.newest_tool_state;
  place.path.push(place.newest_tool_state);
}

void SimulatorEndpoint::State::take(const Query& query, Place& place) noexcept {
  if (!track(place.query_ids, query.query_id)) {
    return;
  }
  if (place.queries.push(query)) {
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
                                    std::span<std::byte> buffer, AllNews& news) noexcept {
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
  if (!opens_a_session(decoded) && !std::holds_alternative<Goodbye>(decoded.message)) {
    ++statistics.unexpected_type;
    return;
  }
  Place* const place = place_of(received.sender, decoded, incoming->peer, news);
  if (place == nullptr) {
    return;
  }
  place->peer = incoming->peer;
  News& of_place = news[static_cast<std::size_t>(place - places.data())];
  if (const auto* state = std::get_if<ToolState>(&decoded.message)) {
    take(*state, decoded.content, *place, of_place);
  } else if (const auto* query = std::get_if<Query>(&decoded.message)) {
    take(*query, *place);
  } else if (const auto* goodbye = std::get_if<Goodbye>(&decoded.message)) {
    ++statistics.accepted;
    of_place.servo_failed = goodbye->fault;
    end_session(*place);
    of_place.tool_state.reset();
    of_place.servo_ended = true;
  }
}

template <typename Message>
SendStatus SimulatorEndpoint::State::transmit(const Message& message, const Place& place) noexcept {
  std::array<std::byte, kMaxDatagramBytes> buffer;
  const SendStatus status = transport.send(
      place.servo, place.peer, encode(message, place.session_id, buffer, place.tool, place.content),
      buffer, statistics);
  statistics.send_no_peer = sent_without_servo + transport.socket().undelivered();
  return status;
}

SimulatorEndpoint::SimulatorEndpoint(const Address& address, std::chrono::nanoseconds silence_limit,
                                     Access access, std::size_t places)
    : state_(std::make_unique<State>(address, silence_limit, std::move(access), places)) {}

SimulatorEndpoint::SimulatorEndpoint(std::string_view address,
                                     std::chrono::nanoseconds silence_limit, Access access,
                                     std::size_t places)
    : state_(std::make_unique<State>(
          parse_address(address, PortZero::kAllowed, reach_with(access.keys)), silence_limit,
          std::move(access), places)) {}

SimulatorEndpoint::~SimulatorEndpoint() {
  for (const Place& place : state_->places) {
    if (place.session_id != 0) {
      state_->transmit(Goodbye{}, place);
    }
  }
}

SimulatorEndpoint::News SimulatorEndpoint::receive(std::chrono::nanoseconds timeout) noexcept {
  return receive_all(timeout).front();
}

std::array<SimulatorEndpoint::News, kMostTools> SimulatorEndpoint::receive_all(
    std::chrono::nanoseconds timeout) noexcept {
  State& own = *state_;
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  std::array<std::byte, kMaxDatagramBytes> buffer;
  State::AllNews news;
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
  for (std::size_t place = 0; place < own.places.size(); ++place) {
    news[place].queries = own.places[place].queries.size();
  }
  return news;
}

std::optional<Query> SimulatorEndpoint::next_query(std::size_t place) noexcept {
  return state_->places[place].queries.pop();
}

std::optional<ToolState> SimulatorEndpoint::next_tool_state(std::size_t place) noexcept {
  return state_->places[place].path.pop();
}

template <typename Message>
SendStatus SimulatorEndpoint::State::transmit_numbered(const Message& message, const Place& place,
                                                       std::uint32_t& count) noexcept {
  if (place.session_id == 0) {
    statistics.send_no_peer = ++sent_without_servo + transport.socket().undelivered();
    return SendStatus::kNoPeer;
  }
  Message numbered = message;
  numbered.sequence = count + 1;
  const SendStatus status = transmit(numbered, place);
  if (status == SendStatus::kSent) {
    count = numbered.sequence;
  }
  return status;
}

SendStatus SimulatorEndpoint::send(const ForceSample& sample, std::size_t place) noexcept {
  Place& to = state_->places[place];
  return state_->transmit_numbered(sample, to, to.sample_sequence);
}

SendStatus SimulatorEndpoint::send(const SurfacePatch& patch, std::size_t place) noexcept {
  Place& to = state_->places[place];
  return state_->transmit_numbered(patch, to, to.patch_sequence);
}

SendStatus SimulatorEndpoint::send(const OtherTools& others, std::size_t place) noexcept {
  Place& to = state_->places[place];
  return state_->transmit_numbered(others, to, to.others_sequence);
}

SendStatus SimulatorEndpoint::send(const Refusal& refusal, std::size_t place) noexcept {
  const Place& to = state_->places[place];
  return to.session_id == 0 ? SendStatus::kNoPeer : state_->transmit(refusal, to);
}

bool SimulatorEndpoint::servo_alive(std::size_t place) const noexcept {
  return state_->alive(state_->places[place]);
}

ToolId SimulatorEndpoint::tool(std::size_t place) const noexcept {
  return state_->places[place].tool;
}

bool SimulatorEndpoint::knows_poses(std::size_t place) const noexcept {
  return state_->places[place].content >= Content::kPose;
}

bool SimulatorEndpoint::knows_sensitivities(std::size_t place) const noexcept {
  return state_->places[place].content == Content::kSensitivities;
}

std::uint64_t SimulatorEndpoint::session_count() const noexcept { return state_->session_count; }

std::uint64_t SimulatorEndpoint::session_id(std::size_t place) const noexcept {
  return state_->places[place].session_id;
}

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
  sample.orientation_WT = state.orientation_WT;
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
