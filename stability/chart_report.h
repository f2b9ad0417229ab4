// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "evaluation/charts/page_text.h"
#include "stability/chart.h"

namespace forcegrid::stability {

/// Results of the methods in a scene.
struct SceneVerdict {
  std::string scene;
  struct Method {
    std::string method;
    double open_loop_error_percent = 0.0;      ///< NaN: not charted
    double closed_loop_error_percent = 0.0;    ///< worst of all hands and timings at 200 N/m
    Behaviour behaviour = Behaviour::kStable;  ///< the first unstable one, if any
    /// Smallest ratio to the exact force's largest stable stiffness; NaN: not charted.
    double stiffness_ratio = 0.0;
  };
  std::vector<Method> methods;
  /// Among the methods that are stable in every loop of the scene, the one with the least
  /// closed-loop error. Empty if none is stable.
  std::string best;
};

/// Returns one verdict for each scene of the chart, in the order of scenes().
std::vector<SceneVerdict> scene_verdicts(const StabilityChart& chart);

/// The rows as CSV; a cell is empty if there is nothing to measure.
std::string stability_csv(const StabilityChart& chart);
/// The whole chart as JSON; docs/stability.md explains the keys.
std::string stability_json(const StabilityChart& chart, const StabilityChartOptions& options);
/// A self-contained page: `lead` on the first screen, then goals, scenes, fault sweep, `pictures`
/// (SVG texts) and every cell.
std::string stability_html(const StabilityChart& chart, const StabilityChartOptions& options,
                           const std::vector<evaluation::LeadPicture>& lead,
                           const std::vector<std::string>& pictures);

/// Writes stability.csv, sweep.csv, stability.json, the pictures and index.html into `options.out`.
/// @returns the files written, the page last. @throws evaluation::ChartError, FileError.
std::vector<std::filesystem::path> write_stability_chart(const StabilityChart& chart,
                                                         const StabilityChartOptions& options);

}  // namespace forcegrid::stability
