// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/elastic_object.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>

#include "rt/checkpoint.h"
#include "rt/rotation.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/energy_descent.h"
#include "simulator/solver/region_schedule.h"
#include "simulator/solver/state_with_sensitivities.h"
#include "simulator/solver/turning_sensitivities.h"

namespace forcegrid::simulator {
namespace {

constexpr int kMaxEvaluationsAStep = 16;
constexpr int kMaxHalvings = 4;
// A correction aims this much below the tolerance, since the linear residual isn't the true one,
// and no further than this fraction of the present residual, where the law's curvature takes over.
constexpr double kAimBelowTolerance = 0.5;
constexpr double kAimBelowResidual = 0.01;
// A residual that grows by more than this under a correction indicates an unstable state.
constexpr double kDivergence = 2.0;
// A correction that leaves more than this of the residual has stalled; so many stalls end the
// attempt.
constexpr double kStall = 0.7;
constexpr int kMaxStalls = 3;
// A step that is predicted well may be this many times max_step_m long.
constexpr double kLongStep = 3.0;
// Intermediate states need no smaller residual than this, relative to the force.
constexpr double kOnTheWay = 1e-2;
// Where the border has so many times its allowed work, the outside no longer follows S.
constexpr double kBorderLost = 100.0;

void check(const SolverOptions& options) {
  check_positive(options.relative_tolerance, "solver: relative_tolerance");
  check_positive(options.force_floor_N, "solver: force_floor_N");
  check_positive(options.max_step_m, "solver: max_step_m");
  check_positive(options.sensitivity_tolerance, "solver: sensitivity_tolerance");
  check_positive(options.max_steps, "solver: max_steps");
  check_positive(options.iterations_per_step, "solver: iterations_per_step");
  check_positive(options.max_iterations, "solver: max_iterations");
  check_positive(options.max_recovery_steps, "solver: max_recovery_steps");
  if (!(options.answer_first_below >= 0.0)) {
    throw Error("solver: answer_first_below is " + std::to_string(options.answer_first_below) +
                "; it must be >= 0");
  }
  if (!(options.long_step_residual >= 0.0)) {
    throw Error("solver: long_step_residual is " + std::to_string(options.long_step_residual) +
                "; it must be >= 0");
  }
  if (!(options.border_tolerance >= 0.0) || options.most_vertices < 0) {
    throw Error("solver: border_tolerance is " + std::to_string(options.border_tolerance) +
                " and most_vertices " + std::to_string(options.most_vertices) +
                "; both must be >= 0");
  }
  if (options.most_vertices > 0 && options.border_tolerance == 0.0) {
    throw Error("solver: most_vertices is " + std::to_string(options.most_vertices) +
                " but border_tolerance 0 asks for the whole object; give a border_tolerance > 0");
  }
}

enum class Outcome { kSettled, kOutOfIterations, kUnstable };

/// Where a tool is, since the grab.
struct Pose {
  Eigen::Vector3d displacement_W = Eigen::Vector3d::Zero();
  Eigen::Quaterniond turn_W = Eigen::Quaterniond::Identity();
};

}  // namespace

template <typename Real>
class ElasticObject<Real>::Implementation {
 public:
  Implementation(const SpringMesh& mesh, const SolverOptions& options)
      : options_((check(mesh), check(options), options)), state_(mesh) {
    correction_m_.resize(state_.vertex_count());
    release();
  }

  const SolverOptions& options() const noexcept { return options_; }
  void set_relative_tolerance(double relative_tolerance) {
    SolverOptions changed = options_;
    changed.relative_tolerance = relative_tolerance;
    check(changed);
    options_ = changed;
  }
  const StateWithSensitivities<Real>& state() const noexcept { return state_; }
  std::size_t memory_bytes() const noexcept {
    return sizeof *this - sizeof state_ + state_.memory_bytes() +
           correction_m_.capacity() * sizeof(Eigen::Vector3f) +
           mesh_patch_.capacity() * sizeof(std::int32_t) +
           (turning_ ? turning_->memory_bytes() : 0);
  }
  bool grabbed() const noexcept { return !mesh_patch_.empty(); }
  bool turns() const noexcept { return turning_ != nullptr; }
  const std::vector<std::int32_t>& patch() const noexcept { return mesh_patch_; }

  void turn(const SpringMesh& mesh) {
    if (options_.border_tolerance > 0.0) {
      throw Error(
          "elastic object: border_tolerance must be 0 for a tool that turns, because the whole "
          "object is solved; use the solver quasi_static");
    }
    turning_ = std::make_unique<TurningSensitivities<Real>>(mesh);
  }

