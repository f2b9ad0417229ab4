// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace forcegrid::cli {

/// Longest line of a help text.
inline constexpr std::size_t kHelpColumns = 100;

/// `help` with its long lines wrapped at blanks or, in lists of names without blanks, behind
/// commas. The rest of a description stays below its beginning in `column`.
std::string wrapped_help(const std::string& help, std::size_t column);

}  // namespace forcegrid::cli
