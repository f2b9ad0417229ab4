// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "profiles/device_profile.h"
#include "servo_loop/fault.h"

namespace forcegrid::stability {

/// Fault in a run of the sweep; permanent unless noted otherwise.
enum class SweptFault : std::uint8_t {
  kNone,                ///< the run for comparison
  kSimulatorStops,      ///< no more answers
  kSimulatorRestarts,   ///< no answer for 0.2 to 1 s, then a new contact epoch
  kSimulatorJumps,      ///< the object is displaced by 3 mm
  kSimulatorNoise,      ///< 30 mN of white noise on each axis
  kSimulatorBias,       ///< 0.2 N along x
  kSimulatorOutliers,   ///< one answer in ten is off by up to 2 N on each axis
  kSimulatorNotFinite,  ///< every answer is NaN
  kSimulatorHuge,       ///< forces are 100 times too large
  kSimulatorReversed,   ///< forces have the wrong sign
  kClockSkew,           ///< time stamps run 1 % fast
  kLoss,                ///< 30 % of the answers are lost, the others 200 ms late
  kCut,                 ///< the object's stiffness drops to 40 %
  kReportsStop,         ///< the device falls silent
  kReportsPause,        ///< no report for 60 ms
  kUnplugged,           ///< the transport ends
  kEncoderJumps,        ///< a counter is wrong by 500 counts from then on
  kEncoderFreezes,      ///< a counter stands still
  kEncoderSaturates,    ///< a counter sticks at the end of 16 bits
};

/// Returns all faults, in the order of the enumeration.
const std::vector<SweptFault>& swept_faults();
/// Short text for tables, e.g. "simulator stops".
const char* to_string(SweptFault fault) noexcept;

/// One seeded run of servo::ServoLoop on an emulated device in simulated time.
struct SweptRun {
  std::string device;  ///< profile
  SweptFault fault = SweptFault::kNone;
  std::uint64_t seed = 0;
  std::string method;
  std::string hand;                             ///< firm, light
  double stiffness_N_per_m = 0.0;               ///< of the object
  double fault_at_s = 0.0;                      ///< after the start
  servo::Fault ended_by = servo::Fault::kNone;  ///< kNone: the loop continued to the end
  double largest_force_N = 0.0;                 ///< commanded, at any time
  /// Largest fraction of the profile's limits at any time: of an arm's currents, of a delta's joint
  /// torques.
  double largest_drive_fraction = 0.0;
  /// [J] Largest energy that the hand got from the rendered force in excess of its own work, at any
  /// time after the fault: sum (F_{k-1} + F_k) / 2 . (P_k - P_{k-1}) over the loop's positions. The
  /// mean of two forces leaves out the K v^2 T / 2 per cycle of a held force, which every sampled
  /// spring leaks and the arm's damping absorbs. While a force ramps in,
  /// ForceRenderer::kRampPower_J_per_s is allowed, because the returning object pushes the hand
  /// out.
  double energy_after_fault_J = 0.0;
  /// [J] work of the motors on the arm in the 0.1 s after the end of the loop.
  double work_after_end_J = 0.0;
};

/// Tolerances: rounding, and the energy error of a passivity guard.
struct SweepLimits {
  static constexpr double kRounding = 1e-9;
  static constexpr double kEnergy_J = 1e-3;
};

/// Whether a run commanded more than the profile allows, and whether the hand got energy after the
/// fault.
bool force_above_limit(const SweptRun& run, const profiles::DeviceProfile& profile) noexcept;
bool energy_after_fault(const SweptRun& run) noexcept;

struct SweepOptions {
  std::string device = "woodenhaptics_v2015";  ///< profile
  std::vector<std::string> methods;            ///< MethodVariant texts, in turn
  int runs = 2000;
  std::uint64_t seed = 1;
  unsigned jobs = 0;  ///< threads; 0: one per processor
  std::function<void(double done, double remaining_s)> progress;
  const std::atomic<bool>* cancel = nullptr;
};

/// Makes the runs of one device, with the faults in turn and everything else drawn from the seed.
/// The same options give the same runs for any number of threads.
/// @throws evaluation::Stopped, profiles::ProfileError, std::invalid_argument for a method that
/// can't be made.
std::vector<SweptRun> sweep_faults(const SweepOptions& options);

/// A line of the table of outcomes.
struct SweepLine {
  std::string device;
  SweptFault fault = SweptFault::kNone;
  int runs = 0;
  int survivors = 0;                                  ///< runs in which the loop continued
  std::vector<std::pair<std::string, int>> ended_by;  ///< servo::name_of() and number of runs
  int force_above_limit = 0;
  int energy_after_fault = 0;
  double largest_force_N = 0.0;
  double most_energy_J = 0.0;
  std::uint64_t worst_seed = 0;  ///< seed of the run with the most energy
};
/// Makes the table. @param runs of one device. @param profile of that device.
std::vector<SweepLine> sweep_table(const std::vector<SweptRun>& runs,
                                   const profiles::DeviceProfile& profile);

}  // namespace forcegrid::stability
