// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/answer_check.h"

namespace forcegrid::simulator {
namespace {

constexpr double kForce_N = 0.05;
constexpr double kForceShare = 0.05;
constexpr double kStiffness_N_per_m = 20.0;
constexpr double kStiffnessShare = 0.2;
constexpr double kPlace_m = 1e-4;

}  // namespace

Verdict check_answer(const StickyContact::Answer& answer,
                     const StickyContact::Answer& reference) noexcept {
  const Equilibrium& one = answer.equilibrium;
  const Equilibrium& other = reference.equilibrium;
  if (!other.converged || !other.reached) {
    return Verdict::kUndecided;
  }
  const bool agree =
      answer.in_contact == reference.in_contact &&
      (answer.position_W - reference.position_W).norm() <= kPlace_m &&
      (one.force_W - other.force_W).norm() <= kForce_N + kForceShare * other.force_W.norm() &&
      (one.stiffness_W - other.stiffness_W).norm() <=
          kStiffness_N_per_m + kStiffnessShare * other.stiffness_W.norm();
  return agree ? Verdict::kRight : Verdict::kWrong;
}

}  // namespace forcegrid::simulator
