#pragma once

#include <memory>

#include "stability/virtual_object.h"

namespace forcegrid::stability {

/// What the scenes' objects are made of: an object with a force table, K of which is varied. x
/// is the direction in which contact is made and broken, walls stand and things snap, since the
/// stated run comes to rest 8 mm along it.
struct BaseField {
  const evaluation::ForceTable& table;
  double stiffness_N_per_m;         ///< K
  Eigen::Vector3d contact_point_W;  ///< [m] c
  /// When what happens in a scene happens.
  double first_event_s = 2.0;
  double second_event_s = 4.0;
};

/// Stiffness drops to 60 % at the first event and to 30 % at the second. @param announced each cut
/// is a new contact epoch.
std::unique_ptr<VirtualObject> make_cut(const BaseField& field, bool announced);

/// The object slides along with the tool by (8, -5, 0) mm in the 3 s from the first event on;
/// @param announced in two slips of half of that at the two events instead, each a new contact
/// epoch with its new contact point.
std::unique_ptr<VirtualObject> make_slide(const BaseField& field, bool announced);

/// A wall of 1000 N/m 2 mm along x behind the object.
std::unique_ptr<VirtualObject> make_second_contact(const BaseField& field);

/// Contact with a flat surface 2 mm along x, made and lost as the hand goes to and fro, without
/// friction:  F_x = -K max(0, x - 2 mm).
std::unique_ptr<VirtualObject> make_tapping(const BaseField& field);

/// The object and 3 Ns/m beside it, behind a spring as every real damper is:
///   F = F_e(x) - 3 Ns/m / 5 ms (x - h),  5 ms h' = x - h
std::unique_ptr<VirtualObject> make_viscous(const BaseField& field);

/// A Kelvin-Voigt object of damping time tau, its rate taken over 5 ms as the solver of a dynamic
/// object does not know it any finer:
///   F = F_e(x) + tau / 5 ms (F_e(x) - g),  5 ms g' = F_e(x) - g
std::unique_ptr<VirtualObject> make_kelvin_voigt(const BaseField& field, double damping_time_s);

/// DynamicObject of the same stiffness, which needs no force table.
std::unique_ptr<VirtualObject> make_dynamic(const BaseField& field, double damping_time_s);

/// Quasi-linear visco-elasticity: F = int G(t - s) dF_e with the relaxation function
///   G(t) = 0.6 + 0.25 exp(-t / 80 ms) + 0.15 exp(-t / 0.8 s)
/// Source: Fung, Biomechanics (1993), section 7.6; the numbers are the method study's.
std::unique_ptr<VirtualObject> make_relaxation(const BaseField& field);

/// The object with a plastic slider beside it: F = F_e(x) - K / 2 (x - p), p dragged along when
/// |x - p| exceeds 1 mm. Source: Prandtl's element, e.g. Visintin, Differential Models of
/// Hysteresis (1994).
std::unique_ptr<VirtualObject> make_hysteresis(const BaseField& field);

/// A shell that buckles: beyond x = 2 mm it snaps by 1 mm, and back below 1 mm. Between, the force
/// is no function of position.
std::unique_ptr<VirtualObject> make_snap_through(const BaseField& field);

}  // namespace forcegrid::stability
