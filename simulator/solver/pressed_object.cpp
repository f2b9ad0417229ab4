// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/pressed_object.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/solver/contact_points.h"
#include "simulator/solver/pressed_springs.h"
#include "simulator/solver/pressed_turning.h"

namespace forcegrid::simulator {
namespace {

constexpr double kSpacingOverRadius = 0.25;
constexpr double kMaxFriction = 2.0;
constexpr int kPressedMaxHalvings = 3;
// The contact forces are substituted once the springs' residual is at most this share of what they
// change.
constexpr double kStillEnough = 0.5;
constexpr double kPressedAimBelowTolerance = 0.5;
constexpr double kPressedAimBelowResidual = 0.05;
constexpr double kLeastGain = 0.3;  // however small the residual is: the force gap may not be
constexpr double kSensitivityTolerance = 0.05;
// The stiffness that F is divided by is at least |F| over this.
constexpr double kDeepPush_m = 0.01;
constexpr int kMaxSensitivityRounds = 4;
constexpr int kMaxShortenings = 5;
constexpr double kShortening = 0.3;
constexpr double kMostGrowth = 1.5;

double smallest_radius_m(const contact::ToolShape& tool) {
  double smallest_m = contact::ToolShape::kMaxRadius_m;
  for (const contact::Capsule& part : tool.parts()) {
    smallest_m = std::min(smallest_m, part.radius_m);
  }
  return smallest_m;
}

PressOptions checked(PressOptions options, const contact::ToolShape& tool) {
  if (!(options.friction >= 0.0 && options.friction <= kMaxFriction)) {
    throw Error("pressing: friction is " + std::to_string(options.friction) + "; give 0 to " +
                std::to_string(kMaxFriction));
  }
  const double radius_m = smallest_radius_m(tool);
  if (options.point_spacing_m == 0.0) {
    options.point_spacing_m = kSpacingOverRadius * radius_m;
  }
  check_positive(options.point_spacing_m, "pressing: point_spacing_m");
  check_positive(options.stick_m, "pressing: stick_m");
  check_positive(options.relative_tolerance, "pressing: relative_tolerance");
  check_positive(options.force_floor_N, "pressing: force_floor_N");
  check_positive(options.max_step_m, "pressing: max_step_m");
  check_positive(options.max_steps, "pressing: max_steps");
  check_positive(options.max_rounds, "pressing: max_rounds");
  check_positive(options.max_iterations, "pressing: max_iterations");
  options.max_step_m = std::min(options.max_step_m, 0.5 * radius_m);
  return options;
}

const SpringMesh& with_surface(const SpringMesh& mesh) {
  check(mesh);
  if (mesh.triangles.empty()) {
    throw Error("pressing: the object has no surface; give it triangles");
  }
  return mesh;
}

}  // namespace

class PressedObject::Implementation {
 public:
  Implementation(const SpringMesh& mesh, const contact::ToolShape& tool,
                 const PressOptions& options)
      : tool_(tool),
        options_(checked(options, tool)),
        origin_W_(with_surface(mesh).top_W),
        springs_(mesh),
        contacts_(mesh, springs_, options_.point_spacing_m,
                  {.friction = options_.friction, .stick_m = options_.stick_m}) {
    springs_.reserve(contacts_.point_count());
    if (options_.rotational_stiffness) {
      turning_.emplace(mesh);
      turning_->reserve(contacts_.point_count());
    }
  }

  contact::ToolShape& tool() noexcept { return tool_; }
  const contact::ToolShape& tool() const noexcept { return tool_; }
  const PressedSprings& springs() const noexcept { return springs_; }

  void reset(const Eigen::Vector3d& position_W) noexcept {
    springs_.rest();
    contacts_.clear();
    contacts_.follow(springs_);
    if (turning_) {
      turning_->rest();
    }
    place_ = position_W - origin_W_;
    last_ = Pressed{};
    last_.equilibrium.converged = true;
    started_ = true;
    last_.position_W = last_.centre_W = position_W;
  }

  double gap_m(const Eigen::Vector3d& position_W, double margin_m) const noexcept {
    return contacts_.gap_m(tool_, position_W - origin_W_, margin_m);
  }

