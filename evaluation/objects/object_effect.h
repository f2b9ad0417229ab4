// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "evaluation/objects/wall.h"

namespace forcegrid::evaluation {

/// Effects that make an object's force depend on more than the displacement. With F_T the force of
/// the scene's table, v the tool's velocity and t the time since the start:
///
///   F_e(d, t) = c(t) [F_T(d - s(t)) - F_T(-s(0))]
///   F(d, t) = F_e(d, t) - sum_j g_j L_j(t) - b v,   tau_j dL_j/dt = F_e(d(t), t) - L_j
///
/// c is the product of the cuts made so far, s the slide, and L_j is zero when a contact begins.
/// The relaxation is quasi-linear viscoelasticity with the reduced relaxation function 1 - sum_j
/// g_j (1 - exp(-t / tau_j)).
/// Source: the hard cases of the method study.
struct ObjectEffect {
  struct Relaxation {
    double share;   ///< g
    double time_s;  ///< tau
  };
  struct Cut {
    double time_s;
    double factor;  ///< of the force from then on
  };
  double viscosity_Ns_per_m = 0.0;
  std::vector<Relaxation> relaxations;
  std::vector<Cut> cuts;
  /// The object is displaced by -slide_W_m / 2 until slide_begin_s, then at a constant speed until
  /// it is at slide_W_m / 2 at slide_end_s.
  Eigen::Vector3d slide_W_m = Eigen::Vector3d::Zero();
  double slide_begin_s = 0.0;
  double slide_end_s = 0.0;
  /// Share of its force error that the simulator corrects per tick. It answers F_k = F_{k-1} +
  /// share (F(t_k) - F_{k-1}) with the relative residual |F(t_k) - F_k| / max(|F_k|, 0.05 N).
  /// Queries are solved completely.
  double solved_share = 1.0;

  double cut_factor(double time_s) const noexcept;
  Eigen::Vector3d slid_W_m(double time_s) const noexcept;  ///< s(t)
};

/// Additions to a scene's object.
struct SceneExtras {
  std::vector<Wall> walls;  ///< second objects that the tool runs into
  ObjectEffect effect;
};

/// An object effect that can be added to a scene of the chart.
struct NamedObjectEffect {
  std::string name;
  std::string title;  ///< in a sentence's words
  ObjectEffect effect;
};

/// viscous (3 Ns/m), relaxing (25 % within 80 ms, 15 % within 0.8 s), cut (to 60 % at 7 s, to 30 %
/// at 13 s), sliding (by 8 and -5 mm from 6 to 9 s), unconverged (60 % per tick).
const std::vector<NamedObjectEffect>& named_object_effects();

}  // namespace forcegrid::evaluation
