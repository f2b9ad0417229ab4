#pragma once

#include <string>

#include "evaluation/trace.h"
#include "tools/tuning.h"

namespace forcegrid::cli {

/// What all runs of `forcegrid tune` have in common; as of RunOptions.
struct TuneRuns {
  std::string device, profile, scene, motion, hand;
  bool calibrated = false;  ///< the counters are right already
  std::string folder;       ///< for their files, which the next run replaces
};

/// Runs the loop for `seconds` with the default method and records positions, samples and reference
/// forces.
/// @throws std::runtime_error with the reason when there is no recording to tune on.
evaluation::Trace record_path(const TuneRuns& runs, double rate_Hz, double seconds);

/// Runs the loop for `seconds` as `row` says and fills in what it has measured, or its problem.
void measure_in_loop(const TuneRuns& runs, double seconds, tools::TuningRow& row);

}  // namespace forcegrid::cli
