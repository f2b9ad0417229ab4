// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/playback/recorded_run.h"

namespace forcegrid::cli {

/// Recordings that a live view shows at a time.
inline constexpr std::size_t kMostRecordings = 4;

/// Reads the recordings of one run, one per device, and puts them on one clock in the order of
/// their tools. A single recording may be of any run.
/// @throws tools::Hdf5Error for a file that RecordedRun refuses; std::runtime_error for recordings
/// that are not of one run, saying what tells them apart: number or place of the tool, scene,
/// clock. Real-time: no.
RecordedRuns recordings_of_one_run(const std::vector<std::string>& files);

}  // namespace forcegrid::cli
