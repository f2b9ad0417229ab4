#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/network.h"
#include "evaluation/trajectories.h"
#include "forcegrid/core/force_method.h"
#include "forcegrid/core/sample_gate.h"
#include "servo_loop/passivity.h"
#include "stability/hand.h"
#include "stability/plant.h"
#include "stability/slow_simulator.h"
#include "stability/virtual_object.h"

namespace forcegrid::stability {

/// What lies between the tool and a servo cycle, and back.
struct DeviceTiming {
  std::string name;
  double count_age_s = 0.0;        ///< of the encoder counts that a cycle uses
  double actuation_delay_s = 0.0;  ///< from a cycle's start until its force acts
};

/// ideal; w2_full_speed: the W2 exchange on a bus with frames of 1 ms, counts 0.6 ms old and the
/// force 0.4 ms late, as servo::ServoLoop places its cycles in the frames; w2_high_speed: the same
/// with microframes of 125 us.
const std::vector<DeviceTiming>& device_timings();
/// @throws std::invalid_argument for an unknown name, listing the known ones.
const DeviceTiming& device_timing(const std::string& name);

/// One closed loop but for its object and its method.
struct LoopSetup {
  double servo_rate_Hz = 500.0;
  DeviceTiming timing;
  DeviceDynamics device;
  Hand hand;
  evaluation::NetworkCondition network;
  Eigen::Vector3d contact_point_W = evaluation::first_contact_point_W();  ///< [m] where it begins
  SimulatorFault fault = SimulatorFault::kNone;
  /// The servo's guard; as it is here it only observes.
  servo::PassivityOptions passivity{.mode = servo::PassivityMode::kObserve};
  double virtual_damping_N_s_per_m = 0.0;  ///< B, added by the servo from the last two positions
  /// [s] How long the hand keeps still; longer for boundaries at which oscillations decay slowly.
  double hold_s = 4.0;
  double errors_from_s = 1.0;  ///< force errors are counted from here on
  int fill_budget = 1000;      ///< of ForceMethod::work() a cycle
  std::uint64_t seed = 1;
};

enum class Behaviour : std::uint8_t {
  kStable,
  kDivergence,  ///< the tool left the hand's target by more than kDivergence_m, or became NaN
  kLimitCycle,  ///< it goes on oscillating while the hand is still
  kCreep,       ///< it wanders off without oscillating
};
/// Short text for files and pages, e.g. "limit cycle".
const char* to_string(Behaviour behaviour) noexcept;

struct LoopResult {
  Behaviour behaviour = Behaviour::kStable;
  /// [m] largest peak to peak of an axis in the last 2 s; NaN after a divergence.
  double hold_peak_to_peak_m = 0.0;
  /// RMS of |F - F_o| in % of the RMS of |F_o| from errors_from_s on, F_o the object's force where
  /// the servo believes the tool to be; NaN when there is no force.
  double force_error_percent = 0.0;
  double reference_rms_N = 0.0;  ///< of |F_o| over the same time
  /// [J] work of the rendered force on the tool less that of the object's own force along the same
  /// path: what the rendering has added, at the end and at most.
  double energy_generated_J = 0.0;
  double most_energy_generated_J = 0.0;
  /// [J] PassivityGuard::largest_energy_to_hand_J(): what a hand got without having put it in.
  double most_energy_to_hand_J = 0.0;
  double damped_energy_J = 0.0;  ///< taken out by the guard
  /// [N] RMS change of F - F_o from one cycle to the next in the last 2 s.
  double rattle_N = 0.0;
  double largest_force_N = 0.0;  ///< rendered, after the limit of the motors
  double end_s = 0.0;            ///< of the run; earlier than usual after a divergence
  std::uint64_t samples_taken = 0;
  std::uint64_t samples_refused = 0;  ///< by SampleGate
  std::uint64_t samples_lost = 0;
};

/// The stated run, and how it is judged: the hand follows `motion` for 6 s and then keeps still for
/// 4 s (LoopSetup::hold_s). Stable is a tool that never leaves the hand's target by more than
/// kDivergence_m and whose every axis stays within less than kSettled_m peak to peak in the last 2
/// s. Source: the method study's criterion.
struct StatedRun {
  static constexpr double kMotion_s = 6.0;
  static constexpr double kJudged_s = 2.0;
  static constexpr double kSettled_m = 0.3e-3;
  static constexpr double kDivergence_m = 0.05;
  static constexpr double kAmplitude_m = 0.008;
  /// A device that nobody holds is flicked with so much at 1, 3 and 5 s instead.
  static constexpr double kFlick_N_s = 0.002;
  static constexpr double kFirstFlick_s = 1.0;
  static constexpr double kFlickEvery_s = 2.0;

  /// [m] The hand's target as a displacement from the contact point:
  ///
  ///   a (1 - exp(-t / 0.5 s)) (sin 2 pi 0.53 t, sin 2 pi 0.71 t, (1 - cos 2 pi 0.97 t) / 2)
  ///
  /// with a = 8 mm; from 6 s on it comes to rest with a time constant of 0.1 s.
  static Eigen::Vector3d target_W(double time_s) noexcept;
};

/// One run of device, hand, servo, method, simulator and link in simulated time. In each cycle, as
/// in servo::ServoLoop::run_cycle(): counts -> position -> what has arrived -> observe() -> force()
/// -> passivity guard -> limit of the motors -> work(). It is a loop of its own, since that one's
/// mechanisms quantise and limit, which the theory that the charts are held against does not know;
/// run servo::ServoLoop itself with SimulatedArm for what a device feels.
/// @param method nullptr: the object's exact force in every cycle, which is what `direct` renders.
/// The same arguments give the same result to the last bit.
/// @throws std::invalid_argument for a rate or timing that can't be, with the remedy.
LoopResult run_closed_loop(const LoopSetup& setup, VirtualObject& object, ForceMethod* method);

/// The same servo, method, simulator and link while the tool follows `trajectory` whatever is
/// rendered: an open loop. The device's encoders count, its dynamics and the hand don't.
/// `behaviour` is always kStable and the energies are NaN.
LoopResult run_open_loop(const LoopSetup& setup, const evaluation::Trajectory& trajectory,
                         VirtualObject& object, ForceMethod* method);

}  // namespace forcegrid::stability
