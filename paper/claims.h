#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "paper/results.h"

namespace forcegrid::paper {

enum class Outcome : std::uint8_t {
  kAgrees,
  kDiffers,
  kOtherMachine,  ///< a time: another machine's, shown beside it
};
const char* to_string(Outcome outcome) noexcept;

/// A figure or a statement of the paper beside what came out here. The outcome is worked out from
/// the numbers, by the rule that `rule` says.
struct Claim {
  std::string topic;
  std::string paper;  ///< what the paper says
  std::string here;   ///< what was measured
  Outcome outcome = Outcome::kAgrees;
  std::string rule;  ///< when it agrees
  std::string why;   ///< what differs, and why
};

std::vector<Claim> claims_of(const Results& results);

}  // namespace forcegrid::paper
