// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/moved_field.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace forcegrid::kriging {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kIterations = 2;
constexpr double kLeastVariance = 1e-18;  // of a motion's unknowns, which keeps it invertible
constexpr double kAnything_N = 1.0;       // deviation of a change that has another cause
constexpr double kClearly_nats = 3.0;
// In a slide the factor is a guess, 2 to 8 deviations from one; after a cut, a thousand.
constexpr double kSureOfScale = 20.0;
constexpr double kScaleSettled = 1e-4;  // variance

// ln N(e; 0, S) but for a constant.
template <typename Vector, typename Matrix>
double log_likelihood(const Vector& e, const Matrix& s) noexcept {
  return -0.5 * (e.dot(s.inverse() * e) + std::log(s.determinant()));
}

}  // namespace

MovedField::MovedField(const FieldSettings& settings) noexcept : Base(settings) {}

Observation MovedField::in_own_frame(const Observation& observation) const noexcept {
  Observation own = observation;
  own.position_m -= shift_m_;
  own.force_N /= strength_;
  own.stiffness_N_per_m /= strength_;
  return own;
}

bool MovedField::seeks_explanation(const Observation& /*observation*/, const Vector3d& /*error_N*/,
                                   const Innovation& /*innovation*/) noexcept {
  return seeks_;
}

void MovedField::enter_contact(std::uint64_t contact, const Vector3d& point_W) noexcept {
  settle();
  Base::enter_contact(contact, point_W);
  entered_contact_ = contact;
}

void MovedField::set_time(double time_s) noexcept {
  if (left_ != Left::kNothing) {
    return;  // the shift is between two samples
  }
  ahead_m_ = shift_m_;
  ahead_s_ = time_s_;
  if (open_) {
    const double longest_s = entered_contact_ == moved_contact_ ? kLongest_s : kLongestUnseen_s;
    const double ahead_s = std::clamp(time_s - time_s_, 0.0, longest_s);
    ahead_m_ += ahead_s * velocity_m_per_s_;
    ahead_s_ += ahead_s;
  }
}

Innovation MovedField::take(const Observation& observation) noexcept {
  finish();
  nearest_pair_m2_ = -1.0;
  taking_ = observation;
  explains_ = false;
  weaker_by_stiffness_ = weakened_by_stiffness(observation);
  if (open_ && moves_on(observation) && sample_count_ > 0) {
    taking_to_s_ = next_.time_s;
    taken_ = Innovation{};
    left_ = Left::kTakeMoving;
    if (!began_) {
      prepare();
    }
  } else {
    taken_ = Base::take(in_own_frame(observation));
    taken_.error_N *= strength_;
    if (taken_.unfinished) {
      taken_.unfinished = false;
      next_.time_s = observation.from_query ? time_s_ : observation.time_s;
      left_ = Left::kExplain;
      prepare();
    } else {
      complete();
    }
  }
  Innovation innovation = taken_;
  innovation.unfinished = left_ != Left::kNothing;
  return innovation;
}

// Once nothing is left of a take().
void MovedField::complete() noexcept {
  if (left_ != Left::kNothing) {
    return;
  }
  taken_.explained = taken_.explained || (weaker_by_stiffness_ && !taken_.surprised);
  taken_.surprised = taken_.surprised || weaker_by_stiffness_;
  if (!taking_.from_query) {
    time_s_ = taking_.time_s;
    moved_contact_ = taking_.contact;
  }
  set_time(time_s_);
}

