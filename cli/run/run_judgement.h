// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/common/figures.h"
#include "cli/run/run_summary.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/servo_loop.h"
#include "simulator/reference/reference_solution.h"

namespace forcegrid::cli {

/// The cycles since the tool first touched the object, without those of faults, and the reference
/// forces at them.
struct ContactCycles {
  std::int64_t contact_ns = 0;  ///< CLOCK_MONOTONIC
  std::vector<const servo::CycleRecord*> records;
  std::vector<Eigen::Vector3d> positions_W;  ///< [m] one per record
  std::vector<Eigen::Vector3d> reference_W;  ///< [N] one per record; empty: not computed

  /// [s] Since the contact.
  [[nodiscard]] double time_s(std::size_t i) const {
    return 1e-9 * static_cast<double>(records[i]->time_ns - contact_ns);
  }
};

/// Selects the cycles since `contact`.
/// @param contact nothing: the tool never touched the object, and no cycle counts
/// @param records must outlive the result
ContactCycles cycles_since(const std::optional<servo::FirstContact>& contact,
                           const std::deque<servo::CycleRecord>& records);

/// Solves the reference forces along a path; see simulator::simulate_reference().
using SolveReference = std::function<simulator::ReferenceSolution(
    const ContactCycles&, const simulator::ReferenceOptions&)>;

/// Computes the reference forces along the cycles' path and writes each method's error into the
/// summary, or the reason why there is none. Progress goes to
/// standard error.
/// @param why_not why no reference forces can be computed; empty: they can
/// @throws std::exception from `solve`.
void judge(const std::string& scene, const std::vector<std::string>& names,
           const std::string& why_not, const std::optional<servo::FirstContact>& contact,
           const SolveReference& solve, ContactCycles& cycles, RunSummary& summary);

/// Makes the rows of the picture of `methods` methods.
std::vector<FigureRow> figure_rows(const ContactCycles& cycles, std::size_t methods);

}  // namespace forcegrid::cli
