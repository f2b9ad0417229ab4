// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_methods.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "cli/run/reference_forces.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "servo_loop/pair_half.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/direct_method.h"

namespace forcegrid::cli {
namespace {

constexpr double kDirectShare = 0.5;  // largest share of a cycle for method direct
constexpr double kDefaultRequests_per_s = 120.0;

// Makes the scene itself a force method, if a servo cycle is long enough for it.
std::unique_ptr<ForceMethod> make_direct(const RunOptions& options) {
  if (!options.simulator.empty()) {
    throw std::runtime_error(
        "method direct needs the object in this process, but --simulator names another process; "
        "leave --simulator out or choose another method");
  }
  const simulator::Scene scene = simulator::make_scene(options.scene);
  if (moves_by_itself(options.scene, options.solver)) {
    throw std::runtime_error("method direct solves equilibria, but scene " + options.scene +
                             " moves by itself; choose another method, or --solver quasi_static");
  }
  simulator::DirectOptions direct_options;
  direct_options.patch_radius_m = scene.patch_radius_m;
  auto direct = std::make_unique<simulator::DirectMethod>(scene.mesh, direct_options);
  const double period_s = 1.0 / options.rate_Hz;
  const double cycle_s = direct->measured_cycle_s(period_s);
  if (cycle_s > kDirectShare * period_s) {
    char times[64];
    std::snprintf(times, sizeof times, "%.2f ms, more than half of the %.2f ms", 1e3 * cycle_s,
                  1e3 * period_s);
    throw std::runtime_error("method direct: one cycle of scene " + options.scene + " takes " +
                             times +
                             " that --rate leaves; use --scene small, a lower --rate, or "
                             "another method");
  }
  return direct;
}

// The options of a run are those of grids over one tool; a method over two has its own in its text.
MethodVariant parse_run_variant(const std::string& text, const MethodOptions& base) {
  MethodVariant variant = parse_pair_variant(text, base);
  return is_pair_method(variant.name) ? parse_pair_variant(text, {}) : variant;
}

}  // namespace

RunMethods::RunMethods(const RunOptions& options, const MethodOptions& base, PairExchanges* pairs)
    : pairs_(pairs) {
  add(options.method, options, base);
  for (const std::string& evaluated : options.evaluated) {
    add(evaluated, options, base);
  }
}

void RunMethods::add(const std::string& text, const RunOptions& options,
                     const MethodOptions& base) {
  const auto known = [&](const std::string& name) {
    return std::find(names_.begin(), names_.end(), name) != names_.end();
  };
  std::string name = text;
  if (text == kDirect) {
    if (known(name)) {
      return;
    }
    owned_.push_back(make_direct(options));
  } else {
    const MethodVariant variant = parse_run_variant(text, base);
    name = variant.text;
    if (known(name)) {
      return;
    }
    owned_.push_back(is_pair_method(variant.name)
                         ? make_half(variant, options, base)
                         : make_force_method(variant.name, variant.options));
  }
  methods_.push_back(owned_.back().get());
  names_.push_back(std::move(name));
}

std::unique_ptr<ForceMethod> RunMethods::make_half(const MethodVariant& variant,
                                                   const RunOptions& options,
                                                   const MethodOptions& base) const {
  const std::size_t devices = options.devices.size();
  if (pairs_ == nullptr || devices != 2) {
    throw std::runtime_error(
        "method " + variant.name + " is over the positions of two tools of one program, and " +
        (devices < 2 ? "there is one device; give a second --device"
                     : "there are " + std::to_string(devices) + " devices; give two") +
        ", or choose a method of one tool, such as " + kMethodOfOneTool);
  }
  MethodOptions of_one = base;
  of_one.budget_reads.reset();
  return std::make_unique<servo::PairHalf>(make_pair_force_method(variant.name, variant.options),
                                           make_force_method(kMethodOfOneTool, of_one),
                                           (*pairs_)[variant.text],
                                           static_cast<std::size_t>(options.device_number - 1));
}

double RunMethods::requests_per_s(const RunOptions& options,
                                  const simulator::ToolOptions& tool) const {
  for (std::size_t i = 1; i < methods_.size(); ++i) {
    if (methods_[i]->needs().requests) {
      throw std::runtime_error("--evaluate \"" + names_[i] +
                               "\": only the rendered method's requests reach the simulator; give "
                               "it as --method");
    }
  }
  const bool needed = methods_.front()->needs().requests;
  const double asked =
      options.requests_per_s.value_or(needed || options.workers > 0 ? kDefaultRequests_per_s : 0.0);
  if (needed && asked == 0.0) {
    throw std::runtime_error(
        "--requests-per-s 0: method \"" + names_.front() +
        "\" works only with requests; give a number above 0, or choose another method");
  }
  if (tool.slides() && asked > 0.0) {
    throw std::runtime_error(
        "contact slide: the force on a sliding tool depends on its path, so requests cannot be "
        "answered; use a method without requests, and --requests-per-s 0");
  }
  if (tool.turns && asked > 0.0) {
    throw std::runtime_error(
        "--tool-turns: the force depends on the tool's orientation, so requests cannot be "
        "answered; "
        "use a method without requests, and --requests-per-s 0");
  }
  if (asked > options.rate_Hz) {
    throw std::runtime_error("--requests-per-s " + std::to_string(std::lround(asked)) +
                             ": at most one request per cycle; give a number up to --rate");
  }
  return asked;
}

}  // namespace forcegrid::cli
