#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "paper/results.h"

namespace forcegrid::paper {

/// Name of a method in pictures and tables: the paper's words where it has some.
std::string label_of(const std::string& method);

/// The tool along the normal, and the forces: the paper's Figure 7, with its last second enlarged.
/// @param data  figure7.csv, as written by write_report(); @param file  the SVG to write.
/// @throws evaluation::ChartError when gnuplot can't draw, with the remedy.
void draw_figure_7(const std::filesystem::path& data, const Figures& figures,
                   const std::filesystem::path& file);

/// The errors: the paper's Figure 8, and their RMS by fifths. @throws as draw_figure_7().
void draw_figure_8(const std::filesystem::path& data, const Figures& figures,
                   const std::filesystem::path& file);

/// Error over r for each resolution, one panel a motion, the paper's choices marked.
/// @throws as draw_figure_7().
void draw_resolutions(const std::vector<ResolutionRow>& rows, const std::filesystem::path& file);

/// Percent correct over contrast, one panel for each way of having learnt the objects, at the Weber
/// fraction of the first row. @throws as draw_figure_7().
void draw_discrimination(const Discrimination& all, const std::filesystem::path& file);

}  // namespace forcegrid::paper
