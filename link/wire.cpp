// SPDX-License-Identifier: Apache-2.0
#include "link/wire.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <concepts>

namespace forcegrid::link {
namespace {

constexpr std::array<char, 4> kMagic = {'F', 'G', 'R', 'D'};

constexpr std::uint32_t kFlagInContact = 1U << 0U;
constexpr std::uint32_t kFlagConverged = 1U << 1U;
constexpr std::uint32_t kFlagHasStiffness = 1U << 2U;
constexpr std::uint8_t kPatchHasStiffness = 1U << 0U;
constexpr std::uint8_t kPatchHasPressForces = 1U << 1U;
constexpr std::uint16_t kOtherInContact = 1U << 0U;
constexpr std::uint32_t kKnownFlags = kFlagInContact | kFlagConverged | kFlagHasStiffness;

/// Appends little-endian fields; the caller ensures that they fit.
class Writer {
 public:
  explicit Writer(std::span<std::byte> buffer) noexcept : buffer_(buffer) {}

  template <std::unsigned_integral T>
  void put(T value) noexcept {
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      buffer_[used_++] = static_cast<std::byte>((value >> (8U * i)) & 0xFFU);
    }
  }
  void put(std::int64_t value) noexcept { put(static_cast<std::uint64_t>(value)); }
  void put(double value) noexcept { put(std::bit_cast<std::uint64_t>(value)); }
  void put(float value) noexcept { put(std::bit_cast<std::uint32_t>(value)); }
  template <typename T, std::size_t N>
  void put(const std::array<T, N>& values) noexcept {
    for (const T& value : values) {
      put(value);
    }
  }
  [[nodiscard]] std::size_t used() const noexcept { return used_; }

 private:
  std::span<std::byte> buffer_;
  std::size_t used_ = 0;
};

/// Reads little-endian fields; the caller ensures that they are there.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> buffer) noexcept : buffer_(buffer) {}

  template <std::unsigned_integral T>
  void get(T& value) noexcept {
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      bits |= std::to_integer<std::uint64_t>(buffer_[used_++]) << (8U * i);
    }
    value = static_cast<T>(bits);
  }
  void get(std::int64_t& value) noexcept {
    std::uint64_t bits = 0;
    get(bits);
    value = static_cast<std::int64_t>(bits);
  }
  void get(double& value) noexcept {
    std::uint64_t bits = 0;
    get(bits);
    value = std::bit_cast<double>(bits);
  }
  void get(float& value) noexcept {
    std::uint32_t bits = 0;
    get(bits);
    value = std::bit_cast<float>(bits);
  }
  template <typename T, std::size_t N>
  void get(std::array<T, N>& values) noexcept {
    for (T& value : values) {
      get(value);
    }
  }

 private:
  std::span<const std::byte> buffer_;
  std::size_t used_ = 0;
};