bool MovedField::prepare() noexcept {
  switch (std::exchange(left_, Left::kNothing)) {
    case Left::kNothing:
      return Base::prepare();
    case Left::kTakeMoving:
      taken_ = take_moving(taking_, taking_to_s_ > time_s_);
      left_ = left_of_motion();
      break;
    case Left::kChange:
      begin_change();
      left_ = Left::kTakeChanged;
      break;
    case Left::kTakeChanged:
      taken_ = take_moving(taking_, false);
      left_ = left_of_motion();
      break;
    case Left::kExplain:
      explains_ = true;
      begin_explanation();
      if (open_) {
        left_ = Left::kTakeExplained;
      } else {
        close();
        learn(teach(in_own_frame(taking_)));
      }
      break;
    case Left::kTakeExplained:
      take_explained();
      break;
    case Left::kClose:
      close();
      left_ = Left::kTeach;
      break;
    case Left::kTeach:
      learn(teach(in_own_frame(taking_)));
      break;
    case Left::kEnd:
      close();
      break;
    case Left::kLeave:
      go_to(next_.time_s);
      close();
      left_ = Left::kTeachAlone;
      break;
    case Left::kTeachAlone:
      taken_.doubt_N2 = teach(in_own_frame(taking_)).doubt_N2;
      left_ = explains_ ? Left::kTeach : Left::kNothing;
      break;
  }
  complete();
  return true;
}

void MovedField::expect_noise(double nugget_N2) noexcept {
  if (nugget_N2 != settings_.nugget_N2) {
    settings_.nugget_N2 = nugget_N2;
    takes_since_factorisation_ = kTakesBetweenFactorisations;
  }
}

// The simulator's stiffness shows a weaker object where its force is still small. Not where a new
// contact's own factor is being learned from it.
// @returns whether that has made it weaker.
bool MovedField::weakened_by_stiffness(const Observation& observation) noexcept {
  if (open_ || observation.from_query || !observation.has_stiffness || sample_count_ == 0 ||
      settings().stiffness_samples == 0 || observation.contact != contact_ ||
      scale_variance_ > kScaleSettled) {
    return false;
  }
  const Observation own = in_own_frame(observation);
  covariances_of_stiffness(own.position_m, x_);
  factor_.solve(x_, 6);
  const Vector6d mean = factor_.template mean<6>(x_);
  const Vector6d error = own.stiffness_N_per_m - mean;
  Matrix6d variance = (settings().kernel.stiffness_stiffness(own.position_m, own.position_m) -
                       factor_.template explained<6>(x_)) *
                      data_scale();
  variance.diagonal().array() += stiffness_variance(own.stiffness_N_per_m, 0.0);
  const Matrix6d inverse = variance.inverse();
  const double squares = error.dot(inverse * error);
  if (!(squares / 6.0 > settings().surprise)) {
    return false;
  }
  const Prediction p = predict(own);
  const Matrix3d force_inverse = p.variance_N2.inverse();
  const double known =
      1.0 / (kWeaker * kWeaker) + mean.dot(inverse * mean) + p.mean_N.dot(force_inverse * p.mean_N);
  const double seen = mean.dot(inverse * error) + p.mean_N.dot(force_inverse * p.error_N);
  const double change = seen / known;
  const double weaker_nats = -0.5 * (squares + p.error_N.dot(force_inverse * p.error_N) -
                                     seen * change + std::log(kWeaker * kWeaker * known));
  const double per_m = 3.0 / settings().kernel.length_m;
  const auto otherwise_nats = [&](double force_N, double stiffness_N_per_m) {
    Matrix3d force_N2 = p.variance_N2;
    force_N2.diagonal().array() += force_N * force_N;
    Matrix6d stiffness_N2_per_m2 = variance;
    stiffness_N2_per_m2.diagonal().array() += stiffness_N_per_m * stiffness_N_per_m;
    return log_likelihood(p.error_N, force_N2) - log_likelihood(Vector3d::Zero(), p.variance_N2) +
           log_likelihood(error, stiffness_N2_per_m2) -
           log_likelihood(Vector6d(Vector6d::Zero()), variance);
  };
  const double moved_nats =
      otherwise_nats(kOpen_m * mean.norm(), kOpen_m / settings().kernel.length_m * mean.norm());
  const double anything_nats = otherwise_nats(kAnything_N, kAnything_N * per_m);
  const bool weaker = change < 0.0 && (1.0 + change) * strength_ > kLeastStrength &&
                      weaker_nats - std::max(moved_nats, anything_nats) > kClearly_nats;
  if (weaker) {
    strength_ *= 1.0 + change;
  }
  return weaker;
}