  Pressed move_to(const Eigen::Vector3d& position_W,
                  const Eigen::Quaterniond& orientation_WT) noexcept {
    const auto start = std::chrono::steady_clock::now();
    Equilibrium& result = last_.equilibrium;
    result.steps = result.evaluations = result.iterations = result.halvings = 0;
    result.left_branch = false;
    result.reached = position_W.allFinite() && orientation_WT.coeffs().allFinite();
    result.converged = result.converged && result.reached;
    if (result.reached) {
      if (!started_) {
        tool_.set_orientation(orientation_WT);
        reset(position_W);
      }
      walk_to(position_W - origin_W_, orientation_WT);
      find_rotational_stiffness();
    }
    last_.position_W = place_ + origin_W_;
    last_.orientation_WT = tool_.orientation_WT();
    result.solve_time_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return last_;
  }

  int grasp() noexcept { return contacts_.grasp(tool_, place_); }
  void let_go() noexcept { contacts_.let_go(); }

  std::vector<Eigen::Vector3d> positions_W() const {
    std::vector<Eigen::Vector3d> result;
    result.reserve(springs_.vertex_count());
    for (std::size_t i = 0; i < springs_.vertex_count(); ++i) {
      result.push_back(origin_W_ + springs_.position(i));
    }
    return result;
  }
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const {
    position_W.resize(vertices.size());
    for (std::size_t n = 0; n < vertices.size(); ++n) {
      position_W[n] = origin_W_ + springs_.position(static_cast<std::size_t>(vertices[n]));
    }
  }

 private:
  enum class Outcome { kSettled, kOutOfRounds, kUnstable };

  // Moves in steps short enough that no point can come out on the tool's other side. Without
  // contact a step may be as wide as the gap.
  void walk_to(const Eigen::Vector3d& target, const Eigen::Quaterniond& aim_WT) noexcept {
    Equilibrium& result = last_.equilibrium;
    double step_limit_m = options_.max_step_m;
    for (;;) {
      const Eigen::Vector3d left = target - place_;
      const double left_m =
          left.norm() + tool_.reach_m() * tool_.orientation_WT().angularDistance(aim_WT);
      double step_m = step_limit_m;
      if (!contacts_.any()) {
        step_m = std::max(step_m, contacts_.gap_m(tool_, place_, left_m + options_.max_step_m));
      }
      const bool last = left_m <= step_m * (1.0 + 1e-9);
      const double parts = std::ceil(left_m / step_m * (1.0 - 1e-9));
      const Eigen::Vector3d next = last ? target : Eigen::Vector3d(place_ + left / parts);
      const Eigen::Vector3d from = place_;
      const Eigen::Quaterniond from_WT = tool_.orientation_WT();
      const Eigen::Quaterniond next_WT = last ? aim_WT : from_WT.slerp(1.0 / parts, aim_WT);
      const Outcome outcome = step_to(next, next_WT, last);
      if (outcome == Outcome::kUnstable) {
        springs_.restore();
        contacts_.restore();
        place_ = from;
        tool_.set_orientation(from_WT);
        if (result.halvings >= kPressedMaxHalvings) {
          give_up();
          return;
        }
        ++result.halvings;
        step_limit_m *= 0.5;
        continue;
      }
      result.steps += contacts_.any() ? 1 : 0;
      if (last) {
        return;
      }
      if (result.steps >= options_.max_steps) {
        result.reached = false;
        return;
      }
    }
  }

  // The equilibrium can't be followed any more: starts again with the object at rest and the tool
  // where it is.
  void give_up() noexcept {
    const Equilibrium counts = last_.equilibrium;
    reset(place_ + origin_W_);
    last_.equilibrium = {};
    last_.equilibrium.evaluations = counts.evaluations;
    last_.equilibrium.iterations = counts.iterations;
    last_.equilibrium.halvings = counts.halvings;
    last_.equilibrium.left_branch = true;
    last_.equilibrium.reached = false;
  }

  Outcome step_to(const Eigen::Vector3d& next, const Eigen::Quaterniond& next_WT,
                  bool last) noexcept {
    const Eigen::Vector3d step = next - place_;
    contacts_.begin_step(springs_, tool_, place_);
    springs_.predict(step);
    place_ = next;
    tool_.set_orientation(next_WT);
    contacts_.find(tool_, place_, springs_);
    if (!contacts_.any() && springs_.at_rest()) {
      describe_rest();
      return Outcome::kSettled;
    }
    if (contacts_.free_at_rest(tool_, place_)) {
      come_to_rest();
      return Outcome::kSettled;
    }
    const Outcome outcome = settle(last);
    if (outcome == Outcome::kUnstable) {
      return outcome;
    }
    contacts_.accept(springs_);
    if (!contacts_.any()) {
      come_to_rest();
    }
    return outcome;
  }

