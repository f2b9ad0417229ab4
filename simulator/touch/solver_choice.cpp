// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/solver_choice.h"

#include <algorithm>
#include <cmath>

#include "simulator/mesh/error.h"
#include "simulator/solver/direct_method.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

constexpr double kLongestAnswer_s = 1.1e-6;  // per vertex, up to kReference vertices
constexpr double kReference = 10'000.0;
constexpr double kReferenceTolerance = 1e-3;
constexpr double kTimeADecade = 0.25;
constexpr double kShareOfPeriod = 2.0 / 3.0;
constexpr double kDirectCycle_s = 0.16e-6;  // per vertex, on average
constexpr double kDynamicStep_s = 0.7e-6;   // per vertex and time step
constexpr double kServoPeriod_s = 2e-3;
constexpr double kDirectShare = 0.5;
constexpr double kBorderTolerance = 1e-3;
constexpr double kServoRate_Hz = 100.0;  // from here on two_rates solves as direct does

double longest_answer_s(double vertices, double relative_tolerance) {
  const double decades = std::log10(kReferenceTolerance / relative_tolerance);
  return kLongestAnswer_s * vertices * std::max(1.0, std::cbrt(vertices / kReference)) *
         std::max(0.5, 1.0 + kTimeADecade * decades);
}

std::string milliseconds(double time_s) {
  return text::number_text(std::round(1e4 * time_s) / 10.0) + " ms";
}

void choose_equilibria(SolverChoice& choice, double count, double rate_Hz, MeshDynamics dynamics) {
  const double answer_s = longest_answer_s(count, choice.options.relative_tolerance);
  const double period_s = 1.0 / rate_Hz;
  const bool fits = answer_s <= kShareOfPeriod * period_s;
  choice.kind = fits ? SolverKind::kQuasiStatic : SolverKind::kLocal;
  choice.why = text::number_text(count) + " vertices to a residual of " +
               text::number_text(choice.options.relative_tolerance) + " take up to about " +
               milliseconds(answer_s) + " of the " + milliseconds(period_s) + " between answers" +
               (fits ? "" : ", so only the region that the tool disturbs is solved");
  if (dynamics == MeshDynamics::kMasses) {
    choice.why +=
        "; the object has masses but no damping, so its equilibria are solved instead of an "
        "endless oscillation (--solver dynamic lets it swing)";
  }
  if (choice.small_enough_for_direct) {
    choice.why +=
        "; small enough for the servo rate: --method direct needs no simulator and is exact";
  }
}

void fit_steps(SolverChoice& choice, double count, double rate_Hz, MeshDynamics dynamics) {
  if (dynamics == MeshDynamics::kNone) {
    throw Error(
        "solver dynamic: the scene has no masses; give each [[object]] a mass_kg, or leave "
        "--solver "
        "out");
  }
  choice.small_enough_for_direct = false;
  const double period_s = 1.0 / rate_Hz;
  const double most_steps = kShareOfPeriod * period_s / (kDynamicStep_s * count);
  const double step_s = std::min(period_s, period_s / std::max(1.0, std::floor(most_steps)));
  choice.dynamic.step_s = std::max(choice.dynamic.step_s, step_s);
  // Up to three periods without a position are simulated without lengthening the steps.
  choice.dynamic.max_steps = static_cast<int>(std::ceil(3.0 * period_s / choice.dynamic.step_s));
  choice.why += "; steps of " + milliseconds(choice.dynamic.step_s) + " for " +
                text::number_text(count) + " vertices";
}

void fit_two_rates(SolverChoice& choice, double rate_Hz, MeshDynamics dynamics) {
  if (dynamics == MeshDynamics::kDamped) {
    throw Error(
        "solver two_rates: it solves equilibria, but the object has dampers; leave --solver out, "
        "or "
        "give --solver quasi_static for its equilibria");
  }
  choice.two_rates = two_rates_options(rate_Hz, choice.options);
  choice.why += "; each answer from at most " +
                std::to_string(choice.two_rates.near.most_vertices) +
                " vertices around the tool; a second thread solves the whole object";
}

}  // namespace

TwoRatesOptions two_rates_options(double rate_Hz, const SolverOptions& options) {
  const TwoRatesOptions defaults;
  TwoRatesOptions result{.near = rate_Hz >= kServoRate_Hz ? DirectOptions{}.solver : options,
                         .whole = options};
  result.near.relative_tolerance = options.relative_tolerance;
  result.near.border_tolerance = defaults.near.border_tolerance;
  result.near.most_vertices = defaults.near.most_vertices;
  result.whole.border_tolerance = 0.0;
  result.whole.most_vertices = 0;
  return result;
}

SolverChoice choose_solver(std::optional<SolverKind> asked, std::size_t vertices, double rate_Hz,
                           const SolverOptions& options, MeshDynamics dynamics) {
  SolverChoice choice{.kind = asked.value_or(SolverKind::kQuasiStatic),
                      .why = "as asked for",
                      .options = options,
                      .dynamic = {},
                      .two_rates = {}};
  const auto count = static_cast<double>(vertices);
  choice.small_enough_for_direct = kDirectCycle_s * count <= kDirectShare * kServoPeriod_s;
  if (!asked && dynamics == MeshDynamics::kDamped) {
    choice.kind = SolverKind::kDynamic;
    choice.why = "the object has dampers";
  } else if (!asked) {
    choose_equilibria(choice, count, rate_Hz, dynamics);
  } else if (choice.kind != SolverKind::kDynamic && dynamics == MeshDynamics::kDamped) {
    choice.why += "; the object's masses and dampers are ignored";
  }
  if (choice.kind == SolverKind::kDynamic) {
    fit_steps(choice, count, rate_Hz, dynamics);
  }
  if (choice.kind == SolverKind::kTwoRates) {
    fit_two_rates(choice, rate_Hz, dynamics);
  }
  if (choice.kind == SolverKind::kLocal && !(options.border_tolerance > 0.0)) {
    choice.options.border_tolerance = kBorderTolerance;
  }
  return choice;
}

}  // namespace forcegrid::simulator
