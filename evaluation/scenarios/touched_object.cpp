// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/touched_object.h"

#include <algorithm>
#include <cmath>

#include "evaluation/motions/exploration.h"

namespace forcegrid::evaluation {

using Eigen::Vector3d;

namespace {

constexpr double kFelt_N = 1e-3;  // of a wall with a soft edge, whose force is never zero

}  // namespace

TouchedObject::TouchedObject(const Trajectory& trajectory, const ForceTable& table,
                             const SceneExtras& extras, double servo_rate_Hz)
    : trajectory_(trajectory), table_(table), extras_(extras), servo_rate_Hz_(servo_rate_Hz) {
  slid_at_first_N_ = extras.effect.slide_W_m.isZero()
                         ? Vector3d(Vector3d::Zero())
                         : untouched(-extras.effect.slid_W_m(0.0)).force_W;
  if (!extras.effect.relaxations.empty()) {
    remember_path();
  }
}

ForceLaw TouchedObject::law(double time_s) const {
  ForceLaw law;
  const int contact = trajectory_.contact_at(time_s);
  const double of_place =
      contact < 0 ? 1.0 : trajectory_.contacts()[static_cast<std::size_t>(contact)].force_factor;
  law.factor = of_place * extras_.effect.cut_factor(time_s);
  law.slid_until_s = time_s;
  law.walls.assign(extras_.walls.size(), true);
  return law;
}

ForceLaw TouchedObject::law_with_sample(const ForceLaw& known, double time_s,
                                        const Vector3d& position_W) const {
  ForceLaw told = law(time_s);
  for (std::size_t i = 0; i < told.walls.size(); ++i) {
    const Vector3d push_N = extras_.walls[i].at(position_W - first_contact_point_W()).force_W;
    const bool pushes = push_N.norm() > kFelt_N;
    told.walls[i] = pushes || (i < known.walls.size() && known.walls[i]);
  }
  return told;
}

Sample TouchedObject::answer(double time_s, const Vector3d& position_W) const {
  return at_rest(time_s, position_W, law(time_s));
}

Sample TouchedObject::answer_on_path(double time_s, const Vector3d& position_W) const {
  return on_path(time_s, position_W, law(time_s));
}

Vector3d TouchedObject::force_on_path_W(double time_s, const Vector3d& position_W,
                                        const ForceLaw& law) const {
  return on_path(time_s, position_W, law).force_W;
}

Sample TouchedObject::at_rest(double time_s, const Vector3d& position_W,
                              const ForceLaw& law) const {
  Sample sample = elastic(time_s, position_W, law);
  const int contact = trajectory_.contact_at(time_s);
  if (contact >= 0 && !lags_N_.empty()) {
    const auto instant = static_cast<std::size_t>(std::lround(time_s * servo_rate_Hz_));
    sample.force_W -= lags_N_[std::min(instant, lags_N_.size() - 1)];
  }
  return sample;
}

Sample TouchedObject::on_path(double time_s, const Vector3d& position_W,
                              const ForceLaw& law) const {
  Sample sample = at_rest(time_s, position_W, law);
  if (trajectory_.contact_at(time_s) >= 0) {
    sample.force_W -= extras_.effect.viscosity_Ns_per_m * velocity_W(time_s);
  }
  return sample;
}

Vector3d TouchedObject::reached_W(double time_s, const Vector3d& position_W) const {
  const int contact = trajectory_.contact_at(time_s);
  if (contact < 0) {
    return position_W;
  }
  const Vector3d origin_W = trajectory_.contacts()[static_cast<std::size_t>(contact)].point_W +
                            extras_.effect.slid_W_m(time_s);
  const Vector3d displacement_W = position_W - origin_W;
  return origin_W + (trajectory_.is_exploration() ? clamped_to_large_object(table_, displacement_W)
                                                  : table_.clamped(displacement_W));
}

// The object of the scene's table, before any effect.
ForceTable::Value TouchedObject::untouched(const Vector3d& displacement_W) const {
  return trajectory_.is_exploration() ? large_object(table_, displacement_W)
                                      : table_.at(displacement_W);
}

Sample TouchedObject::elastic(double time_s, const Vector3d& position_W,
                              const ForceLaw& law) const {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = position_W;
  sample.has_stiffness = true;
  const std::vector<ContactSpan>& contacts = trajectory_.contacts();
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    // The epoch counts beginnings and ends; the first contact is 1.
    sample.contact_epoch += time_s >= contacts[i].begin_s ? 1 : 0;
    sample.contact_epoch += time_s >= contacts[i].end_s ? 1 : 0;
  }
  const int contact = trajectory_.contact_at(time_s);
  if (contact < 0) {
    return sample;
  }
  const ContactSpan& span = contacts[static_cast<std::size_t>(contact)];
  sample.contact_point_W = span.point_W;
  const Vector3d displacement_W =
      position_W - span.point_W - extras_.effect.slid_W_m(law.slid_until_s);
  const ForceTable::Value value = untouched(displacement_W);
  sample.force_W = law.factor * (value.force_W - slid_at_first_N_);
  sample.stiffness_W = law.factor * value.stiffness_W;
  for (std::size_t i = 0; i < extras_.walls.size(); ++i) {
    if (i >= law.walls.size() || !law.walls[i]) {
      continue;
    }
    const Wall::Value pushed = extras_.walls[i].at(position_W - first_contact_point_W());
    sample.force_W += pushed.force_W;
    sample.stiffness_W += pushed.stiffness_W;
  }
  return sample;
}

Vector3d TouchedObject::velocity_W(double time_s) const noexcept {
  const double step_s = 0.5 / servo_rate_Hz_;
  const double before_s = std::max(0.0, time_s - step_s);
  const double after_s = std::min(trajectory_.duration_s(), time_s + step_s);
  return (trajectory_.position_W(after_s) - trajectory_.position_W(before_s)) /
         (after_s - before_s);
}

// The force is assumed linear in between.
void TouchedObject::remember_path() {
  const std::vector<ObjectEffect::Relaxation>& relaxations = extras_.effect.relaxations;
  const auto instants =
      static_cast<std::size_t>(std::ceil(trajectory_.duration_s() * servo_rate_Hz_ - 1e-6));
  const double dt_s = 1.0 / servo_rate_Hz_;
  std::vector<Vector3d> lags_N(relaxations.size(), Vector3d::Zero());
  Vector3d before_N = Vector3d::Zero();
  int contact = -1;
  for (std::size_t i = 0; i < instants; ++i) {
    const double time_s = static_cast<double>(i) * dt_s;
    const int now = trajectory_.contact_at(time_s);
    const Vector3d force_N = elastic(time_s, trajectory_.position_W(time_s), law(time_s)).force_W;
    Vector3d sum_N = Vector3d::Zero();
    for (std::size_t j = 0; j < relaxations.size(); ++j) {
      const double x = dt_s / relaxations[j].time_s;
      const double kept = std::exp(-x);
      if (now != contact) {
        lags_N[j].setZero();
      } else {
        const Vector3d rise_N = (force_N - before_N) / x;
        lags_N[j] = kept * (lags_N[j] - before_N + rise_N) + force_N - rise_N;
      }
      sum_N += relaxations[j].share * lags_N[j];
    }
    contact = now;
    before_N = force_N;
    lags_N_.push_back(sum_N);
  }
}

}  // namespace forcegrid::evaluation
