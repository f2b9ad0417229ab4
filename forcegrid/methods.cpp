// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/methods.h"

#include <cmath>
#include <cstdio>
#include <optional>
#include <stdexcept>

#include "forcegrid/grid/grid_factory.h"
#include "forcegrid/kriging/ensemble_method.h"
#include "forcegrid/kriging/kriging_grid_method.h"
#include "forcegrid/kriging/kriging_method.h"
#include "forcegrid/kriging/work_budget.h"
#include "forcegrid/simple/affine_methods.h"
#include "forcegrid/simple/hold_method.h"
#include "forcegrid/simple/linear_method.h"
#include "forcegrid/simple/rls_method.h"

namespace forcegrid {
namespace {

using Make = std::unique_ptr<ForceMethod> (*)(const MethodOptions&);

struct NamedMethod {
  const char* name;
  Make make;
};

template <typename Method>
std::unique_ptr<ForceMethod> plain(const MethodOptions& /*options*/) {
  return std::make_unique<Method>();
}

template <GridMethodKind kKind>
std::unique_ptr<ForceMethod> on_a_grid(const MethodOptions& options) {
  return make_grid_method(kKind, options);
}

void refuse_unless(bool usable, const char* what) {
  if (!usable) {
    throw std::invalid_argument(std::string("kriging: ") + what);
  }
}

void check_kriging(const MethodOptions& options, bool stored) {
  const auto positive = [](const std::optional<double>& value) {
    return !value || (std::isfinite(*value) && *value > 0.0);
  };
  refuse_unless(positive(options.nugget), "the nugget has to be above zero, e.g. 1e-5 N^2");
  refuse_unless(positive(options.spacing_m), "the spacing has to be above zero, e.g. 1 mm");
  refuse_unless(positive(options.spacing_N), "the spacing in force has to be above zero: 0.1 N");
  refuse_unless(
      !options.samples || (*options.samples >= 2 && *options.samples <= (stored ? 48 : 32)),
      stored ? "use 2 to 48 samples" : "use 2 to 32 samples");
  refuse_unless(!stored || !options.spacing_m || *options.spacing_m <= 0.005,
                "a store's spacing has to be at most 5 mm, half a cell of its grid");
}

void check_budget(double reads) {
  const double least = std::ceil(kriging::least_budget_reads());
  if (!(reads >= least)) {
    char text[200];
    std::snprintf(text, sizeof text,
                  "auto: a budget of %.3g bare trilinear reads a cycle pays for nothing; give at "
                  "least %.0f, or choose a simple method such as rls",
                  reads, least);
    throw std::invalid_argument(text);
  }
}

template <typename Method>
std::unique_ptr<ForceMethod> if_allocated(std::unique_ptr<Method> method) {
  if (!method->allocated()) {
    throw std::runtime_error(std::string(method->name()) +
                             ": not enough memory for what it learns; free some, or use kriging");
  }
  return method;
}

template <KrigingMethod::Kind kKind>
std::unique_ptr<ForceMethod> kriging(const MethodOptions& options) {
  check_kriging(options, kKind == KrigingMethod::Kind::kStore);
  return if_allocated(std::make_unique<KrigingMethod>(kKind, options));
}

template <EnsembleMethod::Kind kKind>
std::unique_ptr<ForceMethod> ensemble(const MethodOptions& options) {
  check_kriging(options, kKind == EnsembleMethod::Kind::kAuto);
  if (kKind == EnsembleMethod::Kind::kAuto && options.budget_reads) {
    check_budget(*options.budget_reads);
  }
  return if_allocated(std::make_unique<EnsembleMethod>(kKind, options));
}

std::unique_ptr<ForceMethod> kriging_grid(const MethodOptions& options) {
  check_kriging(options, true);
  const Eigen::Array3d size_m = options.grid.max_W - options.grid.min_W;
  refuse_unless((size_m > 0.0).all() && size_m.isFinite().all(),
                "forcegrid-kriging needs a workspace: a box whose upper corner is above its lower");
  const double h_m = options.vertex_spacing_m.value_or(KrigingGridMethod::kSpacing_m);
  refuse_unless(h_m >= KrigingGridMethod::kLeastSpacing_m && h_m <= 0.020,
                "use a distance between vertices h of 2mm to 20mm");
  refuse_unless((2.0 * size_m / h_m < KrigingGridMethod::kMostCells).all(),
                "the workspace has too many vertices; use a larger h, e.g. h=8mm");
  refuse_unless(
      options.pool_blocks == 0 || options.pool_blocks >= KrigingGridMethod::blocks_of_a_fill(h_m),
      "the pool is smaller than what is written at once; use pool=96 or leave it out");
  return if_allocated(std::make_unique<KrigingGridMethod>(options));
}

constexpr NamedMethod kMethods[] = {
    {"auto", ensemble<EnsembleMethod::Kind::kAuto>},
    {"forcegrid", on_a_grid<GridMethodKind::kSilent>},
    {"forcegrid+request", on_a_grid<GridMethodKind::kRequest>},
    {"forcegrid-mls", on_a_grid<GridMethodKind::kMls>},
    {"forcegrid-tangent", on_a_grid<GridMethodKind::kTangent>},
    {"hold", plain<HoldMethod>},
    {"linear", plain<LinearMethod>},
    {"secant", plain<SecantMethod>},
    {"broyden", plain<BroydenMethod>},
    {"rls", plain<RlsMethod>},
    {"tangent", plain<TangentMethod>},
    {"kriging", kriging<KrigingMethod::Kind::kForceOnly>},
    {"kriging-tangent", kriging<KrigingMethod::Kind::kTangent>},
    {"kriging-hinge", kriging<KrigingMethod::Kind::kUnilateralConstraint>},
    {"kriging-bank", ensemble<EnsembleMethod::Kind::kKriging>},
    {"kriging-store", kriging<KrigingMethod::Kind::kStore>},
    {"forcegrid-kriging", kriging_grid},
    {"kriging-contact", kriging<KrigingMethod::Kind::kContact>},
};

}  // namespace

const std::vector<std::string>& method_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const NamedMethod& method : kMethods) {
      all.emplace_back(method.name);
    }
    return all;
  }();
  return names;
}

std::string known_methods() {
  std::string text;
  for (const NamedMethod& method : kMethods) {
    text += (text.empty() ? "known methods: " : ", ") + std::string(method.name);
  }
  return text;
}

void check_method_name(const std::string& name) {
  for (const NamedMethod& method : kMethods) {
    if (name == method.name) {
      return;
    }
  }
  throw std::invalid_argument("method '" + name + "' is not known; " + known_methods());
}

std::unique_ptr<ForceMethod> make_force_method(const std::string& name,
                                               const MethodOptions& options) {
  check_method_name(name);
  for (const NamedMethod& method : kMethods) {
    if (name == method.name) {
      return method.make(options);
    }
  }
  return nullptr;
}

}  // namespace forcegrid
