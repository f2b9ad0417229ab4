#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/trace.h"
#include "forcegrid/core/force_method.h"

namespace forcegrid::evaluation {

/// What the simulator would answer at a position of the method's choice: force, and stiffness if
/// the link carries it. For methods that make requests.
using Answerer = std::function<Sample(double time_s, const Eigen::Vector3d& position_W)>;

struct JudgeOptions {
  /// Units of ForceMethod::work() a cycle; negative: all pending work at once after each sample.
  int work_budget = -1;
  Answerer answer;  ///< empty: requests are not answered
  /// Where the tool, going on straight, would touch soon; empty, or nothing: not known. Told to the
  /// method in the air, once a servo instant (ForceMethod::expect_contact).
  std::function<std::optional<Eigen::Vector3d>(const Eigen::Vector3d& position_W,
                                               const Eigen::Vector3d& velocity_W)>
      expect;
  /// What the simulator would answer in the air for a tool at `position_W` that had touched at
  /// `point_W`, the expected contact. Empty: such requests are not answered.
  std::function<Sample(double time_s, const Eigen::Vector3d& position_W,
                       const Eigen::Vector3d& point_W)>
      answer_before_contact;
  double requests_per_s = 0.0;      ///< of a method that makes them
  double request_delay_s = 0.0;     ///< until an answer arrives
  bool stiffness_to_method = true;  ///< false: samples reach the method without dF/dP
  bool keep_forces = false;         ///< fill Verdict::forces_W
};

/// How a method did on a trace. Percent figures are of the RMS of |F_o| over the whole trace;
/// "after" is from one second after the first servo instant on. A figure without anything to
/// measure is NaN: the errors after 1 s of a shorter trace, all errors when every F_o is zero, the
/// cost of samples when none came.
struct Verdict {
  double reference_rms_N = 0.0;
  double rms_error_percent_first_1s = 0.0;
  double p95_error_percent_first_1s = 0.0;
  double max_error_percent_first_1s = 0.0;
  double rms_error_percent_after_1s = 0.0;
  double p95_error_percent_after_1s = 0.0;
  double max_error_percent_after_1s = 0.0;
  double adaptation_s = 0.0;  ///< end of the first half second from which on the RMS error of each
                              ///< half second stays below 5 %; NaN: never
  double largest_step_N = 0.0;   ///< of the error between two cycles, after 1 s
  double query_ns_median = 0.0;  ///< force()
  double query_ns_p99 = 0.0;
  double sample_us_median = 0.0;  ///< take_sample() and the work() that it caused
  double sample_us_p99 = 0.0;
  double cycle_ns = 0.0;  ///< mean over the cycles of all time in the method, samples included
  double cycle_ns_median = 0.0;
  double cycle_ns_p99 = 0.0;
  std::size_t memory_bytes = 0;
  std::size_t samples_taken = 0;      ///< along the path
  std::size_t samples_not_taken = 0;  ///< of no contact, or of one that is over
  std::size_t samples_refused = 0;    ///< by SampleGate
  std::size_t requests_answered = 0;
  std::array<std::size_t, 5> cycles_by_status{};  ///< indexed by EstimateStatus
  std::vector<Eigen::Vector3d> forces_W;          ///< [N] at each servo instant
};

/// Plays a trace to a method that has just been made, as a servo would. At each servo instant: what
/// has been delivered by then (contacts, samples of the present contact, answers), observe(),
/// force(), a request if it is time for one, work(). The method never sees the reference. Samples
/// carry the number of the contact in which they were computed, counted from 1, as their contact
/// epoch.
///
///   error percent = 100 |F - F_o| / RMS |F_o|
///
/// Times are those of rt::Clock around each call, less what reading the clock costs; that of a
/// query of less than 1 us is the mean of eight in a row along the path, as clocks tick in steps.
/// Source of the figures: the forcegrid paper, section 6, judges by the reference force F_o alike.
/// Real-time: no. Threads: one.
Verdict judge(ForceMethod& method, const Trace& trace, const JudgeOptions& options = {});

}  // namespace forcegrid::evaluation
