// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/chart_command.h"
#include "cli/charts/evaluate_command.h"
#include "cli/charts/paper_command.h"
#include "cli/charts/solver_bench_command.h"
#include "cli/common/option_values.h"
#include "cli/device/calibrate_command.h"
#include "cli/record_command.h"
#include "cli/reference/reference_command.h"
#include "cli/tools_program.h"
#include "cli/tune_command.h"

namespace forcegrid::cli {
namespace {

struct ToolsOptions {
  CalibrateOptions calibrate;
  TuneOptions tune;
  ReplayOptions replay;
  PlotOptions plot;
  EvaluateOptions evaluate;
  ChartCommandOptions chart;
  PaperCommandOptions paper;
  ReferenceOptions reference;
};

}  // namespace

bool has_tools_commands() { return true; }

std::shared_ptr<void> add_tools_commands(Command& program, std::function<int()>& action) {
  const auto options = std::make_shared<ToolsOptions>();
  add_calibrate(program, options->calibrate, action);
  add_json(program.subcommand("calibrate"), options->calibrate.json);
  add_tune(program, options->tune, action);
  add_json(program.subcommand("tune"), options->tune.json);
  add_replay(program, options->replay, action);
  add_json(program.subcommand("replay"), options->replay.json);
  add_plot(program, options->plot, action);
  add_json(program.subcommand("plot"), options->plot.json);
  add_evaluate(program, options->evaluate, action);
  add_chart(program, options->chart, action);
  add_paper(program, options->paper, action);
  add_reference(program, options->reference, action);
  return options;
}

std::optional<int> become_tools_program(int /*argc*/, char** /*argv*/) { return std::nullopt; }

int bench_command(const std::string& scene, const JsonTarget& json) {
  return solver_bench_command(scene, json);
}

}  // namespace forcegrid::cli
