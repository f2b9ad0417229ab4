#pragma once

#include <filesystem>
#include <string>

namespace forcegrid::evaluation {

/// `text` as a string literal of gnuplot.
std::string quoted(const std::string& text);

/// Lets gnuplot draw `file`, which `script` sets as its output.
/// @throws ChartError when gnuplot can't be run or the file not be written, with the remedy.
void run_gnuplot(const std::string& script, const std::filesystem::path& file);

}  // namespace forcegrid::evaluation
