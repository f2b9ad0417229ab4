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
  kUnknown,  ///< this system does not tell
  kWarn,     ///< works, worse than it could
  kBad,      ///< does not work, or not as a device needs it
};
const char* to_string(Verdict verdict) noexcept;

/// A change that can be undone and harms nothing: a text for a file of the system.
struct FileFix {
  std::string file;
  std::string text;
  std::string words;  ///< what it does, and for how long
};

/// One thing that was looked at.
struct Finding {
  std::string check{};  ///< "CPU governor"
  Verdict verdict = Verdict::kGood;
  std::string what{};
  std::string cost{};    ///< what it costs the user; empty when good
  std::string remedy{};  ///< the exact command; empty when good
  std::vector<FileFix> fixes{};
  std::vector<std::pair<std::string, double>> measured{};  ///< name with unit, value
  std::vector<LatencyBin> histogram{};                     ///< of what was measured
};

/// What the kernel grants this process; tests have their own.
struct Grants {
  std::string realtime_refused;  ///< why; empty: granted
  std::string memory_refused;    ///< why; empty: granted
  std::int64_t clock_resolution_ns = 1;
};

/// Asks the kernel, on a thread of its own.
Grants ask_kernel();

struct DoctorSystem {
  SurveyRoots roots;
  std::string etc = "/etc";
  SurveyUser user;
  Grants grants;
};

/// Everything that can be read off: rule, group, limits, kernel, governor, idle states, clock, IRQ,
/// devices. Nothing is changed.
/// Real-time: no. Threads: any.
std::vector<Finding> examine_system(const DoctorSystem& system,
                                    const std::vector<profiles::DeviceProfile>& known);

/// Makes a finding's changes, each read back.
/// @returns one sentence for each: what was done, or why it could not be.
std::vector<std::string> apply_fixes(const std::vector<FileFix>& fixes);

/// The text of udev/70-forcegrid.rules, of this program's version.
const char* udev_rule_text() noexcept;

}  // namespace forcegrid::tools
