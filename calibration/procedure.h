// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calibration/guided_moves.h"
#include "calibration/identification.h"
#include "calibration/joint_range.h"
#include "calibration/knob_travel.h"
#include "calibration/rig.h"
#include "profiles/device_profile.h"

namespace forcegrid::calibration {

struct ProcedureOptions {
  /// [kg] fastened to the tip; 0: none, and torque constants cannot be identified.
  double known_mass_kg = 0.0;
  bool homed = true;     ///< the counters were set in the calibration pose just now
  bool range = true;     ///< move to the hard stops
  bool identify = true;  ///< strokes
  bool quick = false;    ///< fewer strokes
  /// [s] How long the motors hold the device while the person lets go of it.
  double let_go_s = 5.0;
  /// A line for the person, and how long [s] what it announces is likely to take, without the
  /// pauses in which motors cool; nullopt: until the person is ready. May be empty.
  std::function<void(const std::string& line, std::optional<double> length_s)> say{};
  /// Polled for whether the person has done what they were asked to: moved the tip, or let go of
  /// it. Empty: nobody is there; the tip is not moved by hand, and let_go_s passes.
  std::function<bool()> person_done{};
};

/// The result of one check.
struct Check {
  std::string name;  ///< "direction", "range", "friction", ..., with the joint
  bool passed = false;
  std::string text;  ///< what was found, and the remedy when it did not pass
};

/// A key of a profile, as "motors.torque_constant_Nm_per_A", and its new value as TOML writes it.
using ProfileChange = std::pair<std::string, std::string>;

/// One joint; all values describe the arm itself.
struct JointResult {
  std::optional<JointRange> range;
  std::optional<JointFit> fit;
  std::optional<double> torque_constant_Nm_per_A;  ///< only with a known mass; not of a delta
  /// With a known mass, a torque; without, the torque that the profile's constant would give, so
  /// that friction over torque constant is right.
  double coulomb_Nm = 0.0;
  double viscous_Nm_s_per_rad = 0.0;
};

struct ProcedureResult {
  std::vector<Check> checks;
  std::array<JointResult, 3> joints;
  std::optional<KnobTravel> knob_travel;     ///< of a delta
  std::optional<double> torque_gain_per_Nm;  ///< of a delta, with a known mass
  bool absolute = false;                     ///< a known mass gave the scale
  double largest_tip_speed_m_per_s = 0.0;
  std::array<double, 3> largest_current_A{};
  std::vector<ProfileChange> changes;  ///< of the profile; none where a check has failed

  [[nodiscard]] bool passed() const;
};

/// Checks directions, range, friction, weight and torque constants of a homed device, in this
/// order, and says what its profile should have instead. Stops before a motion if an earlier check
/// has failed, and always ends at zero current.
/// @param profile  of the device, as assumed; its link data are taken as given.
/// @throws CalibrationError, Stopped.
/// Real-time: no; the rig's steps keep their own time.
ProcedureResult run_procedure(Rig& rig, const profiles::DeviceProfile& profile,
                              const ProcedureOptions& options);

}  // namespace forcegrid::calibration
