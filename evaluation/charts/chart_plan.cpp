// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart_plan.h"

#include <algorithm>
#include <sstream>
#include <stdexcept>

#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "rt/checkpoint.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/direct_method.h"

namespace forcegrid::evaluation {
namespace {

constexpr char kDirect[] = "direct";

// Variants of methods that a chart shows beside the methods as they are.
constexpr const char* kVariants[] = {
    "forcegrid unit=m",      "forcegrid unit=cells",     "forcegrid s=10",
    "forcegrid weight=idw6", "forcegrid r=6mm",          "forcegrid read=tricubic",
    "forcegrid cells=99",    "forcegrid storage=blocks", "forcegrid storage=adaptive",
    "forcegrid+request s=3", "forcegrid-mls ridge=1e-3", "forcegrid-tangent weight=paper",
    "kriging nug=1e-6",      "kriging nug=1e-4"};

// For scenes with walls or object effects.
const std::vector<std::string> kHardMotions{"chirp", "lissajous", "random"};
const std::vector<std::string> kHardConditions{"ideal", "stiffness", "requests120"};
const std::vector<std::string> kQuickScenes{"small", "small+wall_flat", "small+viscous",
                                            "small+cut"};
const std::vector<std::string> kQuickHardMotions{"random"};
const std::vector<std::string> kQuickHardConditions{"ideal"};
const std::vector<std::string> kQuickTrajectories{"chirp", "lissajous", "random",
                                                  "poke",  "regrab",    "circle"};
const std::vector<std::string> kQuickConditions{"ideal", "stiffness", "delay100", "requests120"};

MethodOptions base_options() {
  MethodOptions options;
  options.grid.max_W = {0.16, 0.12, 0.12};
  options.grid.cells.setConstant(49);
  return options;
}

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

template <typename Check>
std::vector<std::string> selected(const std::vector<std::string>& asked,
                                  const std::vector<std::string>& otherwise, const Check& check) {
  std::vector<std::string> names;
  for (const std::string& name : asked.empty() ? otherwise : asked) {
    check(name);
    if (!contains(names, name)) {
      names.push_back(name);
    }
  }
  return names;
}

void check_motion(const std::string& name) {
  if (name != kVisits) {
    Trajectory{name};
  }
}

bool is_hard(const ChartScene& scene) { return scene.name != scene.object; }

// Visits run only over an ideal network, with or without requests or stiffness.
bool can_visit(const ChartScene& scene, const NetworkCondition& condition) {
  return !is_hard(scene) &&
         contains({"ideal", "stiffness", "requests30", "requests60", "requests120"},
                  condition.name);
}

}  // namespace

std::vector<std::string> default_chart_methods() {
  std::vector<std::string> texts;
  for (const std::string& name : method_names()) {
    texts.push_back(name);
    for (const std::string variant : kVariants) {
      if (variant.substr(0, variant.find(' ')) == name) {
        texts.push_back(variant);
      }
    }
  }
  texts.emplace_back(kDirect);
  for (const simulator::Rival& rival : simulator::rivals()) {
    texts.emplace_back(rival.name);
  }
  return texts;
}

std::vector<std::string> chart_motions() {
  std::vector<std::string> names = trajectory_names();
  names.emplace_back(kVisits);
  return names;
}

ChartMethod method_of(const std::string& text) {
  std::istringstream words(text);
  std::string name;
  std::string option;
  words >> name >> option;
  const bool rival = simulator::is_rival(name);
  if (name == kDirect || rival) {
    if (!option.empty()) {
      throw std::invalid_argument("method '" + name + "' has no options; leave '" + option +
                                  "' out");
    }
    return {name, true, {}, rival};
  }
  if (!name.empty() && !contains(method_names(), name)) {
    std::string known = known_methods() + ", " + kDirect;
    for (const simulator::Rival& each : simulator::rivals()) {
      known += std::string(", ") + each.name;
    }
    throw std::invalid_argument("method '" + name + "' is not known; " + known);
  }
  const MethodVariant variant = parse_method_variant(text, base_options());
  return {variant.text, false, make_force_method(variant.name, variant.options)->needs()};
}

bool taken(const ChartOptions& options, const ChartScene& scene, const std::string& motion,
           const std::string& condition) {
  if (!is_hard(scene)) {
    return true;
  }
  return (!options.trajectories.empty() ||
          contains(options.quick ? kQuickHardMotions : kHardMotions, motion)) &&
         (!options.conditions.empty() ||
          contains(options.quick ? kQuickHardConditions : kHardConditions, condition));
}

namespace {

// The traces of the plan that belong to the shard; scenes without any are left out.
void choose_pieces(const ChartOptions& options, ChartPlan& plan) {
  std::vector<std::array<std::string, 3>> all;
  for (const std::string& scene : plan.scenes) {
    for (const std::string& motion : plan.trajectories) {
      for (const std::string& condition : plan.conditions) {
        if (taken(options, chart_scene(scene), motion, condition)) {
          all.push_back({scene, motion, condition});
        }
      }
    }
  }
  std::set<std::string> scenes;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (options.shard.has(i, all.size())) {
      scenes.insert(all[i][0]);
      plan.pieces.insert(std::move(all[i]));
    }
  }
  if (!options.shard.whole()) {
    std::erase_if(plan.scenes, [&](const std::string& scene) { return !scenes.contains(scene); });
  }
}

}  // namespace

