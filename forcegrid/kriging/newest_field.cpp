// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/newest_field.h"

#include <cmath>

namespace forcegrid::kriging {
namespace {

constexpr double kShortStep_m = 1e-3;
constexpr double kErrorKept = 0.85;

}  // namespace

void NewestField::enter_contact(std::uint64_t contact,
                                const Eigen::Vector3d& /*point_W*/) noexcept {
  if (contact != contact_) {
    contact_ = contact;
    position_m_.setZero();
    force_N_.setZero();
  }
}

Innovation NewestField::take(const Observation& observation) noexcept {
  enter_contact(observation.contact, observation.origin_W);
  Innovation innovation;
  innovation.predicted = has_sample_;
  const Eigen::Vector3d step_m = observation.position_m - position_m_;
  const Eigen::Vector3d error_N = observation.force_N - force_N_ - slope_N_per_m_ * step_m;
  innovation.error_N = error_N.norm();
  if (has_sample_) {
    error_N2_ = kErrorKept * error_N2_ + (1.0 - kErrorKept) * error_N.squaredNorm();
  }
  if (observation.has_stiffness) {
    slope_N_per_m_ = stiffness_matrix(observation.stiffness_N_per_m);
  } else {
    slope_N_per_m_ +=
        error_N * step_m.transpose() / (step_m.squaredNorm() + kShortStep_m * kShortStep_m);
  }
  has_sample_ = true;
  position_m_ = observation.position_m;
  force_N_ = observation.force_N;
  return innovation;
}

Reading NewestField::read(const Eigen::Vector3d& position_m,
                          const History& /*history*/) const noexcept {
  const Eigen::Vector3d step_m = position_m - position_m_;
  return {force_N_ + slope_N_per_m_ * step_m, step_m.squaredNorm()};
}

double NewestField::deviation_N(const Eigen::Vector3d& /*position_m*/,
                                const History& /*history*/) const noexcept {
  return std::sqrt(settings_.nugget_N2 + error_N2_ / 3.0);
}

}  // namespace forcegrid::kriging
