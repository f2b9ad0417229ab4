// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/judge/method_costs.h"
#include "evaluation/traces/trace.h"
#include "forcegrid/core/force_method.h"

namespace forcegrid::evaluation {

/// Answer of the simulator at a position that the method requests: force, and stiffness if the link
/// carries it.
using Answerer = std::function<Sample(double time_s, const Eigen::Vector3d& position_W)>;

/// Units of ForceMethod::work() per cycle in a servo loop, as ServoOptions::fill_budget.
inline constexpr int kServoWorkBudget = 1000;

struct JudgeOptions {
  /// Units of ForceMethod::work() per cycle; negative: all pending work at once after each sample.
  int work_budget = -1;
  Answerer answer;  ///< empty: requests are not answered
  /// Predicts the contact point of a tool that keeps its direction; empty, or no value: unknown. In
  /// the air, the method receives it at each servo instant (ForceMethod::expect_contact).
  std::function<std::optional<Eigen::Vector3d>(const Eigen::Vector3d& position_W,
                                               const Eigen::Vector3d& velocity_W)>
      expect;
  /// Answer of the simulator, while the tool is in the air, for a tool at `position_W` that touched
  /// at the predicted contact `point_W`. Empty: such requests are not answered.
  std::function<Sample(double time_s, const Eigen::Vector3d& position_W,
                       const Eigen::Vector3d& point_W)>
      answer_before_contact;
  double requests_per_s = 0.0;      ///< rate for a method that makes requests
  double request_delay_s = 0.0;     ///< until an answer arrives
  bool stiffness_to_method = true;  ///< false: samples reach the method without dF/dP
  bool keep_forces = false;         ///< fill Verdict::forces_W
  /// Takes part in measuring: the least that each cycle took in this call and in earlier ones with
  /// the same trace and a new method of the same kind, which do the same work. What else a machine
  /// does lengthens a cycle now and then, but seldom the same one each time. Begins empty.
  std::vector<double>* least_cycle_ns = nullptr;
};

/// Errors and costs of a method on a trace. Percentages refer to the RMS of |F_o| over the whole
/// trace; "after" starts one second after the first servo instant. A figure is NaN if there is
/// nothing to measure: the errors after 1 s of a shorter trace, all errors if every F_o is zero,
/// and the cost of samples if none arrived.
struct Verdict : MethodCosts {
  double reference_rms_N = 0.0;
  double rms_error_percent_first_1s = 0.0;
  double p95_error_percent_first_1s = 0.0;
  double max_error_percent_first_1s = 0.0;
  double rms_error_percent_after_1s = 0.0;
  double p95_error_percent_after_1s = 0.0;
  double max_error_percent_after_1s = 0.0;
  double adaptation_s = 0.0;  ///< end of the first half second from which on the RMS error of every
                              ///< half second is below 5 %; NaN: never
  double largest_step_N = 0.0;  ///< of the error between two cycles, after 1 s
  std::size_t memory_bytes = 0;
  std::size_t samples_taken = 0;      ///< along the path
  std::size_t samples_not_taken = 0;  ///< of no contact, or of a contact that has ended
  std::size_t samples_refused = 0;    ///< by SampleGate
  std::size_t requests_answered = 0;
  std::array<std::size_t, 5> cycles_by_status{};  ///< indexed by EstimateStatus
  std::vector<Eigen::Vector3d> forces_W;          ///< [N] at each servo instant
};

/// Plays a trace to a new method in the order of a servo. At each servo instant: everything
/// delivered by then (contacts, samples of the present contact, answers), observe(), force(), a
/// request if one is due, work(). The method never receives the reference force. The contact epoch
/// of a sample is the number of its contact, counted from 1.
///
///   error percent = 100 |F - F_o| / RMS |F_o|
///
/// Times are measured with rt::Clock around each call, minus the cost of reading the clock. For
/// queries below 1 us the time is the mean of eight successive queries along the path, because of
/// the clock's resolution. What the subtraction leaves below timer_floor_ns, or even below
/// zero, counts as that floor.
/// Source: the forcegrid paper, section 6, which also compares with the reference force F_o.
/// Real-time: no. Threads: one.
/// @throws std::invalid_argument if least_cycle_ns is of a trace with another number of instants.
Verdict judge(ForceMethod& method, const Trace& trace, const JudgeOptions& options = {});

}  // namespace forcegrid::evaluation