  void find_rotational_stiffness() noexcept {
    Equilibrium& result = last_.equilibrium;
    result.rotational_stiffness_known = false;
    result.rotational_stiffness_W_Nm_per_rad.setZero();
    result.torque_gradient_W_N.setZero();
    if (!turning_ || !contacts_.any() || !result.converged || !last_.stiffness_known) {
      return;
    }
    const PressedTurning::Found found = turning_->solve(
        springs_, contacts_.active(), place_, result.stiffness_W.norm(), options_.max_iterations);
    result.iterations += found.iterations;
    result.rotational_stiffness_known = found.known;
    if (found.known) {
      result.rotational_stiffness_W_Nm_per_rad = found.stiffness_W_Nm_per_rad;
      result.torque_gradient_W_N = found.gradient_W_N;
    }
  }

  void come_to_rest() noexcept {
    springs_.rest();
    contacts_.clear();
    contacts_.follow(springs_);
    describe_rest();
  }

  void evaluate() noexcept {
    contacts_.find(tool_, place_, springs_);
    springs_.evaluate(contacts_.active(), convex_);
    ++last_.equilibrium.evaluations;
    describe();
  }

  Outcome settle(bool last) noexcept {
    Equilibrium& result = last_.equilibrium;
    convex_ = false;
    evaluate();
    int iterations_left = options_.max_iterations;
    int sensitivity_rounds = 0;
    for (int round = 0; round < options_.max_rounds; ++round) {
      if (!finite()) {
        return Outcome::kUnstable;
      }
      const bool known = result.sensitivity_residual <= kSensitivityTolerance;
      const bool for_sensitivity = result.converged;
      if (result.converged && (!last || known || sensitivity_rounds++ >= kMaxSensitivityRounds)) {
        return Outcome::kSettled;
      }
      if (iterations_left <= 0) {
        return Outcome::kOutOfRounds;
      }
      const double target_N = options_.relative_tolerance * force_scale_N();
      const double still_N =
          std::max(kPressedAimBelowTolerance * target_N, kStillEnough * unsettled_N_);
      if (for_sensitivity || (unsettled_N_ > kPressedAimBelowTolerance * target_N &&
                              springs_.residual_N() <= still_N)) {
        contacts_.substitute(springs_);
        evaluate();
      }
      if (!correct(target_N, for_sensitivity, iterations_left)) {
        return Outcome::kUnstable;
      }
    }
    return result.converged ? Outcome::kSettled : Outcome::kOutOfRounds;
  }

  // One Newton step, shortened while it makes the residual larger.
  // @returns false if the state is unstable even with the convex matrix.
  bool correct(double target_N, bool for_sensitivity, int& iterations_left) noexcept {
    Equilibrium& result = last_.equilibrium;
    const double before_N = springs_.residual_N();
    const double aim_N = std::min(
        std::max(kPressedAimBelowTolerance * target_N, kPressedAimBelowResidual * before_N),
        kLeastGain * before_N);
    const double sensitivity_aim_N_per_m =
        for_sensitivity ? 0.3 * kSensitivityTolerance * result.stiffness_W.norm()
                        : std::numeric_limits<double>::infinity();
    const PressedSprings::Descent descent =
        springs_.descend(iterations_left, aim_N, sensitivity_aim_N_per_m);
    result.iterations += descent.iterations;
    iterations_left -= std::max(1, descent.iterations);
    if (descent.unstable) {
      const bool was_convex = convex_;
      convex_ = true;
      evaluate();
      return !was_convex;
    }
    evaluate();
    for (int trial = 0; trial < kMaxShortenings &&
                        !(springs_.residual_N() <= std::max(target_N, kMostGrowth * before_N));
         ++trial) {
      springs_.shorten(kShortening);
      evaluate();
    }
    return true;
  }

  bool finite() const noexcept {
    return springs_.finite() && last_.equilibrium.force_W.allFinite() &&
           last_.equilibrium.stiffness_W.allFinite();
  }

  double force_scale_N() const noexcept {
    return std::max(last_.equilibrium.force_W.norm(), options_.force_floor_N);
  }

