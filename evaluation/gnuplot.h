// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace forcegrid::evaluation {

/// Quotes `text` as a gnuplot string literal.
std::string quoted(const std::string& text);

/// Runs gnuplot to draw `files` (.svg or .png), which `script` sets as its outputs.
/// @throws ChartError with the remedy if gnuplot can't be run or a file can't be written
///         completely; an incomplete picture is removed.
void run_gnuplot(const std::string& script, const std::vector<std::filesystem::path>& files);
inline void run_gnuplot(const std::string& script, const std::filesystem::path& file) {
  run_gnuplot(script, std::vector<std::filesystem::path>{file});
}

}  // namespace forcegrid::evaluation
