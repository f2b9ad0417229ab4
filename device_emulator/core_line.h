// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace forcegrid::emulator {

/// The serial line from a W2's firmware to a second processor in the device, which has the force
/// method and computes the motors' currents (docs/firmware.md). That processor is a process of its
/// own, such as qemu-system-arm; the line is a Unix stream socket at which it listens.
///
/// A frame ends in C0; in it DB DC stands for C0 and DB DD for DB (RFC 1055). Little-endian:
///   to the core, 32 bytes:   u32 number of the cycle, 6 i32 counters, u32 CRC-32 of these 28
///   from the core, 16 bytes: u32 number that it answers, 3 i16 current [mA], u8 status of the
///                            pose, u8 status of the force, u32 CRC-32 of these 12
///
/// Real-time: send() and receive() neither wait, allocate, lock nor throw; one system call each,
/// and at most kReadBytes bytes. Threads: one.
class CoreLine {
 public:
  static constexpr std::size_t kStateBytes = 32, kAnswerBytes = 16, kReadBytes = 256;

  struct Answer {
    std::uint32_t number = 0;
    std::array<std::int16_t, 3> current_mA{};
  };

  /// Connects. @throws EmulatorError naming the path, the system's words and the remedy.
  explicit CoreLine(const std::string& path);
  ~CoreLine();
  CoreLine(const CoreLine&) = delete;
  CoreLine& operator=(const CoreLine&) = delete;

  /// Leaves the frame out if the line does not take all of it at once, or is gone.
  void send(std::uint32_t number, const std::array<std::int32_t, 6>& counters) noexcept;
  /// The newest answer that has come since the last call. Broken frames are counted and left out.
  std::optional<Answer> receive() noexcept;
  [[nodiscard]] std::uint64_t broken_frames() const noexcept { return broken_frames_; }

 private:
  std::optional<Answer> end_frame() noexcept;

  int socket_ = -1;
  std::array<std::uint8_t, 2 * kAnswerBytes> frame_{};
  std::size_t size_ = 0;  ///< larger than the frame: it is too long
  bool escaped_ = false;
  std::uint64_t broken_frames_ = 0;
};

}  // namespace forcegrid::emulator
