// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair_methods.h"

#include <algorithm>
#include <span>
#include <stdexcept>
#include <utility>

#include "forcegrid/methods.h"
#include "forcegrid/pair/pair_grid_method.h"
#include "forcegrid/pair/pair_kriging_method.h"
#include "forcegrid/pair/uncoupled_pair.h"

namespace forcegrid {
namespace {

std::unique_ptr<PairForceMethod> make_uncoupled(const std::string& name,
                                                const MethodOptions& options) {
  std::unique_ptr<ForceMethod> first = make_force_method(name, options);
  const MethodNeeds needs = first->needs();
  if (needs.requests || needs.stiffness) {
    throw std::invalid_argument(
        "method '" + name + "' needs " +
        (needs.requests ? "answers to requests, which samples of two tools are not"
                        : "the samples' stiffness, which not all samples of two tools have") +
        "; choose a method that needs only forces");
  }
  return std::make_unique<UncoupledPair>(std::move(first), make_force_method(name, options));
}

pair::PairFieldSettings field_settings(const MethodOptions& options) {
  pair::PairFieldSettings settings;
  settings.nugget_N2 = options.nugget.value_or(settings.nugget_N2);
  settings.samples = options.samples.value_or(settings.samples);
  settings.spacing.metres = options.spacing_m.value_or(settings.spacing.metres);
  settings.spacing.newtons = options.spacing_N.value_or(settings.spacing.newtons);
  if (!(settings.nugget_N2 > 0.0 && settings.spacing.metres > 0.0 &&
        settings.spacing.newtons > 0.0)) {
    throw std::invalid_argument("nug, spacing and spacing_N have to be above zero");
  }
  if (settings.samples < 2 || settings.samples > pair::PairField::kMaxSamples) {
    throw std::invalid_argument("samples has to be 2 to " +
                                std::to_string(pair::PairField::kMaxSamples));
  }
  return settings;
}

// How many of the newest samples keep their stiffness as data.
constexpr int kStiffnessSamples = 4;
constexpr int kCandidateStiffnessSamples = 2;

std::unique_ptr<PairForceMethod> make_kriging_6d(const MethodOptions& options) {
  pair::PairFieldSettings settings = field_settings(options);
  settings.stiffness_samples = kStiffnessSamples;
  return std::make_unique<PairKrigingMethod>("kriging-6d", std::span(&settings, 1));
}

// [N^2] What samples may be noisy by: a solver's rounding up to some 30 mN.
constexpr double kNuggets_N2[] = {1e-6, 1e-7, 1e-5, 1e-4, 1e-3};
// With stiffness the noise of the forces matters less, so two do.
constexpr double kNuggetsWithStiffness_N2[] = {1e-6, 1e-3};

std::unique_ptr<PairForceMethod> make_auto_6d(const MethodOptions& options) {
  if (options.nugget) {
    throw std::invalid_argument(
        "auto-6d chooses the noise itself; leave nug out, or use kriging-6d");
  }
  std::vector<pair::PairFieldSettings> candidates;
  const auto add = [&](double nugget_N2, int stiffness_samples) {
    candidates.push_back(field_settings(options));
    candidates.back().nugget_N2 = nugget_N2;
    candidates.back().stiffness_samples = stiffness_samples;
  };
  for (const double nugget_N2 : kNuggets_N2) {
    add(nugget_N2, 0);
  }
  for (const double nugget_N2 : kNuggetsWithStiffness_N2) {
    add(nugget_N2, kCandidateStiffnessSamples);
  }
  return std::make_unique<PairKrigingMethod>("auto-6d", candidates);
}

std::unique_ptr<PairForceMethod> make_forcegrid_6d(const MethodOptions& options) {
  PairGridOptions grid;
  grid.spacing_m = options.vertex_spacing_m.value_or(grid.spacing_m);
  grid.radius_m = options.influence_radius_m > 0.0 ? options.influence_radius_m : grid.radius_m;
  grid.unit_m = options.unit_m;
  grid.blocks = options.pool_blocks > 0 ? options.pool_blocks : grid.blocks;
  if (!(grid.spacing_m >= 1e-3 && grid.spacing_m <= 0.05)) {
    throw std::invalid_argument(
        "h, the distance of the dense grid's vertices, has to be 1 to 50 mm");
  }
  if (!(grid.radius_m <= pair::PairGrid::kMostRadius * grid.spacing_m)) {
    throw std::invalid_argument(
        "r has to be at most 4 h: a sample would reach more than 50,000 vertices in six "
        "dimensions");
  }
  return std::make_unique<PairGridMethod>(grid);
}

struct NamedPairMethod {
  const char* name;
  std::unique_ptr<PairForceMethod> (*make)(const MethodOptions& options);
};

constexpr NamedPairMethod kPairMethods[] = {{"auto-6d", make_auto_6d},
                                            {"kriging-6d", make_kriging_6d},
                                            {"forcegrid-6d", make_forcegrid_6d}};

}  // namespace

const std::vector<std::string>& pair_method_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const NamedPairMethod& method : kPairMethods) {
      all.emplace_back(method.name);
    }
    return all;
  }();
  return names;
}

bool is_pair_method(const std::string& name) {
  const std::vector<std::string>& names = pair_method_names();
  return std::find(names.begin(), names.end(), name) != names.end();
}

std::string known_pair_methods() {
  std::string names;
  for (const std::vector<std::string>& some : {pair_method_names(), method_names()}) {
    for (const std::string& name : some) {
      names += (names.empty() ? "" : ", ") + name;
    }
  }
  return "known methods: " + names;
}

void check_pair_method_name(const std::string& name) {
  const std::vector<std::string>& single = method_names();
  if (!is_pair_method(name) && std::find(single.begin(), single.end(), name) == single.end()) {
    throw std::invalid_argument("method '" + name + "' is not known; " + known_pair_methods());
  }
}

std::unique_ptr<PairForceMethod> make_pair_force_method(const std::string& name,
                                                        const MethodOptions& options) {
  for (const NamedPairMethod& method : kPairMethods) {
    if (name == method.name) {
      return method.make(options);
    }
  }
  return make_uncoupled(name, options);
}

}  // namespace forcegrid
