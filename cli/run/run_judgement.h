#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "cli/common/figures.h"
#include "cli/run/run_command.h"
#include "cli/run/run_summary.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::cli {

/// The cycles since the tool first touched, those of faults left out, and the reference forces
/// there.
struct ContactCycles {
  std::int64_t contact_ns = 0;  ///< CLOCK_MONOTONIC
  std::vector<const servo::CycleRecord*> records;
  std::vector<Eigen::Vector3d> positions_W;  ///< [m] one a record
  std::vector<Eigen::Vector3d> reference_W;  ///< [N] one a record; empty: not computed

  [[nodiscard]] double time_s(std::size_t i) const {
    return 1e-9 * static_cast<double>(records[i]->time_ns - contact_ns);
  }
};

/// @param contact  nothing: the tool never touched, and no cycle counts
/// @param records  have to outlive what is returned
ContactCycles cycles_since(const std::optional<servo::FirstContact>& contact,
                           const std::deque<servo::CycleRecord>& records);

/// Solves the object off line along the cycles' path, and says in the summary how far each method
/// was from that; or says there why it did not. The progress goes to `out`.
/// @param why_not  what speaks against it; empty: nothing
/// @throws std::exception from the solver, see simulator::reference_forces().
void judge(const RunOptions& options, const std::vector<std::string>& names,
           const std::string& why_not, const std::optional<servo::FirstContact>& contact,
           std::FILE* out, ContactCycles& cycles, RunSummary& summary);

/// The rows of the picture of `methods` methods.
std::vector<FigureRow> figure_rows(const ContactCycles& cycles, std::size_t methods);

}  // namespace forcegrid::cli
