// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// Result of checking an answer.
enum class Verdict : unsigned char {
  kRight,
  kWrong,
  kUndecided,  ///< the reference did not converge or did not reach its position
};

/// Compares an answer with a reference for the same query. Both are solved to a tolerance and warm
/// started from different positions, so they count as equal when
///   |F - F'| <= 0.05 N + 0.05 |F'|,  |J - J'| <= 20 N/m + 0.2 |J'| (Frobenius norms),
///   |P - P'| <= 0.1 mm,              and both are in contact, or neither.
/// Smaller errors are not detected. Solve time and residual are not compared, since nothing uses
/// them. Real-time: no allocation. Threads: any.
[[nodiscard]] Verdict check_answer(const StickyContact::Answer& answer,
                                   const StickyContact::Answer& reference) noexcept;

}  // namespace forcegrid::simulator
