#include "simulator/touch/sticky_contact.h"

#include <cmath>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/solver/reduced_object.h"
#include "simulator/solver/two_rates_object.h"
#include "simulator/touch/time_stepped_object.h"

namespace forcegrid::simulator {

StickyContact::StickyContact(const SpringMesh& mesh, const ContactOptions& options)
    : options_(options), surface_(mesh) {
  check_positive(options.patch_radius_m, "contact: patch_radius_m");
  if (!(options.approach_distance_m >= 0.0) || !std::isfinite(options.approach_distance_m)) {
    throw Error("contact: approach_distance_m is " + std::to_string(options.approach_distance_m) +
                "; it must be finite and >= 0");
  }
  if (options.tool) {
    tree_.emplace(mesh.triangles, mesh.rest_position_W);
  }
}

std::optional<Eigen::Vector3d> StickyContact::expected_touch(const Eigen::Vector3d& position_W,
                                                             const Eigen::Vector3d& velocity_W,
                                                             double within_s) const noexcept {
  if (in_contact_ || must_leave_first_ || !position_W.allFinite() || !velocity_W.allFinite()) {
    return std::nullopt;
  }
  return surface_.first_hit(position_W, within_s * velocity_W);
}

bool StickyContact::at_surface(const Eigen::Vector3d& position_W) const noexcept {
  const RestSurface::Vertical vertical = surface_.look(position_W);
  const bool sinking = last_position_W_ && position_W.z() < last_position_W_->z();
  if (vertical.inside) {
    return true;
  }
  if (tree_) {
    const auto near = tree_->nearest(*options_.tool, position_W, options_.approach_distance_m);
    return near && (near->touch.gap_m <= 0.0 || sinking);
  }
  return sinking && vertical.below_m && *vertical.below_m <= options_.approach_distance_m;
}

template <typename Object>
StickyContact::Answer StickyContact::step(Object& object, const Eigen::Vector3d& position_W) {
  Answer answer;
  if (!position_W.allFinite()) {
    answer.in_contact = in_contact_;
    answer.epoch = epoch_;
    answer.point_W = in_contact_ || !last_position_W_ ? point_W_ : *last_position_W_;
    answer.equilibrium = object.move_to(position_W);
    answer.equilibrium.converged = false;
    answer.equilibrium.reached = false;
    if (!in_contact_) {
      answer.equilibrium.displacement_W.setZero();
    }
    answer.position_W = answer.point_W + answer.equilibrium.displacement_W;
    return answer;
  }
  if (!in_contact_) {
    const bool touching = at_surface(position_W);
    if (!last_position_W_ && touching) {
      must_leave_first_ = true;
    }
    if (!touching) {
      must_leave_first_ = false;
    } else if (!must_leave_first_ && object.grab(position_W, options_.patch_radius_m) > 0) {
      in_contact_ = true;
      point_W_ = position_W;
      ++epoch_;
    }
  }
  last_position_W_ = position_W;
  answer.in_contact = in_contact_;
  answer.point_W = in_contact_ ? point_W_ : position_W;
  answer.position_W = position_W;
  if (in_contact_) {
    answer.equilibrium = object.move_to(position_W - point_W_);
    if (answer.equilibrium.left_branch) {
      ++epoch_;
    }
    if (!answer.equilibrium.reached) {
      answer.position_W = point_W_ + answer.equilibrium.displacement_W;
    }
  } else {
    answer.equilibrium.converged = true;
  }
  answer.epoch = epoch_;
  return answer;
}

template <typename Object>
void StickyContact::release(Object& object) noexcept {
  if (in_contact_) {
    object.release();
    in_contact_ = false;
    must_leave_first_ = true;
    ++epoch_;
  }
}

template <typename Object>
void StickyContact::reset(Object& object) noexcept {
  object.release();
  in_contact_ = false;
  must_leave_first_ = false;
  last_position_W_.reset();
  point_W_.setZero();
  epoch_ = 0;
}

template StickyContact::Answer StickyContact::step(ReducedObject&, const Eigen::Vector3d&);
template void StickyContact::release(ReducedObject&) noexcept;
template void StickyContact::reset(ReducedObject&) noexcept;
template StickyContact::Answer StickyContact::step(TimeSteppedObject&, const Eigen::Vector3d&);
template StickyContact::Answer StickyContact::step(TwoRatesObject&, const Eigen::Vector3d&);
template void StickyContact::release(TwoRatesObject&) noexcept;
template void StickyContact::reset(TwoRatesObject&) noexcept;
template void StickyContact::release(TimeSteppedObject&) noexcept;
template void StickyContact::reset(TimeSteppedObject&) noexcept;
template StickyContact::Answer StickyContact::step(ElasticObject<float>&, const Eigen::Vector3d&);
template StickyContact::Answer StickyContact::step(ElasticObject<double>&, const Eigen::Vector3d&);
template void StickyContact::release(ElasticObject<float>&) noexcept;
template void StickyContact::release(ElasticObject<double>&) noexcept;
template void StickyContact::reset(ElasticObject<float>&) noexcept;
template void StickyContact::reset(ElasticObject<double>&) noexcept;

}  // namespace forcegrid::simulator
