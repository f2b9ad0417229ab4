#pragma once

#include <filesystem>
#include <string>

namespace forcegrid::evaluation {

/// Text for the charts' files and pages.

/// A number in printf's `format`; empty for NaN and infinity.
std::string number(double value, const char* format = "%.6g");
/// Three significant digits for people, a dash for what isn't finite.
std::string readable(double value);
/// What HTML would take for markup made harmless.
std::string escaped(const std::string& text);
/// The page's head up to the body, with `title`.
std::string page_head(const std::string& title);
/// An SVG without its XML declaration and document type, which HTML does not take.
std::string svg_element(const std::string& svg);
/// A file that was just written. @throws ChartError when it is gone.
std::string read_text(const std::filesystem::path& file);

}  // namespace forcegrid::evaluation
