// KrigingMethod: where the simulator is asked.

#include <algorithm>
#include <cmath>

#include "forcegrid/kriging/kriging_method.h"

namespace forcegrid {
namespace {

// Requests: not twice within this time and distance, the nearer the better.
constexpr double kAskAgain_s = 0.3;
constexpr double kAskApart_m = 0.003;
constexpr double kAskReach_m = 0.012;
constexpr double kAskFurthest_m = 0.015;
constexpr double kAskBeside_m = 0.006;

// Before contact: displacements to ask for, the surface's normal being z.
constexpr double kAskBefore_m[][3] = {
    {0.0, 0.0, 0.004},      {0.0, 0.0, 0.012},      {0.005, 0.0, 0.006},     {-0.005, 0.0, 0.006},
    {0.0, 0.005, 0.006},    {0.0, -0.005, 0.006},   {0.0, 0.0, 0.018},       {0.005, 0.005, 0.012},
    {-0.005, 0.005, 0.012}, {0.005, -0.005, 0.012}, {-0.005, -0.005, 0.012}, {0.0, 0.0, 0.008},
    {0.0, 0.0, -0.004}};

}  // namespace

bool KrigingMethod::plan_request(double time_s, const Eigen::Vector3d& position_W,
                                 Eigen::Vector3d& wanted_W) noexcept {
  if (!origin_known_ || !std::isfinite(time_s) || !position_W.allFinite()) {
    return false;
  }
  if (!in_contact_) {
    return plan_before_contact(time_s, wanted_W);
  }
  const Member& member = members_[active_];
  double best_N = 0.0;
  const auto consider = [&](Eigen::Vector3d candidate_W) {
    if (lattice_spacing_m_ > 0.0) {
      const Eigen::Vector3d corner_W = origin_W_ + lattice_corner_m_;
      candidate_W =
          corner_W + lattice_spacing_m_ *
                         ((candidate_W - corner_W) / lattice_spacing_m_).array().round().matrix();
    }
    if (asked_lately(time_s, candidate_W)) {
      return;
    }
    const double near_m2 = (candidate_W - position_W).squaredNorm();
    const double deviation_N =
        member.field->deviation_N(candidate_W - origin_W_, history_at(member, candidate_W));
    const double value_N = deviation_N * std::exp(-0.5 * near_m2 / (kAskReach_m * kAskReach_m));
    if (deviation_N > kAsk_N && value_N > best_N) {
      best_N = value_N;
      wanted_W = candidate_W;
    }
  };
  const double speed = velocity_W_.norm();
  for (const double periods : {1.0, 2.0, 3.0}) {
    const double ahead_m = std::min(periods * sample_period_s_ * speed, kAskFurthest_m);
    if (ahead_m > 0.0) {
      consider(position_W + ahead_m / speed * velocity_W_);
    }
  }
  // Where the motion may turn to: one place around the tool a call.
  const std::size_t around = next_around_++ % 6;
  Eigen::Vector3d beside_W = position_W;
  beside_W[static_cast<int>(around / 2)] += around % 2 == 0 ? kAskBeside_m : -kAskBeside_m;
  consider(beside_W);
  if (best_N <= 0.0) {
    return false;
  }
  note_asked(time_s, wanted_W);
  return true;
}

bool KrigingMethod::asked_lately(double time_s, const Eigen::Vector3d& candidate_W) const noexcept {
  return std::any_of(asked_.begin(), asked_.end(), [&](const Asked& asked) {
    return time_s - asked.time_s < kAskAgain_s &&
           (candidate_W - asked.position_W).norm() < kAskApart_m;
  });
}

void KrigingMethod::note_asked(double time_s, const Eigen::Vector3d& wanted_W) noexcept {
  asked_[next_asked_] = {time_s, wanted_W};
  next_asked_ = (next_asked_ + 1) % kAsked;
}

bool KrigingMethod::plan_before_contact(double time_s, Eigen::Vector3d& wanted_W) noexcept {
  if (places_ == kNobody) {
    return false;
  }
  const kriging::Field& field = *members_[places_].field;
  if (!(time_s - expected_s_ < kExpected_s) || !field.ready()) {
    return false;
  }
  for (const auto& displacement_m : kAskBefore_m) {
    const Eigen::Vector3d d(displacement_m);
    const Eigen::Vector3d candidate_W = origin_W_ + d;
    if (!asked_lately(time_s, candidate_W) &&
        field.deviation_N(d, kriging::History::Zero()) > kAsk_N) {
      wanted_W = candidate_W;
      note_asked(time_s, wanted_W);
      return true;
    }
  }
  return false;
}

}  // namespace forcegrid
