#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "stability/chart.h"

namespace forcegrid::stability {

/// What the methods do in a scene.
struct SceneVerdict {
  std::string scene;
  struct Method {
    std::string method;
    double open_loop_error_percent = 0.0;      ///< NaN: not charted
    double closed_loop_error_percent = 0.0;    ///< the worst of all hands and timings at 200 N/m
    Behaviour behaviour = Behaviour::kStable;  ///< the first that is not stable, if any
    /// Smallest ratio to the exact force's largest stable stiffness; NaN: not charted.
    double stiffness_ratio = 0.0;
  };
  std::vector<Method> methods;
  /// The one to choose: of those that are stable in every loop of the scene the one with the least
  /// closed-loop error. Empty when none is stable.
  std::string best;
};

/// One for each scene of the chart, in the order of scenes().
std::vector<SceneVerdict> scene_verdicts(const StabilityChart& chart);

/// The rows as a table, empty where there is nothing to measure.
std::string stability_csv(const StabilityChart& chart);
/// Everything; keys are explained in docs/stability.md.
std::string stability_json(const StabilityChart& chart, const StabilityChartOptions& options);
/// One page that needs nothing else. `pictures` are SVG texts.
std::string stability_html(const StabilityChart& chart, const StabilityChartOptions& options,
                           const std::vector<std::string>& pictures);

/// Writes stability.csv, sweep.csv, stability.json, the pictures and index.html into `options.out`.
/// @returns the files written, the page last. @throws evaluation::ChartError, FileError.
std::vector<std::filesystem::path> write_stability_chart(const StabilityChart& chart,
                                                         const StabilityChartOptions& options);

}  // namespace forcegrid::stability
