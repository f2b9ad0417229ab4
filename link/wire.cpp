// SPDX-License-Identifier: Apache-2.0
#include "link/wire.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>

#include "link/message_check.h"

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
constexpr std::uint32_t kFlagHasTorque = 1U << 3U;
constexpr std::uint32_t kFlagHasRotationalStiffness = 1U << 4U;
constexpr std::uint32_t kPoseFlags = kFlagHasTorque | kFlagHasRotationalStiffness;
constexpr std::uint32_t kFlagHasTorqueGradient = 1U << 5U;
constexpr std::uint32_t kStateHasOrientation = 1U << 0U;
constexpr std::uint32_t kStateHasButtons = 1U << 1U;

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

bool usable(ToolId tool) noexcept { return tool > 0 && tool <= kMaxToolId; }

template <std::size_t N>
bool same_bits(const std::array<double, N>& a, const std::array<double, N>& b) noexcept {
  const auto bits = [](double value) { return std::bit_cast<std::uint64_t>(value); };
  return std::ranges::equal(a, b, {}, bits, bits);
}

constexpr std::size_t size_bytes(MessageType type, Content content) noexcept {
  switch (type) {
    case MessageType::kToolState:
      return content == Content::kPosition ? kToolStateBytes : kPoseToolStateBytes;
    case MessageType::kQuery:
      return kQueryBytes;
    case MessageType::kForceSample:
      return content == Content::kPosition ? kForceSampleBytes
             : content == Content::kPose   ? kPoseForceSampleBytes
                                           : kSensitivitiesForceSampleBytes;
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

constexpr bool needs_no_tool(MessageType type) noexcept {
  return type != MessageType::kOtherTools && type != MessageType::kRefusal;
}

constexpr std::uint16_t version_of(ToolId tool, Content content) noexcept {
  switch (content) {
    case Content::kSensitivities:
      return kSensitivitiesVersion;
    case Content::kPose:
      return kPoseVersion;
    case Content::kPosition:
      break;
  }
  return tool == 0 ? kProtocolVersion : kToolsVersion;
}

constexpr Content content_of(std::uint16_t version) noexcept {
  return version == kSensitivitiesVersion ? Content::kSensitivities
         : version == kPoseVersion        ? Content::kPose
                                          : Content::kPosition;
}

constexpr std::uint32_t known_flags(Content content) noexcept {
  return content == Content::kPosition ? kKnownFlags
         : content == Content::kPose   ? kKnownFlags | kPoseFlags
                                       : kKnownFlags | kPoseFlags | kFlagHasTorqueGradient;
}

void put_payload(Writer& writer, const ToolState& message, Content content) noexcept {
  writer.put(message.servo_time_ns);
  writer.put(message.position_W_m);
  writer.put(message.velocity_W_m_per_s);
  if (content != Content::kPosition) {
    writer.put(message.orientation_WT);
    writer.put(message.angular_velocity_W_rad_per_s);
    writer.put(message.buttons);
    writer.put((message.has_orientation ? kStateHasOrientation : 0U) |
               (message.has_buttons ? kStateHasButtons : 0U));
  }
}

void put_payload(Writer& writer, const Query& message, Content) noexcept {
  writer.put(message.servo_time_ns);
  writer.put(message.position_W_m);
}

void put_payload(Writer& writer, const ForceSample& message, Content content) noexcept {
  writer.put(message.echo_servo_time_ns);
  writer.put(message.echo_sequence);
  writer.put(message.query_id);
  writer.put(message.contact_epoch);
  writer.put(((message.in_contact ? kFlagInContact : 0U) |
              (message.converged ? kFlagConverged : 0U) |
              (message.has_stiffness ? kFlagHasStiffness : 0U) |
              (message.has_torque ? kFlagHasTorque : 0U) |
              (message.has_rotational_stiffness ? kFlagHasRotationalStiffness : 0U) |
              (message.has_torque_gradient ? kFlagHasTorqueGradient : 0U)) &
             known_flags(content));
  writer.put(message.position_W_m);
  writer.put(message.force_W_N);
  writer.put(message.contact_point_W_m);
  writer.put(message.relative_residual);
  writer.put(message.solve_time_s);
  writer.put(message.stiffness_W_N_per_m);
  if (content == Content::kPosition) {
    return;
  }
  writer.put(message.torque_W_Nm);
  writer.put(message.has_torque ? message.orientation_WT : kIdentity);
  writer.put(message.rotational_stiffness_W_Nm_per_rad);
  if (content == Content::kPose) {
    return;
  }
  writer.put(message.torque_gradient_W_N);
  writer.put(message.influence_count);
  for (const ToolInfluence& other : message.influences) {
    writer.put(other.tool);
    writer.put(std::uint16_t{0});
    writer.put(other.echo_sequence);
    writer.put(other.position_W_m);
    writer.put(other.stiffness_W_N_per_m);
  }
}

void put_payload(Writer&, const Goodbye&, Content) noexcept {}

void put_payload(Writer& writer, const SurfacePatch& message, Content) noexcept {
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

void put_payload(Writer& writer, const OtherTools& message, Content) noexcept {
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

void put_payload(Writer& writer, const Refusal& message, Content) noexcept {
  writer.put(static_cast<std::uint32_t>(message.reason));
  writer.put(message.most_tools);
}

template <typename Message>
Encoded encode_as(MessageType type, std::uint32_t sequence, const Message& message,
                  std::uint64_t session_id, std::span<std::byte> buffer, ToolId tool,
                  Content content) noexcept {
  const std::size_t size = size_bytes(type, content);
  if (buffer.size() < size) {
    return {WireStatus::kTooShort, 0};
  }
  if (const WireStatus status = check(message); status != WireStatus::kOk) {
    return {status, 0};
  }
  if (session_id == 0 || (tool == 0 ? !needs_no_tool(type) : !usable(tool))) {
    return {WireStatus::kOutOfRange, 0};
  }
  Writer writer(buffer);
  for (const char letter : kMagic) {
    writer.put(static_cast<std::uint8_t>(letter));
  }
  writer.put(version_of(tool, content));
  writer.put(static_cast<std::uint16_t>(type));
  writer.put(static_cast<std::uint16_t>(size - kHeaderBytes - kChecksumBytes));
  writer.put(tool);
  writer.put(sequence);
  writer.put(session_id);
  put_payload(writer, message, content);
  writer.put(checksum(buffer.first(writer.used())));
  return {WireStatus::kOk, writer.used()};
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Content content,
                       ToolState& message) noexcept {
  message.sequence = sequence;
  reader.get(message.servo_time_ns);
  reader.get(message.position_W_m);
  reader.get(message.velocity_W_m_per_s);
  if (content == Content::kPosition) {
    return check(message);
  }
  reader.get(message.orientation_WT);
  reader.get(message.angular_velocity_W_rad_per_s);
  reader.get(message.buttons);
  std::uint32_t flags = 0;
  reader.get(flags);
  message.has_orientation = (flags & kStateHasOrientation) != 0;
  message.has_buttons = (flags & kStateHasButtons) != 0;
  const bool known = (flags & ~(kStateHasOrientation | kStateHasButtons)) == 0;
  return known ? check(message) : WireStatus::kBadReserved;
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Content, Query& message) noexcept {
  message.query_id = sequence;
  reader.get(message.servo_time_ns);
  reader.get(message.position_W_m);
  return check(message);
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Content content,
                       ForceSample& message) noexcept {
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
  bool known = (flags & ~known_flags(content)) == 0;
  if (content != Content::kPosition) {
    message.has_torque = (flags & kFlagHasTorque) != 0;
    message.has_rotational_stiffness = (flags & kFlagHasRotationalStiffness) != 0;
    reader.get(message.torque_W_Nm);
    reader.get(message.orientation_WT);
    reader.get(message.rotational_stiffness_W_Nm_per_rad);
    known = known && (message.has_torque || same_bits(message.orientation_WT, kIdentity));
  }
  if (content == Content::kSensitivities) {
    message.has_torque_gradient = (flags & kFlagHasTorqueGradient) != 0;
    reader.get(message.torque_gradient_W_N);
    reader.get(message.influence_count);
    for (ToolInfluence& other : message.influences) {
      std::uint16_t reserved = 0;
      reader.get(other.tool);
      reader.get(reserved);
      reader.get(other.echo_sequence);
      reader.get(other.position_W_m);
      reader.get(other.stiffness_W_N_per_m);
      known = known && reserved == 0;
    }
  }
  return known ? check(message) : WireStatus::kBadReserved;
}

WireStatus get_payload(Reader&, std::uint32_t sequence, Content, Goodbye& message) noexcept {
  message.fault = sequence == 1;
  return sequence <= 1 ? WireStatus::kOk : WireStatus::kBadReserved;
}

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Content,
                       SurfacePatch& message) noexcept {
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

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Content,
                       OtherTools& message) noexcept {
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

WireStatus get_payload(Reader& reader, std::uint32_t sequence, Content, Refusal& message) noexcept {
  std::uint32_t reason = 0;
  reader.get(reason);
  reader.get(message.most_tools);
  message.reason = static_cast<Refusal::Reason>(reason);
  return sequence == 0 ? check(message) : WireStatus::kBadReserved;
}

Decoded refused(WireStatus status) noexcept {
  Decoded decoded;
  decoded.status = status;
  return decoded;
}

template <typename Message>
Decoded decode_as(Reader reader, std::uint32_t sequence, std::uint64_t session_id, ToolId tool,
                  Content content) noexcept {
  Message message;
  WireStatus status = get_payload(reader, sequence, content, message);
  if (status == WireStatus::kOk && session_id == 0) {
    status = WireStatus::kOutOfRange;
  }
  if (status != WireStatus::kOk) {
    return refused(status);
  }
  return {WireStatus::kOk, session_id, message, tool, content};
}

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
  if (version < kProtocolVersion || version > kSensitivitiesVersion) {
    return refused(WireStatus::kBadVersion);
  }
  const auto type = static_cast<MessageType>(type_number);
  const Content content = content_of(version);
  const std::size_t size = size_bytes(type, content);
  const bool names_a_tool =
      version == kToolsVersion || (content != Content::kPosition && tool != 0);
  if (size == 0 || (!names_a_tool && !needs_no_tool(type))) {
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
  if (names_a_tool && !usable(tool)) {
    return refused(WireStatus::kOutOfRange);
  }
  switch (type) {
    case MessageType::kToolState:
      return decode_as<ToolState>(reader, sequence, session_id, tool, content);
    case MessageType::kQuery:
      return decode_as<Query>(reader, sequence, session_id, tool, content);
    case MessageType::kForceSample:
      return decode_as<ForceSample>(reader, sequence, session_id, tool, content);
    case MessageType::kGoodbye:
      if (!names_a_tool && sequence != 0) {
        return refused(WireStatus::kBadReserved);
      }
      return decode_as<Goodbye>(reader, sequence, session_id, tool, content);
    case MessageType::kSurfacePatch:
      return decode_as<SurfacePatch>(reader, sequence, session_id, tool, content);
    case MessageType::kOtherTools:
      return decode_as<OtherTools>(reader, sequence, session_id, tool, content);
    case MessageType::kRefusal:
      return decode_as<Refusal>(reader, sequence, session_id, tool, content);
  }
  return refused(WireStatus::kBadType);
}

Encoded encode(const ToolState& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool, Content content) noexcept {
  return encode_as(MessageType::kToolState, message.sequence, message, session_id, buffer, tool,
                   content);
}

Encoded encode(const Query& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool, Content content) noexcept {
  return encode_as(MessageType::kQuery, message.query_id, message, session_id, buffer, tool,
                   content);
}

Encoded encode(const ForceSample& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool, Content content) noexcept {
  return encode_as(MessageType::kForceSample, message.sequence, message, session_id, buffer, tool,
                   content);
}

Encoded encode(const Goodbye& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool, Content content) noexcept {
  return encode_as(MessageType::kGoodbye, tool != 0 && message.fault ? 1 : 0, message, session_id,
                   buffer, tool, content);
}

Encoded encode(const SurfacePatch& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool, Content content) noexcept {
  return encode_as(MessageType::kSurfacePatch, message.sequence, message, session_id, buffer, tool,
                   content);
}

Encoded encode(const OtherTools& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool, Content content) noexcept {
  return encode_as(MessageType::kOtherTools, message.sequence, message, session_id, buffer, tool,
                   content);
}

Encoded encode(const Refusal& message, std::uint64_t session_id, std::span<std::byte> buffer,
               ToolId tool, Content content) noexcept {
  return encode_as(MessageType::kRefusal, 0, message, session_id, buffer, tool, content);
}

}  // namespace forcegrid::link
