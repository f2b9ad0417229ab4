// SPDX-License-Identifier: Apache-2.0
#include "stability/scene_objects.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "evaluation/motions/variation.h"
#include "evaluation/objects/wall.h"
#include "stability/dynamic_object.h"

namespace forcegrid::stability {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kSlide_s = 3.0;

class SceneObject : public VirtualObject {
 public:
  explicit SceneObject(const BaseField& field)
      : base_(field.table, field.stiffness_N_per_m, field.contact_point_W),
        first_event_s_(field.first_event_s),
        second_event_s_(field.second_event_s) {}

  Value at(const Vector3d& position_W) const override { return base_.at(position_W); }
  Contact contact() const override { return base_.contact(); }
  double stiffness_N_per_m() const noexcept override { return base_.stiffness_N_per_m(); }

 protected:
  double first_event_s() const { return first_event_s_; }
  unsigned events_until(double time_s) const {
    return (time_s >= first_event_s_ ? 1U : 0U) + (time_s >= second_event_s_ ? 1U : 0U);
  }
  Vector3d displacement_W(const Vector3d& position_W) const {
    return position_W - base_.contact().point_W;
  }

 private:
  TableObject base_;
  double first_event_s_;
  double second_event_s_;
};

class Cut final : public SceneObject {
 public:
  Cut(const BaseField& field, bool announced) : SceneObject(field), announced_(announced) {}

  void advance(double time_s, const Vector3d& /*position_W*/) override {
    cuts_ = events_until(time_s);
  }
  Value at(const Vector3d& position_W) const override {
    static constexpr std::array kFactors{1.0, 0.6, 0.3};
    const Value whole = SceneObject::at(position_W);
    return {kFactors[cuts_] * whole.force_W, kFactors[cuts_] * whole.stiffness_W};
  }
  Contact contact() const override {
    Contact contact = SceneObject::contact();
    contact.epoch += announced_ ? cuts_ : 0U;
    return contact;
  }

 private:
  bool announced_;
  std::uint32_t cuts_ = 0;
};

class Slide final : public SceneObject {
 public:
  Slide(const BaseField& field, bool announced) : SceneObject(field), announced_(announced) {}

  void advance(double time_s, const Vector3d& /*position_W*/) override {
    slips_ = events_until(time_s);
    const double done =
        announced_ ? 0.5 * slips_ : std::clamp((time_s - first_event_s()) / kSlide_s, 0.0, 1.0);
    shift_W_ = done * Vector3d(0.008, -0.005, 0.0);
  }
  Value at(const Vector3d& position_W) const override {
    return SceneObject::at(position_W - shift_W_);
  }
  Contact contact() const override {
    Contact contact = SceneObject::contact();
    if (announced_) {
      contact.epoch += slips_;
      contact.point_W += shift_W_;
    }
    return contact;
  }

 private:
  bool announced_;
  std::uint32_t slips_ = 0;
  Vector3d shift_W_ = Vector3d::Zero();
};

class SecondContact final : public SceneObject {
 public:
  explicit SecondContact(const BaseField& field)
      : SceneObject(field),
        wall_{.normal_W = Vector3d::UnitX(), .surface_W_m = {0.002, 0.0, 0.0}} {}

  Value at(const Vector3d& position_W) const override {
    const Value soft = SceneObject::at(position_W);
    const evaluation::Wall::Value hard = wall_.at(displacement_W(position_W));
    return {soft.force_W + hard.force_W, soft.stiffness_W + hard.stiffness_W};
  }

 private:
  evaluation::Wall wall_;
};

class Tapping final : public SceneObject {
 public:
  explicit Tapping(const BaseField& field) : SceneObject(field) {}

  void advance(double /*time_s*/, const Vector3d& position_W) override {
    const bool touching = depth_m(position_W) > 0.0;
    if (touching && !contact_.in_contact) {
      ++contact_.epoch;
      contact_.point_W = position_W - depth_m(position_W) * Vector3d::UnitX();
    }
    contact_.in_contact = touching;
  }
  Value at(const Vector3d& position_W) const override {
    const double depth = depth_m(position_W);
    Value value{Vector3d::Zero(), Matrix3d::Zero()};
    if (depth > 0.0) {
      value.force_W.x() = -stiffness_N_per_m() * depth;
      value.stiffness_W(0, 0) = -stiffness_N_per_m();
    }
    return value;
  }
  Contact contact() const override { return contact_; }

