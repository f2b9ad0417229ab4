// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "evaluation/motions/twist_motions.h"

namespace forcegrid::cli {

/// Options of `forcegrid chart wrist`.
struct ChartWristOptions {
  std::string out;
  std::string scene = "small";
  std::vector<std::string> motions = evaluation::twist_motion_names();
  std::string method = "auto";
  double simulator_rate_Hz = 30.0;
  std::uint64_t seed = 1;
  bool quick = false;
};

/// Adds the subcommand `wrist` to `chart`.
void add_chart_wrist(Command& chart, ChartWristOptions& options, std::function<int()>& action);

/// Measures the torque of a twisting grasp at servo rate; see docs/turning.md. Result and errors
/// are those of chart_accuracy_command().
int chart_wrist_command(const ChartWristOptions& asked);

}  // namespace forcegrid::cli
