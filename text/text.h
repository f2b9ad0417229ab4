// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::text {

/// Joins the words with ", ". Threads: any, for all functions of this file.
std::string joined(const std::vector<std::string>& words);

/// Nine digits, without trailing zeros.
std::string number_text(double value);

}  // namespace forcegrid::text