// To the sample's time. @returns false, and closes it, if it can't.
bool MovedField::moves_on(const Observation& observation) noexcept {
  const double dt_s = observation.from_query ? 0.0 : observation.time_s - time_s_;
  if (!(dt_s >= 0.0 && dt_s < kLongestUnseen_s)) {
    close();
    return false;
  }
  go_to(time_s_ + dt_s);
  began_ = observation.contact != contact_ || !(dt_s < kLongest_s);
  if (began_) {
    Covariance opened = covariance_;
    if (!(dt_s < kLongest_s)) {  // it may have come to rest
      const double change_m_per_s = kChange_m_per_s + velocity_m_per_s_.norm();
      opened.diagonal().head<3>().array() += std::pow(change_m_per_s * dt_s, 2);
      opened.diagonal().tail<3>().array() += std::pow(change_m_per_s, 2);
    }
    begin_motion(time_s_ + dt_s, opened);
  }
  return true;
}

void MovedField::go_to(double time_s) noexcept {
  shift_m_ = motion_.shift_m(time_s, motion_.eta());
  velocity_m_per_s_ = motion_.velocity_m_per_s();
  covariance_ = motion_.covariance_at(time_s);
  next_ = {time_s, motion_.eta()};
}

// From the present shift and velocity on. @param opened their covariance.
void MovedField::begin_motion(double time_s, const Covariance& opened) noexcept {
  end_motion();
  factor_.clear_more();
  open_ = true;
  Covariance covariance = opened;
  covariance.diagonal().array() += kLeastVariance;
  motion_.begin(time_s, shift_m_, velocity_m_per_s_, covariance);
  next_ = {time_s, motion_.eta()};
}

// The samples go to where they are thought to have been, with what is uncertain of that as noise.
void MovedField::end_motion() noexcept {
  if (!open_) {
    return;
  }
  const bool fits = motion_.fit(factor_.data_products(), factor_.rows());
  open_ = false;
  next_terms_N_.setZero();
  for (std::size_t i = 0; i < linear_.size(); ++i) {
    Stored& s = stored_[i];
    Terms& terms_N = terms_N_[i];
    if (s.used && fits && !terms_N.isZero()) {
      const SteadyMotion::Columns by_N = terms_N.leftCols<SteadyMotion::kUnknowns>();
      const Vector3d moved_m = motion_.design(linear_[i].time_s) * (motion_.eta() - linear_[i].eta);
      s.position_m -= moved_m;
      s.first_position_m -= moved_m;
      s.doubt_N2 += (by_N * motion_.covariance() * by_N.transpose()).trace() / 3.0;
    }
    terms_N.setZero();
  }
  factorise();
  collapse();
}

MovedField::Terms MovedField::terms_of(const Observation& /*observation*/, int slot) noexcept {
  linear_[static_cast<std::size_t>(slot)] = next_;
  return next_terms_N_;
}

void MovedField::solve_weights() noexcept {
  if (!open_) {
    Base::solve_weights();
    return;
  }
  motion_.fit(factor_.data_products(), factor_.rows());  // take_moving() sees whether it does
  factor_.sum_of_data(motion_.factors(), alpha_.data());
  factor_.solve_transposed(alpha_.data());
}

// To the mean of the next sample's force, whose covariances with the rows are solved in `x`.
// @returns how that force depends on what is unknown of the motion.
SteadyMotion::Columns MovedField::add_motion(const Factor::Columns& x,
                                             Vector3d& mean_N) const noexcept {
  const Terms left_N = next_terms_N_ - factor_.more_means(x);
  mean_N -= left_N * motion_.factors();
  return left_N.leftCols<SteadyMotion::kUnknowns>();
}

void MovedField::add_features(const Vector3d& /*p*/, const Vector3d& /*origin_W*/,
                              const typename Factor::Columns& x, Vector3d& mean_N,
                              Matrix3d& covariance_N2) const noexcept {
  if (!open_) {
    return;
  }
  const SteadyMotion::Columns motion_N = add_motion(x, mean_N);
  // Its own uncertainty is absolute, not to be scaled by the data's spread.
  covariance_N2 += motion_N * motion_.covariance() * motion_N.transpose() / data_scale();
}

