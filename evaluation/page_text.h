// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace forcegrid::evaluation {

/// Text for the charts' files and pages.

/// Formats a number in printf's `format`; empty for NaN and infinity.
std::string number(double value, const char* format = "%.6g");
/// Formats a number for people with three significant digits; a dash if it is not finite.
std::string readable(double value);
/// Escapes HTML's special characters.
std::string escaped(const std::string& text);
/// The beginning of a page with `title`, up to the body.
std::string page_head(const std::string& title);
/// An SVG without its XML declaration and document type, which HTML does not take.
std::string svg_element(const std::string& svg);
/// Reads back a file that was just written. @throws ChartError if it is missing.
std::string read_text(const std::filesystem::path& file);

}  // namespace forcegrid::evaluation