  int grab(const Eigen::Vector3d& point_W, double radius_m) {
    if (grabbed()) {
      throw Error("elastic object: a patch is held already; call release() first");
    }
    std::vector<std::int32_t> patch;
    state_.visit_grabbable(point_W, radius_m, [&patch](std::int32_t i) { patch.push_back(i); });
    if (patch.empty()) {
      return 0;
    }
    state_.hold(std::move(patch), options_.border_tolerance > 0.0);
    for (const std::int32_t i : state_.patch()) {
      mesh_patch_.push_back(state_.mesh_number(static_cast<std::size_t>(i)));
    }
    solve_sensitivities();
    if (turning_) {
      turning_->hold(state_, point_W - state_.origin_W());
      find_torque(SolverOptions{}.max_iterations);
    }
    return static_cast<int>(mesh_patch_.size());
  }

  void release() noexcept {
    mesh_patch_.clear();
    state_.release();
    if (turning_) {
      turning_->release();
    }
    turn_W_ = saved_turn_W_ = Eigen::Quaterniond::Identity();
    has_turned_ = false;
    schedule_.reset();
    last_ = Equilibrium{};
    last_.converged = true;
  }

  Equilibrium move_to(const Pose& pose) noexcept {
    const Eigen::Vector3d& displacement_W = pose.displacement_W;
    const auto start = std::chrono::steady_clock::now();
    Equilibrium answer;
    if (!displacement_W.allFinite() || !pose.turn_W.coeffs().allFinite()) {
      clear_counts();
      answer = last_;
      answer.converged = answer.reached = false;
    } else if (!grabbed()) {
      answer.displacement_W = displacement_W;
      answer.converged = true;
    } else {
      follow(pose);
      answer = last_;
    }
    answer.solve_time_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return answer;
  }

  std::vector<std::int32_t> neighbourhood() const {
    std::vector<std::int32_t> vertices;
    const std::int32_t end = state_.region().reach_of(options_.most_vertices);
    for (std::int32_t i = 0; grabbed() && i < end; ++i) {
      vertices.push_back(state_.mesh_number(static_cast<std::size_t>(i)));
    }
    return vertices;
  }
  StateWithSensitivities<Real>& state() noexcept { return state_; }

  std::vector<Eigen::Vector3d> positions_W() const {
    std::vector<Eigen::Vector3d> positions;
    positions.resize(state_.vertex_count());
    for (std::size_t i = 0; i < positions.size(); ++i) {
      positions[static_cast<std::size_t>(state_.mesh_number(i))] =
          state_.origin_W() + state_.standing_position(i);
    }
    return positions;
  }
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const {
    position_W.resize(vertices.size());
    for (std::size_t n = 0; n < vertices.size(); ++n) {
      const std::size_t i = state_.own_number(static_cast<std::size_t>(vertices[n]));
      position_W[n] = state_.origin_W() + state_.standing_position(i);
    }
  }

 private:
  void clear_counts() noexcept {
    last_.steps = last_.evaluations = last_.iterations = last_.halvings = 0;
    last_.left_branch = false;
  }

  // The move in steps of at most max_step_m, or half as long where a step met an unstable state.
  void follow(const Pose& aim) noexcept {
    clear_counts();
    if (options_.border_tolerance > 0.0) {
      choose_region();
    }
    double step_limit_m = longest_step_m(way_m(aim));
    for (;;) {
      const double pieces = std::max(1.0, std::ceil(way_m(aim) / step_limit_m * (1.0 - 1e-12)));
      const Pose target = pieces > 1.0 ? part_of_the_way(aim, pieces) : aim;
      const double length_m = way_m(target);
      ++last_.steps;
      const bool is_last = pieces <= 1.0 || last_.steps >= options_.max_steps;
      advance_to(target);
      evaluate();
      if (step_limit_m > options_.max_step_m && length_m > options_.max_step_m &&
          !(last_.relative_residual <= options_.long_step_residual)) {
        restore();
        state_.forget_preconditioner();
        --last_.steps;
        step_limit_m = options_.max_step_m;
        continue;
      }
      const Outcome outcome = is_last ? settle() : relax();
      if (outcome == Outcome::kUnstable) {
        if (last_.halvings < kMaxHalvings && length_m > 0.0) {
          restore();
          ++last_.halvings;
          --last_.steps;
          step_limit_m = 0.5 * length_m;
          continue;
        }
        leave_branch();
        if (is_last) {
          evaluate();
          settle();
        }
      }
      if (is_last) {
        if (outcome == Outcome::kSettled) {
          grow();
        }
        last_.reached = pieces <= 1.0;
        break;
      }
    }
    last_.displacement_W = state_.displacement_W();
    last_.turn_W = turn_W_;
    if (turning_) {
      find_torque(options_.max_iterations);
    }
  }

