// SPDX-License-Identifier: Apache-2.0
#include "simulator/predicted_contact.h"

namespace forcegrid::simulator {
namespace {

constexpr double kExpectedWithin_s = 0.3;
constexpr double kExpectedApart_m = 0.002;
constexpr double kPressedWithin_s = 1.0;

}  // namespace

PredictedContact::PredictedContact(const Scene& scene, const ToolOptions& tool)
    : slides_(tool.slides()), local_surface_(LocalSurface::make(scene.mesh, tool)) {
  if (slides_ && local_surface_) {
    contact_prediction_ = std::make_unique<ContactPredictionThread>(
        scene.mesh, *tool_shape(tool), PressOptions{.friction = tool.friction});
  }
}

void PredictedContact::look(const ToolContact& contact, const Eigen::Vector3d& position_W,
                            const Eigen::Vector3d& velocity_W) {
  look([&](double within_s) { return contact.expected_touch(position_W, velocity_W, within_s); },
       velocity_W);
}

void PredictedContact::look(const ExpectedTouch& expected_touch,
                            const Eigen::Vector3d& velocity_W) {
  const auto touch_W = expected_touch(kExpectedWithin_s);
  if (!touch_W) {
    expected_W_.reset();
    stiffness_W_N_per_m_.reset();
  } else if (!expected_W_ || (*touch_W - *expected_W_).norm() > kExpectedApart_m) {
    expected_W_ = touch_W;
    stiffness_W_N_per_m_.reset();
  }
  if (!contact_prediction_) {
    return;
  }
  later_touch_W_ = expected_touch(kPressedWithin_s);
  if (later_touch_W_) {
    contact_prediction_->expect(*later_touch_W_, velocity_W);
  }
}

void PredictedContact::begin_anew() noexcept {
  expected_W_.reset();
  stiffness_W_N_per_m_.reset();
  later_touch_W_.reset();
}

bool PredictedContact::wants_stiffness() const noexcept {
  return !slides_ && expected_W_ && !stiffness_W_N_per_m_;
}

void PredictedContact::learn_stiffness(
    const std::function<StickyContact::Answer(const QueryJob&)>& answer, std::uint32_t epoch) {
  QueryJob job;
  job.epoch = epoch;
  job.touching = true;
  job.point_W = *expected_W_;
  job.position_W = *expected_W_;
  const StickyContact::Answer touching = answer(job);
  stiffness_W_N_per_m_ = Eigen::Matrix3f::Zero();
  if (finite(touching.equilibrium) && touching.in_contact) {
    const Eigen::Matrix3d& k = touching.equilibrium.stiffness_W;
    stiffness_W_N_per_m_ = (0.5 * (k + k.transpose())).cast<float>();
  }
}

bool PredictedContact::cut(link::SurfacePatch& patch) {
  if (!local_surface_) {
    return false;
  }
  local_surface_->cut(expected_W_, patch);
  if (patch.triangle_count == 0) {
    return true;
  }
  if (stiffness_W_N_per_m_) {
    const Eigen::Matrix3f& k = *stiffness_W_N_per_m_;
    patch.has_stiffness = true;
    patch.stiffness_W_N_per_m = {k(0, 0), k(1, 1), k(2, 2), k(0, 1), k(0, 2), k(1, 2)};
  }
  if (const auto pressed =
          later_touch_W_ ? contact_prediction_->near(*later_touch_W_) : std::nullopt) {
    patch.has_press_forces = true;
    for (std::size_t k = 0; k < pressed->force_W.size(); ++k) {
      Eigen::Map<Eigen::Vector3f>(patch.press_forces_W_N[k].data()) =
          pressed->force_W[k].cast<float>();
    }
  }
  return true;
}

}  // namespace forcegrid::simulator
