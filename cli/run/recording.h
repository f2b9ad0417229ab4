// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "cli/run/run_command.h"
#include "evaluation/traces/trace.h"
#include "profiles/device_profile.h"
#include "servo_loop/servo_loop.h"
#include "tools/recorder.h"

namespace forcegrid::cli {

/// Largest number of samples of a trace; older ones are dropped. 2.7 hours at 30 per second.
inline constexpr std::size_t kRecordedSamples = 300'000;

/// Whether `--record` names a trace in CSV rather than a recording in HDF5 (.h5 or .hdf5).
bool records_trace(const RunOptions& options);

/// Rejects a `--record` that can't succeed, before the run starts.
/// @throws std::runtime_error for a name that is neither a trace's nor a recording's, and for a
///         trace of a run without reference forces, which evaluation needs; evaluation::TraceError
///         for a file that can't be written.
void check_recording(const RunOptions& options);

/// Returns the recorder for `--record FILE.h5`, its attributes filled with the description of the
/// run, `view_hello` among them, which the live view of the recording begins with; null if
/// `--record` names no recording.
/// @throws tools::Hdf5Error if the file can't be created.
std::unique_ptr<tools::Recorder> start_recorder(const RunOptions& options,
                                                const profiles::DeviceProfile& profile,
                                                const std::vector<std::string>& methods,
                                                const std::string& device_url,
                                                const driver::DeviceIdentity& identity,
                                                const std::string& view_hello);

/// Adds to a closed recording what is known only after the run: the reference forces of `cycles`
/// (empty: skipped) and the summary.
/// @throws tools::Hdf5Error if it can't be written.
void complete_recording(const tools::Recorder& recorder, const std::string& file,
                        const std::vector<const servo::CycleRecord*>& cycles,
                        const std::vector<Eigen::Vector3d>& reference_W,
                        const std::string& summary);

/// Makes the trace of a run: the simulator's samples with their times of arrival, the contacts that
/// follow from them, and the reference force at every cycle. Times are seconds since `contact_ns`.
/// @param samples all samples that reached the servo, in order of arrival. Samples without contact
///         only mark the end of a contact; answers to queries are left out.
/// @param cycles the cycles since the contact. @param reference_W [N] one per cycle.
evaluation::Trace trace_of(const std::deque<servo::ArrivedSample>& samples,
                           const std::vector<const servo::CycleRecord*>& cycles,
                           const std::vector<Eigen::Vector3d>& reference_W,
                           std::int64_t contact_ns);

}  // namespace forcegrid::cli
