// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/sample_queue.h"

#include <cmath>

namespace forcegrid::kriging {
namespace {

// Whether the sample answers a query about an expected contact.
bool of_expected(const Sample& sample) noexcept {
  return sample.before_contact && sample.from_query;
}

}  // namespace

bool SampleQueue::accepts(const Sample& sample, const ContactState& contact,
                          bool takes_expected) const noexcept {
  const bool expected = takes_expected && of_expected(sample) && contact.has_origin() &&
                        sample.contact_point_W.allFinite();
  return (expected || (contact.in_contact() && !sample.before_contact)) &&
         std::isfinite(sample.time_s) && sample.position_W.allFinite() &&
         sample.force_W.allFinite() && (sample.from_query || !(sample.time_s < newest_s_));
}

void SampleQueue::push(const Sample& sample, const ContactState& contact,
                       ToolMotion& motion) noexcept {
  QueuedSample& entry = queue_[taken_++ % kLength];
  entry = QueuedSample{};
  entry.before_contact = of_expected(sample);
  Observation& o = entry.observation;
  o.origin_W = entry.before_contact ? sample.contact_point_W : contact.origin_W();
  o.position_m = sample.position_W - o.origin_W;
  o.force_N = sample.force_W;
  o.time_s = sample.time_s;
  o.from_query = sample.from_query;
  o.unfinished = !sample.converged || sample.relative_residual > kUnfinished;
  o.contact = contact.number();
  o.has_stiffness = sample.has_stiffness && sample.stiffness_W.allFinite();
  if (o.has_stiffness) {
    for (int i = 0; i < 6; ++i) {
      const int r = kStiffnessRow[i];
      const int c = kStiffnessColumn[i];
      o.stiffness_N_per_m[i] = 0.5 * (sample.stiffness_W(r, c) + sample.stiffness_W(c, r));
    }
  }
  if (sample.from_query) {
    return;
  }
  o.has_rise = has_previous_ && sample.time_s - newest_s_ < kNextPeriods * motion.sample_period_s();
  o.rise_N = sample.force_W - newest_force_N_;
  has_previous_ = true;
  newest_force_N_ = sample.force_W;
  newest_s_ = sample.time_s;
  newest_W_ = sample.position_W;
  motion.sample_arrived();
}

}  // namespace forcegrid::kriging