// The stiffness of f there.
Matrix3d MovedField::slope_N_per_m(const Observation& own) noexcept {
  const bool put_off = collapse_due_;
  if (put_off) {
    Base::expect_reads(true);
  }
  const Matrix3d slope = Base::stiffness_N_per_m(own.position_m, own.history);
  if (put_off) {
    Base::expect_reads(false);
  }
  return slope;
}

MovedField::Prediction MovedField::predict(const Observation& own) noexcept {
  Prediction prediction;
  prediction.slope_N_per_m = slope_N_per_m(own);
  covariances_of_force(own.position_m, own.history, x_);
  factor_.solve(x_, 3);
  prediction.mean_N = factor_.template mean<3>(x_);
  if (open_) {
    next_terms_N_ = motion_.terms(next_.time_s, prediction.slope_N_per_m, next_.eta);
    prediction.motion_N = add_motion(x_, prediction.mean_N);
  }
  prediction.error_N = own.force_N - prediction.mean_N;
  prediction.variance_N2 =
      (settings().kernel.force_force(own.position_m, own.history, own.position_m, own.history) -
       factor_.template explained<3>(x_)) *
      data_scale();
  prediction.variance_N2.diagonal().array() += settings().nugget_N2;
  return prediction;
}

Innovation MovedField::teach(const Observation& own) noexcept {
  seeks_ = false;
  const Innovation taken = Base::take(own);
  finish();
  seeks_ = true;
  return taken;
}

// What is left after take_moving(). At rest it is closed.
MovedField::Left MovedField::left_of_motion() noexcept {
  switch (found_) {
    case Found::kFits:
      close_if_at_rest();
      break;
    case Found::kSurprise:
      return Left::kExplain;
    case Found::kChange:
      return Left::kChange;
    case Found::kTooFar:
      return Left::kLeave;
    case Found::kBroken:
      return Left::kEnd;
  }
  return Left::kNothing;
}

// The velocity has changed since the sample before.
void MovedField::begin_change() noexcept {
  go_to(time_s_);
  Covariance opened = covariance_;
  opened.diagonal().tail<3>().array() += kChange_m_per_s * kChange_m_per_s;
  begin_motion(time_s_, opened);
  go_to(taking_to_s_);
}

// Takes a sample where the object is most likely to have been, unless it surprises or, if
// `may_change`, shows another velocity, or would have gone too far: then nothing is taken.
Innovation MovedField::take_moving(const Observation& observation, bool may_change) noexcept {
  const SteadyMotion::Vector before = motion_.eta();
  const SteadyMotion::Columns design = motion_.design(next_.time_s);
  Innovation innovation;
  innovation.predicted = true;
  next_.eta = before;
  for (int i = 0; i < kIterations; ++i) {
    shift_m_ = motion_.shift_m(next_.time_s, next_.eta);
    const Prediction p = predict(in_own_frame(observation));
    const Matrix3d s = p.variance_N2 + p.motion_N * motion_.covariance() * p.motion_N.transpose();
    if (i == 0) {
      innovation.error_N = strength_ * p.error_N.norm();
      innovation.normalised = p.error_N.dot(s.inverse() * p.error_N) / 3.0;
      const double change_m = kChange_m_per_s * (next_.time_s - time_s_);
      const Matrix3d if_changed_N2 =
          s + change_m * change_m * p.slope_N_per_m * p.slope_N_per_m.transpose();
      const bool changed =
          may_change &&
          log_likelihood(p.error_N, if_changed_N2) - log_likelihood(p.error_N, s) > kChange_nats;
      innovation.surprised = innovation.normalised > settings().surprise;
      if (changed || innovation.surprised) {
        found_ = changed ? Found::kChange : Found::kSurprise;
        return innovation;
      }
    }
    const SteadyMotion::Vector step =
        motion_.covariance() * p.motion_N.transpose() * (s.inverse() * p.error_N);
    if (!((design * step).norm() < kFurthest_m)) {
      found_ = Found::kTooFar;
      return innovation;
    }
    next_.eta = before + step;
  }
  shift_m_ = motion_.shift_m(next_.time_s, next_.eta);
  const Observation own = in_own_frame(observation);
  next_terms_N_ = motion_.terms(next_.time_s, slope_N_per_m(own), next_.eta);
  innovation.doubt_N2 = teach(own).doubt_N2;
  const bool fits = motion_.fit(factor_.data_products(), factor_.rows());
  const Vector3d jump_m = design * (motion_.eta() - next_.eta);
  if (fits && data_scale() < kBroken && jump_m.norm() < kFurthest_m) {
    found_ = Found::kFits;
    go_to(next_.time_s);
  } else {
    found_ = Found::kBroken;
  }
  return innovation;
}

