// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_method.h"

#include <cmath>
#include <utility>

namespace forcegrid {
namespace {

using kriging::History;

constexpr double kScaleChanged = 1e-3;  // beyond it, what earlier contacts taught is out of date

}  // namespace

KrigingMethod::KrigingMethod(Kind kind, double least_uncertainty_N,
                             std::unique_ptr<kriging::Field> field,
                             std::unique_ptr<kriging::SampleStore> store) noexcept
    : kind_(kind),
      store_(std::move(store)),
      field_(std::move(field)),
      least_uncertainty_N_(least_uncertainty_N) {}

const char* KrigingMethod::name() const noexcept {
  switch (kind_) {
    case Kind::kForceOnly:
      return "kriging";
    case Kind::kTangent:
      return "kriging-tangent";
    case Kind::kUnilateralConstraint:
      return "kriging-hinge";
    case Kind::kStore:
      return "kriging-store";
    case Kind::kContact:
      return "kriging-contact";
  }
  return "invalid kind";
}

MethodNeeds KrigingMethod::needs() const noexcept {
  MethodNeeds needs;
  needs.stiffness = kind_ == Kind::kTangent;
  needs.requests_before_contact = kind_ == Kind::kContact;
  needs.can_request = true;
  return needs;
}

std::size_t KrigingMethod::memory_bytes() const noexcept {
  return sizeof(*this) + field_->memory_bytes() + (store_ != nullptr ? store_->memory_bytes() : 0);
}

void KrigingMethod::take_sample(const Sample& sample) noexcept {
  if (!queue_.accepts(sample, contact_, kind_ == Kind::kContact)) {
    return;
  }
  if (!contact_.has_origin()) {
    enter_contact(sample.position_W);
  }
  if (queue_.taken() - next_ >= kriging::SampleQueue::kLongestBacklog) {
    ++next_;
    ++passed_over_.value;
  }
  queue_.push(sample, contact_, motion_);
}

void KrigingMethod::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  if (motion_.observe(time_s, position_W)) {
    follower_.tool_moved(motion_);
  }
}

void KrigingMethod::contact_made(std::uint32_t /*epoch*/, const Eigen::Vector3d& point_W) noexcept {
  contact_.made(motion_.time_s());
  if (point_W.allFinite()) {
    enter_contact(point_W);
  }
  queue_.begin_contact();
  rendering_.begin_contact();
  requests_.begin_contact();
  update_uncertainty();
}

void KrigingMethod::contact_lost() noexcept { contact_.lost(); }

void KrigingMethod::expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept {
  if (kind_ == Kind::kContact && !contact_.in_contact() && std::isfinite(time_s) &&
      point_W.allFinite() && contact_.expect(time_s, point_W)) {
    enter_contact(point_W);
    requests_.begin_contact();
  }
}

void KrigingMethod::enter_contact(const Eigen::Vector3d& point_W) noexcept {
  contact_.set_origin(point_W);
  field_->enter_contact(contact_.number(), point_W);
}

int KrigingMethod::piece_units() const noexcept {
  const int rows = field_->row_count();
  return 1 + rows * rows / 2;
}

int KrigingMethod::take_next() noexcept {
  const std::uint64_t number = next_++;
  const kriging::Innovation innovation = field_->take(queue_.at(number).observation);
  ++fits_;
  if (innovation.surprised || std::abs(innovation.scale - 1.0) > kScaleChanged) {
    surprised_fit_ = fits_;
  }
  if (contact_.in_contact() && number >= queue_.first_of_contact()) {
    rendering_.contact_sampled();
  }
  if (next_ == queue_.taken()) {
    if (store_ != nullptr) {
      follower_.sample_taken();    // follow() updates the uncertainty
    } else if (field_->ready()) {  // else prepare() does
      update_uncertainty();
    }
  }
  return piece_units();
}

bool KrigingMethod::may_follow() const noexcept {
  return store_ != nullptr && follower_.due() && contact_.in_contact() && contact_.has_origin();
}

int KrigingMethod::follow() noexcept {
  const bool changed = follower_.step(*field_, tool_W(), contact_.origin_W(), motion_);
  fits_ += changed ? 1 : 0;
  if (!follower_.due()) {
    update_uncertainty();
  }
  return piece_units();
}

// A field that is not ready does not take the next sample: the budget is used up.
int KrigingMethod::prepare(int budget) noexcept {
  int done = 0;
  while (done < budget && !field_->ready()) {
    field_->prepare();
    done += piece_units();
    if (field_->ready()) {
      update_uncertainty();
    }
  }
  return done;
}

int KrigingMethod::work(int budget) noexcept {
  int done = prepare(budget);
  while (done < budget) {
    if (next_ < queue_.taken()) {
      done += take_next();
      done += prepare(budget - done);
    } else if (may_follow()) {
      done += follow();
    } else {
      break;
    }
  }
  return done;
}

double KrigingMethod::deviation_N(const Eigen::Vector3d& position_W) const noexcept {
  return field_->deviation_N(position_W - contact_.origin_W(), History::Zero());
}

void KrigingMethod::update_uncertainty() noexcept {
  if (contact_.has_origin() && field_->sample_count() > 0) {
    rendering_.uncertainty().update(
        tool_W(), motion_, [this](const Eigen::Vector3d& p_W) { return deviation_N(p_W); });
  }
}

bool KrigingMethod::plan_request(double time_s, const Eigen::Vector3d& position_W,
                                 Eigen::Vector3d& wanted_W) noexcept {
  if (!contact_.has_origin() || !std::isfinite(time_s) || !position_W.allFinite()) {
    return false;
  }
  if (contact_.in_contact()) {
    return requests_.plan(
        time_s, position_W, contact_.origin_W(), motion_,
        [this](const Eigen::Vector3d& p_W) { return deviation_N(p_W); }, wanted_W);
  }
  if (kind_ != Kind::kContact || !contact_.expects(time_s) || !field_->ready()) {
    return false;
  }
  return requests_.plan_before_contact(
      time_s, contact_.origin_W(),
      [this](const Eigen::Vector3d& d_m) { return field_->deviation_N(d_m, History::Zero()); },
      wanted_W);
}

ForceEstimate KrigingMethod::force(double time_s,
                                   const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  if (rendering_.answers_without_field(time_s, position_W, contact_, estimate) ||
      field_->sample_count() == 0) {
    return estimate;
  }
  rendering_.render(*field_, History::Zero(), position_W, contact_, Eigen::Vector3d::Zero(),
                    least_uncertainty_N_, estimate);
  return estimate;
}

}  // namespace forcegrid