  // [m] The farthest that a vertex of the patch has to go.
  double way_m(const Pose& aim) const noexcept {
    const double straight_m = (aim.displacement_W - state_.displacement_W()).norm();
    return turning_ ? straight_m +
                          rt::rotation_vector_rad(turn_W_, aim.turn_W).norm() * turning_->reach_m()
                    : straight_m;
  }

  Pose part_of_the_way(const Pose& aim, double pieces) const noexcept {
    Pose target;
    target.displacement_W =
        state_.displacement_W() + (aim.displacement_W - state_.displacement_W()) / pieces;
    target.turn_W = turning_ ? turn_W_.slerp(1.0 / pieces, aim.turn_W) : aim.turn_W;
    return target;
  }

  void advance_to(const Pose& target) noexcept {
    if (!turning_) {
      state_.advance_to(target.displacement_W);
      return;
    }
    const Eigen::Vector3d theta_W_rad = rt::rotation_vector_rad(turn_W_, target.turn_W);
    has_turned_ = has_turned_ || !theta_W_rad.isZero(0.0);
    saved_turn_W_ = turn_W_;
    turn_W_ = target.turn_W;
    if (has_turned_) {
      state_.set_patch_anchor(turning_->anchor(turn_W_));
    }
    state_.advance_to(target.displacement_W);
    if (has_turned_) {
      turning_->predict(theta_W_rad, state_);
    }
  }

  void restore() noexcept {
    state_.restore();
    turn_W_ = saved_turn_W_;
    if (has_turned_) {
      state_.set_patch_anchor(turning_->anchor(turn_W_));
    }
  }

  void find_torque(int max_iterations) noexcept {
    const auto found =
        turning_->solve(state_, found_, options_.sensitivity_tolerance, max_iterations);
    last_.torque_known = last_.rotational_stiffness_known = found.known;
    last_.torque_W_Nm = found.torque_W_Nm;
    last_.rotational_stiffness_W_Nm_per_rad = found.stiffness_W_Nm_per_rad;
    last_.torque_gradient_W_N = found.gradient_W_N;
    last_.iterations += found.iterations;
  }

  // Tries a move of a few steps in one step.
  double longest_step_m(double way_m) const noexcept {
    const double long_step_m = kLongStep * options_.max_step_m;
    return options_.long_step_residual > 0.0 && way_m <= long_step_m ? long_step_m
                                                                     : options_.max_step_m;
  }

  void change_region(int levels) noexcept {
    state_.change_region(levels);
    schedule_.region_changed();
  }

  double border_share() const noexcept {
    return last_.border_work_N / (options_.border_tolerance * force_scale_N_);
  }

  void choose_region() noexcept {
    const int levels =
        schedule_.next_levels(state_.region(), border_share(), options_.most_vertices);
    if (schedule_.region_is_new()) {
      state_.forget_trend();
    }
    if (levels != state_.region().solved()) {
      change_region(levels);
    }
  }

  // Solves with a larger region until the border's work is small enough.
  void grow() noexcept {
    if (options_.border_tolerance <= 0.0 || options_.answer_first_below > 0.0 ||
        state_.region().is_whole()) {
      return;
    }
    while (!state_.region().is_whole() && border_share() > 1.0) {
      const int levels = state_.region().limited(state_.region().larger(), options_.most_vertices);
      if (levels <= state_.region().solved()) {
        return;
      }
      change_region(levels);
      evaluate();
      if (settle() != Outcome::kSettled) {
        return;
      }
    }
    if (state_.region().is_whole()) {
      schedule_.became_whole();
    }
  }

  void evaluate() noexcept {
    found_ = state_.evaluate();
    last_.force_W = found_.force_W;
    last_.raw_force_W = found_.raw_force_W;
    last_.stiffness_W = found_.stiffness_W;
    last_.force_gap_N = (found_.force_W - found_.raw_force_W).norm();
    last_.border_work_N = found_.border_work_N;
    force_scale_N_ = std::max(found_.force_W.norm(), options_.force_floor_N);
    stiffness_scale_N_per_m_ = std::max(found_.stiffness_W.norm(), 1e-12);
    last_.relative_residual = found_.residual_N / force_scale_N_;
    last_.sensitivity_residual = found_.sensitivity_residual_N_per_m / stiffness_scale_N_per_m_;
    last_.converged = found_.finite() && last_.relative_residual <= options_.relative_tolerance;
    ++last_.evaluations;
    last_.vertices = state_.evaluated_vertices();
  }

