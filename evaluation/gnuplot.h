#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace forcegrid::evaluation {

/// `text` as a string literal of gnuplot.
std::string quoted(const std::string& text);

/// Lets gnuplot draw `files` (.svg or .png), which `script` sets as its outputs.
/// @throws ChartError when gnuplot can't be run or a file not be written to its end, with the
///         remedy; a picture that was cut off is removed.
void run_gnuplot(const std::string& script, const std::vector<std::filesystem::path>& files);
inline void run_gnuplot(const std::string& script, const std::filesystem::path& file) {
  run_gnuplot(script, std::vector<std::filesystem::path>{file});
}

}  // namespace forcegrid::evaluation
