// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/direct_method.h"

#include <chrono>
#include <cmath>
#include <string>

#include "rt/percentiles.h"
#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

constexpr double kMeasuredSpeed_m_per_s = 0.2;
constexpr double kMeasuredReach_m = 0.008;
constexpr int kSettlingCycles = 40;  // until the stiffness of a new grip is right

}  // namespace

DirectMethod::DirectMethod(const SpringMesh& mesh, const DirectOptions& options)
    : options_(options), object_(mesh, options.solver), top_W_(mesh.top_W) {
  if (!(options.patch_radius_m > 0.0)) {
    throw Error("direct: patch_radius_m is " + std::to_string(options.patch_radius_m) +
                "; it must be > 0");
  }
  if (options_.grab_on_own_thread) {
    grabber_ = std::jthread([this] { run_grabs(); });
  }
}

DirectMethod::~DirectMethod() {
  if (grabber_.joinable()) {
    // A grab in progress sets kServo at its end, and would overwrite a value set before that.
    turn_.wait(Turn::kGrab);
    turn_ = Turn::kQuit;
    turn_.notify_all();
  }
}

std::size_t DirectMethod::memory_bytes() const noexcept {
  return sizeof *this - sizeof object_ + object_.memory_bytes();
}

void DirectMethod::take_sample(const Sample& /*sample*/) noexcept {}

void DirectMethod::grab() noexcept {
  object_.release();
  holds_ = false;
  if (wanted_point_W_.allFinite()) {
    try {
      holds_ = object_.grab(wanted_point_W_, options_.patch_radius_m) > 0;
    } catch (...) {
      // Out of memory: nothing is held, and the force's status says so.
      object_.release();
    }
  }
}

void DirectMethod::run_grabs() noexcept {
  for (;;) {
    turn_.wait(Turn::kServo);
    if (turn_ == Turn::kQuit) {
      return;
    }
    grab();
    turn_ = Turn::kServo;
    turn_.notify_all();
  }
}

void DirectMethod::start_grab() noexcept {
  wanted_point_W_ = point_W_;
  contact_ = Contact::kHeld;
  if (!options_.grab_on_own_thread) {
    grab();
    return;
  }
  turn_ = Turn::kGrab;
  turn_.notify_all();
}

void DirectMethod::contact_made(std::uint32_t /*epoch*/, const Eigen::Vector3d& point_W) noexcept {
  point_W_ = point_W;
  solved_ = false;
  contact_ = Contact::kWaiting;
  if (turn_ == Turn::kServo) {
    start_grab();
  }
}

void DirectMethod::contact_lost() noexcept {
  contact_ = Contact::kFree;
  solved_ = false;
}

void DirectMethod::observe(double /*time_s*/, const Eigen::Vector3d& position_W) noexcept {
  if (turn_ != Turn::kServo || !position_W.allFinite()) {
    return;
  }
  if (contact_ == Contact::kWaiting) {
    start_grab();  // the contact came while an older grab was still being solved
    if (turn_ != Turn::kServo) {
      return;
    }
  }
  if (contact_ == Contact::kHeld && holds_) {
    equilibrium_ = object_.move_to(position_W - point_W_);
    observed_W_ = point_W_ + equilibrium_.displacement_W;
    solved_ = true;
  }
}

int DirectMethod::work(int /*budget*/) noexcept { return 0; }

ForceEstimate DirectMethod::force(double /*time_s*/,
                                  const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  if (contact_ == Contact::kFree) {
    estimate.status = EstimateStatus::kOk;
    estimate.uncertainty_N = 0.0;
    return estimate;
  }
  if (!solved_) {
    return estimate;
  }
  const Eigen::Vector3d further_W = equilibrium_.stiffness_W * (position_W - observed_W_);
  const Eigen::Vector3d force_W = equilibrium_.force_W + further_W;
  if (!force_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
    return estimate;
  }
  estimate.force_W = force_W;
  estimate.status = EstimateStatus::kOk;
  estimate.uncertainty_N = equilibrium_.force_gap_N + further_W.norm();
  return estimate;
}

double DirectMethod::measured_cycle_s(double servo_period_s, int cycles) {
  object_.release();
  if (object_.grab(top_W_, options_.patch_radius_m) == 0) {
    throw Error("direct: no free vertex within " + std::to_string(options_.patch_radius_m) +
                " m of the object's top; use a larger grip");
  }
  rt::Percentiles time_us;
  for (int cycle = 1; cycle <= kSettlingCycles + cycles; ++cycle) {
    const double path_m = kMeasuredSpeed_m_per_s * servo_period_s * cycle;
    const double height_m = kMeasuredReach_m * 0.5 * (1.0 - std::cos(path_m / kMeasuredReach_m));
    const double time_s = object_.move_to({0.0, 0.5 * height_m, height_m}).solve_time_s;
    if (cycle > kSettlingCycles) {
      time_us.add(1e6 * time_s);
    }
  }
  object_.release();
  return 1e-6 * time_us.at(0.5);
}

}  // namespace forcegrid::simulator
