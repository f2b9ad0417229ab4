// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "profiles/device_profile.h"
#include "tools/device_survey.h"
#include "tools/latency_histogram.h"

namespace forcegrid::tools {

enum class Verdict : std::uint8_t {
  kGood,
  kUnknown,  ///< this system does not report it
  kWarn,     ///< works, but could be better
  kBad,      ///< does not work, or not as a device needs it
};
const char* to_string(Verdict verdict) noexcept;

/// A harmless and reversible change: a text to write to a file of the system.
struct FileFix {
  std::string file;
  std::string text;
  std::string words;  ///< its effect and how long it lasts
};

/// The result of one check.
struct Finding {
  std::string check{};  ///< "CPU governor"
  Verdict verdict = Verdict::kGood;
  std::string what{};
  std::string cost{};    ///< effect on the user; empty when good
  std::string remedy{};  ///< the exact command; empty when good
  std::vector<FileFix> fixes{};
  std::vector<std::pair<std::string, double>> measured{};  ///< name with unit, value
  std::vector<LatencyBin> histogram{};                     ///< of the measured values
};

/// Rights that the kernel grants this process; tests supply their own.
struct Grants {
  std::string realtime_refused;  ///< why; empty: granted
  std::string memory_refused;    ///< why; empty: granted
  std::int64_t clock_resolution_ns = 1;
};

/// Requests the rights from the kernel, on a separate thread.
Grants ask_kernel();

struct DoctorSystem {
  SurveyRoots roots;
  std::string etc = "/etc";
  SurveyUser user;
  Grants grants;
};

/// Checks everything that can be read without a measurement: udev rule, group, limits, kernel,
/// governor, idle states, clock, IRQ, devices. Changes nothing.
/// Real-time: no. Threads: any.
std::vector<Finding> examine_system(const DoctorSystem& system,
                                    const std::vector<profiles::DeviceProfile>& known);

/// Makes a finding's changes and verifies each by reading it back.
/// @returns one sentence for each: the change, or the reason why it failed.
std::vector<std::string> apply_fixes(const std::vector<FileFix>& fixes);

/// Returns the text of udev/10-forcegrid.rules in this program's version.
const char* udev_rule_text() noexcept;

}  // namespace forcegrid::tools
