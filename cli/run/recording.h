#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "cli/run/run_command.h"
#include "evaluation/trace.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_loop.h"
#include "tools/recorder.h"

namespace forcegrid::cli {

/// Samples that a recording holds at most, the newest: 2.7 hours at 30 a second.
inline constexpr std::size_t kRecordedSamples = 300'000;

/// Whether `--record` asks for a trace in CSV; a recording in HDF5 ends in .h5 or .hdf5.
bool records_trace(const RunOptions& options);

/// Refuses `--record` where it could come to nothing, before the run.
/// @throws std::runtime_error for a name that says neither trace nor recording, and for a trace of
/// a
///         run without reference forces, by which alone it can be judged; evaluation::TraceError
///         for a file that can't be written.
void check_recording(const RunOptions& options);

/// The recorder that `--record FILE.h5` asks for, with everything in it that says what is run; null
/// if it does not ask for one.
/// @throws tools::Hdf5Error when the file can't be made.
std::unique_ptr<tools::Recorder> start_recorder(const RunOptions& options,
                                                const profiles::DeviceProfile& profile,
                                                const std::vector<std::string>& methods,
                                                const std::string& device_url,
                                                const driver::DeviceIdentity& identity);

/// Adds to a recording that was closed what is known only after the run: the reference forces of
/// `cycles` (none: skipped) and the summary.
/// @throws tools::Hdf5Error when it can't be written.
void complete_recording(const tools::Recorder& recorder, const std::string& file,
                        const std::vector<const servo::CycleRecord*>& cycles,
                        const std::vector<Eigen::Vector3d>& reference_W,
                        const std::string& summary);

/// The trace of a run: what the simulator returned, when it arrived, which contacts that means, and
/// the reference force at every cycle. Times are seconds since `contact_ns`.
/// @param samples all that reached the servo, in order of arrival; those without contact only mark
///        its end, and answers to queries are left out.
/// @param cycles the cycles since the contact. @param reference_W [N] one a cycle.
evaluation::Trace trace_of(const std::deque<servo::ArrivedSample>& samples,
                           const std::vector<const servo::CycleRecord*>& cycles,
                           const std::vector<Eigen::Vector3d>& reference_W,
                           std::int64_t contact_ns);

}  // namespace forcegrid::cli
