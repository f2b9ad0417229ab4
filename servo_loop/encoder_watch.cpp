// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/encoder_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace forcegrid::servo {

EncoderWatch::EncoderWatch(const profiles::DeviceProfile& profile) noexcept
    : loaded_above_Nm_(profile.dynamics.coulomb_friction_Nm) {
  for (double& torque_Nm : loaded_above_Nm_) {
    torque_Nm *= kFrictions;
  }
}

void EncoderWatch::restart() noexcept {
  joints_ = {};
  settled_from_ = {};
}

std::optional<int> EncoderWatch::check(rt::TimePoint now,
                                       const driver::DeviceReport& report) noexcept {
  if (report.sequence != last_sequence_) {
    const rt::Duration since_last = report.released - last_released_;
    if (since_last > rt::Duration::zero() && since_last <= kYoung &&
        now - report.released <= kYoung) {
      watched_ += std::min(since_last, kCredit);
    }
    last_sequence_ = report.sequence;
    last_released_ = report.released;
  }
  std::optional<int> frozen;
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    Joint& joint = joints_[i];
    const std::int32_t counts = report.counts[i];
    if (!joint.known || counts != joint.counts) {
      if (joint.suspected) {
        joint.suspected = false;
        joint.suspect_no_sooner = now + kPatience;
        joint.travel_counts = 0;
      } else if (joint.known && now >= settled_from_) {
        joint.travel_counts += std::min(std::abs(counts - joint.counts), kMovedOn_counts);
        if (joint.travel_counts >= kMovedOn_counts) {
          joint.suspect_no_sooner = now;
        }
        joint.travel_counts = std::min(joint.travel_counts, kMovedOn_counts);
      }
      joint.known = true;
      joint.counts = counts;
      joint.still_since = watched_;
      continue;
    }
    if (!frozen && unmoved(joint) &&
        watched_ - joint.watched_when_suspected >= kReliefTime + kProofTime) {
      frozen = static_cast<int>(i);
    }
  }
  return frozen;
}

Eigen::Array3d EncoderWatch::relief(rt::TimePoint now, double elapsed_s,
                                    const Eigen::Vector3d& force_torque_Nm) noexcept {
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    Joint& joint = joints_[i];
    const bool loaded =
        std::abs(force_torque_Nm[static_cast<Eigen::Index>(i)]) > loaded_above_Nm_[i];
    if (loaded && !joint.loaded) {
      joint.loaded_since = watched_;
    }
    joint.loaded = loaded;
    if (!loaded) {
      joint.suspected = false;
    } else if (!joint.suspected && joint.known && now >= joint.suspect_no_sooner &&
               watched_ - std::max(joint.still_since, joint.loaded_since) >= kSuspectAfter) {
      joint.suspected = true;
      joint.suspected_since = now;
      joint.watched_when_suspected = watched_;
      ++suspected_stuck_encoders_;
    }
    if (joint.suspected) {
      const double led = rt::seconds(now - joint.suspected_since) / rt::seconds(kReliefTime);
      joint.part = std::clamp(1.0 - led, 0.0, joint.part);
    } else {
      joint.part = std::min(1.0, joint.part + elapsed_s / rt::seconds(kReliefTime));
    }
  }
  // What is left of the force could be what holds an unmoved joint where it is.
  if (std::any_of(joints_.begin(), joints_.end(),
                  [this](const Joint& joint) { return unmoved(joint); })) {
    for (Joint& joint : joints_) {
      joint.part = 0.0;
    }
  }
  if (std::any_of(joints_.begin(), joints_.end(),
                  [](const Joint& joint) { return joint.part < 1.0; })) {
    settled_from_ = now + kSettleTime;
  }
  return {joints_[0].part, joints_[1].part, joints_[2].part};
}

bool EncoderWatch::unmoved(const Joint& joint) const noexcept {
  return joint.suspected && joint.part <= 0.0 &&
         watched_ - joint.watched_when_suspected >= kReliefTime;
}

}  // namespace forcegrid::servo
