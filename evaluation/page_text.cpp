// SPDX-License-Identifier: Apache-2.0
#include "evaluation/page_text.h"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "evaluation/chart_html_parts.h"
#include "evaluation/force_table.h"

namespace forcegrid::evaluation {

std::string number(double value, const char* format) {
  if (!std::isfinite(value)) {
    return {};
  }
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string readable(double value) {
  if (!std::isfinite(value)) {
    return "&ndash;";
  }
  const double size = std::abs(value);
  return number(value, size >= 100.0  ? "%.0f"
                       : size >= 10.0 ? "%.1f"
                       : size >= 1.0  ? "%.2f"
                                      : "%.3f");
}

std::string escaped(const std::string& text) {
  std::string result;
  for (const char character : text) {
    switch (character) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += character;
    }
  }
  return result;
}

std::string page_head(const std::string& title) { return kHtmlHead + escaped(title) + kHtmlStyle; }

std::string svg_element(const std::string& svg) {
  const std::size_t begin = svg.find("<svg");
  return begin == std::string::npos ? std::string() : svg.substr(begin);
}

std::string read_text(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream content;
  content << stream.rdbuf();
  if (!stream) {
    throw ChartError(file.string() +
                     " can't be read back; it may have been removed, so run the command again");
  }
  return content.str();
}

}  // namespace forcegrid::evaluation