// A surprise: finds its cause, which may be a motion.
void MovedField::begin_explanation() noexcept {
  if (open_) {
    go_to(taking_to_s_);
  }
  const Prediction p = predict(in_own_frame(taking_));
  if (!open_) {
    covariance_.setZero();
    velocity_m_per_s_.setZero();
  }
  Covariance wider = covariance_;
  wider.diagonal().head<3>().array() += kOpen_m * kOpen_m;
  wider.diagonal().tail<3>().array() += kOpen_m_per_s * kOpen_m_per_s;
  const double moved_nats =
      log_likelihood(p.error_N, p.variance_N2 + p.slope_N_per_m * wider.topLeftCorner<3, 3>() *
                                                    p.slope_N_per_m.transpose());
  const Matrix3d weaker_N2 = p.variance_N2 + kWeaker * kWeaker * p.mean_N * p.mean_N.transpose();
  const double weaker_nats = log_likelihood(p.error_N, weaker_N2);
  Matrix3d anything_N2 = p.variance_N2;
  anything_N2.diagonal().array() += kAnything_N * kAnything_N;
  const double anything_nats = log_likelihood(p.error_N, anything_N2);
  const double change = kWeaker * kWeaker * p.mean_N.dot(weaker_N2.inverse() * p.error_N);
  const bool weaker =
      weaker_nats > moved_nats && change < 0.0 && (1.0 + change) * strength_ > kLeastStrength;
  if (weaker) {
    strength_ *= 1.0 + change;
  } else {
    begin_motion(next_.time_s, wider);
  }
  clearly_weaker_ = weaker && weaker_nats - std::max(moved_nats, anything_nats) > kClearly_nats;
}

// Lets f take the sample if the motion leaves something to learn.
void MovedField::take_explained() noexcept {
  const Innovation moved = take_moving(taking_, false);
  if (found_ == Found::kTooFar) {
    left_ = Left::kLeave;
  } else if (found_ != Found::kFits) {
    left_ = Left::kClose;
  } else {
    learn(moved);
  }
}

// The end of a surprise: f has taken the sample.
void MovedField::learn(const Innovation& innovation) noexcept {
  taken_.doubt_N2 = innovation.doubt_N2;
  taken_.explained = clearly_weaker_ && !innovation.surprised;
}

void MovedField::close_if_at_rest() noexcept {
  if (velocity_m_per_s_.norm() < kRests_m_per_s &&
      covariance_.topLeftCorner<3, 3>().trace() < 3.0 * kKnown_m * kKnown_m) {
    close();
  }
}

void MovedField::close() noexcept {
  end_motion();
  ahead_m_ = shift_m_;
  velocity_m_per_s_.setZero();
  covariance_.setZero();
}

