// SPDX-License-Identifier: Apache-2.0
#include "view/log_line.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace forcegrid::view {
namespace {

constexpr int kMostLinesPerSecond = 20;

struct LinesOfASecond {
  std::chrono::steady_clock::time_point begin;
  int lines = 0;
  int left_out = 0;
};

}  // namespace

void log_line(const std::string& text) {
  static LinesOfASecond second;
  const auto now = std::chrono::steady_clock::now();
  if (now - second.begin >= std::chrono::seconds(1)) {
    if (second.left_out > 0) {
      std::fprintf(stderr, "forcegrid-view: %d lines more were left out\n", second.left_out);
    }
    second = {now, 0, 0};
  }
  if (++second.lines > kMostLinesPerSecond) {
    ++second.left_out;
    return;
  }
  std::string shown = text;
  std::replace_if(
      shown.begin(), shown.end(),
      [](char letter) { return static_cast<unsigned char>(letter) < 0x20 || letter == 0x7f; }, '?');
  std::fprintf(stderr, "forcegrid-view: %s\n", shown.c_str());
}

}  // namespace forcegrid::view
