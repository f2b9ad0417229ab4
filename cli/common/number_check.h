#pragma once

#include <CLI/CLI.hpp>

namespace forcegrid::cli {

/// A finite number from `low` to `high`; CLI::Range would let NaN through.
CLI::Validator between(double low, double high);

}  // namespace forcegrid::cli
