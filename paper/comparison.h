// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "paper/recorded_motion.h"

namespace forcegrid::paper {

/// One method that the paper names, on one of the paper's scenes and one motion.
struct ComparisonRow {
  std::string scene;
  std::string motion;
  std::string method;
  std::string stands_for;  ///< whose idea it is, by the paper's references
  std::string needs;       ///< beyond forces along the path
  std::string right_when;
  /// RMS error after 1 s in % of the RMS force, and the mean cost per cycle, samples included, over
  /// the bare trilinear read of the same run; NaN if it was not judged.
  double error_percent = std::numeric_limits<double>::quiet_NaN();
  double cycle_over_bare_read = std::numeric_limits<double>::quiet_NaN();
  /// [s] NaN for a method that computes nothing beforehand.
  double precompute_s = std::numeric_limits<double>::quiet_NaN();
  double memory_MB = std::numeric_limits<double>::quiet_NaN();  ///< tables included
  std::string not_judged;                                       ///< the reason; empty if judged
};

/// What the paper's sections 1 and 2 compare the forcegrid with, each from its source's own idea.
struct Comparison {
  std::vector<ComparisonRow> rows;  ///< by scene and motion, then by method
  /// Three sentences that follow from the rows: which method to take without the object's model,
  /// with it and time beforehand, and with it and a processor to solve it.
  std::vector<std::string> which_to_take;
};

/// Plays every method on every motion; motions of one scene follow each other.
/// @param bare_read_ns  [ns] cost of the bare trilinear read in this run.
/// @throws evaluation::ChartError, evaluation::Stopped, simulator::Error.
/// Real-time: no. Threads: one; nothing else should run.
Comparison compare_rivals(const std::vector<const RecordedMotion*>& motions, double bare_read_ns,
                          const PaperOptions& options);

/// The sentences of Comparison::which_to_take. Of each group the method with the smallest worst
/// error over scenes and motions is taken; one that was not judged on all of them is not.
std::vector<std::string> which_to_take(const std::vector<ComparisonRow>& rows);

}  // namespace forcegrid::paper
