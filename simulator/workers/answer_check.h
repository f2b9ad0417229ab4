#pragma once

#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// What a check says about an answer.
enum class Verdict : unsigned char {
  kRight,
  kWrong,
  kUndecided,  ///< the reference itself did not converge or get there
};

/// Holds an answer against another one to the same question. Both stop at a tolerance and come from
/// other positions, so they agree when
///   |F - F'| <= 0.05 N + 0.05 |F'|,  |J - J'| <= 20 N/m + 0.2 |J'| (Frobenius norms),
///   |P - P'| <= 0.1 mm,              and both are in contact, or neither.
/// Smaller errors are not seen, nor are solve time and residual, which nobody relies on.
/// Real-time: no allocation. Threads: any.
[[nodiscard]] Verdict check_answer(const StickyContact::Answer& answer,
                                   const StickyContact::Answer& reference) noexcept;

}  // namespace forcegrid::simulator
