// What the loop takes from the link and gives to it, a cycle at a time.

#include <algorithm>
#include <span>

#include "servo_loop/servo_loop.h"

namespace forcegrid::servo {
namespace {

// A contact point this far from a tool in the air is where it will touch.
constexpr double kElsewhere_m = 1e-6;

}  // namespace

void ServoLoop::send_tool_state(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept {
  link::ToolState tool;
  tool.sequence = ++tool_sequence_;
  tool.servo_time_ns = now.time_since_epoch().count();
  tool.position_W_m = triple(position_W);
  tool.velocity_W_m_per_s = triple(guard_.velocity_D());
  ports_.tool.publish(tool);
}

void ServoLoop::take_samples(rt::TimePoint now) noexcept {
  NearSurface surface;
  if (ports_.surface.fetch(surface)) {
    first_touch_.take(surface);
  }
  ArrivedSample arrived;
  // Bounded by the ring's capacity, whatever the link thread does meanwhile.
  for (int i = 0; i < 64 && ports_.samples.pop(arrived); ++i) {
    if (arrived.sample.from_query) {
      take_answer(arrived);
      continue;
    }
    if (has_sample_) {
      const double interval_s = rt::seconds(arrived.arrived - newest_arrival_);
      sample_period_s_ += 0.1 * (std::clamp(interval_s, 0.0, 1.0) - sample_period_s_);
    }
    has_sample_ = true;
    newest_arrival_ = arrived.arrived;
    ++samples_taken_;
    take_contact(arrived);
    first_touch_.answer(servo_time_s(now), arrived.sample.time_s, arrived.in_contact,
                        arrived.sample.contact_epoch);
    const std::span<const Sample> believed =
        in_contact_ ? gate_.pass(arrived.sample) : std::span<const Sample>();
    for (const Sample& sample : believed) {
      for (ForceMethod* method : methods_) {
        method->take_sample(sample);
      }
    }
    if (!in_contact_ || !believed.empty()) {
      newest_sample_arrived_ = arrived.arrived;
      newest_sample_time_s_ = arrived.sample.time_s;
    }
  }
}

void ServoLoop::take_contact(const ArrivedSample& arrived) noexcept {
  const Sample& sample = arrived.sample;
  if (arrived.in_contact && (!in_contact_ || sample.contact_epoch != contact_epoch_)) {
    gate_.forget();
    for (ForceMethod* method : methods_) {
      method->contact_made(sample.contact_epoch, sample.contact_point_W);
    }
  } else if (!arrived.in_contact && (in_contact_ || !contact_known_)) {
    gate_.forget();
    for (ForceMethod* method : methods_) {
      method->contact_lost();
    }
  }
  contact_known_ = true;
  in_contact_ = arrived.in_contact;
  contact_epoch_ = sample.contact_epoch;
  contact_expected_ =
      !in_contact_ && (sample.contact_point_W - sample.position_W).norm() > kElsewhere_m;
  if (!in_contact_) {
    expected_point_W_ = sample.contact_point_W;
    air_epoch_ = sample.contact_epoch;
  }
}

// An answer is no sign of where the tool is or of contact, and is of no use in another one, unless
// it was asked for before this one. Only the method that asked learns from it, so that its shadows
// stay what they are.
void ServoLoop::take_answer(const ArrivedSample& answer) noexcept {
  if (!answer.in_contact || !contact_known_) {
    return;
  }
  Sample sample = answer.sample;
  sample.before_contact = asks_before_contact_ && sample.contact_epoch == air_epoch_;
  if (sample.before_contact || (in_contact_ && sample.contact_epoch == contact_epoch_)) {
    methods_[0]->take_sample(sample);
    ++answers_taken_;
  }
}

void ServoLoop::make_request(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept {
  const rt::Duration interval = rt::from_seconds(1.0 / options_.requests_per_s);
  // On a raster, so that the rate is met although cycles don't divide it; but what a pause has kept
  // from being asked is not asked at once.
  next_request_ += interval;
  if (next_request_ <= now) {
    next_request_ = now + interval;
  }
  Eigen::Vector3d wanted_W = Eigen::Vector3d::Zero();
  const bool may_ask = in_contact_ || (contact_expected_ && asks_before_contact_);
  if (!may_ask || !methods_[0]->plan_request(servo_time_s(now), position_W, wanted_W)) {
    return;
  }
  link::Query query;
  query.query_id = ++last_query_id_;
  query.servo_time_ns = now.time_since_epoch().count();
  query.position_W_m = triple(wanted_W);
  if (ports_.queries.push(query)) {
    ++requests_made_;
  }
}

}  // namespace forcegrid::servo
