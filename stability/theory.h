// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "stability/hand.h"
#include "stability/plant.h"

namespace forcegrid::stability {

/// A spring rendered by a computer on a linear device and hand, along one axis:
///
///   m x'' = -b x' - k x + f,   f(t) = -K x_j - B (x_j - x_{j-1}) / T
///   for t in [j T + tau, (j + 1) T + tau),   x_j = x(j T)
///
/// m, b, k of device and hand together; T the period at which the force is renewed and held, tau
/// its age when it begins to act. Friction, quantisation and the motors' limit are left out.
/// For the exact force in every servo cycle T is the servo's period and tau count age + actuation
/// delay; for `hold` T is the simulator's period, and tau that period plus the network's delay.
struct SampledSpring {
  double mass_kg = 0.0;
  double damping_N_s_per_m = 0.0;
  double hand_stiffness_N_per_m = 0.0;
  double period_s = 0.0;
  double age_s = 0.0;                      ///< tau
  double virtual_damping_N_s_per_m = 0.0;  ///< B
};

/// m, b and k of a device in a hand.
SampledSpring sampled_spring(const DeviceDynamics& device, const Hand& hand, double period_s,
                             double age_s);

/// Largest magnitude of an eigenvalue of the exactly discretised loop (state x, x', the forces
/// under way, the last position) for the stiffness K; below 1 it is stable.
/// Source: Franklin, Powell and Workman (1998), section 4.3.3, systems with delay.
double spectral_radius(const SampledSpring& spring, double stiffness_N_per_m);

/// [N/m] The smallest unstable K when K rises from 1 N/m, to within 0.01 %; infinite if 1e6 N/m is
/// still stable, zero if 1 N/m is unstable.
double eigenvalue_limit_N_per_m(const SampledSpring& spring);

/// [N/m] Largest passive stiffness of a sampled wall without delay, b > K T / 2 + |B|.
/// Source: Colgate and Schenkel, J. Robotic Systems 14(1), 1997.
double colgate_schenkel_N_per_m(double damping_N_s_per_m, double period_s,
                                double virtual_damping_N_s_per_m);

/// [N/m] A force that does not follow the tool for `age_s` adds -K age of damping: K < b / age.
/// Source: the method study.
double delay_rule_N_per_m(double damping_N_s_per_m, double age_s);

/// [N/m] With encoders that step by Delta and Coulomb friction f_c:  K <= min(2 b / T, 2 f_c /
/// Delta). Infinite steps of zero are no bound.
/// Source: Abbott and Okamura, IEEE Trans. Robotics 21(5), 2005.
double abbott_okamura_N_per_m(double damping_N_s_per_m, double period_s, double coulomb_friction_N,
                              double position_step_m);

}  // namespace forcegrid::stability
