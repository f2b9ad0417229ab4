// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/sample_intake.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>

#include "rt/vectors.h"

namespace forcegrid::servo {
namespace {

// [m] A contact point farther than this from a tool in the air is where the tool will touch.
constexpr double kElsewhere_m = 1e-6;

// Weight of the newest interval in the average of sample periods.
constexpr double kPeriodWeight = 0.1;

}  // namespace

SampleIntake::SampleIntake(ServoPorts& ports, std::vector<ForceMethod*> methods,
                           const Options& options)
    : ports_(ports),
      methods_(std::move(methods)),
      requests_per_s_(options.requests_per_s),
      queries_before_contact_(methods_[0]->needs().requests_before_contact),
      gate_(options.max_force_N),
      sample_period_s_(1.0 / options.simulator_rate_Hz) {}

void SampleIntake::send_tool_state(rt::TimePoint now, const Eigen::Vector3d& position_W,
                                   const Eigen::Vector3d& velocity_W,
                                   const std::optional<ToolPose>& pose) noexcept {
  link::ToolState tool;
  tool.sequence = ++tool_sequence_;
  tool.servo_time_ns = now.time_since_epoch().count();
  tool.position_W_m = rt::to_array(position_W);
  tool.velocity_W_m_per_s = rt::to_array(velocity_W);
  if (pose) {
    tool.has_orientation = true;
    tool.orientation_WT = pose->orientation_WT_wxyz;
    tool.angular_velocity_W_rad_per_s = rt::to_array(pose->angular_velocity_W_rad_per_s);
    tool.has_buttons = pose->has_buttons;
    tool.buttons = pose->has_buttons ? pose->buttons : 0;
  }
  ports_.tool.publish(tool);
}

void SampleIntake::take(rt::TimePoint now, FirstTouch& first_touch) noexcept {
  NearSurface surface;
  if (ports_.surface.fetch(surface)) {
    first_touch.take(surface);
  }
  ArrivedSample arrived;
  // Bounded by the ring's capacity, however fast the link thread pushes.
  for (int i = 0; i < ServoPorts::kSampleCapacity && ports_.samples.pop(arrived); ++i) {
    ++arrivals_taken_;
    if (arrived.sample.from_query) {
      take_answer(arrived);
    } else {
      take_sample(now, arrived, first_touch);
    }
  }
}

void SampleIntake::take_sample(rt::TimePoint now, const ArrivedSample& arrived,
                               FirstTouch& first_touch) noexcept {
  if (has_sample_) {
    const double interval_s = rt::seconds(arrived.arrived - newest_arrival_);
    sample_period_s_ += kPeriodWeight * (std::clamp(interval_s, 0.0, 1.0) - sample_period_s_);
  }
  has_sample_ = true;
  newest_arrival_ = arrived.arrived;
  ++samples_taken_;
  take_contact(arrived);
  first_touch.answer(servo_time_s(now), arrived.sample.time_s, arrived.in_contact,
                     arrived.sample.contact_epoch);
  const std::span<const Sample> believed =
      in_contact_ ? gate_.pass(arrived.sample) : std::span<const Sample>();
  for (const Sample& sample : believed) {
    for (ForceMethod* method : methods_) {
      method->take_sample(sample);
    }
  }
  if (!in_contact_ || !believed.empty()) {
    take_torque(arrived);
    believed_arrival_ = arrived.arrived;
    believed_time_s_ = arrived.sample.time_s;
  }
}

// A torque without the contact that it belongs to is none.
void SampleIntake::take_torque(const ArrivedSample& arrived) noexcept {
  if (!in_contact_ || !arrived.has_torque) {
    tool_torque_.forget();
    return;
  }
  const auto& [w, x, y, z] = arrived.orientation_WT_wxyz;
  tool_torque_.take({.position_W = arrived.sample.position_W,
                     .force_W = arrived.sample.force_W,
                     .torque_W_Nm = arrived.torque_W_Nm,
                     .orientation_WT = Eigen::Quaterniond(w, x, y, z),
                     .has_rotational_stiffness = arrived.has_rotational_stiffness,
                     .rotational_stiffness_W_Nm_per_rad = arrived.rotational_stiffness_W_Nm_per_rad,
                     .has_gradient = arrived.has_torque_gradient && arrived.sample.has_stiffness,
                     .gradient_W_N = arrived.torque_gradient_W_N,
                     .stiffness_W_N_per_m = arrived.sample.stiffness_W});
}

void SampleIntake::take_contact(const ArrivedSample& arrived) noexcept {
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
  expected_contact_W_.reset();
  if (!in_contact_) {
    air_epoch_ = sample.contact_epoch;
    if ((sample.contact_point_W - sample.position_W).norm() > kElsewhere_m) {
      expected_contact_W_ = sample.contact_point_W;
    }
  }
}

// Only the rendered method learns from an answer: the methods evaluated beside it are to see
// exactly what they would see without queries.
void SampleIntake::take_answer(const ArrivedSample& answer) noexcept {
  if (!answer.in_contact || !contact_known_) {
    return;
  }
  Sample sample = answer.sample;
  sample.before_contact = queries_before_contact_ && sample.contact_epoch == air_epoch_;
  if (sample.before_contact || (in_contact_ && sample.contact_epoch == contact_epoch_)) {
    methods_[0]->take_sample(sample);
    ++answers_taken_;
  }
}

void SampleIntake::query_if_due(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept {
  if (!(requests_per_s_ > 0.0) || now < next_query_) {
    return;
  }
  // On a fixed schedule, so that the average rate is met although it does not divide the servo
  // rate; after a pause the schedule begins anew.
  const rt::Duration interval = rt::from_seconds(1.0 / requests_per_s_);
  next_query_ += interval;
  if (next_query_ <= now) {
    next_query_ = now + interval;
  }
  if (in_contact_ || (expected_contact_W_ && queries_before_contact_)) {
    send_query(now, position_W);
  }
}

void SampleIntake::send_query(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept {
  Eigen::Vector3d wanted_W = Eigen::Vector3d::Zero();
  if (!methods_[0]->plan_request(servo_time_s(now), position_W, wanted_W)) {
    return;
  }
  link::Query query;
  query.query_id = ++last_query_id_;
  query.servo_time_ns = now.time_since_epoch().count();
  query.position_W_m = rt::to_array(wanted_W);
  if (ports_.queries.push(query)) {
    ++queries_sent_;
  }
}

double SampleIntake::sample_age_s(rt::TimePoint now) const noexcept {
  return has_sample_ ? rt::seconds(now - believed_arrival_)
                     : std::numeric_limits<double>::infinity();
}

void SampleIntake::describe(rt::TimePoint now, CycleRecord& record) const noexcept {
  record.in_contact = in_contact_;
  record.contact_epoch = contact_epoch_;
  record.samples_taken = samples_taken_;
  record.arrivals_taken = arrivals_taken_;
  record.sample_period_ms = 1e3 * sample_period_s_;
  record.requests_per_s = requests_per_s_;
  record.sample_age_ms = has_sample_ ? 1e3 * (servo_time_s(now) - believed_time_s_) : -1.0;
}

void SampleIntake::restart() noexcept {
  has_sample_ = false;
  gate_.forget();
  tool_torque_.forget();
}

}  // namespace forcegrid::servo
