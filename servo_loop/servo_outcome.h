// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "rt/thread.h"
#include "servo_loop/emergency_stop.h"
#include "servo_loop/fault.h"
#include "servo_loop/first_touch.h"

namespace forcegrid::servo {

/// How a run of the ServoLoop ended, and what it counted since the loop was made.
struct ServoOutcome {
  Fault fault = Fault::kNone;
  int joint = -1;  ///< 0, 1, 2 if the fault concerns one joint; else negative
  EmergencySource emergency = EmergencySource::kNone;  ///< of Fault::kEmergencyStop
  std::string device_failure;                          ///< the device's own message, if any
  std::uint64_t cycles = 0;
  std::uint64_t missed_deadlines = 0;
  std::uint64_t stalls = 0;           ///< pauses longer than 50 ms; the force ramps in after each
  std::uint64_t requests_made = 0;    ///< queries of the rendered method, handed to the link
  std::uint64_t answers_taken = 0;    ///< answers to these, given to the method
  std::uint64_t samples_refused = 0;  ///< by SampleGate
  FirstTouch::Counts first_touches;
  /// How often a joint's torque was removed because its encoder seemed stuck, see EncoderWatch.
  std::uint64_t suspected_stuck_encoders = 0;
  double energy_to_hand_J = 0.0;            ///< by the rendered force, over the whole run
  double largest_energy_to_hand_J = 0.0;    ///< in any one contact, at any time
  double damped_energy_J = 0.0;             ///< by the passivity guard
  std::uint64_t cycles_damped = 0;          ///< by the passivity guard
  std::uint64_t cycles_shortened = 0;       ///< cycles whose force the passivity guard shortened
  std::uint64_t cycles_touching_tools = 0;  ///< in which another device's tool was felt
  double largest_tool_force_N = 0.0;        ///< of those tools, before gain and limits
  rt::Scheduling scheduling;
  std::string memory_lock_refused;  ///< why memory could not be locked; empty if it is
  std::string awake_refused;        ///< see rt::ProcessorsAwake
  bool zero_current_delivered = false;
};

}  // namespace forcegrid::servo
