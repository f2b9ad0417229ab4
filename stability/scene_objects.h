// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "stability/virtual_object.h"

namespace forcegrid::stability {

/// Basis of the scenes' objects: an object with a force table and a variable stiffness K. Contacts,
/// walls and snaps act along x, because the standard run comes to rest 8 mm along it.
struct BaseField {
  const evaluation::ForceTable& table;
  double stiffness_N_per_m;         ///< K
  Eigen::Vector3d contact_point_W;  ///< [m] c
  /// [s] Times of the two events of a scene.
  double first_event_s = 2.0;
  double second_event_s = 4.0;
};

/// Stiffness drops to 60 % at the first event and to 30 % at the second.
/// @param announced whether each cut starts a new contact epoch.
std::unique_ptr<VirtualObject> make_cut(const BaseField& field, bool announced);

/// The object slides along with the tool by (8, -5, 0) mm in the 3 s from the first event on.
/// @param announced true: instead, it slips by half of that at each event, with a new contact epoch
/// and contact point.
std::unique_ptr<VirtualObject> make_slide(const BaseField& field, bool announced);

/// A wall of 1000 N/m 2 mm along x behind the object.
std::unique_ptr<VirtualObject> make_second_contact(const BaseField& field);

/// Contact without friction with a flat surface 2 mm along x, made and lost as the hand moves to
/// and fro: F_x = -K max(0, x - 2 mm).
std::unique_ptr<VirtualObject> make_tapping(const BaseField& field);

/// An object that the tool touches and then holds until it lifts off: its surface is 2 mm along z,
/// and a tool beyond it that has touched at p feels
///
///   F = K / K_table a(p) R(theta(p)) F_table(R(theta(p))^T (x - p))
///
/// with the stiffness a and the orientation theta of evaluation::VariedObject of seed 1, which
/// differ from touch to touch. Each touch and each lift-off is a new contact epoch. A touch can be
/// expected.
std::unique_ptr<VirtualObject> make_touching(const BaseField& field);

/// The object and a parallel damper of 3 Ns/m, in series with a spring like every real damper:
///   F = F_e(x) - 3 Ns/m / 5 ms (x - h),  5 ms h' = x - h
std::unique_ptr<VirtualObject> make_viscous(const BaseField& field);

/// A Kelvin-Voigt object of damping time tau. Its rate is taken over 5 ms, the resolution of a
/// dynamic object's solver:
///   F = F_e(x) + tau / 5 ms (F_e(x) - g),  5 ms g' = F_e(x) - g
std::unique_ptr<VirtualObject> make_kelvin_voigt(const BaseField& field, double damping_time_s);

/// A DynamicObject of the same stiffness; it needs no force table.
std::unique_ptr<VirtualObject> make_dynamic(const BaseField& field, double damping_time_s);

/// Quasi-linear visco-elasticity: F = int G(t - s) dF_e with the relaxation function
///   G(t) = 0.6 + 0.25 exp(-t / 80 ms) + 0.15 exp(-t / 0.8 s)
/// Source: Fung, Biomechanics (1993), section 7.6; the numbers are the method study's.
std::unique_ptr<VirtualObject> make_relaxation(const BaseField& field);

/// The object with a parallel plastic slider: F = F_e(x) - K / 2 (x - p), p dragged along when |x -
/// p| exceeds 1 mm. Source: Prandtl's element, e.g. Visintin, Differential Models of Hysteresis
/// (1994).
std::unique_ptr<VirtualObject> make_hysteresis(const BaseField& field);

/// A shell that buckles: above x = 2 mm it snaps by 1 mm, and below 1 mm it snaps back. In between,
/// the force is not a function of position.
std::unique_ptr<VirtualObject> make_snap_through(const BaseField& field);

}  // namespace forcegrid::stability
