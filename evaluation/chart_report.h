// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/chart.h"

namespace forcegrid::evaluation {

/// One of the paper's figures 7 and 8: a title and the text of its SVG.
struct ChartFigure {
  std::string title;
  std::string svg;
};

/// The rows as CSV; a cell is empty if there is nothing to measure.
std::string chart_csv(const Chart& chart);

/// The whole chart as JSON: tables, numbers with their goals, points of each scene's picture, rows.
/// docs/accuracy.md explains the keys.
std::string chart_json(const Chart& chart, const ChartOptions& options);

/// A self-contained page: the goals, each scene's picture and table, the figures, and all rows with
/// filters and sorting. `pictures` holds one SVG text per scene, empty for none.
std::string chart_html(const Chart& chart, const ChartOptions& options,
                       const std::vector<std::string>& pictures,
                       const std::vector<ChartFigure>& figures);

/// Writes accuracy.csv, accuracy.json, error_against_cost_SCENE.svg and index.html into
/// `options.out`.
/// @returns the files written. @throws ChartError, FileError.
std::vector<std::filesystem::path> write_chart(const Chart& chart, const ChartOptions& options,
                                               const std::vector<ChartFigure>& figures);

}  // namespace forcegrid::evaluation
