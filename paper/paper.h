#pragma once

#include "paper/results.h"

namespace forcegrid::paper {

/// Runs the paper's experiments: the timing paragraph first, while nothing else of the program
/// runs, then Figures 7 and 8, resolutions and distances of influence, and the three objects.
/// @throws evaluation::ChartError, evaluation::FileError, evaluation::Stopped, simulator::Error
/// with
///         a sentence for the user.
/// Real-time: no. Threads: one; starts options.jobs of its own.
Results run_experiments(const PaperOptions& options);

}  // namespace forcegrid::paper
