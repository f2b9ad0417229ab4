// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/files/error.h"

namespace forcegrid::evaluation {

/// This computer has no gnuplot.
class NoGnuplot : public ChartError {
 public:
  using ChartError::ChartError;
};

/// Quotes `text` as a gnuplot string literal.
std::string quoted(const std::string& text);

/// Runs gnuplot to draw `files` (.svg, .png or .pdf), which `script` sets as its outputs.
/// @throws NoGnuplot or another ChartError, with the remedy, if gnuplot can't be run or a file
/// can't
///         be written completely; an incomplete picture is removed.
/// @throws rt::Interrupted if the thread's supervision asks to stop; then no picture is there.
void run_gnuplot(const std::string& script, const std::vector<std::filesystem::path>& files);
inline void run_gnuplot(const std::string& script, const std::filesystem::path& file) {
  run_gnuplot(script, std::vector<std::filesystem::path>{file});
}

}  // namespace forcegrid::evaluation
