// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_view.h"

#include <algorithm>
#include <cstdint>

#include "cli/run/reference_forces.h"
#include "cli/run/view_title.h"
#include "evaluation/judge/baseline_cost.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::cli {
namespace {

// Why the rendered method can't make requests; empty: it can.
std::string why_no_requests(const RunOptions& options, const ForceMethod& rendered,
                            const simulator::ToolOptions& tool) {
  if (!rendered.needs().requests && !rendered.needs().can_request) {
    return "method " + options.method + " makes no requests";
  }
  if (tool.slides()) {
    return "the force on a sliding tool depends on its path";
  }
  if (tool.turns) {
    return "the force depends on the tool's orientation";
  }
  if (options.simulator.empty() && moves_by_itself(options.scene, options.solver)) {
    return "the object of this scene moves by itself";
  }
  return "";
}

void add_budget_facts(const RunOptions& options, const RunMethods& methods,
                      const MethodOptions& method_options, ControlFacts& facts) {
  for (const ForceMethod* method : methods.methods()) {
    if (const auto least = method->least_budget_reads()) {
      facts.least_budget_reads = std::max(*least, facts.least_budget_reads.value_or(0.0));
    }
  }
  facts.budget_us = options.budget.us;
  if (options.budget.us && method_options.budget_reads) {
    facts.read_ns = 1e3 * *options.budget.us / *method_options.budget_reads;
  } else if (facts.least_budget_reads) {
    facts.read_ns = evaluation::bare_trilinear_read_ns();
  }
}

ControlFacts control_facts(const RunOptions& options, const RunProcesses& processes,
                           const RunMethods& methods, const MethodOptions& method_options,
                           const servo::ServoOptions& servo_options,
                           const simulator::ToolOptions& tool) {
  const ViewProcess& view = *processes.view();
  ControlFacts facts;
  facts.emulated = processes.has_emulator();
  facts.own_simulator = processes.has_simulator();
  facts.hand_socket = processes.has_emulator() ? view.hand_socket(options.device_number) : "";
  facts.simulator_socket = view.simulator_socket();
  facts.run_socket = view.run_socket(options.device_number);
  facts.rate_Hz = options.rate_Hz;
  facts.simulator_rate_Hz = options.simulator_rate_Hz;
  facts.delay_ms = options.simulator_delay_ms;
  facts.jitter_ms = options.simulator_jitter_ms;
  facts.loss_percent = options.simulator_loss_percent;
  facts.requests_per_s = servo_options.requests_per_s;
  facts.needs_requests = methods.rendered().needs().requests;
  facts.why_no_requests = why_no_requests(options, methods.rendered(), tool);
  add_budget_facts(options, methods, method_options, facts);
  facts.hand = options.hand;
  facts.scene = processes.has_simulator() ? options.scene : "";
  facts.scenes = simulator::scene_names();
  if (options.device_number > 0) {
    facts.why_same_simulator = "several devices share the simulator: it stays as it began";
  }
  if (!options.record.empty()) {
    facts.why_one_scene = "a recording has one scene";
  }
  if (tool.slides()) {
    facts.why_whole = "the object under a sliding tool can't be cut";
  } else if (tool.turns) {
    facts.why_whole = "the object under a tool that turns can't be cut";
  } else if (options.workers > 0) {
    facts.why_whole = "the workers have the whole object";
  } else if (options.simulator.empty() && moves_by_itself(options.scene, options.solver)) {
    facts.why_whole = "an object that moves by itself can't be cut";
  }
  if (std::find(facts.scenes.begin(), facts.scenes.end(), facts.scene) == facts.scenes.end()) {
    facts.scenes.push_back(facts.scene);
  }
  return facts;
}

}  // namespace

ViewTitle live_title(const RunOptions& options, const RunProcesses& processes,
                     const RunMethods& methods, const MethodOptions& method_options,
                     const servo::ServoOptions& servo_options, const simulator::ToolOptions& tool) {
  ViewTitle title = view_title(options, methods, method_options, servo_options, processes);
  title.hand_socket =
      processes.has_emulator() ? processes.view()->hand_socket(options.device_number) : "";
  title.tool = static_cast<std::uint16_t>(std::max(options.device_number, 1) - 1);

  title.controls = control_facts(options, processes, methods, method_options, servo_options, tool);
  title.tour = options.tour;
  return title;
}

}  // namespace forcegrid::cli
