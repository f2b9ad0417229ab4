// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/page_text.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "evaluation/charts/chart_html_parts.h"
#include "evaluation/objects/force_table.h"

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

GoalVerdict goal_verdict(double measured, double goal, bool at_least) {
  constexpr double kNear_percent = 10.0;
  constexpr double kMany_percent = 100.0;
  if (!std::isfinite(measured)) {
    return {"missed: not measurable", "missed", false};
  }
  const bool met = at_least ? measured >= goal : measured <= goal;
  const double scale = std::abs(goal) > 0.0 ? std::abs(goal) : 1.0;
  const double beyond_percent = 100.0 * (at_least ? goal - measured : measured - goal) / scale;
  const auto percent = [](double value) {
    return number(value, value < 10.0 ? "%.2g" : "%.0f") + " %";
  };
  if (met) {
    const double spare_percent = std::min(-beyond_percent, kMany_percent);
    return {
        at_least || spare_percent < 0.1 ? "met" : "met, " + percent(spare_percent) + " to spare",
        "met", true};
  }
  if (!at_least && beyond_percent > kMany_percent) {
    return {"missed, " + number(measured / goal, "%.3g") + " times the goal", "missed", false};
  }
  return {"missed by " + percent(beyond_percent),
          beyond_percent <= kNear_percent ? "near" : "missed", false};
}

std::string lead_pictures(const std::vector<LeadPicture>& pictures) {
  if (pictures.empty()) {
    return {};
  }
  std::string html = "<div class=lead>";
  for (const LeadPicture& picture : pictures) {
    html += "<figure><figcaption><b>" + escaped(picture.question) + "</b> " +
            escaped(picture.caption) + "</figcaption>" + svg_element(picture.svg) + "</figure>";
  }
  return html + "</div>";
}

std::string folded_list(const std::string& summary, const std::vector<std::string>& items) {
  std::string html = "<details class=none><summary>" + escaped(summary) + ": " +
                     std::to_string(items.size()) + "</summary><ul>";
  for (const std::string& item : items) {
    html += "<li>" + escaped(item);
  }
  return html + "</ul></details>";
}

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
