// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/charts/chart.h"
#include "evaluation/charts/page_text.h"

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

/// A self-contained page: the pictures of the first screen, the goals, each scene's picture and
/// table, the figures, what was not judged, and all rows with filters and sorting. `pictures` holds
/// one SVG text per scene, empty for none.
std::string chart_html(const Chart& chart, const ChartOptions& options,
                       const std::vector<LeadPicture>& lead,
                       const std::vector<std::string>& pictures,
                       const std::vector<ChartFigure>& figures);

/// Writes accuracy.csv, accuracy.json, error_against_cost.svg for the first screen, one
/// error_against_cost_SCENE.svg per scene, and index.html into `options.out`.
/// @param more pictures of the first screen, after that of error and cost.
/// @returns the files written, the page last. @throws ChartError, FileError.
std::vector<std::filesystem::path> write_chart(const Chart& chart, const ChartOptions& options,
                                               const std::vector<ChartFigure>& figures,
                                               const std::vector<LeadPicture>& more = {});

}  // namespace forcegrid::evaluation
