// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "cli/common/options.h"

namespace forcegrid::cli {

/// Validators for every option that takes numbers. They refuse NaN, infinity and what is outside
/// the range, and say what to give instead. CLI11's own accept NaN, and it reads "-1" as the
/// largest unsigned number. An option with several values is checked value by value.

/// Accepts a finite number from `low` to `high`.
Check between(double low, double high);

/// Accepts a whole number from `low` to `high`.
Check whole_between(std::int64_t low, std::int64_t high);

/// Accepts any finite number.
Check finite_number();

/// Accepts a seed: a whole number from 0 to 2^64 - 1.
Check seed_number();

}  // namespace forcegrid::cli