// Keeps the samples as far apart as possible: another one comes in for that which is nearest to its
// neighbour, if it is further from all. Near another sample the newer one stays.
void MovedField::remember(const Observation& observation) noexcept {
  if (observation.from_query) {
    return;
  }
  settle();
  transient_ = kNone;
  Observation own = in_own_frame(observation);
  if (observation.contact < scaled_since_) {
    own.force_N *= scaled_by_;
    own.stiffness_N_per_m *= scaled_by_;
  }
  int nearest = kNone;
  double nearest_m2 = std::numeric_limits<double>::max();
  for (int i = 0; i < kMaxSamplesHeld; ++i) {
    const Stored& s = stored_[static_cast<std::size_t>(i)];
    const double d2 = s.used ? distance_m2(s, own.position_m, own.history, own.force_N)
                             : std::numeric_limits<double>::max();
    if (d2 < nearest_m2) {
      nearest_m2 = d2;
      nearest = i;
    }
  }
  int leaves = kNone;
  if (nearest != kNone && !settings().spacing.apart(nearest_m2)) {
    leaves = nearest;
  } else if (sample_count_ + 1 >= settings().samples) {
    if (nearest_pair_m2_ < 0.0) {
      find_nearest_pair();
    }
    if (nearest_m2 <= nearest_pair_m2_) {
      return;
    }
    leaves = nearest_pair_;
  }
  if (leaves != kNone) {
    stored_[static_cast<std::size_t>(leaves)].used = false;
    --sample_count_;
  }
  place(own);
  nearest_pair_m2_ = -1.0;
}

void MovedField::scale_earlier_contacts(std::uint64_t contact, const ContactScale& scale) noexcept {
  if (contact != scaled_since_) {
    scaled_since_ = contact;
    scaled_by_ = 1.0;
  }
  const double factor = scale.factor / scaled_by_;
  if (!(std::abs(scale.factor - 1.0) > kSureOfScale * scale.deviation) || factor == 1.0) {
    return;
  }
  scaled_by_ = scale.factor;
  for (Stored& s : stored_) {
    if (s.used && s.contact < contact) {
      s.force_N *= factor;
      s.first_force_N *= factor;
      s.stiffness_N_per_m *= factor;
    }
  }
}

void MovedField::find_nearest_pair() noexcept {
  nearest_pair_m2_ = std::numeric_limits<double>::max();
  for (int i = 0; i < kMaxSamplesHeld; ++i) {
    const Stored& a = stored_[static_cast<std::size_t>(i)];
    for (int j = a.used ? i + 1 : kMaxSamplesHeld; j < kMaxSamplesHeld; ++j) {
      const Stored& b = stored_[static_cast<std::size_t>(j)];
      const double d2 = b.used ? distance_m2(a, b.position_m, b.history, b.force_N)
                               : std::numeric_limits<double>::max();
      if (d2 < nearest_pair_m2_) {
        nearest_pair_m2_ = d2;
        nearest_pair_ = a.order < b.order ? i : j;
      }
    }
  }
}

bool MovedField::begin_with(std::span<const Observation> observations) noexcept {
  settle();
  open_ = false;
  next_terms_N_.setZero();
  terms_N_.fill(Terms::Zero());
  block_count_ = 0;
  blocks_due_ = 0;
  begin_factor();
  transient_ = kNone;
  if (!observations.empty()) {
    contact_ = observations.back().contact;
  }
  scale_ = 1.0;
  scale_variance_ = 0.0;
  close();
  for (int i = 0; i < kMaxSamplesHeld; ++i) {
    if (stored_[static_cast<std::size_t>(i)].used) {
      append_later(i, false);
      scale_variance_ = stored_[static_cast<std::size_t>(i)].contact == contact_
                            ? scale_variance_
                            : expected_scale_variance_;
    }
  }
  finish_if_read();
  return true;
}

Reading MovedField::read(const Vector3d& position_m, const History& history) const noexcept {
  Reading reading = Base::read(position_m - ahead_m_, history);
  reading.force_N *= strength_;
  return reading;
}

Matrix3d MovedField::stiffness_N_per_m(const Vector3d& position_m,
                                       const History& history) const noexcept {
  return strength_ * Base::stiffness_N_per_m(position_m - ahead_m_, history);
}

double MovedField::deviation_N(const Vector3d& position_m, const History& history) const noexcept {
  if (open_) {
    next_terms_N_ = motion_.terms(ahead_s_, Base::stiffness_N_per_m(position_m - ahead_m_, history),
                                  motion_.eta());
  }
  return strength_ * Base::deviation_N(position_m - ahead_m_, history);
}

}  // namespace forcegrid::kriging
