// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace forcegrid::firmware {

/// The board that the images run on: Arm's MPS2 with the image AN500, a Cortex-M7, as QEMU emulates
/// it. For another board write another board file and linker script.
/// Real-time: every function is bounded and neither allocates nor waits.

/// Clock of the timer and of the serial port [Hz].
inline constexpr std::uint32_t kBoardClock_Hz = 25'000'000;

/// Ticks of the board's timer since start_timer(), modulo 2^32; one every 1 / kBoardClock_Hz.
std::uint32_t timer_ticks() noexcept;
void start_timer() noexcept;

/// The board's serial ports, 8N1 at 1 Mbit/s.
enum class Port : std::uint8_t {
  kSimulator,  ///< UART 0
  kArm,        ///< UART 1
};
void start_serial(Port port) noexcept;
/// @returns false if there is no byte.
[[nodiscard]] bool serial_read(Port port, std::uint8_t& byte) noexcept;
/// @returns false if the port can't take one yet.
[[nodiscard]] bool serial_write(Port port, std::uint8_t byte) noexcept;
/// Sleeps until a byte has come on a port, or returns at once if one came since serial_read() found
/// none.
void wait_for_serial() noexcept;

/// Bytes of the stack that were used since start, at most; and those that there are.
std::size_t stack_bytes_used() noexcept;
std::size_t stack_bytes() noexcept;

/// Stops for good, after a failure that no cycle can go on after. Each image defines what it does
/// with its motors first.
[[noreturn]] void stop_device() noexcept;

}  // namespace forcegrid::firmware
