// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "device_emulator/device_options.h"
#include "device_emulator/emulator_report.h"
#include "rt/local_datagrams.h"

namespace forcegrid::emulator {

/// A Unix datagram socket that takes where the emulated hand is wanted, such as under the pointer
/// of the live view. A datagram is three little-endian f64: the hand's target in the frame D [m],
/// or three NaN: let go. A datagram of text, "hand firm", "hand light", "hand arm" or "hand none",
/// is another hand; the same text is the answer, to a sender that has an address. Anything else, an
/// infinity, or NaN in some of the numbers only, is malformed: dropped and counted.
///
/// Real-time: receive() neither waits, allocates, locks nor throws; at most 2 kMostAtOnce + 1
/// system calls. Threads: one.
class HandTargetSocket {
 public:
  static constexpr std::size_t kDatagramBytes = 24;
  static constexpr int kMostAtOnce = 16;

  /// Binds a socket at `path` that only this user may write to (mode 0600).
  /// @throws EmulatorError naming the path, the system's words and the remedy.
  explicit HandTargetSocket(const std::string& path);
  /// Takes what has come. @returns whether a well-formed datagram was among it.
  bool receive() noexcept;
  /// [m] Frame D; nothing before the first datagram, and once the pointer has let go.
  [[nodiscard]] const std::optional<Eigen::Vector3d>& target_D() const noexcept {
    return target_D_;
  }
  /// The hand that holds the device from now on; nothing: the one that did.
  [[nodiscard]] const std::optional<HandKind>& hand() const noexcept { return hand_; }
  [[nodiscard]] const HandTargetUse& use() const noexcept { return use_; }

 private:
  bool take_target(std::span<const std::uint8_t> bytes) noexcept;
  bool take_hand(std::span<const std::uint8_t> bytes) noexcept;

  rt::LocalDatagrams socket_;
  std::optional<Eigen::Vector3d> target_D_;
  std::optional<HandKind> hand_;
  HandTargetUse use_;
};

}  // namespace forcegrid::emulator
