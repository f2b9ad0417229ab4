// SPDX-License-Identifier: Apache-2.0
#include "examples/firmware/simulator_link.h"

#include <cmath>

namespace forcegrid::firmware {
namespace {

constexpr std::size_t kHeaderBytes = 24, kChecksumBytes = 4;
constexpr std::uint32_t kMagic = 0x44524746;  // "FGRD"
constexpr std::uint16_t kVersion = 1, kToolState = 1, kForceSample = 3;
constexpr std::uint32_t kInContact = 1, kConverged = 2, kHasStiffness = 4;
constexpr double kMaxPosition_m = 10.0, kMaxForce_N = 1000.0, kMaxStiffness_N_per_m = 1e7;

Eigen::Vector3d vector(std::span<const std::uint8_t> bytes, std::size_t offset) noexcept {
  return {get<double>(bytes, offset), get<double>(bytes, offset + 8),
          get<double>(bytes, offset + 16)};
}
template <typename Numbers>
bool within(const Numbers& numbers, double bound) noexcept {
  return (numbers.array().abs() <= bound).all();  // false for NaN
}

}  // namespace

SimulatorLink::ToolStateBytes SimulatorLink::tool_state(
    std::int64_t time_ns, const Eigen::Vector3d& position_W,
    const Eigen::Vector3d& velocity_W) noexcept {
  ToolStateBytes bytes{};
  put(bytes, 0, kMagic);
  put(bytes, 4, kVersion);
  put(bytes, 6, kToolState);
  put(bytes, 8, static_cast<std::uint16_t>(bytes.size() - kHeaderBytes - kChecksumBytes));
  put(bytes, 12, ++sent_);
  put(bytes, 16, session_);
  put(bytes, 24, time_ns);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    put(bytes, 32 + 8 * axis, position_W[static_cast<Eigen::Index>(axis)]);
    put(bytes, 56 + 8 * axis, velocity_W[static_cast<Eigen::Index>(axis)]);
  }
  put(bytes, 80, crc32(std::span(bytes).first(80)));
  return bytes;
}

std::optional<SimulatorLink::Arrived> SimulatorLink::sample(
    std::span<const std::uint8_t> datagram) noexcept {
  ++dropped_;  // until it is known to be good
  if (datagram.size() != kForceSampleBytes || get<std::uint32_t>(datagram, 0) != kMagic ||
      get<std::uint16_t>(datagram, 4) != kVersion ||
      get<std::uint16_t>(datagram, 6) != kForceSample ||
      get<std::uint32_t>(datagram, 208) != crc32(datagram.first(208)) ||
      get<std::uint64_t>(datagram, 16) != session_) {
    return std::nullopt;
  }
  const auto sequence = get<std::uint32_t>(datagram, 12);
  const auto flags = get<std::uint32_t>(datagram, 44);
  Arrived arrived;
  Sample& s = arrived.sample;
  s.time_s = 1e-9 * static_cast<double>(get<std::int64_t>(datagram, 24));
  s.from_query = get<std::uint32_t>(datagram, 36) != 0;
  s.contact_epoch = get<std::uint32_t>(datagram, 40);
  s.position_W = vector(datagram, 48);
  s.force_W = vector(datagram, 72);
  s.contact_point_W = vector(datagram, 96);
  s.relative_residual = get<double>(datagram, 120);
  s.converged = (flags & kConverged) != 0;
  s.has_stiffness = (flags & kHasStiffness) != 0;
  for (Eigen::Index row = 0; row < 3; ++row) {
    s.stiffness_W.row(row) = vector(datagram, 136 + 24 * static_cast<std::size_t>(row)).transpose();
  }
  arrived.in_contact = (flags & kInContact) != 0;
  if (static_cast<std::int32_t>(sequence - newest_) <= 0 || s.from_query ||
      !within(s.position_W, kMaxPosition_m) || !within(s.force_W, kMaxForce_N) ||
      !within(s.contact_point_W, kMaxPosition_m) || !within(s.stiffness_W, kMaxStiffness_N_per_m) ||
      !(s.relative_residual >= 0.0) || !std::isfinite(s.relative_residual)) {
    return std::nullopt;
  }
  newest_ = sequence;
  --dropped_;
  return arrived;
}

}  // namespace forcegrid::firmware
