// SPDX-License-Identifier: Apache-2.0
#include "text/text.h"

#include <cstdio>

namespace forcegrid::text {

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

std::string number_text(double value) {
  std::string text(32, '\0');
  const int length = std::snprintf(text.data(), text.size(), "%.9g", value);
  text.resize(static_cast<std::size_t>(length));
  return text;
}

}  // namespace forcegrid::text
