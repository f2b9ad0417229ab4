// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "paper/results.h"

namespace forcegrid::paper {

enum class Outcome : std::uint8_t {
  kAgrees,
  kDiffers,
  kOtherMachine,  ///< a time, measured on another machine
};
const char* to_string(Outcome outcome) noexcept;

/// A figure or a statement of the paper and this project's result. The outcome follows from the
/// numbers by the criterion in `rule`.
struct Claim {
  std::string topic;
  std::string paper;  ///< the paper's statement
  std::string here;   ///< the measured result
  Outcome outcome = Outcome::kAgrees;
  std::string rule;  ///< criterion for agreement
  std::string why;   ///< the difference and its reason
};

std::vector<Claim> claims_of(const Results& results);

}  // namespace forcegrid::paper
