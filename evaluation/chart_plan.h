#pragma once

#include <memory>
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

/// What a chart judges: names without doubles, all of them known.
struct ChartPlan {
  std::vector<std::string> scenes;
  std::vector<std::string> trajectories;
  std::vector<std::string> conditions;
  std::vector<ChartMethod> methods;
  std::vector<NotRun> not_run;
};

/// @throws ChartError for an unknown name, std::invalid_argument for a method that can't be made.
ChartPlan plan_of(const ChartOptions& options);

/// Makes a method to see that it can be made, and what it needs.
/// @throws std::invalid_argument for one that can't.
ChartMethod method_of(const std::string& text);

/// A new one; `direct` on `mesh`.
std::unique_ptr<ForceMethod> make(const ChartMethod& method, const simulator::SpringMesh& mesh,
                                  double patch_radius_m);

/// Whether a motion and a condition are judged on a scene: on one with walls or an effect only
/// some of them, unless they were asked for.
bool taken(const ChartOptions& options, const ChartScene& scene, const std::string& motion,
           const std::string& condition);

/// Whether a method can be judged under a condition and on a motion; null: on visits.
bool applies(const ChartMethod& method, const ChartScene& scene, const NetworkCondition& condition,
             const Trajectory* motion);

}  // namespace forcegrid::evaluation
