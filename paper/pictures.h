// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "paper/results.h"

namespace forcegrid::paper {

/// Name of a method in pictures and tables: the paper's term if it has one.
std::string label_of(const std::string& method);

/// Draws the tool's position along the normal and the forces: the paper's Figure 7, with its last
/// second enlarged.
/// @param data  figure7.csv, as written by write_report(); @param file  the SVG to write.
/// @throws evaluation::ChartError with the remedy if gnuplot fails.
void draw_figure_7(const std::filesystem::path& data, const Figures& figures,
                   const std::filesystem::path& file);

/// Draws the errors: the paper's Figure 8, and their RMS by fifths. @throws as draw_figure_7().
void draw_figure_8(const std::filesystem::path& data, const Figures& figures,
                   const std::filesystem::path& file);

/// Draws the error over r for each resolution, one panel per motion, with the paper's choices
/// marked.
/// @throws as draw_figure_7().
void draw_resolutions(const std::vector<ResolutionRow>& rows, const std::filesystem::path& file);

/// Draws percent correct over contrast, one panel per Knowledge, at the Weber fraction of the first
/// row. @throws as draw_figure_7().
void draw_discrimination(const Discrimination& all, const std::filesystem::path& file);

}  // namespace forcegrid::paper
