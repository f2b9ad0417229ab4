// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "stability/closed_loop.h"

namespace forcegrid::stability {

/// The baseline of the chart: the object's exact force in every cycle. The method `direct` renders
/// this force.
inline constexpr char kExact[] = "exact";

/// Parts of the chart.
namespace part {
inline constexpr char kMap[] = "map";            ///< hands x rates x timings x networks
inline constexpr char kLinear[] = "linear";      ///< compared with the eigenvalues
inline constexpr char kPlane[] = "plane";        ///< K over B
inline constexpr char kScene[] = "scene";        ///< scenes in which methods may fail
inline constexpr char kOpen[] = "open";          ///< the same scenes in open loop
inline constexpr char kGuard[] = "guard";        ///< passivity guard on and off
inline constexpr char kRequests[] = "requests";  ///< touches, with requests to the simulator
inline constexpr char kStress[] = "stress";      ///< 30 % loss, 200 ms
inline constexpr char kOnBoard[] = "onboard";  ///< methods of docs/firmware.md: either side of USB
inline constexpr char kSweep[] = "sweep";      ///< fault sweep, see fault_sweep.h; it has no cells
}  // namespace part

/// Devices of the chart.
namespace device {
inline constexpr char kStudy[] = "study";        ///< default DeviceDynamics
inline constexpr char kLinear[] = "linear";      ///< no quantisation, no limit
inline constexpr char kFriction[] = "friction";  ///< 0.1 N of Coulomb friction
}  // namespace device

/// One cell of the chart.
struct StabilityCase {
  std::string part;
  std::string scene = "held";  ///< of scenes(), or "spring", a LinearObject
  std::string method;          ///< MethodVariant text, or kExact
  std::string device = device::kStudy;
  std::string hand;
  std::string timing;
  double servo_rate_Hz = 500.0;
  double simulator_rate_Hz = 30.0;  ///< 0 for kExact, which needs no simulator
  double delay_s = 0.0;
  double loss = 0.0;
  double requests_per_s = 0.0;  ///< that the method may make
  bool sees_contacts = false;   ///< LoopSetup::sees_contacts
  bool guard = false;           ///< whether the passivity guard acts
  double virtual_damping_N_s_per_m = 0.0;
  /// [N/m] stiffness of the run whose errors and energies are reported
  double stiffness_N_per_m = 200.0;
  bool find_limit = true;  ///< also search for the largest stable stiffness

  /// Identifies the cell in files.
  std::string text() const;
};

/// [s] LoopSetup::hold_s of cells on the linear device, because oscillations decay slowly near its
/// stability boundary. They have no further windows.
inline constexpr double kLinearHold_s = 60.0;
/// [s] LoopSetup::longest_settling_s of the others.
inline constexpr double kLongestSettling_s = 16.0;

/// [s] In second_contact, errors count from this time on, after the hand has touched the wall. No
/// method can predict the first touch of an unknown wall.
inline constexpr double kWallKnown_s = 3.0;

/// [s] Times at which objects change in the open loop of 20 s; in the closed loop they change at 2
/// and 4 s.
inline constexpr double kOpenLoopFirstEvent_s = 7.0;
inline constexpr double kOpenLoopSecondEvent_s = 13.0;

/// The loop of a case. @param stiffness whether the method needs dF/dP.
LoopSetup setup_of(const StabilityCase& cell, bool stiffness, std::uint64_t seed);

/// Selection of the chart's cells.
struct CaseSelection {
  bool quick = false;
  std::vector<std::string> methods;  ///< empty: all of chart_methods()
  std::string default_method;        ///< always included
  std::vector<std::string> parts;    ///< names in `part`; empty: all of them
  std::vector<std::string> hands;    ///< empty: all of them
};

/// Returns the names in `part`, in the order of the chart.
const std::vector<std::string>& chart_parts();

/// Returns exact, hold, linear, broyden, rls, tangent, forcegrid, forcegrid-mls, kriging,
/// kriging-bank and auto.
const std::vector<std::string>& chart_methods();

/// Returns all cells of the chart; those of kExact come first.
/// @throws std::invalid_argument for an unknown part or hand, listing the known ones.
std::vector<StabilityCase> chart_cases(const CaseSelection& selection);

/// Returns the cells of a picture of the largest stable stiffness over the delay: a light hand on a
/// full-speed bus, servo at 500 Hz, simulator at 30 Hz, 0 to 150 ms. kExact comes first.
std::vector<StabilityCase> stiffness_cells(const std::vector<std::string>& methods);

}  // namespace forcegrid::stability
