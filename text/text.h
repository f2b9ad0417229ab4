// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::text {

/// The words with ", " between them. Threads: any, as all of these.
std::string joined(const std::vector<std::string>& words);

/// Nine digits, without trailing zeros.
std::string number_text(double value);

}  // namespace forcegrid::text
