// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "calibration/held_arm.h"
#include "calibration/rigid_body.h"

namespace forcegrid::calibration {

/// A number and its standard error.
struct Estimate {
  double value = 0.0;
  double error = 0.0;

  [[nodiscard]] double relative_error() const noexcept;
};

/// The forces on a joint, in terms of its motor's commands: all torques are the profile's torque
/// constant times the current.
struct JointFit {
  Estimate scale;                 ///< profile's torque constant over the true one
  Estimate coulomb_Nm;            ///< c: true friction times scale
  Estimate viscous_Nm_s_per_rad;  ///< v: likewise
  Estimate delay_s;               ///< of the currents behind their commands
  double residual_Nm = 0.0;       ///< RMS of the part that the model does not explain
  std::size_t samples = 0;
};

/// Least squares over a joint's strokes:
///
///   u = a tau_rigid + c tanh(s q') + v q' + e u'
///
/// with u the commanded torque by the profile's torque constant k_p, tau_rigid that of RigidBody,
/// s the profile's smoothing, a = k_p / k, c = a c_true, v = a v_true, e the delay of the currents.
/// c / a and v / a are as accurate in absolute terms as tau_rigid is. Without a known mass only c
/// and v, the friction in units of the motor's own current, have a meaning.
///
/// Both sides are averaged over the same window, w(t) = 15/16 (1 - (t/T)^2)^2 over +-T: u exactly,
/// since it is constant between steps; angles and tip through the best-fitting cubic, whose second
/// derivative has just this window. So no noisy signal is differentiated twice, and a filter's lag
/// cancels. Samples next to a reversal, slower than kLeastTanh allows, are left out. So are samples
/// within whose window the host paused, and outliers more than four standard deviations (by the
/// median) away, up to a fifth of all. Source: Khalil and Dombre (2002), ch. 12 (parallel
/// filtering, standard errors); Press et al., Numerical Recipes (2007), 14.9 (the polynomial
/// filter) and 15.7 (outliers).
/// @param joint  whose strokes `trace` has.
/// @throws CalibrationError if the joint hardly moved.
/// Real-time: no. Threads: any, with a RigidBody of its own.
JointFit fit_joint(const Trace& trace, RigidBody& body, double smoothing_s_per_rad, int joint);

/// The same for three joints that share one torque constant, as a delta's do: one `scale` for all.
std::array<JointFit, 3> fit_joints_of_one_scale(const std::array<Trace, 3>& traces, RigidBody& body,
                                                double smoothing_s_per_rad);

}  // namespace forcegrid::calibration
