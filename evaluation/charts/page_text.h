// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace forcegrid::evaluation {

/// Text for the charts' files and pages.

/// Formats a number in printf's `format`; empty for NaN and infinity.
std::string number(double value, const char* format = "%.6g");
/// One picture of a page's first screen: a question, what the picture shows, and its SVG.
struct LeadPicture {
  std::string question;
  std::string caption;
  std::string svg;
};
/// The pictures side by side where the window is wide enough; empty without pictures.
std::string lead_pictures(const std::vector<LeadPicture>& pictures);

/// Formats a number for people with three significant digits; a dash if it is not finite.
std::string readable(double value);
/// Escapes HTML's special characters.
std::string escaped(const std::string& text);
/// The beginning of a page with `title`, up to the body.
std::string page_head(const std::string& title);
/// How a measured value stands to its goal, in words: "met, 29 % to spare", "missed by 7 %",
/// "missed, 3.4 times the goal". Percentages are of the goal.
struct GoalVerdict {
  std::string words;
  const char* css_class;  ///< of the page's style: met, near (missed by at most 10 %), missed
  bool met;
};
/// @param at_least the goal is a lower bound. A value that is not finite is missed, since it could
///        not be measured.
GoalVerdict goal_verdict(double measured, double goal, bool at_least);
/// A list that opens at a click: "SUMMARY: N".
std::string folded_list(const std::string& summary, const std::vector<std::string>& items);
/// An SVG without its XML declaration and document type, which HTML does not take.
std::string svg_element(const std::string& svg);
/// Reads back a file that was just written. @throws ChartError if it is missing.
std::string read_text(const std::filesystem::path& file);

}  // namespace forcegrid::evaluation
