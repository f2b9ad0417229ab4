#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/force_table.h"
#include "evaluation/judge.h"
#include "evaluation/object_effect.h"
#include "evaluation/trace.h"
#include "evaluation/trajectories.h"

namespace forcegrid::evaluation {

/// How the simulator's answers come to a servo.
struct NetworkCondition {
  std::string name;
  double simulator_rate_Hz = 30.0;
  double delay_s = 0.0;         ///< beyond the simulator's own period
  double jitter_s = 0.0;        ///< a uniformly random further delay of up to this
  double loss = 0.0;            ///< fraction of the answers that never arrive, at random
  double noise_N = 0.0;         ///< standard deviation of white noise on each axis of the force
  bool stiffness = false;       ///< answers carry dF/dP
  double requests_per_s = 0.0;  ///< that a method may make on top
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
///   requests30, requests60, requests120   ideal with so many requests a second
///
/// and delay100, lossy, noise10, rate10 and rate60 with `+stiffness`.
const std::vector<NetworkCondition>& network_conditions();

/// @throws ChartError for an unknown name, listing the known ones.
const NetworkCondition& network_condition(const std::string& name);

/// The recording of a tool that follows `trajectory` on the object of `table`. Servo:
/// `servo_rate_Hz` from 0 to before the trajectory's end, with the true force, which is zero in the
/// air. Simulator: ticks at k / rate; an answer is for the first servo instant at or after its tick
/// and arrives one period after the tick, plus the condition's delays. Contacts are events at the
/// servo instants at which they begin and end: the servo knows them from its own side, before any
/// force arrives. Every sample carries the stiffness; JudgeOptions::stiffness_to_method keeps it
/// from the method. Noise, jitter and loss are drawn from `seed`. Walls stand around the first
/// contact point and push a tool that is in contact, wherever it took hold of the object; an
/// effect is of the object's force, and of the simulator.
/// @throws ChartError for a trajectory that leaves the table.
Trace make_trace(const Trajectory& trajectory, const ForceTable& table,
                 const NetworkCondition& condition, double servo_rate_Hz, std::uint64_t seed,
                 const SceneExtras& extras = {});

/// Options for judge() under a condition: whether stiffness arrives, and requests answered from the
/// table, one request period later. Beyond the table's range the answer is for the nearest position
/// within it (Sample::position_W); in the air the force is zero. Noise as the condition has it. An
/// object that remembers answers as it would at that moment to a tool at rest there.
/// `trajectory` and `table` must outlive the result.
JudgeOptions judge_options(const Trajectory& trajectory, const ForceTable& table,
                           const NetworkCondition& condition, double servo_rate_Hz,
                           std::uint64_t seed, const SceneExtras& extras = {});

}  // namespace forcegrid::evaluation
