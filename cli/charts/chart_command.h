#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace forcegrid::cli {

/// What `forcegrid chart accuracy` was asked for; empty lists are all there is.
struct ChartAccuracyOptions {
  std::string out;
  std::string cache;  ///< folder of force tables; empty: forcegrid in the user's cache folder
  std::vector<std::string> scenes;
  std::vector<std::string> trajectories;
  std::vector<std::string> conditions;
  std::vector<std::string> methods;  ///< MethodVariant texts, or direct
  std::string goals_for;             ///< method held against the goals; empty: that of `run`
  bool quick = false;
  unsigned jobs = 0;  ///< 0: one a processor
  std::uint64_t seed = 1;
  std::vector<std::string> figures;         ///< SCENE/TRAJECTORY/CONDITION
  std::vector<std::string> figure_methods;  ///< empty: the default method, forcegrid, hold
};

/// What `forcegrid chart stability` was asked for.
struct ChartStabilityOptions {
  std::string out;
  std::string cache;                 ///< as ChartAccuracyOptions::cache
  std::vector<std::string> methods;  ///< MethodVariant texts; empty: those of the chart
  std::vector<std::string> parts;    ///< empty: all
  std::vector<std::string> hands;    ///< empty: all
  std::string goals_for;             ///< as ChartAccuracyOptions::goals_for
  bool quick = false;
  unsigned jobs = 0;  ///< 0: one a processor
  std::uint64_t seed = 1;
};

/// What `forcegrid chart solvers` was asked for.
struct ChartSolversOptions {
  std::string out;
  std::vector<int> sizes{1'000, 10'000, 100'000};  ///< vertices
  std::vector<std::string> scenes{"stomach"};
  bool quick = false;
};

struct ChartCommandOptions {
  ChartAccuracyOptions accuracy;
  ChartSolversOptions solvers;
  ChartStabilityOptions stability;
};

/// Adds the subcommand `chart` with its own subcommands `accuracy`, `stability` and `solvers`,
/// which set `action`.
void add_chart(CLI::App& app, ChartCommandOptions& options, std::function<int()>& action);

/// Adds the subcommand `stability` to `chart`.
void add_chart_stability(CLI::App& chart, ChartStabilityOptions& options,
                         std::function<int()>& action);

/// Adds the subcommand `solvers` to `chart`.
void add_chart_solvers(CLI::App& chart, ChartSolversOptions& options, std::function<int()>& action);

/// Judges force methods on the chart's objects, motions and networks, and writes tables, pictures
/// and a page into `options.out`, see docs/accuracy.md.
/// @returns the program's exit status, 0.
/// @throws std::exception with a sentence for the user.
int chart_accuracy_command(const ChartAccuracyOptions& options);

/// Closes the loop over force methods in simulated time, see docs/stability.md; as
/// chart_accuracy_command().
int chart_stability_command(const ChartStabilityOptions& options);

/// Measures what a servo cycle costs with each solver, see docs/solvers.md; as
/// chart_accuracy_command().
int chart_solvers_command(const ChartSolversOptions& options);

}  // namespace forcegrid::cli
