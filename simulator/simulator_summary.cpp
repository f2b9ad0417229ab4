// SPDX-License-Identifier: Apache-2.0
#include "simulator/simulator_summary.h"

#include <nlohmann/json.hpp>

namespace forcegrid::simulator {
namespace {

nlohmann::json to_json(const WorkerStatistics& statistics, std::uint64_t unchecked) {
  nlohmann::json each = nlohmann::json::array();
  for (const WorkerRecord& worker : statistics.workers) {
    const auto round_trips = static_cast<double>(worker.round_trips);
    each.push_back({{"name", worker.name},
                    {"present", worker.present},
                    {"expelled", worker.expelled},
                    {"answers", worker.answers},
                    {"late", worker.late},
                    {"checked_right", worker.right},
                    {"wrong", worker.wrong},
                    {"round_trip_mean_ms",
                     worker.round_trips == 0 ? 0.0 : 1e3 * worker.round_trip_sum_s / round_trips}});
  }
  return {{"strangers", statistics.strangers},
          {"joined", statistics.joined},
          {"refused", statistics.refused},
          {"gone", statistics.gone},
          {"expelled", statistics.expelled},
          {"jobs_given", statistics.given},
          {"answers", statistics.answered},
          {"jobs_taken_back", statistics.taken_back},
          {"jobs_given_up", statistics.given_up},
          {"late", statistics.late},
          {"checked_right", statistics.right},
          {"wrong", statistics.wrong},
          {"unchecked", unchecked},
          {"malformed", statistics.malformed},
          {"unasked", statistics.unasked},
          {"each", each}};
}

nlohmann::json to_json(const ReducedUse& use) {
  return {{"answers", use.answers},
          {"full_answers", use.full_answers},
          {"out_of_reach", use.out_of_reach},
          {"not_converged", use.not_converged},
          {"checks", use.checks},
          {"failed_checks", use.failed_checks},
          {"worst_check_percent", 100.0 * use.worst_check},
          {"trainings", use.trainings},
          {"training_s", use.training_s},
          {"states", use.states},
          {"modes", use.modes},
          {"springs", use.springs}};
}

nlohmann::json to_json(const std::optional<ModelUse>& use) {
  if (!use) {
    return nullptr;
  }
  nlohmann::json trials = nlohmann::json::array();
  for (const ModelUse::Trial& trial : use->trials) {
    trials.push_back({{"model", trial.model},
                      {"mean_ms", trial.mean_ms},
                      {"error_percent", trial.error_percent}});
  }
  return {{"tolerance_percent", use->tolerance_percent},
          {"chosen", use->chosen},
          {"why", use->why},
          {"trials", trials}};
}

nlohmann::json to_json(const std::optional<SurfaceUse>& use) {
  if (!use) {
    return nullptr;
  }
  return {{"frames", use->frames},
          {"inside_frames", use->inside_frames},
          {"dropped", use->dropped},
          {"view_lost", use->view_lost},
          {"frame_ms", {{"mean", use->mean_ms}, {"max", use->max_ms}}}};
}

}  // namespace

nlohmann::json to_json(const SimulatorSummary& summary) {
  nlohmann::json result = {{"scene", summary.scene},
                           {"tool", summary.tool},
                           {"patches", summary.patches},
                           {"contact", summary.contact},
                           {"listening", summary.listening},
                           {"vertices", summary.vertices},
                           {"springs", summary.springs},
                           {"solver", summary.solver},
                           {"solver_why", summary.solver_why},
                           {"model", to_json(summary.model)},
                           {"rate_Hz", summary.rate_Hz},
                           {"link",
                            {{"delay_ms", 1e3 * summary.link.delay_s},
                             {"jitter_ms", 1e3 * summary.link.jitter_s},
                             {"loss_percent", 1e2 * summary.link.loss},
                             {"delayed", summary.delayed},
                             {"lost_on_purpose", summary.lost_on_purpose}}},
                           {"control_changes", summary.control_changes},
                           {"sessions", summary.sessions},
                           {"ticks", summary.ticks},
                           {"answers", summary.answers},
                           {"replies", summary.replies},
                           {"queries_refused", summary.queries_refused},
                           {"late_ticks", summary.late_ticks},
                           {"missed_ticks", summary.missed_ticks},
                           {"send_failures", summary.send_failures},
                           {"datagrams_dropped", nlohmann::json::object_t(summary.dropped.begin(),
                                                                          summary.dropped.end())},
                           {"workers", to_json(summary.workers, summary.unchecked)},
                           {"contacts", summary.contacts},
                           {"unconverged", summary.unconverged},
                           {"branch_changes", summary.branch_changes},
                           {"long_steps", summary.long_steps},
                           {"not_reached", summary.not_reached},
                           {"not_finite", summary.not_finite},
                           {"whole_solutions", summary.whole_solutions},
                           {"reduced", to_json(summary.reduced)},
                           {"worst_relative_residual", summary.worst_relative_residual},
                           {"solve_ms",
                            {{"mean", summary.solve_mean_ms},
                             {"p50", summary.solve_p50_ms},
                             {"p99", summary.solve_p99_ms},
                             {"max", summary.solve_max_ms}}},
                           {"grab_max_ms", summary.grab_max_ms},
                           {"iterations_mean", summary.iterations_mean},
                           {"surface", to_json(summary.surface)}};
  for (const SimulatorSummary::ToolUse& use : summary.tools) {
    result["tools"].push_back({{"tool", use.tool},
                               {"sessions", use.sessions},
                               {"answers", use.answers},
                               {"contacts", use.contacts}});
  }
  if (!summary.tools.empty()) {
    result["tool_faults"] = summary.faults;
  }
  return result;
}

}  // namespace forcegrid::simulator
