#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "cli/run_command.h"
#include "evaluation/trace.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::cli {

/// Samples that a recording holds at most, the newest: 2.7 hours at 30 a second.
inline constexpr std::size_t kRecordedSamples = 300'000;

/// Refuses `--record` where it could come to nothing, before the run.
/// @throws std::runtime_error for a run without off-line forces, by which alone a trace can be
///         judged; evaluation::TraceError for a file that can't be written.
void check_recording(const RunOptions& options);

/// The trace of a run: what the simulator returned, when it arrived, which contacts that means, and
/// the off-line force at every cycle. Times are seconds since `contact_ns`.
/// @param samples all that reached the servo, in order of arrival; those without contact only mark
///        its end, and answers to queries are left out.
/// @param cycles the cycles since the contact. @param truth_W [N] one a cycle.
evaluation::Trace trace_of(const std::deque<servo::ArrivedSample>& samples,
                           const std::vector<const servo::CycleRecord*>& cycles,
                           const std::vector<Eigen::Vector3d>& truth_W, std::int64_t contact_ns);

}  // namespace forcegrid::cli
