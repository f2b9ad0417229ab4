// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "forcegrid/core/pair_force_method.h"
#include "stability/closed_loop.h"
#include "stability/hand.h"
#include "stability/pair_object.h"
#include "stability/plant.h"

namespace forcegrid::stability {

/// Two devices and hands on one object, without object and method. Each side has a servo loop and a
/// method of its own, which may stand at different distances from the simulator and each other.
struct PairLoopSetup {
  double servo_rate_Hz = 500.0;
  DeviceTiming timing;
  DeviceDynamics device;
  Hand hand;
  bool together = true;  ///< false: the second tool stands still where it touched
  PairObjectMaker object = pair_object_of(kSprings);
  /// Samples carry the object's dF_i/dP_j.
  bool stiffness = false;
  double simulator_rate_Hz = 30.0;
  /// [s] Until a side gets an answer, beyond the simulator's own period.
  std::array<double, 2> delay_s{0.0, 0.0};
  /// [s] Age of the other tool's place where each side renders, rounded to cycles. In one program
  /// the two ages are together a cycle where each loop begins its own within the other one's; what
  /// the loops gain around both sides depends on their sum.
  std::array<double, 2> other_age_s{0.0, 0.0};
  /// Moves that place on to the present by its velocity, as servo::PairHalf does.
  bool moved_on = false;
  /// [s] That the hands keep still; longer where oscillations decay slowly.
  double hold_s = 4.0;
  int fill_budget = 1000;  ///< of PairForceMethod::work() per cycle
  bool judged = true;      ///< false: force_error_percent is NaN, which saves the exact forces
  /// Asked in every cycle; the run that it ends counts as a divergence.
  std::function<bool()> stopping;
};

struct PairLoopResult {
  Behaviour behaviour = Behaviour::kStable;  ///< the worse of the tools'
  /// [%] RMS of |F - F_o| over both tools from 1 s on, in % of that of F_o: the object's forces at
  /// the positions that the servos measured in this cycle.
  double force_error_percent = 0.0;
  double hold_peak_to_peak_m = 0.0;  ///< the larger of the tools'; NaN after a divergence
  double end_s = 0.0;
};

/// Makes the method of a side; null: the object's exact forces in every cycle.
using PairMethodMaker = std::function<std::unique_ptr<PairForceMethod>()>;

/// The standard run (StatedRun) with two hands in simulated time. The second hand's target is the
/// first one's with x and y exchanged and turned round. Both tools hold the object from the start.
/// Each cycle has the order of run_closed_loop(): counts, position, arrived samples, observe(),
/// forces(), the motors' limit, work(); there is no guard. The simulator takes both positions at
/// its ticks. A side renders its own tool's force from its present position and the other's place
/// of `other_age_s` ago.
/// @param stiffness_N_per_m of PairLoopSetup::object.
/// @returns the result; the same arguments give the same result to the last bit.
/// @throws std::invalid_argument with the remedy for an impossible rate, delay or timing.
PairLoopResult run_pair_loop(const PairLoopSetup& setup, double stiffness_N_per_m,
                             const PairMethodMaker& make_method);

}  // namespace forcegrid::stability