  bool settled() const noexcept {
    return last_.converged && last_.sensitivity_residual <= options_.sensitivity_tolerance;
  }

  bool correct(int max_iterations, double residual_aim_N, double sensitivity_aim_N_per_m) noexcept {
    const Descent descent = state_.descend(max_iterations, residual_aim_N, sensitivity_aim_N_per_m);
    last_.iterations += descent.iterations;
    state_.absorb_correction();
    return !descent.unstable;
  }
  bool correct_to_tolerance(int max_iterations) noexcept {
    return correct(max_iterations,
                   std::max(kAimBelowTolerance * options_.relative_tolerance * force_scale_N_,
                            kAimBelowResidual * found_.residual_N),
                   kAimBelowTolerance * options_.sensitivity_tolerance * stiffness_scale_N_per_m_);
  }

  // A step on the way, after its evaluation: a bounded number of iterations.
  Outcome relax() noexcept {
    if (!found_.finite()) {
      return Outcome::kUnstable;
    }
    const double aim_N = kOnTheWay * force_scale_N_;
    const double sensitivity_aim_N_per_m =
        options_.sensitivity_tolerance * stiffness_scale_N_per_m_;
    const bool near_enough = found_.residual_N <= aim_N &&
                             found_.sensitivity_residual_N_per_m <= sensitivity_aim_N_per_m;
    return near_enough || correct(options_.iterations_per_step, aim_N, sensitivity_aim_N_per_m)
               ? Outcome::kSettled
               : Outcome::kUnstable;
  }

  // The answer is final; this corrects what the prediction left over, for the next move.
  Outcome correct_once() noexcept {
    return settled() || correct_to_tolerance(options_.max_iterations) ? Outcome::kSettled
                                                                      : Outcome::kUnstable;
  }

  // The last step, after its evaluation: corrections until the tolerances hold.
  Outcome settle() noexcept {
    if (!state_.region().is_whole() && options_.most_vertices == 0 &&
        border_share() > kBorderLost) {
      change_region(state_.region().levels());
      evaluate();
    }
    if (found_.finite() && last_.relative_residual <= options_.answer_first_below) {
      return correct_once();
    }
    int iterations_left = options_.max_iterations;
    int stalls = 0;
    for (int round = 0; round < kMaxEvaluationsAStep; ++round) {
      rt::note_progress();
      if (!found_.finite()) {
        return Outcome::kUnstable;
      }
      if (settled()) {
        return Outcome::kSettled;
      }
      if (iterations_left <= 0) {
        return Outcome::kOutOfIterations;
      }
      const double before_N = found_.residual_N;
      const bool was_converged = last_.converged;
      const int done_before = last_.iterations;
      const bool stable = correct_to_tolerance(iterations_left);
      iterations_left -= std::max(1, last_.iterations - done_before);
      if (!stable) {
        return Outcome::kUnstable;
      }
      evaluate();
      if (!was_converged && found_.residual_N > kDivergence * before_N) {
        return Outcome::kUnstable;
      }
      if (found_.residual_N > kStall * before_N && ++stalls >= kMaxStalls) {
        break;
      }
    }
    return last_.converged ? Outcome::kSettled : Outcome::kOutOfIterations;
  }

  void leave_branch() noexcept {
    last_.left_branch = true;
    change_region(state_.region().levels());
    const EnergyDescent spent =
        descend_in_energy(state_, options_.max_recovery_steps, options_.relative_tolerance,
                          options_.force_floor_N, correction_m_);
    last_.evaluations += spent.evaluations;
    last_.iterations += spent.iterations;
  }

  void solve_sensitivities() {
    Equilibrium kept = last_;
    evaluate();
    state_.invert_coarse();
    const SolverOptions asked = options_;
    if (options_.border_tolerance > 0.0) {
      // Outside the region nothing corrects S later.
      options_.max_iterations = std::max(options_.max_iterations, SolverOptions{}.max_iterations);
      options_.answer_first_below = 0.0;
    }
    settle();
    options_ = asked;
    kept.stiffness_W = last_.stiffness_W;
    kept.sensitivity_residual = last_.sensitivity_residual;
    last_ = kept;
  }

