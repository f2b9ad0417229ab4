// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_judgement.h"

#include <algorithm>
#include <cmath>

#include "cli/common/progress_line.h"
#include "cli/common/stop_request.h"
#include "rt/checkpoint.h"
#include "rt/vectors.h"

namespace forcegrid::cli {
namespace {

std::string why_reference_is_skipped() {
  return StopRequest::emergency().pressed() ? "skipped by the emergency stop"
         : StopRequest::signal() != 0       ? "skipped by " + StopRequest::signal_name()
                                            : "skipped because the simulator was lost";
}

void add_errors(RunSummary& summary, const std::vector<std::string>& names,
                const ContactCycles& cycles) {
  const auto& reference_W = cycles.reference_W;
  double reference_sum = 0.0;
  double force_max_N = 0.0;
  for (const Eigen::Vector3d& force_W : reference_W) {
    reference_sum += force_W.squaredNorm();
    force_max_N = std::max(force_max_N, force_W.norm());
  }
  const double force_rms_N = std::sqrt(reference_sum / static_cast<double>(reference_W.size()));
  summary.force_rms_N = force_rms_N;
  summary.force_max_N = force_max_N;
  const auto percent = [&](double sum, double count) {
    return count > 0.0 && force_rms_N > 0.0 ? 100.0 * std::sqrt(sum / count) / force_rms_N : 0.0;
  };
  for (std::size_t method = 0; method < names.size(); ++method) {
    double first_sum = 0.0;
    double first_count = 0.0;
    double rest_sum = 0.0;
    double rest_count = 0.0;
    double worst = 0.0;
    for (std::size_t i = 0; i < reference_W.size(); ++i) {
      const double squared =
          (rt::to_vector(cycles.records[i]->method_force_W_N[method]) - reference_W[i])
              .squaredNorm();
      if (cycles.time_s(i) < 1.0) {
        first_sum += squared;
        first_count += 1.0;
      } else {
        rest_sum += squared;
        rest_count += 1.0;
        worst = std::max(worst, squared);
      }
    }
    MethodError error;
    error.rms_percent = percent(first_sum + rest_sum, first_count + rest_count);
    error.rms_percent_first_1s = percent(first_sum, first_count);
    error.rms_percent_after_1s = percent(rest_sum, rest_count);
    error.max_percent_after_1s = percent(worst, 1.0);
    summary.errors[names[method]] = error;
  }
}

}  // namespace

ContactCycles cycles_since(const std::optional<servo::FirstContact>& contact,
                           const std::deque<servo::CycleRecord>& records) {
  ContactCycles cycles;
  if (!contact) {
    return cycles;
  }
  cycles.contact_ns = contact->time_ns;
  for (const servo::CycleRecord& record : records) {
    if (record.time_ns >= contact->time_ns && record.fault == servo::Fault::kNone) {
      cycles.records.push_back(&record);
      cycles.positions_W.push_back(rt::to_vector(record.touching_W_m));
    }
  }
  return cycles;
}

void judge(const std::string& scene, const std::vector<std::string>& names,
           const std::string& why_not, const std::optional<servo::FirstContact>& contact,
           const SolveReference& solve, ContactCycles& cycles, RunSummary& summary) {
  if (!contact || cycles.records.size() < 2) {
    summary.reference = "the tool never touched the object";
    return;
  }
  if (!why_not.empty()) {
    summary.reference = why_not;
    return;
  }
  if (StopRequest::stop()) {
    summary.reference = why_reference_is_skipped();
    return;
  }
  simulator::ReferenceOptions reference_options;
  reference_options.scene = scene;
  reference_options.contact_point_W = contact->point_W;
  reference_options.cancel = &StopRequest::stop();
  ProgressLine line;
  reference_options.progress = [&line](double done, double remaining_s) {
    line.show("Reference forces (Ctrl-C skips them)", done, remaining_s);
  };
  simulator::ReferenceSolution reference;
  try {
    reference = solve(cycles, reference_options);
  } catch (const rt::Interrupted&) {
    reference.cancelled = true;
  }
  if (reference.cancelled) {
    summary.reference = why_reference_is_skipped();
    return;
  }
  cycles.reference_W = reference.forces_W;
  summary.reference = "computed";
  summary.reference_details = reference.to_json();
  if (reference.unconverged > 0) {
    summary.notes.push_back(std::to_string(reference.unconverged) +
                            " reference forces did not reach their tolerance");
  }
  add_errors(summary, names, cycles);
}

std::vector<FigureRow> figure_rows(const ContactCycles& cycles, std::size_t methods) {
  std::vector<FigureRow> rows;
  for (std::size_t i = 0; i < cycles.records.size(); ++i) {
    FigureRow row;
    row.time_s = cycles.time_s(i);
    row.position_W_m = cycles.records[i]->touching_W_m;
    if (!cycles.reference_W.empty()) {
      row.reference_W_N = rt::to_array(cycles.reference_W[i]);
    }
    for (std::size_t method = 0; method < methods; ++method) {
      row.method_W_N.push_back(cycles.records[i]->method_force_W_N[method]);
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace forcegrid::cli
