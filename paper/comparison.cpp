// SPDX-License-Identifier: Apache-2.0
#include "paper/comparison.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "evaluation/charts/chart_plan.h"
#include "evaluation/charts/page_text.h"
#include "evaluation/scenarios/scenarios.h"
#include "simulator/mesh/error.h"
#include "simulator/rivals/rivals.h"

namespace forcegrid::paper {
namespace {

using evaluation::readable;

// The methods of forcegrid/ that the paper names or that it is compared with, as Rival has the
// others.
const std::vector<simulator::Rival>& sample_methods() {
  static const std::vector<simulator::Rival> all{
      {"forcegrid", "the paper", "samples", "the tool retraces its path and moves fast"},
      {"auto", "this project's default", "samples",
       "the force is a function of the tool's position, or becomes one between events"},
      {"hold", "streaming, as the paper compares with", "samples", "the tool hardly moves"},
      {"linear", "[20] Picinbono et al. 2001, in time", "samples", "the motion is slow and smooth"},
      {"secant", "[20] Picinbono et al. 2001, in position", "samples",
       "the motion stays on a line"},
      {"rls", "[2] Balaniuk 1999, the buffer model", "samples",
       "the force is nearly quadratic around the tool; also while an object changes"}};
  return all;
}

std::vector<simulator::Rival> compared_methods() {
  std::vector<simulator::Rival> all = sample_methods();
  all.insert(all.end(), simulator::rivals().begin(), simulator::rivals().end());
  return all;
}

// The worst row of each method over the motions, in the order of the rows.
std::vector<ComparisonRow> worst_rows(const std::vector<ComparisonRow>& rows) {
  std::vector<ComparisonRow> worst;
  for (const ComparisonRow& row : rows) {
    const auto found = std::find_if(worst.begin(), worst.end(), [&row](const ComparisonRow& each) {
      return each.method == row.method;
    });
    if (found == worst.end()) {
      worst.push_back(row);
    } else if (std::isfinite(found->error_percent) &&
               !(row.error_percent <= found->error_percent)) {
      *found = row;  // a NaN, which then remains
    }
  }
  return worst;
}

// The best of `worst` that belongs to one of `names`; null if none was judged everywhere.
const ComparisonRow* best_of(const std::vector<ComparisonRow>& worst,
                             const std::vector<std::string>& names) {
  const ComparisonRow* best = nullptr;
  for (const ComparisonRow& row : worst) {
    const bool wanted = std::find(names.begin(), names.end(), row.method) != names.end();
    if (wanted && std::isfinite(row.error_percent) &&
        (best == nullptr || row.error_percent < best->error_percent)) {
      best = &row;
    }
  }
  return best;
}

std::string memory_text(double memory_MB) {
  return memory_MB < 0.1 ? readable(1e3 * memory_MB) + " kB" : readable(memory_MB) + " MB";
}

std::string error_and_cost(const ComparisonRow& row) {
  return readable(row.error_percent) + " % at worst, " + readable(row.cycle_over_bare_read) +
         " bare reads per cycle";
}

}  // namespace

std::vector<std::string> which_to_take(const std::vector<ComparisonRow>& rows) {
  const std::vector<ComparisonRow> worst = worst_rows(rows);
  std::vector<std::string> of_samples;
  for (const simulator::Rival& method : sample_methods()) {
    of_samples.emplace_back(method.name);
  }
  const ComparisonRow* const samples = best_of(worst, of_samples);
  const ComparisonRow* const paper = best_of(worst, {"forcegrid"});
  const ComparisonRow* const tables =
      best_of(worst, {"penetration-depth", "unit-responses", "greens-functions", "condensation"});
  const ComparisonRow* const solved = best_of(worst, {"coarse-mesh", "two-rates"});
  std::vector<std::string> sentences;
  sentences.push_back(samples == nullptr || paper == nullptr
                          ? "No method of samples alone was judged everywhere."
                          : "If only samples arrive, take " + samples->method + " (" +
                                error_and_cost(*samples) +
                                "; the paper's forcegrid: " + error_and_cost(*paper) + ").");
  sentences.push_back(
      tables == nullptr
          ? "No method of tables made beforehand was judged everywhere."
          : "If the object's model is known before the run and a cycle has no time to solve it, "
            "take " +
                tables->method + " (" + error_and_cost(*tables) + ", " +
                readable(tables->precompute_s) + " s beforehand, " +
                memory_text(tables->memory_MB) + "), and only where " + tables->right_when +
                (paper != nullptr && paper->error_percent < tables->error_percent
                     ? "; the forcegrid is more accurate here, and needs no model."
                     : "."));
  sentences.push_back(
      solved == nullptr
          ? "No method that solves the object in the cycle was judged everywhere."
          : "If the servo's computer can solve the object itself, take " + solved->method + " (" +
                error_and_cost(*solved) + ", " + memory_text(solved->memory_MB) + ")" +
                (samples != nullptr && samples->error_percent <= solved->error_percent
                     ? ", which here is no more accurate than " + samples->method +
                           " is with samples alone."
                     : ", which is more accurate than any method of samples alone."));
  return sentences;
}

Comparison compare_rivals(const std::vector<const RecordedMotion*>& motions, double bare_read_ns,
                          const PaperOptions& options) {
  Comparison comparison;
  std::optional<evaluation::KnownObject> object;
  std::string scene;
  const std::vector<simulator::Rival> methods = compared_methods();
  const auto start = std::chrono::steady_clock::now();
  for (const RecordedMotion* motion : motions) {
    if (!object || motion->scene != scene) {
      scene = motion->scene;
      object.emplace(evaluation::known_object(evaluation::chart_scene(scene)));
    }
    for (const simulator::Rival& method : methods) {
      check_stop(options);
      const double part = static_cast<double>(comparison.rows.size()) /
                          static_cast<double>(motions.size() * methods.size());
      if (options.progress && part > 0.0) {
        const double elapsed_s =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        options.progress(
            std::string("comparing ") + method.name + " on " + scene + ", " + motion->motion, part,
            elapsed_s * (1.0 / part - 1.0));
      }
      ComparisonRow row;
      row.scene = scene;
      row.motion = motion->motion;
      row.method = method.name;
      row.stands_for = method.source;
      row.needs = method.needs;
      row.right_when = method.right_when;
      try {
        const bool rival = simulator::is_rival(method.name);
        simulator::MadeRival made;
        if (rival) {
          made = evaluation::make(evaluation::method_of(method.name), *object, options.cancel);
        } else {
          made.method = make_method(method.name);
        }
        const evaluation::Verdict verdict = play(*made.method, motion->trace).verdict;
        row.error_percent = verdict.rms_error_percent_after_1s;
        row.cycle_over_bare_read = verdict.cycle_ns / bare_read_ns;
        row.precompute_s = made.precompute_s;
        row.memory_MB = 1e-6 * static_cast<double>(verdict.memory_bytes);
      } catch (const simulator::Error& error) {
        row.not_judged = error.what();
      }
      comparison.rows.push_back(std::move(row));
    }
  }
  comparison.which_to_take = which_to_take(comparison.rows);
  return comparison;
}

}  // namespace forcegrid::paper