  SolverOptions options_;
  StateWithSensitivities<Real> state_;
  RegionSchedule schedule_;
  std::unique_ptr<TurningSensitivities<Real>> turning_;  // null: the tool does not turn
  Eigen::Quaterniond turn_W_ = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond saved_turn_W_ = Eigen::Quaterniond::Identity();
  bool has_turned_ = false;  // until then the patch stands where it was grabbed, to the last digit
  std::vector<std::int32_t> mesh_patch_;       // in the mesh's numbering
  std::vector<Eigen::Vector3f> correction_m_;  // for leave_branch()
  Evaluation found_;
  double force_scale_N_ = 1.0;
  double stiffness_scale_N_per_m_ = 1.0;
  Equilibrium last_;
};

template <typename Real>
ElasticObject<Real>::ElasticObject(const SpringMesh& mesh, const SolverOptions& options)
    : implementation_(std::make_unique<Implementation>(mesh, options)) {}
template <typename Real>
ElasticObject<Real>::~ElasticObject() = default;
template <typename Real>
ElasticObject<Real>::ElasticObject(ElasticObject&&) noexcept = default;
template <typename Real>
ElasticObject<Real>& ElasticObject<Real>::operator=(ElasticObject&&) noexcept = default;

template <typename Real>
std::size_t ElasticObject<Real>::vertex_count() const noexcept {
  return implementation_->state().vertex_count();
}
template <typename Real>
std::size_t ElasticObject<Real>::spring_count() const noexcept {
  return implementation_->state().spring_count();
}
template <typename Real>
std::size_t ElasticObject<Real>::memory_bytes() const noexcept {
  return sizeof *this + implementation_->memory_bytes();
}
template <typename Real>
const SolverOptions& ElasticObject<Real>::options() const noexcept {
  return implementation_->options();
}
template <typename Real>
void ElasticObject<Real>::set_relative_tolerance(double relative_tolerance) {
  implementation_->set_relative_tolerance(relative_tolerance);
}
template <typename Real>
int ElasticObject<Real>::count_grabbable(const Eigen::Vector3d& point_W,
                                         double radius_m) const noexcept {
  int count = 0;
  implementation_->state().visit_grabbable(point_W, radius_m, [&count](std::int32_t) { ++count; });
  return count;
}
template <typename Real>
int ElasticObject<Real>::grab(const Eigen::Vector3d& point_W, double radius_m) {
  return implementation_->grab(point_W, radius_m);
}
template <typename Real>
void ElasticObject<Real>::release() noexcept {
  implementation_->release();
}
template <typename Real>
bool ElasticObject<Real>::grabbed() const noexcept {
  return implementation_->grabbed();
}
template <typename Real>
void ElasticObject<Real>::turn(const SpringMesh& mesh) {
  implementation_->turn(mesh);
}
template <typename Real>
bool ElasticObject<Real>::turns() const noexcept {
  return implementation_->turns();
}
template <typename Real>
Equilibrium ElasticObject<Real>::move_to(const Eigen::Vector3d& displacement_W) noexcept {
  return implementation_->move_to({.displacement_W = displacement_W});
}
template <typename Real>
Equilibrium ElasticObject<Real>::move_to(const Eigen::Vector3d& displacement_W,
                                         const Eigen::Quaterniond& turn_W) noexcept {
  return implementation_->move_to({displacement_W, turn_W});
}
template <typename Real>
std::vector<std::int32_t> ElasticObject<Real>::neighbourhood() const {
  return implementation_->neighbourhood();
}
template <typename Real>
void ElasticObject<Real>::copy(const std::vector<std::int32_t>& vertices,
                               Neighbourhood& copy) const noexcept {
  const Implementation& implementation = *implementation_;
  implementation.state().copy(vertices, copy);
}
template <typename Real>
void ElasticObject<Real>::correct(const Neighbourhood& was, const Neighbourhood& is) noexcept {
  implementation_->state().correct(was, is);
}
template <typename Real>
std::vector<Eigen::Vector3d> ElasticObject<Real>::positions_W() const {
  return implementation_->positions_W();
}
template <typename Real>
void ElasticObject<Real>::copy_positions(const std::vector<std::int32_t>& vertices,
                                         std::vector<Eigen::Vector3d>& position_W) const {
  implementation_->copy_positions(vertices, position_W);
}
template <typename Real>
const std::vector<std::int32_t>& ElasticObject<Real>::patch() const noexcept {
  return implementation_->patch();
}
template <typename Real>
Eigen::Matrix3d ElasticObject<Real>::sensitivity(std::size_t vertex) const {
  const StateWithSensitivities<Real>& state = implementation_->state();
  return state.sensitivity(state.own_number(vertex));
}

template class ElasticObject<float>;
template class ElasticObject<double>;

}  // namespace forcegrid::simulator