 private:
  double depth_m(const Vector3d& position_W) const {
    return displacement_W(position_W).x() - 0.002;
  }
  Contact contact_{.in_contact = false, .epoch = 0};
};

class Touching final : public VirtualObject {
 public:
  explicit Touching(const BaseField& field)
      : table_(field.table),
        varied_(field.table, kSeed),
        stiffness_N_per_m_(field.stiffness_N_per_m),
        surface_z_m_(field.contact_point_W.z() + 0.002) {
    contact_.point_W = field.contact_point_W;
  }

  void advance(double /*time_s*/, const Vector3d& position_W) override {
    const bool touching = position_W.z() > surface_z_m_;
    if (touching != contact_.in_contact) {
      ++contact_.epoch;
    }
    if (touching && !contact_.in_contact) {
      contact_.point_W = position_W;
      contact_.point_W.z() = surface_z_m_;
    }
    contact_.in_contact = touching;
  }
  Value at(const Vector3d& position_W) const override {
    return contact_.in_contact ? touched_at(contact_.point_W, position_W)
                               : Value{Vector3d::Zero(), Matrix3d::Zero()};
  }
  Value touched_at(const Vector3d& point_W, const Vector3d& position_W) const override {
    const Matrix3d turn =
        Eigen::AngleAxisd(varied_.turn_rad(point_W), Vector3d::UnitZ()).toRotationMatrix();
    const double factor = stiffness_N_per_m_ / TableObject::normal_stiffness_N_per_m(table_) *
                          varied_.stiffness_factor(point_W);
    const Value value = table_.at(table_.clamped(turn.transpose() * (position_W - point_W)));
    return {factor * turn * value.force_W, factor * turn * value.stiffness_W * turn.transpose()};
  }
  std::optional<Vector3d> expected_touch_W(const Vector3d& position_W, const Vector3d& velocity_W,
                                           double within_s) const override {
    const double gap_m = surface_z_m_ - position_W.z();
    if (gap_m < 0.0 || !(velocity_W.z() > 0.0) || gap_m > velocity_W.z() * within_s) {
      return std::nullopt;
    }
    return Vector3d(position_W + gap_m / velocity_W.z() * velocity_W);
  }
  Contact contact() const override { return contact_; }
  double stiffness_N_per_m() const noexcept override { return stiffness_N_per_m_; }

 private:
  static constexpr std::uint64_t kSeed = 1;
  const evaluation::ForceTable& table_;
  evaluation::VariedObject varied_;
  double stiffness_N_per_m_;
  double surface_z_m_;
  Contact contact_{.in_contact = false, .epoch = 0};
};

// Fraction of its way that a first-order lag covers in a given time.
double lag(double duration_s, double time_constant_s) {
  return -std::expm1(-duration_s / time_constant_s);
}

class Viscous final : public SceneObject {
 public:
  explicit Viscous(const BaseField& field)
      : SceneObject(field), follower_W_(field.contact_point_W) {}

  void advance(double time_s, const Vector3d& position_W) override {
    follower_W_ += lag(time_s - last_s_, kTime_s) * (position_W - follower_W_);
    last_s_ = time_s;
  }
  Value at(const Vector3d& position_W) const override {
    Value value = SceneObject::at(position_W);
    value.force_W -= kSpring_N_per_m * (position_W - follower_W_);
    value.stiffness_W -= kSpring_N_per_m * Matrix3d::Identity();
    return value;
  }

 private:
  static constexpr double kTime_s = 0.005;
  static constexpr double kSpring_N_per_m = 3.0 / kTime_s;
  Vector3d follower_W_;
  double last_s_ = 0.0;
};

class KelvinVoigt final : public SceneObject {
 public:
  KelvinVoigt(const BaseField& field, double damping_time_s)
      : SceneObject(field), gain_(damping_time_s / kTime_s) {}

  void advance(double time_s, const Vector3d& position_W) override {
    follower_W_N_ +=
        lag(time_s - last_s_, kTime_s) * (SceneObject::at(position_W).force_W - follower_W_N_);
    last_s_ = time_s;
  }
  Value at(const Vector3d& position_W) const override {
    Value value = SceneObject::at(position_W);
    value.force_W += gain_ * (value.force_W - follower_W_N_);
    value.stiffness_W *= 1.0 + gain_;
    return value;
  }

