// SPDX-License-Identifier: Apache-2.0
#include "cli/common/number_check.h"

#include <cstdio>
#include <string>

namespace forcegrid::cli {

CLI::Validator between(double low, double high) {
  char range[64];
  std::snprintf(range, sizeof range, "%g..%g", low, high);
  const std::string text = range;
  return CLI::Validator(
      [low, high, text](std::string& input) {
        double value = 0.0;
        return CLI::detail::lexical_cast(input, value) && value >= low && value <= high
                   ? std::string()
                   : "'" + input + "' is no number in " + text;
      },
      text);
}

}  // namespace forcegrid::cli
