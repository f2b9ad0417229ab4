// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/contact_prediction.h"

#include <sys/resource.h>

#include <algorithm>
#include <utility>

#include "rt/thread.h"

namespace forcegrid::simulator {
namespace {

constexpr double kNear_m = 1e-4;  // of a touch from the surface
constexpr int kNice = 15;         // so that answers come first

PressOptions roughly(PressOptions options) {
  options.relative_tolerance = std::max(options.relative_tolerance, ContactPrediction::kTolerance);
  options.max_step_m = std::min(options.max_step_m, ContactPrediction::kStep_m);
  return options;
}

}  // namespace

ContactPrediction::ContactPrediction(const SpringMesh& mesh, const contact::ToolShape& tool,
                                     PressOptions options)
    : surface_(mesh.triangles, mesh.rest_position_W), object_(mesh, tool, roughly(options)) {}

std::optional<Eigen::Vector3d> ContactPrediction::course_W(
    const Eigen::Vector3d& touch_W, const Eigen::Vector3d& velocity_W) const noexcept {
  const auto found = surface_.nearest(object_.tool(), touch_W, kNear_m);
  if (!found || !velocity_W.allFinite()) {
    return std::nullopt;
  }
  const Eigen::Vector3d& normal_W = found->touch.normal_W;
  const double inward_m_per_s = -normal_W.dot(velocity_W);
  const Eigen::Vector3d along_W_m_per_s = velocity_W + inward_m_per_s * normal_W;
  const double along_m_per_s = along_W_m_per_s.norm();
  const double inward_at_least_m_per_s = std::max(inward_m_per_s, along_m_per_s / kMaxSlope);
  if (!(inward_at_least_m_per_s > 0.0)) {
    return -normal_W;
  }
  return along_W_m_per_s / inward_at_least_m_per_s - normal_W;
}

std::optional<PressForces> ContactPrediction::press(const Eigen::Vector3d& touch_W,
                                                    const Eigen::Vector3d& velocity_W) noexcept {
  const auto course = course_W(touch_W, velocity_W);
  if (!course) {
    return std::nullopt;
  }
  PressForces result;
  result.touch_W = touch_W;
  result.course_W = *course;
  const auto found = surface_.nearest(object_.tool(), touch_W, kNear_m);
  object_.reset(touch_W);
  double push_before_N = 0.0;
  for (std::size_t k = 0; k < result.force_W.size(); ++k) {
    const double depth_m = static_cast<double>(k + 1) * link::SurfacePatch::kPressDepth_m;
    const Pressed pressed = object_.move_to(touch_W + depth_m * *course);
    const Equilibrium& there = pressed.equilibrium;
    const double push_N = found->touch.normal_W.dot(there.force_W);
    if (!there.converged || !there.reached || there.left_branch || !(push_N > push_before_N)) {
      return std::nullopt;
    }
    result.force_W[k] = there.force_W;
    push_before_N = push_N;
  }
  return result;
}

ContactPredictionThread::ContactPredictionThread(const SpringMesh& mesh,
                                                 const contact::ToolShape& tool,
                                                 const PressOptions& options)
    : press_(mesh, tool, options), thread_([this] { run(); }) {}

ContactPredictionThread::~ContactPredictionThread() {
  // A prediction in progress sets kOwner at its end, and would overwrite a kQuit set before that.
  turn_.wait(Turn::kPress);
  turn_ = Turn::kQuit;
  turn_.notify_all();
}

void ContactPredictionThread::take() noexcept {
  if (turn_ == Turn::kOwner && std::exchange(fresh_, false) && found_) {
    newest_ = found_;
  }
}

void ContactPredictionThread::expect(const Eigen::Vector3d& touch_W,
                                     const Eigen::Vector3d& velocity_W) noexcept {
  take();
  const auto course = press_.course_W(touch_W, velocity_W);
  if (turn_ != Turn::kOwner || !course ||
      (pressed_at_W_ && (touch_W - *pressed_at_W_).norm() <= kSamePlace_m &&
       (*course - pressed_course_W_).norm() <= kSameCourse)) {
    return;
  }
  pressed_at_W_ = touch_W_ = touch_W;
  pressed_course_W_ = *course;
  velocity_W_ = velocity_W;
  turn_ = Turn::kPress;
  turn_.notify_all();
}

std::optional<PressForces> ContactPredictionThread::near(const Eigen::Vector3d& touch_W) noexcept {
  take();
  return newest_ && (newest_->touch_W - touch_W).norm() <= kUsable_m ? newest_ : std::nullopt;
}

void ContactPredictionThread::run() noexcept {
  rt::name_current_thread("fg-prediction");
  // If this is refused, the thread still runs beside the answers and does not hold them up.
  static_cast<void>(::setpriority(PRIO_PROCESS, 0, kNice));
  for (;;) {
    turn_.wait(Turn::kOwner);
    if (turn_ == Turn::kQuit) {
      return;
    }
    found_ = press_.press(touch_W_, velocity_W_);
    fresh_ = true;
    turn_ = Turn::kOwner;
    turn_.notify_all();
  }
}

}  // namespace forcegrid::simulator
