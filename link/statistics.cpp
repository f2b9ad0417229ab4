#include "link/statistics.h"

#include <numeric>

namespace forcegrid::link {

const char* to_string(SendStatus status) noexcept {
  switch (status) {
    case SendStatus::kSent:
      return "sent";
    case SendStatus::kInvalid:
      return "not finite or out of range";
    case SendStatus::kNotRising:
      return "sequence does not rise";
    case SendStatus::kNoPeer:
      return "nobody to send to";
    case SendStatus::kSystemFailed:
      return "refused by the system";
  }
  return "unknown send status";
}

std::uint64_t LinkStatistics::malformed_total() const noexcept {
  return std::accumulate(malformed.begin(), malformed.end(), std::uint64_t{0});
}

std::uint64_t LinkStatistics::dropped() const noexcept {
  return malformed_total() + foreign_address + foreign_session + unexpected_type + forged + late +
         duplicated + overflowed;
}

}  // namespace forcegrid::link