std::uint32_t checksum(std::span<const std::byte> bytes) noexcept {
  return static_cast<std::uint32_t>(
      ::crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

template <typename T, std::size_t N>
bool finite(const std::array<T, N>& values) noexcept {
  return std::ranges::all_of(values, [](T value) { return std::isfinite(value); });
}

template <typename T, std::size_t N>
bool within(const std::array<T, N>& values, double bound) noexcept {
  return std::ranges::all_of(values, [bound](T value) { return std::abs(value) <= bound; });
}

WireStatus check(const ToolState& message) noexcept {
  if (!finite(message.position_W_m) || !finite(message.velocity_W_m_per_s)) {
    return WireStatus::kNotFinite;
  }
  if (message.servo_time_ns < 0 || !within(message.position_W_m, kMaxPosition_m) ||
      !within(message.velocity_W_m_per_s, kMaxVelocity_m_per_s)) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

WireStatus check(const Query& message) noexcept {
  if (!finite(message.position_W_m)) {
    return WireStatus::kNotFinite;
  }
  if (message.query_id == 0 || message.servo_time_ns < 0 ||
      !within(message.position_W_m, kMaxPosition_m)) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

WireStatus check(const ForceSample& message) noexcept {
  if (!finite(message.position_W_m) || !finite(message.force_W_N) ||
      !finite(message.stiffness_W_N_per_m) || !finite(message.contact_point_W_m) ||
      !std::isfinite(message.relative_residual) || !std::isfinite(message.solve_time_s)) {
    return WireStatus::kNotFinite;
  }
  if (!message.has_stiffness && !within(message.stiffness_W_N_per_m, 0.0)) {
    return WireStatus::kBadReserved;
  }
  if (message.echo_servo_time_ns < 0 || !within(message.position_W_m, kMaxPosition_m) ||
      !within(message.force_W_N, kMaxForce_N) ||
      !within(message.stiffness_W_N_per_m, kMaxStiffness_N_per_m) ||
      !within(message.contact_point_W_m, kMaxPosition_m) || message.relative_residual < 0.0 ||
      message.solve_time_s < 0.0 || message.solve_time_s > kMaxSolveTime_s) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

WireStatus check(const Goodbye&) noexcept { return WireStatus::kOk; }

bool usable(ToolId tool) noexcept { return tool > 0 && tool <= kMaxToolId; }

WireStatus check(const OtherTools& message) noexcept {
  if (message.count > OtherTools::kMost) {
    return WireStatus::kOutOfRange;
  }
  const auto told = std::span(message.tools).first(message.count);
  const auto rest = std::span(message.tools).subspan(message.count);
  if (!std::ranges::all_of(message.tools,
                           [](const OtherTool& other) { return finite(other.position_W_m); })) {
    return WireStatus::kNotFinite;
  }
  if (!std::ranges::all_of(rest, [](const OtherTool& other) {
        return other.tool == 0 && !other.in_contact && other.age_ns == 0 &&
               within(other.position_W_m, 0.0);
      })) {
    return WireStatus::kBadReserved;
  }
  // A tool of version 1 is told as number 0.
  const bool in_range = std::ranges::all_of(told, [](const OtherTool& other) {
    return other.tool <= kMaxToolId && other.age_ns >= 0 &&
           within(other.position_W_m, kMaxPosition_m);
  });
  return in_range ? WireStatus::kOk : WireStatus::kOutOfRange;
}

WireStatus check(const Refusal& message) noexcept {
  const bool known = message.reason == Refusal::Reason::kAllPlacesTaken ||
                     message.reason == Refusal::Reason::kToolTaken ||
                     message.reason == Refusal::Reason::kOtherFault;
  return known && message.most_tools > 0 && message.most_tools <= kMostTools
             ? WireStatus::kOk
             : WireStatus::kOutOfRange;
}

// Everything beyond the counts must be zero, so that a message has one form.
bool nothing_undeclared(const SurfacePatch& message) noexcept {
  for (std::size_t v = message.vertex_count; v < message.vertices_W_m.size(); ++v) {
    if (!within(message.vertices_W_m[v], 0.0)) {
      return false;
    }
  }
  for (std::size_t t = message.triangle_count; t < message.triangles.size(); ++t) {
    if (message.triangles[t] != SurfacePatch::Triangle{}) {
      return false;
    }
  }
  const bool press_undeclared =
      !message.has_press_forces &&
      !std::ranges::all_of(message.press_forces_W_N, [](const auto& f) { return within(f, 0.0); });
  return !press_undeclared && !(message.has_stiffness && message.has_press_forces) &&
         (message.has_stiffness || within(message.stiffness_W_N_per_m, 0.0));
}

WireStatus check(const SurfacePatch& message) noexcept {
  if (message.vertex_count > SurfacePatch::kMaxVertices ||
      message.triangle_count > SurfacePatch::kMaxTriangles) {
    return WireStatus::kOutOfRange;
  }
  const auto all_finite = [](const auto& vector) { return finite(vector); };
  if (!finite(message.position_W_m) || !finite(message.stiffness_W_N_per_m) ||
      !std::isfinite(message.tool_radius_m) || !std::isfinite(message.tool_length_m) ||
      !std::ranges::all_of(message.press_forces_W_N, all_finite) ||
      !std::ranges::all_of(message.vertices_W_m, all_finite)) {
    return WireStatus::kNotFinite;
  }
  if (!nothing_undeclared(message)) {
    return WireStatus::kBadReserved;
  }
  const auto vertex_near = [](const auto& vertex) {
    return within(vertex, SurfacePatch::kMaxOffset_m);
  };
  const auto force_usual = [](const auto& force) { return within(force, kMaxForce_N); };
  const auto declared = [&message](const SurfacePatch::Triangle& triangle) {
    return std::ranges::all_of(triangle, [&](auto v) { return v < message.vertex_count; });
  };
  const auto triangles = std::span(message.triangles).first(message.triangle_count);
  if (message.echo_servo_time_ns < 0 || !within(message.position_W_m, kMaxPosition_m) ||
      !within(message.stiffness_W_N_per_m, kMaxStiffness_N_per_m) || message.tool_radius_m < 0.0F ||
      message.tool_radius_m > SurfacePatch::kMaxToolRadius_m || message.tool_length_m < 0.0F ||
      message.tool_length_m > SurfacePatch::kMaxToolLength_m ||
      message.tool_opening_crad > SurfacePatch::kMaxToolOpening_crad ||
      !std::ranges::all_of(message.press_forces_W_N, force_usual) ||
      !std::ranges::all_of(message.vertices_W_m, vertex_near) ||
      !std::ranges::all_of(triangles, declared)) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

constexpr std::size_t size_bytes(MessageType type) noexcept {
  switch (type) {
    case MessageType::kToolState:
      return kToolStateBytes;
    case MessageType::kQuery:
      return kQueryBytes;
    case MessageType::kForceSample:
      return kForceSampleBytes;
    case MessageType::kGoodbye:
      return kGoodbyeBytes;
    case MessageType::kSurfacePatch:
      return kSurfacePatchBytes;
    case MessageType::kOtherTools:
      return kOtherToolsBytes;
    case MessageType::kRefusal:
      return kRefusalBytes;
  }
  return 0;
}

constexpr bool in_version_1(MessageType type) noexcept {
  return type != MessageType::kOtherTools && type != MessageType::kRefusal;
}

void put_payload(Writer& writer, const ToolState& message) noexcept {
  writer.put(message.servo_time_ns);
  writer.put(message.position_W_m);
  writer.put(message.velocity_W_m_per_s);
}

void put_payload(Writer& writer, const Query& message) noexcept {
  writer.put(message.servo_time_ns);
  writer.put(message.position_W_m);
}

void put_payload(Writer& writer, const ForceSample& message) noexcept {
  writer.put(message.echo_servo_time_ns);
  writer.put(message.echo_sequence);
  writer.put(message.query_id);
  writer.put(message.contact_epoch);
  writer.put((message.in_contact ? kFlagInContact : 0U) |
             (message.converged ? kFlagConverged : 0U) |
             (message.has_stiffness ? kFlagHasStiffness : 0U));
  writer.put(message.position_W_m);
  writer.put(message.force_W_N);
  writer.put(message.contact_point_W_m);
  writer.put(message.relative_residual);
  writer.put(message.solve_time_s);
  writer.put(message.stiffness_W_N_per_m);
}

void put_payload(Writer&, const Goodbye&) noexcept {}

void put_payload(Writer& writer, const SurfacePatch& message) noexcept {
  writer.put(message.echo_servo_time_ns);
  writer.put(message.echo_sequence);
  writer.put(message.contact_epoch);
  writer.put(message.vertex_count);
  writer.put(message.triangle_count);
  writer.put(static_cast<std::uint8_t>((message.has_stiffness ? kPatchHasStiffness : 0U) |
                                       (message.has_press_forces ? kPatchHasPressForces : 0U)));
  writer.put(message.tool_opening_crad);
  writer.put(message.tool_radius_m);
  writer.put(message.tool_length_m);
  if (message.has_press_forces) {
    writer.put(message.press_forces_W_N);
  } else {
    writer.put(message.stiffness_W_N_per_m);
  }
  writer.put(message.position_W_m);
  writer.put(message.vertices_W_m);
  writer.put(message.triangles);
}

void put_payload(Writer& writer, const OtherTools& message) noexcept {
  writer.put(message.count);
  writer.put(std::uint32_t{0});
  for (const OtherTool& other : message.tools) {
    writer.put(other.tool);
    writer.put(other.in_contact ? kOtherInContact : std::uint16_t{0});
    writer.put(std::uint32_t{0});
    writer.put(other.age_ns);
    writer.put(other.position_W_m);
  }
}

void put_payload(Writer& writer, const Refusal& message) noexcept {
  writer.put(static_cast<std::uint32_t>(message.reason));
  writer.put(message.most_tools);
}

template <typename Message>
Encoded encode_as(MessageType type, std::uint32_t sequence, const Message& message,
                  std::uint64_t session_id, std::span<std::byte> buffer, ToolId tool) noexcept {
  const std::size_t size = size_bytes(type);
  if (buffer.size() < size) {
    return {WireStatus::kTooShort, 0};
  }
  if (const WireStatus status = check(message); status != WireStatus::kOk) {
    return {status, 0};
  }
  if (session_id == 0 || (tool == 0 ? !in_version_1(type) : !usable(tool))) {
    return {WireStatus::kOutOfRange, 0};
  }
  Writer writer(buffer);
  for (const char letter : kMagic) {
    writer.put(static_cast<std::uint8_t>(letter));
  }
  writer.put(tool == 0 ? kProtocolVersion : kToolsVersion);
  writer.put(static_cast<std::uint16_t>(type));
  writer.put(static_cast<std::uint16_t>(size - kHeaderBytes - kChecksumBytes));
  writer.put(tool);
  writer.put(sequence);
  writer.put(session_id);
  put_payload(writer, message);
  writer.put(checksum(buffer.first(writer.used())));
  return {WireStatus::kOk, writer.used()};
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, ToolState& message) noexcept {
  message.sequence = sequence;
  reader.get(message.servo_time_ns);
  reader.get(message.position_W_m);
  reader.get(message.velocity_W_m_per_s);
  return check(message);
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Query& message) noexcept {
  message.query_id = sequence;
  reader.get(message.servo_time_ns);
  reader.get(message.position_W_m);
  return check(message);
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, ForceSample& message) noexcept {
  message.sequence = sequence;
  reader.get(message.echo_servo_time_ns);
  reader.get(message.echo_sequence);
  reader.get(message.query_id);
  reader.get(message.contact_epoch);
  std::uint32_t flags = 0;
  reader.get(flags);
  message.in_contact = (flags & kFlagInContact) != 0;
  message.converged = (flags & kFlagConverged) != 0;
  message.has_stiffness = (flags & kFlagHasStiffness) != 0;
  reader.get(message.position_W_m);
  reader.get(message.force_W_N);
  reader.get(message.contact_point_W_m);
  reader.get(message.relative_residual);
  reader.get(message.solve_time_s);
  reader.get(message.stiffness_W_N_per_m);
  return (flags & ~kKnownFlags) != 0 ? WireStatus::kBadReserved : check(message);
}

WireStatus get_payload(Reader&, std::uint32_t sequence, Goodbye& message) noexcept {
  message.fault = sequence == 1;
  return sequence <= 1 ? WireStatus::kOk : WireStatus::kBadReserved;
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, SurfacePatch& message) noexcept {
  message.sequence = sequence;
  reader.get(message.echo_servo_time_ns);
  reader.get(message.echo_sequence);
  reader.get(message.contact_epoch);
  reader.get(message.vertex_count);
  reader.get(message.triangle_count);
  std::uint8_t flags = 0;
  reader.get(flags);
  message.has_stiffness = (flags & kPatchHasStiffness) != 0;
  message.has_press_forces = (flags & kPatchHasPressForces) != 0;
  reader.get(message.tool_opening_crad);
  reader.get(message.tool_radius_m);
  reader.get(message.tool_length_m);
  if (message.has_press_forces) {
    reader.get(message.press_forces_W_N);
  } else {
    reader.get(message.stiffness_W_N_per_m);
  }
  reader.get(message.position_W_m);
  reader.get(message.vertices_W_m);
  reader.get(message.triangles);
  const bool known = (flags & ~(kPatchHasStiffness | kPatchHasPressForces)) == 0;
  return known ? check(message) : WireStatus::kBadReserved;
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, OtherTools& message) noexcept {
  message.sequence = sequence;
  reader.get(message.count);
  std::uint32_t reserved = 0;
  reader.get(reserved);
  bool known = reserved == 0;
  for (OtherTool& other : message.tools) {
    std::uint16_t flags = 0;
    reader.get(other.tool);
    reader.get(flags);
    reader.get(reserved);
    reader.get(other.age_ns);
    reader.get(other.position_W_m);
    other.in_contact = (flags & kOtherInContact) != 0;
    known = known && reserved == 0 && (flags & ~kOtherInContact) == 0;
  }
  return known ? check(message) : WireStatus::kBadReserved;
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Refusal& message) noexcept {
  std::uint32_t reason = 0;
  reader.get(reason);
  reader.get(message.most_tools);
  message.reason = static_cast<Refusal::Reason>(reason);
  return sequence == 0 ? check(message) : WireStatus::kBadReserved;
}

template <typename Message>
Decoded decode_as(Reader reader, std::uint32_t sequence, std::uint64_t session_id,
                  ToolId tool) noexcept {
  Message message;
  WireStatus status = get_payload(reader, sequence, message);
  if (status == WireStatus::kOk && session_id == 0) {
    status = WireStatus::kOutOfRange;
  }
  if (status != WireStatus::kOk) {
    return {status, 0, {}, 0};
  }
  return {WireStatus::kOk, session_id, message, tool};
}

Decoded refused(WireStatus status) noexcept { return {status, 0, {}, 0}; }

}  // namespace

const char* to_string(WireStatus status) noexcept {
  switch (status) {
    case WireStatus::kOk:
      return "ok";
    case WireStatus::kTooShort:
      return "too short";
    case WireStatus::kBadMagic:
      return "bad magic";
    case WireStatus::kBadVersion:
      return "bad version";
    case WireStatus::kBadType:
      return "bad type";
    case WireStatus::kBadLength:
      return "bad length";
    case WireStatus::kBadChecksum:
      return "bad checksum";
    case WireStatus::kBadReserved:
      return "reserved field not zero";
    case WireStatus::kNotFinite:
      return "not finite";
    case WireStatus::kOutOfRange:
      return "out of range";
  }
  return "unknown wire status";
}

Decoded decode(std::span<const std::byte> datagram) noexcept {
  if (datagram.size() < kHeaderBytes + kChecksumBytes) {
    return refused(WireStatus::kTooShort);
  }
  Reader reader(datagram);
  for (const char letter : kMagic) {
    std::uint8_t byte = 0;
    reader.get(byte);
    if (byte != static_cast<std::uint8_t>(letter)) {
      return refused(WireStatus::kBadMagic);
    }
  }
  std::uint16_t version = 0;
  std::uint16_t type_number = 0;
  std::uint16_t payload_bytes = 0;
  ToolId tool = 0;
  std::uint32_t sequence = 0;
  std::uint64_t session_id = 0;
  reader.get(version);
  reader.get(type_number);
  reader.get(payload_bytes);
  reader.get(tool);
  reader.get(sequence);
  reader.get(session_id);
  if (version != kProtocolVersion && version != kToolsVersion) {
    return refused(WireStatus::kBadVersion);
  }
  const auto type = static_cast<MessageType>(type_number);
  const std::size_t size = size_bytes(type);
  if (size == 0 || (version == kProtocolVersion && !in_version_1(type))) {
    return refused(WireStatus::kBadType);
  }
  if (datagram.size() != size || payload_bytes != size - kHeaderBytes - kChecksumBytes) {
    return refused(WireStatus::kBadLength);
  }
  std::uint32_t stated_checksum = 0;
  Reader(datagram.last(kChecksumBytes)).get(stated_checksum);
  if (stated_checksum != checksum(datagram.first(size - kChecksumBytes))) {
    return refused(WireStatus::kBadChecksum);
  }
  if (version == kProtocolVersion && tool != 0) {
    return refused(WireStatus::kBadReserved);
  }
  if (version == kToolsVersion && !usable(tool)) {
    return refused(WireStatus::kOutOfRange);
  }
  switch (type) {
    case MessageType::kToolState:
      return decode_as<ToolState>(reader, sequence, session_id, tool);
    case MessageType::kQuery:
      return decode_as<Query>(reader, sequence, session_id, tool);
    case MessageType::kForceSample:
      return decode_as<ForceSample>(reader, sequence, session_id, tool);
    case MessageType::kGoodbye:
      if (version == kProtocolVersion && sequence != 0) {
        return refused(WireStatus::kBadReserved);
      }
      return decode_as<Goodbye>(reader, sequence, session_id, tool);
    case MessageType::kSurfacePatch:
      return decode_as<SurfacePatch>(reader, sequence, session_id, tool);
    case MessageType::kOtherTools:
      return decode_as<OtherTools>(reader, sequence, session_id, tool);
    case MessageType::kRefusal:
      return decode_as<Refusal>(reader, sequence, session_id, tool);
  }
  return refused(WireStatus::kBadType);
}

Encoded encode(const ToolState& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool) noexcept {
  return encode_as(MessageType::kToolState, message.sequence, message, session_id, buffer, tool);
}

Encoded encode(const Query& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool) noexcept {
  return encode_as(MessageType::kQuery, message.query_id, message, session_id, buffer, tool);
}

Encoded encode(const ForceSample& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool) noexcept {
  return encode_as(MessageType::kForceSample, message.sequence, message, session_id, buffer, tool);
}

Encoded encode(const Goodbye& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool) noexcept {
  return encode_as(MessageType::kGoodbye, tool != 0 && message.fault ? 1 : 0, message, session_id,
                   buffer, tool);
}

Encoded encode(const SurfacePatch& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool) noexcept {
  return encode_as(MessageType::kSurfacePatch, message.sequence, message, session_id, buffer, tool);
}

Encoded encode(const OtherTools& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool) noexcept {
  return encode_as(MessageType::kOtherTools, message.sequence, message, session_id, buffer, tool);
}

Encoded encode(const Refusal& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool) noexcept {
  return encode_as(MessageType::kRefusal, 0, message, session_id, buffer, tool);
}

}  // namespace forcegrid::link
