// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/network.h"
#include "forcegrid/core/force_method.h"
#include "forcegrid/core/sample_gate.h"
#include "servo_loop/passivity.h"
#include "stability/hand.h"
#include "stability/plant.h"
#include "stability/slow_simulator.h"
#include "stability/virtual_object.h"

namespace forcegrid::stability {

/// Delays from the tool to a servo cycle and back.
struct DeviceTiming {
  std::string name;
  double count_age_s = 0.0;        ///< age of the encoder counts that a cycle uses
  double actuation_delay_s = 0.0;  ///< from a cycle's start until its force acts
};

/// Returns the known timings. ideal: no delay. w2_full_speed: the W2 exchange on a bus with frames
/// of 1 ms; counts are 0.6 ms old and forces 0.4 ms late, as servo::ServoLoop places its cycles in
/// the frames. w2_high_speed: the same with microframes of 125 us. on_board: the method runs on the
/// device's own processor, which reads the counters itself; from them to the currents it executes
/// up to 3,624 instructions (docs/firmware.md), 20 us at 200 MHz.
const std::vector<DeviceTiming>& device_timings();
/// @throws std::invalid_argument for an unknown name, listing the known ones.
const DeviceTiming& device_timing(const std::string& name);

/// A closed loop without its object and its method.
struct LoopSetup {
  double servo_rate_Hz = 500.0;
  DeviceTiming timing;
  DeviceDynamics device;
  Hand hand;
  /// Its requests_per_s lets the method ask the simulator, as servo::ServoOptions::requests_per_s
  /// does.
  evaluation::NetworkCondition network;
  /// [m] Place of the first contact.
  Eigen::Vector3d contact_point_W = evaluation::first_contact_point_W();
  SimulatorFault fault = SimulatorFault::kNone;
  /// The servo's guard; by default it only observes.
  servo::PassivityOptions passivity{.mode = servo::PassivityMode::kObserve};
  /// The servo sees touches and lift-offs itself, in the cycle in which they happen, as in
  /// evaluation::judge(). Otherwise the first answer of a contact, or out of it, tells of it.
  bool sees_contacts = false;
  double virtual_damping_N_s_per_m = 0.0;  ///< B, added by the servo from the last two positions
  /// [s] Time that the hand keeps still; longer for boundaries at which oscillations decay slowly.
  double hold_s = 4.0;
  /// [s] Further rest of a tool that is not still after hold_s, as long as it moves less and less.
  /// Errors and rattle do not count it.
  double longest_settling_s = 0.0;
  double errors_from_s = 1.0;  ///< force errors are counted from here on
  int fill_budget = 1000;      ///< of ForceMethod::work() per cycle
  std::uint64_t seed = 1;
};

enum class Behaviour : std::uint8_t {
  kStable,
  kDivergence,  ///< the tool left the hand's target by more than kDivergence_m, or became NaN
  kLimitCycle,  ///< it keeps oscillating while the hand is still
  kCreep,       ///< it drifts without oscillating
};
/// Short text for files and pages, e.g. "limit cycle".
const char* to_string(Behaviour behaviour) noexcept;

struct LoopResult {
  Behaviour behaviour = Behaviour::kStable;
  /// [m] largest peak-to-peak motion of any axis in the last 2 s, further windows included; NaN
  /// after a divergence.
  double hold_peak_to_peak_m = 0.0;
  /// RMS of |F - F_o| in % of the RMS of |F_o| from errors_from_s on. F_o is the object's force at
  /// the tool position that the servo measured. NaN if there is no force.
  double force_error_percent = 0.0;
  double reference_rms_N = 0.0;  ///< of |F_o| over the same time
  /// RMS of |F - F_o| from a touch on, pooled over the contacts that begin in the air, in % of the
  /// RMS of |F_o| in all contact. The servo knows of a contact when its first answer arrives. NaN
  /// if no contact begins in the air.
  double first_67ms_error_percent = std::numeric_limits<double>::quiet_NaN();
  double first_250ms_error_percent = std::numeric_limits<double>::quiet_NaN();
  /// [J] energy added by the rendering: work of the rendered force on the tool minus that of the
  /// object's exact force along the same path; at the end, and its maximum.
  double energy_generated_J = 0.0;
  double most_energy_generated_J = 0.0;
  /// [J] PassivityGuard::largest_energy_to_hand_J(): energy that the hand got in excess of its own
  /// work.
  double most_energy_to_hand_J = 0.0;
  double damped_energy_J = 0.0;  ///< dissipated by the guard
  /// [N] RMS change of F - F_o from one cycle to the next in the last 2 s.
  double rattle_N = 0.0;
  double largest_force_N = 0.0;  ///< rendered, after the motors' limit
  double end_s = 0.0;            ///< end of the run; earlier after a divergence
  std::uint64_t samples_taken = 0;
  std::uint64_t samples_refused = 0;  ///< by SampleGate
  std::uint64_t samples_lost = 0;
  std::uint64_t touches = 0;         ///< contacts that begin in the air
  std::uint64_t requests_made = 0;   ///< that the simulator has got
  std::uint64_t answers_taken = 0;   ///< by the method, to requests
  std::uint64_t answers_before = 0;  ///< of these, to requests before contact
};

/// The standard run and its stability criterion. The hand moves for 6 s and then keeps still for 4
/// s (LoopSetup::hold_s). The loop is stable if the tool never leaves the hand's target by more
/// than kDivergence_m and every axis stays below kSettled_m peak to peak in the last 2 s. A tool
/// that moves more gets further windows of 2 s, up to LoopSetup::longest_settling_s, until one is
/// below kSettled_m or two in a row are not below the smallest before. Source: the method study's
/// criterion, which has no further windows.
struct StatedRun {
  static constexpr double kMotion_s = 6.0;
  static constexpr double kJudged_s = 2.0;
  static constexpr double kSettled_m = 0.3e-3;
  static constexpr double kDivergence_m = 0.05;
  static constexpr double kAmplitude_m = 0.008;
  /// A device that nobody holds is flicked with this impulse at 1, 3 and 5 s instead.
  static constexpr double kFlick_N_s = 0.002;
  static constexpr double kFirstFlick_s = 1.0;
  static constexpr double kFlickEvery_s = 2.0;

