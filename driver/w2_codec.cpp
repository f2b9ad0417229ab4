// SPDX-License-Identifier: Apache-2.0
#include "driver/w2_codec.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace forcegrid::driver::w2 {
namespace {

constexpr std::size_t kCommandWord = 3;
constexpr std::int16_t kLoadCounters = 1;

std::int16_t word_at(std::span<const std::uint8_t> bytes, std::size_t index) noexcept {
  return static_cast<std::int16_t>(
      static_cast<std::uint16_t>(bytes[2 * index] | (bytes[2 * index + 1] << 8)));
}

void put_word(std::span<std::uint8_t> bytes, std::size_t index, std::int16_t value) noexcept {
  const auto bits = static_cast<std::uint16_t>(value);
  bytes[2 * index] = static_cast<std::uint8_t>(bits & 0xFF);
  bytes[2 * index + 1] = static_cast<std::uint8_t>(bits >> 8);
}

}  // namespace

bool decode(std::span<const std::uint8_t> bytes, InputReport& report, std::size_t wire_bytes,
            bool has_stylus_button) noexcept {
  if (bytes.size() != wire_bytes || wire_bytes < kReportBytes) {
    return false;
  }
  for (std::size_t i = 0; i < report.counts.size(); ++i) {
    report.counts[i] = word_at(bytes, i);
  }
  report.calibration_button = word_at(bytes, 6) != 0;
  std::int16_t& counter_d = report.counts[3];
  report.stylus_button = has_stylus_button && counter_d > kStylusThreshold;
  if (report.stylus_button) {
    counter_d = static_cast<std::int16_t>(counter_d - kStylusOffset);
  }
  return true;
}

Currents report_currents(const std::array<double, 3>& current_A,
                         const std::array<double, 3>& max_current_A) noexcept {
  Currents result;
  for (std::size_t i = 0; i < 3; ++i) {
    const double limit_mA =
        std::clamp(std::floor(1000.0 * max_current_A[i]) - 1.0, 0.0,
                   static_cast<double>(std::numeric_limits<std::int16_t>::max()));
    if (!std::isfinite(current_A[i]) || std::isnan(limit_mA)) {
      return {.finite = false, .clamped = false, .current_mA = {}};
    }
    const double wanted_mA = std::trunc(1000.0 * current_A[i]);
    const double sent_mA = std::clamp(wanted_mA, -limit_mA, limit_mA);
    result.clamped = result.clamped || sent_mA != wanted_mA;
    result.current_mA[i] = static_cast<std::int16_t>(sent_mA);
  }
  return result;
}

ReportBytes encode_currents(const std::array<std::int16_t, 3>& current_mA) noexcept {
  ReportBytes bytes{};
  for (std::size_t i = 0; i < 3; ++i) {
    put_word(bytes, i, current_mA[i]);
  }
  return bytes;
}

OutBytes out_bytes(const ReportBytes& report,
                   const std::array<std::int16_t, 3>& wrist_mA) noexcept {
  OutBytes bytes{};
  std::copy(report.begin(), report.end(), bytes.begin());
  for (std::size_t i = 0; i < wrist_mA.size(); ++i) {
    put_word(bytes, kReportBytes / 2 + i, wrist_mA[i]);
  }
  return bytes;
}

ReportBytes encode_load_counters(const std::array<std::int16_t, 6>& counts) noexcept {
  ReportBytes bytes{};
  for (std::size_t i = 0; i < 3; ++i) {
    put_word(bytes, i, counts[i + 3]);
    put_word(bytes, kCommandWord + 1 + i, counts[i]);
  }
  put_word(bytes, kCommandWord, kLoadCounters);
  return bytes;
}

std::array<std::int32_t, 6> CounterUnwrapper::follow(
    const std::array<std::int16_t, 6>& counts) noexcept {
  if (!started_) {
    restart(counts);
    return counts_;
  }
  for (std::size_t i = 0; i < counts.size(); ++i) {
    // The difference of the low words, taken modulo 2^16, is the shortest way; the sum wraps like
    // the device's own 32-bit counter.
    const auto moved = static_cast<std::int16_t>(static_cast<std::uint16_t>(
        static_cast<std::uint16_t>(counts[i]) - static_cast<std::uint16_t>(counts_[i])));
    counts_[i] = static_cast<std::int32_t>(static_cast<std::uint32_t>(counts_[i]) +
                                           static_cast<std::uint32_t>(std::int32_t{moved}));
  }
  return counts_;
}

void CounterUnwrapper::restart(const std::array<std::int16_t, 6>& counts) noexcept {
  started_ = true;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    counts_[i] = counts[i];
  }
}

}  // namespace forcegrid::driver::w2
