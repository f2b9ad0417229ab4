#pragma once

#include <string>
#include <vector>

#include "paper/recorded_motion.h"

namespace forcegrid::paper {

/// The methods in Figures 7 and 8: F_s, F_g, F_g with d in metres, and this project's default.
const std::vector<std::string>& figure_methods();

/// A fifth of the chirp: how fast the tool was, and each method's error in it.
struct Fifth {
  double begin_s = 0.0;
  double end_s = 0.0;
  double top_speed_m_per_s = 0.0;
  std::vector<double> rms_error_percent;  ///< one a method, of the RMS of F_o over the whole motion
};

/// Figures 7 and 8: a tool that has grabbed the surface moves along its normal, a sine of constant
/// amplitude and rising speed; forces streamed at 30 Hz, rendered by methods, and reference.
struct Figures {
  RecordedMotion motion;
  std::vector<Played> played;  ///< in the order of figure_methods()
  std::vector<Fifth> fifths;
  /// [s] When the first informative answer is there, and [N] the true force that was not felt until
  /// then at its largest: the first answer is for the instant of the grab, when there is no force.
  double blind_s = 0.0;
  double unfelt_N = 0.0;
};

/// @throws as record_motion().
Figures make_figures(const PaperOptions& options);

/// Errors and speeds of a motion that has been played, in fifths of its time.
std::vector<Fifth> fifths_of(const evaluation::Trace& trace, const std::vector<Played>& played);

}  // namespace forcegrid::paper
