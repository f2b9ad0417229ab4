// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>

namespace forcegrid::cli {

/// Accepts a finite number from `low` to `high`. CLI::Range would accept NaN.
CLI::Validator between(double low, double high);

}  // namespace forcegrid::cli
