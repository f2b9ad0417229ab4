// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/judge/judge.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/objects/object_effect.h"
#include "evaluation/traces/trace.h"

namespace forcegrid::evaluation {

/// Conditions under which a servo receives the simulator's answers.
struct NetworkCondition {
  std::string name;
  double simulator_rate_Hz = 30.0;
  double delay_s = 0.0;         ///< beyond the simulator's own period
  double jitter_s = 0.0;        ///< maximum of an additional uniformly random delay
  double loss = 0.0;            ///< fraction of the answers that are lost, at random
  double noise_N = 0.0;         ///< standard deviation of white noise on each axis of the force
  bool stiffness = false;       ///< answers carry dF/dP
  double requests_per_s = 0.0;  ///< that a method may make in addition
};

/// The conditions of the chart:
///
///   ideal        force only, 30 Hz
///   stiffness    force and stiffness, 30 Hz
///   delay100     100 ms of delay
///   lossy        20 ms of delay, 20 ms of jitter, 20 % loss
///   noise10      10 mN of noise
///   rate10       simulator at 10 Hz
///   rate60       simulator at 60 Hz
///   requests30, requests60, requests120   ideal with this number of requests per second
///
/// and delay100, lossy, noise10, rate10 and rate60 with `+stiffness`.
const std::vector<NetworkCondition>& network_conditions();

/// @throws ChartError for an unknown name, listing the known ones.
const NetworkCondition& network_condition(const std::string& name);

/// Makes the recording of a tool that follows `trajectory` on the object of `table`. Servo
/// instants: at `servo_rate_Hz` from 0 to before the trajectory's end, with the reference force,
/// which is zero in the air. Simulator: ticks at k / rate; an answer is for the first servo instant
/// at or after its tick and arrives one period after the tick, plus the condition's delays. Contact
/// events are at the servo instants at which contacts begin and end: the servo detects them itself,
/// before any force arrives. Every sample carries the stiffness, which
/// JudgeOptions::stiffness_to_method can hide from the method. Noise, jitter and loss are drawn
/// from `seed`. Walls lie around the first contact point and push any tool in contact, wherever it
/// holds the object. An object effect changes the object's force and the simulator.
/// @throws ChartError for a trajectory that leaves the table.
Trace make_trace(const Trajectory& trajectory, const ForceTable& table,
                 const NetworkCondition& condition, double servo_rate_Hz, std::uint64_t seed,
                 const SceneExtras& extras = {});

/// Makes the options for judge() under a condition: whether stiffness arrives, and requests
/// answered from the table one request period later, with the condition's noise. Outside the
/// table's range the answer is for the nearest position within it (Sample::position_W); in the air
/// the force is zero. An object with memory answers for a tool at rest at that position and time.
/// `trajectory` and `table` must outlive the result.
JudgeOptions judge_options(const Trajectory& trajectory, const ForceTable& table,
                           const NetworkCondition& condition, double servo_rate_Hz,
                           std::uint64_t seed, const SceneExtras& extras = {});

}  // namespace forcegrid::evaluation
