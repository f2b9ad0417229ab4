// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/field_requests.h"

#include <limits>

namespace forcegrid::kriging {

std::array<Eigen::Vector3d, FieldRequests::kPoints> FieldRequests::points_around(
    const Eigen::Vector3d& position_W, const ToolMotion& motion) noexcept {
  std::array<Eigen::Vector3d, kPoints> points;
  const double speed = motion.velocity_W().norm();
  std::size_t next = 0;
  for (const double periods : {1.0, 2.0, 3.0}) {
    const double ahead_m = std::min(periods * motion.sample_period_s() * speed, kFurthest_m);
    if (ahead_m > 0.0) {
      points[next++] = position_W + ahead_m / speed * motion.velocity_W();
    } else {
      points[next++].setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  }
  // Where the motion may turn: one place beside the tool per call.
  const std::size_t beside = next_beside_++ % 6;
  points[next] = position_W;
  points[next][static_cast<int>(beside / 2)] += beside % 2 == 0 ? kBeside_m : -kBeside_m;
  return points;
}

Eigen::Vector3d FieldRequests::on_lattice(const Eigen::Vector3d& point_W,
                                          const Eigen::Vector3d& origin_W) const noexcept {
  if (!(lattice_spacing_m_ > 0.0)) {
    return point_W;
  }
  const Eigen::Vector3d corner_W = origin_W + lattice_corner_m_;
  return corner_W +
         lattice_spacing_m_ * ((point_W - corner_W) / lattice_spacing_m_).array().round().matrix();
}

bool FieldRequests::asked_lately(double time_s, const Eigen::Vector3d& point_W) const noexcept {
  return std::any_of(asked_.begin(), asked_.end(), [&](const Asked& asked) {
    return time_s - asked.time_s < kAskAgain_s && (point_W - asked.position_W).norm() < kAskApart_m;
  });
}

void FieldRequests::note_asked(double time_s, const Eigen::Vector3d& wanted_W) noexcept {
  asked_[next_asked_] = {time_s, wanted_W};
  next_asked_ = (next_asked_ + 1) % kAsked;
}

}  // namespace forcegrid::kriging