  /// [m] The hand's target as a displacement from the contact point:
  ///
  ///   a (1 - exp(-t / 0.5 s)) (sin 2 pi 0.53 t, sin 2 pi 0.71 t, (1 - cos 2 pi 0.97 t) / 2)
  ///
  /// with a = 8 mm. From 6 s on it comes to rest with a time constant of 0.1 s.
  static Eigen::Vector3d target_W(double time_s) noexcept;
};

/// Runs device, hand, servo, method, simulator and link in simulated time. Each cycle has the order
/// of servo::ServoLoop::run_cycle(): counts -> position -> arrived samples -> observe() -> force()
/// -> passivity guard -> motors' limit -> requests -> work(). It does not use servo::ServoLoop,
/// whose mechanisms quantise and limit, unlike the theory that the charts compare with. For the
/// behaviour of a real device, run servo::ServoLoop with SimulatedArm.
///
/// Requests follow servo::SampleIntake: one per 1 / requests_per_s at most, in contact, and before
/// an expected contact for a method that needs().requests_before_contact. An answer reaches the
/// method only if its contact lasts, or if it was asked for in the stretch of air before. Where a
/// touch is expected comes with the samples in the air, as late as they are. servo::FirstTouch, the
/// servo's own copy of the surface, is not modelled.
/// @param method nullptr: the object's exact force in every cycle, as `direct` renders it.
/// @returns the result; the same arguments give the same result to the last bit.
/// @throws std::invalid_argument with the remedy for an impossible rate or timing.
LoopResult run_closed_loop(const LoopSetup& setup, VirtualObject& object, ForceMethod* method);

/// Runs the same servo, method, simulator and link in open loop: the tool follows `trajectory`
/// independently of the rendered force. Uses the device's encoders, but neither its dynamics nor
/// the hand. `behaviour` is always kStable, and the energies are NaN.
LoopResult run_open_loop(const LoopSetup& setup, const evaluation::Trajectory& trajectory,
                         VirtualObject& object, ForceMethod* method);

}  // namespace forcegrid::stability
