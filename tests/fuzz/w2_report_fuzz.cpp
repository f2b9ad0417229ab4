// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "driver/device.h"
#include "driver/hid_descriptor.h"
#include "driver/w2_codec.h"
#include "tests/fuzz/fuzz_targets.h"

namespace forcegrid::fuzz {
namespace {

using namespace driver;

// The whole input as one report, then cut into reports that follow each other.
void reports(Input input) {
  for (const std::size_t wire_bytes : {w2::kReportBytes, w2::kW3ReportBytes}) {
    w2::InputReport report;
    require(w2::decode(input, report, wire_bytes) == (input.size() == wire_bytes),
            "a report is taken if and only if it has the right length");
    w2::CounterUnwrapper unwrapper;
    std::array<std::int32_t, 6> last{};
    for (std::size_t at = 0; input.size() - at >= wire_bytes; at += wire_bytes) {
      require(w2::decode(input.subspan(at, wire_bytes), report, wire_bytes), "the right length");
      const auto counts = unwrapper.follow(report.counts);
      for (std::size_t i = 0; i < counts.size(); ++i) {
        require(static_cast<std::int16_t>(counts[i]) == report.counts[i],
                "an unwrapped counter keeps its low 16 bits");
        require(at == 0 || std::abs(static_cast<std::int64_t>(counts[i]) - last[i]) <= 32768,
                "an unwrapped counter moves by at most half its range");
      }
      last = counts;
    }
  }
}

// The input as doubles: currents asked for, and limits.
void currents(Input input) {
  std::array<double, 6> numbers{};
  std::memcpy(numbers.data(), input.data(), std::min(input.size(), sizeof numbers));
  const std::array<double, 3> asked_A{numbers[0], numbers[1], numbers[2]};
  const std::array<double, 3> limit_A{3.0, 32.767, std::abs(std::fmod(numbers[3], 40.0))};
  if (!std::isfinite(limit_A[2])) {
    return;
  }
  const w2::Currents sent = w2::report_currents(asked_A, limit_A);
  const bool finite =
      std::isfinite(asked_A[0]) && std::isfinite(asked_A[1]) && std::isfinite(asked_A[2]);
  require(sent.finite == finite, "a current that is no number is noticed");
  for (std::size_t i = 0; i < 3; ++i) {
    require(std::abs(sent.current_mA[i]) <= 1000.0 * limit_A[i], "no current beyond the limit");
    require(finite || sent.current_mA[i] == 0, "no current at all if one is no number");
    require(sent.current_mA[i] == 0 || (sent.current_mA[i] > 0) == (asked_A[i] > 0),
            "no current the other way");
  }
}

}  // namespace

void w2_report(Input input) {
  reports(input);
  currents(input);
  try {
    parse_hid_descriptor(input);
  } catch (const DeviceError&) {
    // A descriptor that is refused is what most inputs are.
  }
}

}  // namespace forcegrid::fuzz
