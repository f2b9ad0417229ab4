// SPDX-License-Identifier: Apache-2.0
#include "driver/counter_continuity.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace forcegrid::driver {
namespace {

constexpr std::int32_t kAboutZero_counts = 50;
constexpr double kSamePlace_m = 0.010;

bool about_zero(const std::array<std::int32_t, 6>& counts) {
  return std::all_of(counts.begin(), counts.begin() + 3,
                     [](std::int32_t count) { return std::abs(count) <= kAboutZero_counts; });
}

}  // namespace

std::string why_counters_are_lost(Mechanism& mechanism, const std::array<std::int32_t, 6>& last,
                                  const std::array<std::int32_t, 6>& now) {
  if (about_zero(now) && !about_zero(last)) {
    return "its encoder counters start from zero: it has lost power";
  }
  const ArmPose before = mechanism.forward(last);
  const ArmPose after = mechanism.forward(now);
  if (after.status == KinematicsStatus::kOutOfRange ||
      after.status == KinematicsStatus::kNotFinite) {
    return "its encoder counters belong to no pose of the arm";
  }
  const double moved_m = (after.position_D - before.position_D).norm();
  if (!(moved_m <= kSamePlace_m)) {
    return "its encoder counters put the tool " + std::to_string(std::lround(1e3 * moved_m)) +
           " mm from where it was, which may be so or may be that it has lost power";
  }
  return "";
}

}  // namespace forcegrid::driver