ChartPlan plan_of(const ChartOptions& options) {
  std::vector<std::string> scenes;
  for (const ChartScene& scene : chart_scenes()) {
    scenes.push_back(scene.name);
  }
  for (const ChartScene& scene : hard_scenes()) {
    if (scene.object == chart_scenes().back().object) {
      scenes.push_back(scene.name);
    }
  }
  std::vector<std::string> conditions;
  for (const NetworkCondition& condition : network_conditions()) {
    conditions.push_back(condition.name);
  }
  ChartPlan plan;
  plan.scenes = selected(options.scenes, options.quick ? kQuickScenes : scenes,
                         [](const std::string& name) { chart_scene(name); });
  plan.trajectories =
      selected(options.trajectories, options.quick ? kQuickTrajectories : chart_motions(),
               [](const std::string& name) { check_motion(name); });
  plan.conditions = selected(options.conditions, options.quick ? kQuickConditions : conditions,
                             [](const std::string& name) { network_condition(name); });
  const auto add = [&plan](const ChartMethod& method) {
    if (std::none_of(plan.methods.begin(), plan.methods.end(),
                     [&method](const ChartMethod& each) { return each.text == method.text; })) {
      plan.methods.push_back(method);
    }
  };
  for (const std::string& text : options.methods) {
    add(method_of(text));
  }
  if (options.methods.empty()) {
    std::vector<std::string> texts = default_chart_methods();
    texts.push_back(options.default_method);
    for (const std::string& text : texts) {
      try {
        add(method_of(text));
      } catch (const std::invalid_argument& error) {
        plan.not_run.push_back({text, error.what()});
      }
    }
  }
  choose_pieces(options, plan);
  return plan;
}

bool applies(const ChartMethod& method, const ChartScene& scene, const NetworkCondition& condition,
             const Trajectory* motion) {
  if (motion == nullptr && (method.direct || !can_visit(scene, condition))) {
    return false;
  }
  if (method.direct) {
    const Trajectory& trajectory = *motion;
    if (trajectory.is_exploration()) {
      return false;  // the large object consists of tables and has no mesh
    }
    // The table represents a homogeneous object, the mesh does not; nor does the mesh have walls.
    const bool same_everywhere = std::all_of(
        trajectory.contacts().begin(), trajectory.contacts().end(), [](const ContactSpan& span) {
          return span.force_factor == 1.0 && span.point_W == first_contact_point_W();
        });
    return condition.name == "ideal" && same_everywhere && !is_hard(scene);
  }
  return (condition.stiffness || !method.needs.stiffness) &&
         (condition.requests_per_s > 0.0 || !method.needs.requests);
}

std::unique_ptr<ForceMethod> make(const ChartMethod& method, const simulator::SpringMesh& mesh,
                                  double patch_radius_m) {
  if (method.direct) {
    simulator::DirectOptions options;
    options.patch_radius_m = patch_radius_m;
    options.grab_on_own_thread = false;  // a recording does not wait for a thread
    return std::make_unique<simulator::DirectMethod>(mesh, options);
  }
  const MethodVariant variant = parse_method_variant(method.text, base_options());
  return make_force_method(variant.name, variant.options);
}

KnownObject known_object(const ChartScene& scene) {
  return {make_mesh(scene), scene.patch_radius_m, simulator::RivalTables([object = scene.object] {
            return simulator::make_coarser_mesh(object, first_contact_point_W());
          })};
}

simulator::MadeRival make(const ChartMethod& method, KnownObject& object,
                          const std::atomic<bool>* cancel) {
  simulator::MadeRival made;
  if (!method.rival) {
    made.method = make(method, object.mesh, object.patch_radius_m);
    return made;
  }
  const rt::Supervised supervised({.stop = cancel});
  try {
    return object.rivals.make(method.text, object.mesh, object.patch_radius_m);
  } catch (const rt::Interrupted&) {
    throw Stopped();
  }
}

}  // namespace forcegrid::evaluation
