// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "paper/results.h"

namespace forcegrid::paper {

/// Runs the paper's experiments: first the timing paragraph, while the program runs nothing else,
/// then Figures 7 and 8, the methods that the paper names, resolutions and distances of influence,
/// and the three objects.
/// @throws evaluation::ChartError, evaluation::FileError, evaluation::Stopped, simulator::Error
///         with a sentence for the user.
/// Real-time: no. Threads: one; it starts options.jobs further threads.
Results run_experiments(const PaperOptions& options);

}  // namespace forcegrid::paper
