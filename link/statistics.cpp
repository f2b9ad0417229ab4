// SPDX-License-Identifier: Apache-2.0
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

std::uint64_t LinkStatistics::seal_refused_total() const noexcept {
  return std::accumulate(seal_refused.begin(), seal_refused.end(), std::uint64_t{0});
}

std::uint64_t LinkStatistics::dropped() const noexcept {
  return malformed_total() + seal_refused_total() + not_allowed + foreign_address +
         foreign_session + unexpected_type + forged + late + duplicated + overflowed;
}

std::vector<std::pair<std::string, std::uint64_t>> drop_reasons(const LinkStatistics& statistics) {
  std::vector<std::pair<std::string, std::uint64_t>> reasons = {
      {"address not allowed", statistics.not_allowed},
      {"foreign address", statistics.foreign_address}};
  for (std::size_t i = 0; i < statistics.seal_refused.size(); ++i) {
    reasons.emplace_back(std::string("seal: ") + to_string(static_cast<SealStatus>(i)),
                         statistics.seal_refused[i]);
  }
  for (std::size_t i = 0; i < statistics.malformed.size(); ++i) {
    reasons.emplace_back(to_string(static_cast<WireStatus>(i)), statistics.malformed[i]);
  }
  reasons.insert(reasons.end(), {{"foreign session", statistics.foreign_session},
                                 {"unexpected type", statistics.unexpected_type},
                                 {"answer to nothing sent", statistics.forged},
                                 {"duplicated", statistics.duplicated},
                                 {"late", statistics.late},
                                 {"queue full", statistics.overflowed}});
  std::erase_if(reasons, [](const auto& reason) { return reason.second == 0; });
  return reasons;
}

std::string drop_text(const LinkStatistics& statistics) {
  std::string text;
  for (const auto& [name, count] : drop_reasons(statistics)) {
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + name;
  }
  return text;
}

}  // namespace forcegrid::link