 private:
  static constexpr double kTime_s = 0.005;
  double gain_;
  Vector3d follower_W_N_ = Vector3d::Zero();
  double last_s_ = 0.0;
};

class Relaxation final : public SceneObject {
 public:
  explicit Relaxation(const BaseField& field) : SceneObject(field) {}

  void advance(double time_s, const Vector3d& position_W) override {
    const Vector3d elastic_W = SceneObject::at(position_W).force_W;
    for (Part& part : parts_) {
      part.relaxed_W += lag(time_s - last_s_, part.time_s) * (elastic_W - part.relaxed_W);
    }
    last_s_ = time_s;
  }
  Value at(const Vector3d& position_W) const override {
    Value value = SceneObject::at(position_W);
    for (const Part& part : parts_) {
      value.force_W -= part.weight * part.relaxed_W;
    }
    return value;
  }

 private:
  struct Part {
    double weight;
    double time_s;
    Vector3d relaxed_W = Vector3d::Zero();  // [N] low-passed elastic force
  };
  std::array<Part, 2> parts_{Part{0.25, 0.08}, Part{0.15, 0.8}};
  double last_s_ = 0.0;
};

class Hysteresis final : public SceneObject {
 public:
  explicit Hysteresis(const BaseField& field)
      : SceneObject(field), slider_W_(field.contact_point_W) {}

  void advance(double /*time_s*/, const Vector3d& position_W) override {
    slider_W_ = dragged_W(position_W);
  }
  Value at(const Vector3d& position_W) const override {
    Value value = SceneObject::at(position_W);
    value.force_W -= 0.5 * stiffness_N_per_m() * (position_W - dragged_W(position_W));
    if ((position_W - slider_W_).norm() <= kYield_m) {
      value.stiffness_W -= 0.5 * stiffness_N_per_m() * Matrix3d::Identity();
    }
    return value;
  }

 private:
  static constexpr double kYield_m = 0.001;
  Vector3d dragged_W(const Vector3d& position_W) const {
    const Vector3d stretch_W = position_W - slider_W_;
    const double length_m = stretch_W.norm();
    return length_m > kYield_m ? Vector3d(position_W - kYield_m / length_m * stretch_W) : slider_W_;
  }
  Vector3d slider_W_;
};

class SnapThrough final : public SceneObject {
 public:
  explicit SnapThrough(const BaseField& field) : SceneObject(field) {}

  void advance(double /*time_s*/, const Vector3d& position_W) override {
    const double x_m = displacement_W(position_W).x();
    snapped_ = snapped_ ? x_m > 0.001 : x_m > 0.002;
  }
  Value at(const Vector3d& position_W) const override {
    return SceneObject::at(position_W - (snapped_ ? 0.001 : 0.0) * Vector3d::UnitX());
  }

 private:
  bool snapped_ = false;
};

}  // namespace

std::unique_ptr<VirtualObject> make_cut(const BaseField& field, bool announced) {
  return std::make_unique<Cut>(field, announced);
}
std::unique_ptr<VirtualObject> make_slide(const BaseField& field, bool announced) {
  return std::make_unique<Slide>(field, announced);
}
std::unique_ptr<VirtualObject> make_second_contact(const BaseField& field) {
  return std::make_unique<SecondContact>(field);
}
std::unique_ptr<VirtualObject> make_tapping(const BaseField& field) {
  return std::make_unique<Tapping>(field);
}
std::unique_ptr<VirtualObject> make_touching(const BaseField& field) {
  return std::make_unique<Touching>(field);
}
std::unique_ptr<VirtualObject> make_viscous(const BaseField& field) {
  return std::make_unique<Viscous>(field);
}
std::unique_ptr<VirtualObject> make_kelvin_voigt(const BaseField& field, double damping_time_s) {
  return std::make_unique<KelvinVoigt>(field, damping_time_s);
}
std::unique_ptr<VirtualObject> make_dynamic(const BaseField& field, double damping_time_s) {
  return std::make_unique<DynamicObject>(field.stiffness_N_per_m, field.contact_point_W,
                                         damping_time_s);
}
std::unique_ptr<VirtualObject> make_relaxation(const BaseField& field) {
  return std::make_unique<Relaxation>(field);
}
std::unique_ptr<VirtualObject> make_hysteresis(const BaseField& field) {
  return std::make_unique<Hysteresis>(field);
}
std::unique_ptr<VirtualObject> make_snap_through(const BaseField& field) {
  return std::make_unique<SnapThrough>(field);
}

}  // namespace forcegrid::stability
