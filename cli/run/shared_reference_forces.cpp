// SPDX-License-Identifier: Apache-2.0
#include "cli/run/shared_reference_forces.h"

#include <algorithm>

namespace forcegrid::cli {
namespace {

// Loops that end together do so within a look of the thread that watches them, and a cycle.
constexpr double kEndTogether_s = 0.1;

double end_s(const ToolRun& run) {
  return 1e-9 * static_cast<double>(run.cycles.records.back()->time_ns);
}

// Where a tool was when the object was solved before `time_s`; at its touch if that came later.
Eigen::Vector3d solved_before_W(const ToolRun& run, double time_s) {
  Eigen::Vector3d at_W = run.contact->point_W;
  for (const servo::ArrivedSample& arrived : *run.samples) {
    if (arrived.in_contact && !arrived.sample.from_query && arrived.sample.time_s < time_s) {
      at_W = arrived.sample.position_W;
    }
  }
  return at_W;
}

// When others on the object first felt that `run` had ended: the simulator then tells each of a new
// contact. kNever_s: they had ended themselves before the object was solved again.
double end_felt_s(const ToolRun& run, const std::vector<ToolRun>& runs, double simulator_period_s) {
  double felt_s = simulator::ToolPath::kNever_s;
  for (const ToolRun& other : runs) {
    std::optional<std::uint32_t> epoch;
    if (&other == &run || !other.contact) {
      continue;
    }
    for (const servo::ArrivedSample& arrived : *other.samples) {
      const Sample& sample = arrived.sample;
      if (!arrived.in_contact || sample.from_query) {
        continue;
      }
      // Its state may be a little older than the end.
      if (epoch && *epoch != sample.contact_epoch &&
          sample.time_s > end_s(run) - simulator_period_s) {
        felt_s = std::min(felt_s, sample.time_s);
      }
      epoch = sample.contact_epoch;
    }
  }
  return felt_s;
}

}  // namespace

std::vector<simulator::ToolPath> paths_of(const std::vector<ToolRun>& runs,
                                          double simulator_period_s) {
  std::vector<simulator::ToolPath> paths(runs.size());
  double newest_end_s = 0.0;
  for (const ToolRun& run : runs) {
    newest_end_s = run.cycles.records.empty() ? newest_end_s : std::max(newest_end_s, end_s(run));
  }
  for (std::size_t k = 0; k < runs.size(); ++k) {
    const ToolRun& run = runs[k];
    simulator::ToolPath& path = paths[k];
    for (const servo::CycleRecord* record : run.cycles.records) {
      path.times_s.push_back(1e-9 * static_cast<double>(record->time_ns));
    }
    path.positions_W = run.cycles.positions_W;
    if (!run.contact || path.times_s.empty()) {
      continue;
    }
    path.touched_s = 1e-9 * static_cast<double>(run.contact->time_ns);
    path.contact_point_W = run.contact->point_W;
    if (end_s(run) < newest_end_s - kEndTogether_s) {
      path.let_go_s = end_s(run);
    } else if (end_s(run) < newest_end_s) {
      path.let_go_s = end_felt_s(run, runs, simulator_period_s);
    }
    for (const ToolRun& other : runs) {
      path.tools_before_touch_W.push_back(
          other.contact ? solved_before_W(other, path.touched_s - 0.5 * simulator_period_s)
                        : Eigen::Vector3d::Zero());
    }
  }
  return paths;
}

const simulator::ReferenceSolution& SharedReferenceForces::of(
    std::size_t device, const simulator::ReferenceOptions& options) {
  if (solved_.empty() || solved_.front().cancelled) {
    solved_ = simulator::simulate_shared_reference(paths_, options);
  }
  return solved_.at(device);
}

}  // namespace forcegrid::cli
