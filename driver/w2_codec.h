// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace forcegrid::driver::w2 {

/// Bytes of a W2 report on the wire, either way. There is no report ID.
inline constexpr std::size_t kReportBytes = 14;
/// W3 sends the same 14 bytes first in reports of this length; the rest means nothing.
inline constexpr std::size_t kW3ReportBytes = 64;
/// W6, this project's own, sends a W2's reports in this length. OUT has the currents of the motors
/// in a wrist behind them, int16 little-endian [mA]; IN has zeros there.
inline constexpr std::size_t kW6ReportBytes = 20;
/// Bytes of the older W1 report, which this driver refuses.
inline constexpr std::size_t kW1ReportBytes = 8;

using ReportBytes = std::array<std::uint8_t, kReportBytes>;
/// A report to any of these devices, which reads as much of it as it knows. All zeros: no current.
using OutBytes = std::array<std::uint8_t, kW6ReportBytes>;

/// A device-to-host report: six counters, low 16 bits of the device's 32, and the info word.
/// Layout: int16 little-endian a, b, c, d, e, f, info. Source: haptikfabrikenapi firmware/main.cpp.
struct InputReport {
  std::array<std::int16_t, 6> counts{};
  bool calibration_button = false;  ///< info is not 0: pressed since the last calibrate command
  bool stylus_button = false;       ///< pressed; counts[3] is without what says so
  bool operator==(const InputReport&) const = default;
};

/// Above this, counter d of a device whose stylus has a button is kStylusOffset too much, which
/// says that the button is pressed. Source: haptikfabrikenapi src/fsusbhapticdevicethread.cpp.
inline constexpr std::int16_t kStylusThreshold = 5000;
inline constexpr std::int16_t kStylusOffset = 10000;

/// @param wire_bytes  length of a report on the wire: 14 (W2) or 64 (W3).
/// @param has_stylus_button  whether counter d carries a button, see kStylusThreshold.
/// @returns false when `bytes` is not exactly one report; `report` is then untouched.
/// Real-time: no allocation, lock or throw. Threads: any.
[[nodiscard]] bool decode(std::span<const std::uint8_t> bytes, InputReport& report,
                          std::size_t wire_bytes = kReportBytes,
                          bool has_stylus_button = false) noexcept;

/// Currents as a report has them.
struct Currents {
  bool finite = true;  ///< false: an input was NaN or infinite, and all three are zero
  bool clamped = false;
  std::array<std::int16_t, 3> current_mA{};
};

/// 1000 I truncated toward zero, limited to +-(1000 max_current - 1) mA as the original host does.
/// The limit acts in double: 40 A must not wrap to a current the other way.
/// @param max_current_A  at most 32.767, else that is the limit.
/// Real-time: no allocation, lock or throw. Threads: any.
[[nodiscard]] Currents report_currents(const std::array<double, 3>& current_A,
                                       const std::array<double, 3>& max_current_A) noexcept;

/// Host-to-device report: int16 little-endian current a, b, c [mA], command 0, three zeros.
[[nodiscard]] ReportBytes encode_currents(const std::array<std::int16_t, 3>& current_mA) noexcept;

/// The report with a wrist's currents [mA] behind it.
[[nodiscard]] OutBytes out_bytes(const ReportBytes& report,
                                 const std::array<std::int16_t, 3>& wrist_mA = {}) noexcept;

/// Host-to-device report of command 1: loads the six counters (d, e and f travel in the current
/// fields; the device sets its motors to zero current) and clears the info word.
[[nodiscard]] ReportBytes encode_load_counters(const std::array<std::int16_t, 6>& counts) noexcept;

/// Follows 16-bit counters beyond their wrap: each new value is taken as the nearest one to the
/// last, which holds while a counter moves less than 32768 counts between two reports.
class CounterUnwrapper {
 public:
  /// The next report's counters, as 32-bit ones. The first call starts from the values as they are.
  /// Real-time: no allocation, lock or throw. Threads: one.
  [[nodiscard]] std::array<std::int32_t, 6> follow(
      const std::array<std::int16_t, 6>& counts) noexcept;

  /// Forgets the past: the next values are compared with `counts`.
  void restart(const std::array<std::int16_t, 6>& counts) noexcept;

 private:
  bool started_ = false;
  std::array<std::int32_t, 6> counts_{};
};

}  // namespace forcegrid::driver::w2
