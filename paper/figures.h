// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "paper/recorded_motion.h"

namespace forcegrid::paper {

/// Returns the methods in Figures 7 and 8: F_s, F_g, F_g with d in metres, and this project's
/// default.
const std::vector<std::string>& figure_methods();

/// A fifth of the chirp: the tool's speed and each method's error.
struct Fifth {
  double begin_s = 0.0;
  double end_s = 0.0;
  double top_speed_m_per_s = 0.0;
  /// One per method, in % of the RMS of F_o over the whole motion.
  std::vector<double> rms_error_percent;
};

/// Figures 7 and 8: a tool that holds the surface moves along its normal in a sine of constant
/// amplitude and rising frequency. Compared are the forces streamed at 30 Hz, those of the methods,
/// and the reference force.
struct Figures {
  RecordedMotion motion;
  std::vector<Played> played;  ///< in the order of figure_methods()
  std::vector<Fifth> fifths;
  /// [s] Time of the first informative answer, and [N] the largest reference force until then,
  /// which was not rendered. The very first answer is for the instant of the grab, when there is no
  /// force.
  double blind_s = 0.0;
  double unfelt_N = 0.0;
};

/// @throws as record_motion().
Figures make_figures(const PaperOptions& options);

/// Errors and speeds of a played motion, in fifths of its time.
std::vector<Fifth> fifths_of(const evaluation::Trace& trace, const std::vector<Played>& played);

}  // namespace forcegrid::paper