  void describe() noexcept {
    Equilibrium& result = last_.equilibrium;
    const ContactPoints::Sums sums = contacts_.sums(springs_, place_);
    last_.points = sums.points;
    last_.slipping = sums.slipping;
    last_.held = sums.held;
    last_.normal_N = sums.normal_N;
    last_.friction_W = -sums.friction_W;
    last_.deepest_m = sums.deepest_m;
    last_.centre_W = sums.points > 0 ? Eigen::Vector3d(sums.centre + origin_W_)
                                     : Eigen::Vector3d(place_ + origin_W_);
    last_.stiffness_known = sums.slipping == 0 || options_.friction == 0.0;
    result.force_W = result.raw_force_W = -sums.force_W;
    result.stiffness_W = sums.stiffness_W;
    result.torque_known = true;
    result.torque_W_Nm = -sums.torque_W_Nm;
    result.force_gap_N = springs_.force_gap_N();
    unsettled_N_ = contacts_.unsettled().place_m *
                       std::max(result.stiffness_W.norm(), result.force_W.norm() / kDeepPush_m) +
                   contacts_.unsettled().friction_N;
    result.relative_residual =
        std::max({springs_.residual_N(), result.force_gap_N, unsettled_N_}) / force_scale_N();
    result.sensitivity_residual = std::max(
        springs_.sensitivity_residual_N_per_m() / std::max(result.stiffness_W.norm(), 1e-12),
        contacts_.pull_unsettled(springs_));
    result.converged = std::isfinite(result.relative_residual) &&
                       result.relative_residual <= options_.relative_tolerance;
  }

  void describe_rest() noexcept {
    const Equilibrium counts = last_.equilibrium;
    last_ = Pressed{};
    last_.centre_W = place_ + origin_W_;
    last_.equilibrium.steps = counts.steps;
    last_.equilibrium.evaluations = counts.evaluations;
    last_.equilibrium.iterations = counts.iterations;
    last_.equilibrium.halvings = counts.halvings;
    last_.equilibrium.left_branch = counts.left_branch;
    last_.equilibrium.converged = true;
    last_.equilibrium.torque_known = true;
  }

  contact::ToolShape tool_;
  PressOptions options_;
  Eigen::Vector3d origin_W_;
  PressedSprings springs_;
  ContactPoints contacts_;
  std::optional<PressedTurning> turning_;            // with PressOptions::rotational_stiffness
  Eigen::Vector3d place_ = Eigen::Vector3d::Zero();  // of the tool, from origin_W_
  bool started_ = false;
  double unsettled_N_ = 0.0;  // by how much contact forces that still change may put F wrong
  bool convex_ = false;       // the matrix of this step is made positive definite
  Pressed last_;
};

PressedObject::PressedObject(const SpringMesh& mesh, const contact::ToolShape& tool,
                             const PressOptions& options)
    : implementation_(std::make_unique<Implementation>(mesh, tool, options)) {}
PressedObject::~PressedObject() = default;
PressedObject::PressedObject(PressedObject&&) noexcept = default;
PressedObject& PressedObject::operator=(PressedObject&&) noexcept = default;

std::size_t PressedObject::vertex_count() const noexcept {
  return implementation_->springs().vertex_count();
}
std::size_t PressedObject::spring_count() const noexcept {
  return implementation_->springs().spring_count();
}
const contact::ToolShape& PressedObject::tool() const noexcept { return implementation_->tool(); }
void PressedObject::reset(const Eigen::Vector3d& position_W) noexcept {
  implementation_->reset(position_W);
}
double PressedObject::gap_m(const Eigen::Vector3d& position_W, double margin_m) const noexcept {
  return implementation_->gap_m(position_W, margin_m);
}
void PressedObject::reset(const Eigen::Vector3d& position_W,
                          const Eigen::Quaterniond& orientation_WT) noexcept {
  implementation_->tool().set_orientation(orientation_WT);
  implementation_->reset(position_W);
}
Pressed PressedObject::move_to(const Eigen::Vector3d& position_W) noexcept {
  return implementation_->move_to(position_W, implementation_->tool().orientation_WT());
}
Pressed PressedObject::move_to(const Eigen::Vector3d& position_W,
                               const Eigen::Quaterniond& orientation_WT) noexcept {
  return implementation_->move_to(position_W, orientation_WT);
}
int PressedObject::grasp() noexcept { return implementation_->grasp(); }
void PressedObject::let_go() noexcept { implementation_->let_go(); }
std::vector<Eigen::Vector3d> PressedObject::positions_W() const {
  return implementation_->positions_W();
}
void PressedObject::copy_positions(const std::vector<std::int32_t>& vertices,
                                   std::vector<Eigen::Vector3d>& position_W) const {
  implementation_->copy_positions(vertices, position_W);
}

}  // namespace forcegrid::simulator
