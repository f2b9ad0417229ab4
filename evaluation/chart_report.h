#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/chart.h"

namespace forcegrid::evaluation {

/// One of the paper's figures 7 and 8 to be shown: a title and the SVG's text.
struct ChartFigure {
  std::string title;
  std::string svg;
};

/// The rows as a table, one line each, empty where there is nothing to measure.
std::string chart_csv(const Chart& chart);

/// Everything: tables, numbers with their goals, points of each scene's picture, rows; keys are
/// explained in docs/accuracy.md.
std::string chart_json(const Chart& chart, const ChartOptions& options);

/// One page that needs nothing else: the goals, each scene's picture and table, the figures, and
/// all rows, to be filtered and sorted. `pictures` holds one SVG text a scene, empty for none.
std::string chart_html(const Chart& chart, const ChartOptions& options,
                       const std::vector<std::string>& pictures,
                       const std::vector<ChartFigure>& figures);

/// Writes accuracy.csv, accuracy.json, error_against_cost_SCENE.svg and index.html into
/// `options.out`.
/// @returns the files written. @throws ChartError, FileError.
std::vector<std::filesystem::path> write_chart(const Chart& chart, const ChartOptions& options,
                                               const std::vector<ChartFigure>& figures);

}  // namespace forcegrid::evaluation
