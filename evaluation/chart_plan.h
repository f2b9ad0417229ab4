// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "evaluation/chart.h"
#include "evaluation/network.h"
#include "evaluation/scenarios.h"
#include "evaluation/trajectories.h"
#include "forcegrid/core/force_method.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::evaluation {

/// A method of a chart: a MethodVariant's text, or "direct".
struct ChartMethod {
  std::string text;
  bool direct = false;
  MethodNeeds needs;
};

/// The selection of a chart: known names, each once.
struct ChartPlan {
  std::vector<std::string> scenes;
  std::vector<std::string> trajectories;
  std::vector<std::string> conditions;
  std::vector<ChartMethod> methods;
  std::vector<NotRun> not_run;
  /// Scene, motion and condition of the traces on which methods are evaluated; the scenes are
  /// these.
  std::set<std::array<std::string, 3>> pieces;
};

/// Makes the plan. @throws ChartError for an unknown name, std::invalid_argument for a method that
/// can't be made.
ChartPlan plan_of(const ChartOptions& options);

/// Makes a method once to check its text and to learn its needs.
/// @throws std::invalid_argument if it can't be made.
ChartMethod method_of(const std::string& text);

/// Makes a new method; `direct` solves `mesh`.
std::unique_ptr<ForceMethod> make(const ChartMethod& method, const simulator::SpringMesh& mesh,
                                  double patch_radius_m);

/// Whether the chart evaluates a motion and a condition on a scene. On scenes with walls or an
/// object effect it takes only some of them, unless they are selected.
bool taken(const ChartOptions& options, const ChartScene& scene, const std::string& motion,
           const std::string& condition);

/// Whether a method can be evaluated under a condition and on a motion (null: visits).
bool applies(const ChartMethod& method, const ChartScene& scene, const NetworkCondition& condition,
             const Trajectory* motion);

}  // namespace forcegrid::evaluation
