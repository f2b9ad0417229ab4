// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "evaluation/charts/chart.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/network.h"
#include "evaluation/scenarios/scenarios.h"
#include "forcegrid/core/force_method.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/rivals/rivals.h"

namespace forcegrid::evaluation {

/// A method of a chart: a MethodVariant's text, "direct", or the name of a simulator::Rival.
struct ChartMethod {
  std::string text;
  bool direct = false;  ///< it knows the object itself: "direct" and all rivals
  MethodNeeds needs;
  bool rival = false;
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

/// Makes a new method that is no rival; `direct` solves `mesh`.
std::unique_ptr<ForceMethod> make(const ChartMethod& method, const simulator::SpringMesh& mesh,
                                  double patch_radius_m);

/// A scene's object and what methods that know it have computed of it, on demand.
struct KnownObject {
  simulator::SpringMesh mesh;
  double patch_radius_m = 0.0;
  simulator::RivalTables rivals;
};
KnownObject known_object(const ChartScene& scene);

/// Makes a new method, a rival or not. Tables of a rival are made in the first call.
/// @throws simulator::Error for an object that a rival can't be made for, Stopped when `cancel` is
///         set.
simulator::MadeRival make(const ChartMethod& method, KnownObject& object,
                          const std::atomic<bool>* cancel);

/// Whether the chart evaluates a motion and a condition on a scene. On scenes with walls or an
/// object effect it takes only some of them, unless they are selected.
bool taken(const ChartOptions& options, const ChartScene& scene, const std::string& motion,
           const std::string& condition);

/// Whether a method can be evaluated under a condition and on a motion (null: visits).
bool applies(const ChartMethod& method, const ChartScene& scene, const NetworkCondition& condition,
             const Trajectory* motion);

}  // namespace forcegrid::evaluation
