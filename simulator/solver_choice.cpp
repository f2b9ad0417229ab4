#include "simulator/solver_choice.h"

#include <algorithm>
#include <cmath>

#include "profiles/nearest_name.h"
#include "profiles/text.h"
#include "simulator/error.h"

namespace forcegrid::simulator {
namespace {

constexpr double kLongestAnswer_s = 1.1e-6;  // a vertex, of objects up to kReference vertices
constexpr double kReference = 10'000.0;
constexpr double kReferenceTolerance = 1e-3;
constexpr double kTimeADecade = 0.25;
constexpr double kShareOfPeriod = 2.0 / 3.0;
constexpr double kDirectCycle_s = 0.16e-6;  // a vertex, in the mean
constexpr double kServoPeriod_s = 2e-3;
constexpr double kDirectShare = 0.5;
constexpr double kBorderTolerance = 1e-3;

double longest_answer_s(double vertices, double relative_tolerance) {
  const double decades = std::log10(kReferenceTolerance / relative_tolerance);
  return kLongestAnswer_s * vertices * std::max(1.0, std::cbrt(vertices / kReference)) *
         std::max(0.5, 1.0 + kTimeADecade * decades);
}

std::string milliseconds(double time_s) {
  return profiles::number_text(std::round(1e4 * time_s) / 10.0) + " ms";
}

}  // namespace

const std::vector<std::string>& solver_names() {
  static const std::vector<std::string> names{"auto", "quasi_static", "local"};
  return names;
}

SolverChoice choose_solver(const std::string& asked, std::size_t vertices, double rate_Hz,
                           const SolverOptions& options) {
  const std::vector<std::string>& names = solver_names();
  if (std::find(names.begin(), names.end(), asked) == names.end()) {
    throw Error("solver '" + asked + "' is unknown; write one of: " + profiles::joined(names) +
                " (the nearest is " + profiles::nearest_name(asked, names) + ")");
  }
  SolverChoice choice{.name = asked, .why = "as asked for", .options = options};
  const auto count = static_cast<double>(vertices);
  choice.small_enough_for_direct = kDirectCycle_s * count <= kDirectShare * kServoPeriod_s;
  if (asked == "auto") {
    const double answer_s = longest_answer_s(count, options.relative_tolerance);
    const double period_s = 1.0 / rate_Hz;
    const bool fits = answer_s <= kShareOfPeriod * period_s;
    choice.name = fits ? "quasi_static" : "local";
    choice.why = std::to_string(vertices) + " vertices to a residual of " +
                 profiles::number_text(options.relative_tolerance) + " take up to some " +
                 milliseconds(answer_s) + " of the " + milliseconds(period_s) + " between answers" +
                 (fits ? "" : ", so that only what the tool disturbs is solved");
    if (choice.small_enough_for_direct) {
      choice.why +=
          "; small enough for the servo's own rate: --method direct needs no simulator and is "
          "exact";
    }
  }
  if (choice.name == "local" && !(options.border_tolerance > 0.0)) {
    choice.options.border_tolerance = kBorderTolerance;
  }
  return choice;
}

}  // namespace forcegrid::simulator
