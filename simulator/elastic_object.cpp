#include "simulator/elastic_object.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <numeric>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

#include "simulator/coarse_correction.h"
#include "simulator/error.h"
#include "simulator/region.h"
#include "simulator/spring_kernels.h"
#include "simulator/spring_table.h"

namespace forcegrid::simulator {
namespace {

using kernels::BlockInverse;
using kernels::Float4;
using kernels::Lanes;
using kernels::Precise;

constexpr int kMaxEvaluationsAStep = 16;
constexpr int kMaxHalvings = 4;
constexpr int kRecoveryIterations = 40;
constexpr int kMaxLineSearchTrials = 12;
constexpr double kLargestRecoveryMove_m = 1e-3;
// A correction aims this much below the tolerance, since the linear residual isn't the true one,
// and no further than this fraction of the present residual, where the law's curvature takes over.
constexpr double kAimBelowTolerance = 0.5;
constexpr double kAimBelowResidual = 0.01;
// A step longer than this many times the last one is predicted to first order only.
constexpr double kLargestTrend = 2.0;
// The preconditioner tolerates this much motion before it is worth computing anew.
constexpr double kPreconditionerReach_m = 3e-3;
// A residual that grows by more than this under a correction tells of an unstable state.
constexpr double kDivergence = 2.0;
constexpr int kMaxStalls = 3;
// A region gives up its last ring below this fraction of what the border may have.
constexpr double kShrinkBelow = 0.3;
// So far beyond what the border may have the outside no longer follows S.
constexpr double kBorderLost = 100.0;
constexpr int kCalmMoves = 4;
constexpr int kFirstLevels = 4;
constexpr int kMovesBetweenAttempts = 30;
// Below this fraction of where it began a lane is at single precision's end.
constexpr double kFinishedLane = 1e-13;

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
  if (!(options.border_tolerance >= 0.0) || options.whole_every < 0) {
    throw Error("solver: border_tolerance is " + std::to_string(options.border_tolerance) +
                " and whole_every " + std::to_string(options.whole_every) + "; both must be >= 0");
  }
}

enum class Outcome { kSettled, kOutOfIterations, kUnstable };

}  // namespace

template <typename Real>
class ElasticObject<Real>::Implementation {
 public:
  Implementation(const SpringMesh& mesh, const SolverOptions& options)
      : options_(options), vertices_(static_cast<std::int32_t>(mesh.rest_position_W.size())) {
    check(mesh);
    check(options);
    origin_W_ = mesh.top_W;
    const std::size_t n = mesh.rest_position_W.size();
    rest_.reserve(n);
    for (const Eigen::Vector3d& position_W : mesh.rest_position_W) {
      rest_.push_back(position_W - origin_W_);
    }
    fixed_ = mesh.fixed;
    SpringTable<Real> table = make_spring_table<Real>(mesh);
    springs_ = table.springs;
    rows_ = std::move(table.rows);
    constants_ = std::move(table.constants);
    exponential_ = table.exponential;
    tangent_.resize(constants_.size());
    vertex_force_ = make_vertex_forces(mesh, rest_);
    mesh_number_.resize(n);
    std::iota(mesh_number_.begin(), mesh_number_.end(), 0);
    own_number_.assign(mesh_number_.begin(), mesh_number_.end());
    region_ = Region(vertices_);
    state_.resize(n);
    residual_.resize(n);
    direction_.resize(n);
    product_.resize(n);
    saved_state_.resize(n);
    inverse_.resize(n);
    correction_.resize(n);
    if constexpr (kDouble) {
      position_.resize(n);
      saved_position_.resize(n);
      force_.resize(n);
      t_N_per_m_.resize(tangent_.size());
    } else {
      single_position_.resize(n);
    }
    free_.resize(n);
    coarse_ = make_coarse_grid(rest_);
    coarse_residual_.resize(static_cast<std::size_t>(coarse_.node_count));
    coarse_correction_.resize(static_cast<std::size_t>(coarse_.node_count));
    release();
  }

  const SolverOptions& options() const noexcept { return options_; }
  void set_relative_tolerance(double relative_tolerance) {
    SolverOptions changed = options_;
    changed.relative_tolerance = relative_tolerance;
    check(changed);
    options_ = changed;
  }
  std::size_t vertex_count() const noexcept { return rest_.size(); }
  std::size_t spring_count() const noexcept { return springs_; }
  std::size_t memory_bytes() const noexcept {
    const auto bytes = [](const auto&... vectors) {
      return (... + (vectors.capacity() * sizeof(*vectors.data())));
    };
    return sizeof *this +
           bytes(rest_, fixed_, free_, mesh_patch_, mesh_number_, own_number_, rows_.row_begin,
                 rows_.owner, rows_.other, constants_, vertex_force_, patch_, constrained_, state_,
                 residual_, direction_, product_, saved_state_, inverse_, tangent_, correction_,
                 position_, saved_position_, force_, t_N_per_m_, single_position_, coarse_.place,
                 coarse_.inverse_m_per_N, coarse_residual_, coarse_correction_);
  }
  bool grabbed() const noexcept { return !patch_.empty(); }
  const std::vector<std::int32_t>& patch() const noexcept { return mesh_patch_; }

  template <typename Visit>
  void visit_grabbable(const Eigen::Vector3d& point_W, double radius_m, Visit visit) const {
    const Eigen::Vector3d centre = point_W - origin_W_;
    for (std::int32_t i = 0; i < vertices_; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (fixed_[at] == 0 && (rest_[at] - centre).norm() <= radius_m) {
        visit(i);
      }
    }
  }

  int grab(const Eigen::Vector3d& point_W, double radius_m) {
    if (grabbed()) {
      throw Error("elastic object: a patch is held already; call release() first");
    }
    visit_grabbable(point_W, radius_m, [this](std::int32_t i) { patch_.push_back(i); });
    if (patch_.empty()) {
      return 0;
    }
    if (options_.border_tolerance > 0.0) {
      number_around_patch();
    }
    for (const std::int32_t i : patch_) {
      mesh_patch_.push_back(mesh_number_[static_cast<std::size_t>(i)]);
    }
    for (const std::int32_t i : patch_) {
      const auto at = static_cast<std::size_t>(i);
      free_[at] = 0;
      constrained_.push_back(i);
      for (int c = 0; c < 3; ++c) {
        state_[at].component[c][1 + c] = 1.0F;
      }
    }
    solve_sensitivities();
    return static_cast<int>(patch_.size());
  }

  void release() noexcept {
    patch_.clear();
    mesh_patch_.clear();
    region_.whole(rows_);
    moves_ = whole_since_ = 0;
    stand_at_rest();
    last_ = Equilibrium{};
    last_.converged = true;
  }

  // Every vertex where it rests, and nothing known of the state before.
  void stand_at_rest() noexcept {
    constrained_.clear();
    displacement_.setZero();
    saved_displacement_.setZero();
    trend_valid_ = false;
    preconditioner_valid_ = false;
    for (std::int32_t i = 0; i < vertices_; ++i) {
      const auto at = static_cast<std::size_t>(i);
      free_[at] = fixed_[at] == 0 ? 1 : 0;
      if (free_[at] == 0) {
        constrained_.push_back(i);
      }
      state_[at] = Lanes{};
      set_position(at, rest_[at]);
    }
  }

  Equilibrium move_to(const Eigen::Vector3d& displacement_W) noexcept {
    const auto start = std::chrono::steady_clock::now();
    const auto finish = [&start](Equilibrium& result) {
      result.solve_time_s =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    };
    const auto clear_counts = [](Equilibrium& result) {
      result.steps = result.evaluations = result.iterations = result.halvings = 0;
      result.left_branch = false;
    };
    if (!displacement_W.allFinite()) {
      Equilibrium unchanged = last_;
      clear_counts(unchanged);
      unchanged.converged = false;
      unchanged.reached = false;
      finish(unchanged);
      return unchanged;
    }
    if (!grabbed()) {
      Equilibrium untouched;
      untouched.displacement_W = displacement_W;
      untouched.converged = true;
      finish(untouched);
      return untouched;
    }
    clear_counts(last_);
    last_.reached = true;
    if (options_.border_tolerance > 0.0) {
      choose_region();
    }
    double step_limit_m = options_.max_step_m;
    int steps = 0;
    for (;;) {
      const Eigen::Vector3d left = displacement_W - displacement_;
      const double pieces = std::max(1.0, std::ceil(left.norm() / step_limit_m * (1.0 - 1e-12)));
      const Eigen::Vector3d target =
          pieces > 1.0 ? Eigen::Vector3d(displacement_ + left / pieces) : displacement_W;
      const double length_m = (target - displacement_).norm();
      ++steps;
      const bool last = pieces <= 1.0 || steps >= options_.max_steps;
      advance_to(target);
      const Outcome outcome = last ? settle() : relax();
      if (outcome == Outcome::kUnstable) {
        if (last_.halvings < kMaxHalvings && length_m > 0.0) {
          restore();
          ++last_.halvings;
          --steps;
          step_limit_m = 0.5 * length_m;
          continue;
        }
        last_.left_branch = true;
        change_region(region_.levels());
        recover();
        if (last) {
          settle();
        }
      }
      if (last && outcome == Outcome::kSettled) {
        grow();
      }
      if (last) {
        last_.reached = pieces <= 1.0;
        break;
      }
    }
    last_.steps = steps;
    last_.displacement_W = displacement_;
    finish(last_);
    return last_;
  }

  std::vector<Eigen::Vector3d> positions_W() const {
    std::vector<Eigen::Vector3d> positions;
    positions.resize(rest_.size());
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      positions[static_cast<std::size_t>(mesh_number_[i])] = origin_W_ + standing_position(i);
    }
    return positions;
  }

  Eigen::Matrix3d sensitivity(std::size_t mesh_vertex) const {
    const std::size_t vertex = own_number_[mesh_vertex];
    return sensitivity_of(vertex);
  }

 private:
  static constexpr bool kDouble = std::is_same_v<Real, double>;

  Eigen::Vector3d position(std::size_t i) const noexcept {
    if constexpr (kDouble) {
      return {position_[i].xyz[0], position_[i].xyz[1], position_[i].xyz[2]};
    } else {
      return {state_[i].component[0][0], state_[i].component[1][0], state_[i].component[2][0]};
    }
  }

  void set_position(std::size_t i, const Eigen::Vector3d& position) noexcept {
    if constexpr (kDouble) {
      position_[i].xyz = kernels::Double4{position.x(), position.y(), position.z(), 0.0};
    } else {
      for (int c = 0; c < 3; ++c) {
        state_[i].component[c][0] = static_cast<float>(position[c]);
      }
    }
  }

  // Grabbed first, then ring by ring, so that a region is the head of every array.
  void number_around_patch() {
    const std::vector<std::int32_t> order = region_.number_around(patch_, rows_);
    permute(order, rest_);
    permute(order, fixed_);
    permute(order, free_);
    permute(order, mesh_number_);
    if (!vertex_force_.empty()) {
      permute(order, vertex_force_);
    }
    renumber_springs(order, rows_, constants_);
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      own_number_[static_cast<std::size_t>(mesh_number_[i])] = i;
    }
    std::iota(patch_.begin(), patch_.end(), 0);
    coarse_ = make_coarse_grid(rest_);
    stand_at_rest();
    region_.whole(rows_);
  }

  // Where a vertex is; one outside the region follows S from where it was left.
  Eigen::Vector3d standing_position(std::size_t i) const {
    if (static_cast<std::int32_t>(i) < rows_.reach) {
      return position(i);
    }
    const Eigen::Vector3d way = displacement_ - region_.place(static_cast<std::int32_t>(i));
    return position(i) + sensitivity_of(i) * way;
  }

  Eigen::Matrix3d sensitivity_of(std::size_t i) const noexcept {
    Eigen::Matrix3d s;
    for (int c = 0; c < 3; ++c) {
      for (int j = 0; j < 3; ++j) {
        s(c, j) = static_cast<double>(state_[i].component[c][1 + j]);
      }
    }
    return s;
  }

  // Brings what joins the region to where the tool is; what leaves it keeps that place.
  // Between moves, or to a larger region.
  void change_region(int levels) noexcept {
    const std::int32_t reached = rows_.reach;
    region_.set(levels, displacement_, rows_);
    for (std::int32_t i = reached; i < rows_.reach; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const Eigen::Matrix3d s = sensitivity_of(at);
      const Eigen::Vector3d from = position(at);
      const Eigen::Vector3d& place = region_.place(i);
      set_position(at, from + s * (saved_displacement_ - place));
      saved_state_[at] = state_[at];
      if constexpr (kDouble) {
        saved_position_[at] = position_[at];
      }
      set_position(at, from + s * (displacement_ - place));
      direction_[at] = product_[at] = Lanes{};
    }
    // Nobody corrects S out there, so that it must not go on as it went while it was solved.
    for (std::int32_t i = region_.solved_vertices(); i < rows_.reach; ++i) {
      saved_state_[static_cast<std::size_t>(i)] = state_[static_cast<std::size_t>(i)];
    }
    preconditioner_valid_ = false;
    calm_moves_ = 0;
  }

  double border_share() const noexcept {
    return last_.border_work_N / (options_.border_tolerance * force_scale_N_);
  }

  void choose_region() noexcept {
    ++moves_;
    // What is mended all at once where the region is new is no trend.
    if (++calm_moves_ < kCalmMoves) {
      trend_valid_ = false;
    }
    if (options_.whole_every > 0 && moves_ % options_.whole_every == 0) {
      local_levels_ = region_.solved();
      change_region(region_.levels());
      return;
    }
    int levels = region_.solved();
    if (moves_ == 1) {
      levels = kFirstLevels;
    } else if (options_.whole_every > 0 && moves_ % options_.whole_every == 1) {
      levels = local_levels_;
    } else if (border_share() > 1.0) {
      levels = region_.larger();
    } else if (region_.is_whole()) {
      // Every attempt with less costs an answer of two parts.
      levels -= moves_ - whole_since_ > kMovesBetweenAttempts ? 1 : 0;
    } else if (border_share() < kShrinkBelow) {
      levels -= 1;
    }
    levels = std::clamp(levels, 1, region_.levels());
    if (levels != region_.solved()) {
      change_region(levels);
    }
  }

  // Solves with a larger region until the border is quiet.
  void grow() noexcept {
    if (options_.border_tolerance <= 0.0 || options_.answer_first_below > 0.0) {
      return;
    }
    if (region_.is_whole()) {
      return;
    }
    while (!region_.is_whole() && border_share() > 1.0) {
      change_region(region_.larger());
      if (settle() != Outcome::kSettled) {
        return;
      }
    }
    if (region_.is_whole()) {
      whole_since_ = moves_;
    }
  }

  void restore() noexcept {
    std::copy_n(saved_state_.begin(), rows_.reach, state_.begin());
    if constexpr (kDouble) {
      std::copy_n(saved_position_.begin(), rows_.reach, position_.begin());
    }
    displacement_ = saved_displacement_;
    trend_valid_ = false;
    // What an unstable state left here may not be finite, and is multiplied by zero when CG starts.
    std::fill(direction_.begin(), direction_.end(), Lanes{});
    std::fill(product_.begin(), product_.end(), Lanes{});
  }

  // In double, lane 0 of the state holds the correction to the positions until this adds it.
  void absorb_correction() noexcept {
    if constexpr (kDouble) {
      for (std::size_t i = 0; i < static_cast<std::size_t>(rows_.reach); ++i) {
        for (int c = 0; c < 3; ++c) {
          position_[i].xyz[c] += static_cast<double>(state_[i].component[c][0]);
          state_[i].component[c][0] = 0.0F;
        }
      }
    }
  }

  void place_patch() noexcept {
    for (const std::int32_t i : patch_) {
      const auto at = static_cast<std::size_t>(i);
      set_position(at, rest_[at] + displacement_);
    }
  }

  // Keeps the present state for restore() and predicts the one at `displacement`.
  void advance_to(const Eigen::Vector3d& displacement) noexcept {
    const Eigen::Vector3d step = displacement - displacement_;
    const Eigen::Vector3d last_step = displacement_ - saved_displacement_;
    const Eigen::Vector3f step_m = step.template cast<float>();
    const double trend =
        last_step.isZero(0.0) ? 0.0 : step.dot(last_step) / last_step.squaredNorm();
    const bool trust = trend_valid_ && std::abs(trend) <= kLargestTrend;
    if constexpr (kDouble) {
      std::copy_n(position_.begin(), rows_.reach, saved_position_.begin());
    }
    kernels::predict(rows_.reach, step_m.data(), trust ? static_cast<float>(trend) : 0.0F,
                     state_.data(), saved_state_.data());
    absorb_correction();
    saved_displacement_ = displacement_;
    displacement_ = displacement;
    trend_valid_ = true;
    place_patch();
  }

  // Fills residual_ (zero on constrained vertices), tangent_ and last_'s force and residuals.
  void evaluate() noexcept {
    const bool refresh =
        !preconditioner_valid_ ||
        (displacement_ - preconditioner_displacement_).norm() > kPreconditionerReach_m;
    const Precise* force = nullptr;
    if constexpr (kDouble) {
      kernels::evaluate(rows_, constants_.data(), exponential_, state_.data(), position_.data(),
                        t_N_per_m_.data(), force_.data(), residual_.data(), tangent_.data());
      kernels::add_vertex_forces(active_forces(), state_.data(), position_.data(), force_.data(),
                                 residual_.data());
      force = force_.data();
    } else {
      kernels::evaluate(rows_, constants_.data(), exponential_, state_.data(),
                        single_position_.data(), residual_.data(), tangent_.data());
      kernels::add_vertex_forces(active_forces(), state_.data(), residual_.data());
    }
    if (refresh) {
      kernels::sum_blocks(rows_, tangent_.data(), inverse_.data());
      kernels::add_home_blocks(active_forces(), inverse_.data());
      const auto solved = static_cast<std::size_t>(region_.solved_vertices());
      for (std::size_t i = 0; i < static_cast<std::size_t>(rows_.reach); ++i) {
        kernels::invert_block(inverse_[i], free_[i] != 0 && i < solved);
      }
      preconditioner_displacement_ = displacement_;
      preconditioner_valid_ = true;
    }
    const kernels::StateSums sums =
        kernels::summarise(rows_.active, inverse_.data(), state_.data(), residual_.data(), force);
    Eigen::Vector3d raw = Eigen::Vector3d::Zero();
    for (const std::int32_t i : patch_) {
      const auto at = static_cast<std::size_t>(i);
      for (int c = 0; c < 3; ++c) {
        if constexpr (kDouble) {
          raw[c] += force_[at].xyz[c];
        } else {
          raw[c] += static_cast<double>(residual_[at].component[c][0]);
        }
      }
    }
    double sensitivity_squared = 0.0;
    for (int j = 0; j < 3; ++j) {
      last_.force_W[j] = sums.force_N[j];
      sensitivity_squared += sums.sensitivity_squared[j];
      for (int k = 0; k < 3; ++k) {
        last_.stiffness_W(j, k) = sums.stiffness_N_per_m[j][k];
      }
    }
    last_.raw_force_W = raw;
    last_.force_gap_N = (last_.force_W - raw).norm();
    residual_N_ = std::sqrt(sums.residual_squared_N2);
    force_scale_N_ = std::max(last_.force_W.norm(), options_.force_floor_N);
    last_.relative_residual = residual_N_ / force_scale_N_;
    stiffness_scale_N_per_m_ = std::max(last_.stiffness_W.norm(), 1e-12);
    last_.sensitivity_residual = std::sqrt(sensitivity_squared) / stiffness_scale_N_per_m_;
    last_.converged = std::isfinite(residual_N_) && last_.force_W.allFinite() &&
                      last_.stiffness_W.allFinite() &&
                      last_.relative_residual <= options_.relative_tolerance;
    ++last_.evaluations;
    last_.vertices = rows_.active;
    silence_border();
    for (const std::int32_t i : constrained_) {
      residual_[static_cast<std::size_t>(i)] = Lanes{};
    }
  }

  // The ring outside the region is evaluated, but not solved.
  void silence_border() noexcept {
    last_.border_work_N = 0.0;
    for (std::int32_t i = region_.solved_vertices(); i < rows_.reach; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (i < rows_.active && free_[at] != 0) {
        Eigen::Vector3d residual_N;
        for (int c = 0; c < 3; ++c) {
          residual_N[c] = static_cast<double>(residual_[at].component[c][0]);
        }
        last_.border_work_N += (sensitivity_of(at).transpose() * residual_N).norm();
      }
      residual_[at] = Lanes{};
    }
  }

  std::span<const kernels::VertexForce> active_forces() const noexcept {
    return vertex_force_.empty()
               ? std::span<const kernels::VertexForce>{}
               : std::span(vertex_force_).first(static_cast<std::size_t>(rows_.active));
  }

  // A small region needs no news from afar.
  const kernels::CoarseGrid& coarse() const noexcept {
    return region_.is_whole() ? coarse_ : no_coarse_;
  }

  bool finite() const noexcept {
    return std::isfinite(residual_N_) && std::isfinite(last_.sensitivity_residual) &&
           last_.force_W.allFinite();
  }

  kernels::StepSums take_step(Float4 alpha) noexcept {
    kernels::StepSums sums = kernels::take_step(rows_.reach, alpha, inverse_.data(), coarse(),
                                                direction_.data(), state_.data(), residual_.data(),
                                                product_.data(), coarse_residual_.data());
    sums.preconditioned +=
        kernels::solve_coarse(coarse(), coarse_residual_.data(), coarse_correction_.data());
    return sums;
  }

  void next_direction(Float4 beta) noexcept {
    kernels::next_direction(rows_.reach, beta, inverse_.data(), coarse(), coarse_correction_.data(),
                            direction_.data(), product_.data());
  }

  struct Descent {
    bool unstable = false;      // K is not positive definite along some lane's direction
    int lane_0_iterations = 0;  // done before that
  };

  // Preconditioned conjugate gradients on all four lanes from the residual that evaluate() left,
  // until lane 0 is at `residual_aim_N` and the others at `sensitivity_aim_N_per_m`.
  Descent descend(int max_iterations, double residual_aim_N,
                  double sensitivity_aim_N_per_m) noexcept {
    Descent result;
    const Float4 zero{};
    kernels::StepSums sums = take_step(zero);
    next_direction(zero);
    const Float4 first = sums.preconditioned;
    Float4 before = first;
    for (int iteration = 0; iteration < max_iterations; ++iteration) {
      const Float4 curvature =
          kernels::apply_stiffness(rows_, tangent_.data(), direction_.data(), product_.data()) +
          kernels::add_home_stiffness(active_forces(), direction_.data(), product_.data());
      Float4 alpha{};
      bool active = false;
      for (int lane = 0; lane < 4; ++lane) {
        if (!(before[lane] > first[lane] * static_cast<float>(kFinishedLane))) {
          continue;
        }
        if (!(curvature[lane] > 0.0F)) {
          result.unstable = true;
          return result;
        }
        alpha[lane] = before[lane] / curvature[lane];
        active = true;
      }
      if (!active) {
        return result;
      }
      sums = take_step(alpha);
      ++last_.iterations;
      ++result.lane_0_iterations;
      const double sensitivity_N_per_m =
          std::sqrt(static_cast<double>(sums.squared[1]) + static_cast<double>(sums.squared[2]) +
                    static_cast<double>(sums.squared[3]));
      const double residual_N = std::sqrt(static_cast<double>(sums.squared[0]));
      if (!std::isfinite(residual_N) || !std::isfinite(sensitivity_N_per_m)) {
        result.unstable = true;
        return result;
      }
      if (residual_N <= residual_aim_N && sensitivity_N_per_m <= sensitivity_aim_N_per_m) {
        return result;
      }
      Float4 beta{};
      for (int lane = 0; lane < 4; ++lane) {
        beta[lane] = before[lane] > 0.0F ? sums.preconditioned[lane] / before[lane] : 0.0F;
      }
      before = sums.preconditioned;
      next_direction(beta);
    }
    return result;
  }

  // A step on the way: one evaluation and a fixed number of iterations.
  Outcome relax() noexcept {
    evaluate();
    if (!finite()) {
      return Outcome::kUnstable;
    }
    const Descent descent = descend(options_.iterations_per_step, 0.0, 0.0);
    absorb_correction();
    return descent.unstable ? Outcome::kUnstable : Outcome::kSettled;
  }

  double residual_aim_N() const noexcept {
    return std::max(kAimBelowTolerance * options_.relative_tolerance * force_scale_N_,
                    kAimBelowResidual * residual_N_);
  }
  double sensitivity_aim_N_per_m() const noexcept {
    return kAimBelowTolerance * options_.sensitivity_tolerance * stiffness_scale_N_per_m_;
  }

  // The answer stands; what the prediction left over is mended for the next move.
  Outcome correct_once() noexcept {
    if (last_.converged && last_.sensitivity_residual <= options_.sensitivity_tolerance) {
      return Outcome::kSettled;
    }
    const Descent descent =
        descend(options_.max_iterations, residual_aim_N(), sensitivity_aim_N_per_m());
    absorb_correction();
    return descent.unstable ? Outcome::kUnstable : Outcome::kSettled;
  }

  // The last step: corrections until the tolerances hold.
  Outcome settle() noexcept {
    evaluate();
    if (!region_.is_whole() && border_share() > kBorderLost) {
      change_region(region_.levels());
      evaluate();
    }
    if (finite() && last_.relative_residual <= options_.answer_first_below) {
      return correct_once();
    }
    int iterations_left = options_.max_iterations;
    int stalls = 0;
    for (int round = 0; round < kMaxEvaluationsAStep; ++round) {
      if (!finite()) {
        return Outcome::kUnstable;
      }
      if (last_.converged && last_.sensitivity_residual <= options_.sensitivity_tolerance) {
        return Outcome::kSettled;
      }
      if (iterations_left <= 0) {
        return Outcome::kOutOfIterations;
      }
      const double before_N = residual_N_;
      const bool was_converged = last_.converged;
      const int done_before = last_.iterations;
      const Descent descent = descend(iterations_left, residual_aim_N(), sensitivity_aim_N_per_m());
      iterations_left -= std::max(1, last_.iterations - done_before);
      absorb_correction();
      if (descent.unstable) {
        return Outcome::kUnstable;
      }
      evaluate();
      if (!was_converged && residual_N_ > kDivergence * before_N) {
        return Outcome::kUnstable;
      }
      if (residual_N_ > 0.7 * before_N && ++stalls >= kMaxStalls) {
        return last_.converged ? Outcome::kSettled : Outcome::kOutOfIterations;
      }
    }
    return last_.converged ? Outcome::kSettled : Outcome::kOutOfIterations;
  }

  void solve_sensitivities() {
    Equilibrium kept = last_;
    evaluate();
    invert_coarse(rows_, tangent_, vertex_force_, free_, coarse_);
    const SolverOptions asked = options_;
    if (options_.border_tolerance > 0.0) {
      // Outside the region nothing corrects S later.
      options_.max_iterations = std::max(options_.max_iterations, SolverOptions{}.max_iterations);
      options_.answer_first_below = 0.0;
    }
    settle();
    options_ = asked;
    kept.force_W.setZero();
    kept.stiffness_W = last_.stiffness_W;
    kept.sensitivity_residual = last_.sensitivity_residual;
    last_ = kept;
  }

  // [J] The springs' energy, k l0^2 (2 (sinh(a e / 2) / a)^2 + c e^4 / 4) each, which is
  // k l0^2 (e^2 / 2 + c e^4 / 4) for a = 0; the home springs' and the loads'.
  double energy() const noexcept {
    double sum_J = 0.0;
    for (std::int32_t i = 0; i < vertices_; ++i) {
      const auto a = static_cast<std::size_t>(i);
      const Eigen::Vector3d here = position(a);
      for (std::int32_t s = rows_.row_begin[a]; s < rows_.row_begin[a + 1]; ++s) {
        const auto at = static_cast<std::size_t>(s);
        const auto b = static_cast<std::size_t>(rows_.other[at]);
        const kernels::SpringConstants<Real>& law = constants_[at];
        const auto inverse_length = static_cast<double>(law.inverse_length_per_m);
        const auto exponent = static_cast<double>(law.exponent);
        const double strain = (position(b) - here).norm() * inverse_length - 1.0;
        const double root =
            exponent > 0.0 ? 2.0 * std::sinh(0.5 * exponent * strain) / exponent : strain;
        sum_J += static_cast<double>(law.scale_N) / inverse_length *
                 (0.5 * root * root + 0.25 * static_cast<double>(law.cubic) * std::pow(strain, 4));
      }
    }
    for (std::size_t i = 0; i < vertex_force_.size(); ++i) {
      const kernels::VertexForce& force = vertex_force_[i];
      const Eigen::Vector3d from_home = position(i) - rest_[i];
      sum_J += 0.5 * static_cast<double>(force.home_stiffness_N_per_m) * from_home.squaredNorm() -
               Eigen::Map<const Eigen::Vector3d>(force.load_N).dot(from_home);
    }
    return sum_J;
  }

  // From an unstable or diverging state downhill in energy to another branch: truncated Newton
  // steps with a backtracking line search, the tool held where it is.
  void recover() noexcept {
    restore_finite();  // from here on saved_state_ belongs to the line search
    double energy_J = energy();
    for (int step = 0; step < options_.max_recovery_steps; ++step) {
      preconditioner_valid_ = false;
      evaluate();
      if (!finite() || last_.converged) {
        return;
      }
      std::copy(state_.begin(), state_.end(), saved_state_.begin());
      if constexpr (kDouble) {
        std::copy(position_.begin(), position_.end(), saved_position_.begin());
      }
      const Descent descent = descend(kRecoveryIterations, 0.1 * residual_N_, 1e30);
      double largest_m = 0.0;
      for (std::size_t i = 0; i < rest_.size(); ++i) {
        for (int c = 0; c < 3; ++c) {
          float move = 0.0F;
          if (descent.lane_0_iterations == 0) {
            move = direction_[i].component[c][0];
          } else if constexpr (kDouble) {
            move = state_[i].component[c][0];
          } else {
            move = state_[i].component[c][0] - saved_state_[i].component[c][0];
          }
          correction_[i][c] = move;
        }
        largest_m = std::max(largest_m, static_cast<double>(correction_[i].norm()));
      }
      std::copy(saved_state_.begin(), saved_state_.end(), state_.begin());
      if (!(largest_m > 0.0) || !std::isfinite(largest_m)) {
        return;
      }
      double scale = largest_m > kLargestRecoveryMove_m || descent.lane_0_iterations == 0
                         ? kLargestRecoveryMove_m / largest_m
                         : 1.0;
      bool lower = false;
      for (int trial = 0; trial < kMaxLineSearchTrials && !lower; ++trial) {
        for (std::size_t i = 0; i < rest_.size(); ++i) {
          const Eigen::Vector3d base = saved_position(i);
          set_position(i, base + scale * correction_[i].template cast<double>());
        }
        const double trial_J = energy();
        lower = trial_J < energy_J;
        if (lower) {
          energy_J = trial_J;
        }
        scale *= 0.5;
      }
      if (!lower) {
        for (std::size_t i = 0; i < rest_.size(); ++i) {
          set_position(i, saved_position(i));
        }
        return;
      }
    }
  }

  Eigen::Vector3d saved_position(std::size_t i) const noexcept {
    if constexpr (kDouble) {
      return {saved_position_[i].xyz[0], saved_position_[i].xyz[1], saved_position_[i].xyz[2]};
    } else {
      return {saved_state_[i].component[0][0], saved_state_[i].component[1][0],
              saved_state_[i].component[2][0]};
    }
  }

  // The state at the start of the step with the patch moved on: finite, whatever happened since.
  void restore_finite() noexcept {
    const Eigen::Vector3d displacement = displacement_;
    restore();
    displacement_ = displacement;
    place_patch();
  }

  SolverOptions options_;
  std::int32_t vertices_ = 0;
  Eigen::Vector3d origin_W_;
  std::vector<Eigen::Vector3d> rest_;  // [m] from origin_W_, so that float keeps its digits
  std::vector<std::uint8_t> fixed_;
  std::vector<std::uint8_t> free_;
  std::vector<std::int32_t> patch_;
  std::vector<std::int32_t> mesh_patch_;   // the same in the mesh's numbering
  std::vector<std::int32_t> mesh_number_;  // by own number
  std::vector<std::size_t> own_number_;    // by the mesh's number
  Region region_{0};
  int moves_ = 0;
  int whole_since_ = 0;
  int calm_moves_ = 0;               // since the region changed
  int local_levels_ = kFirstLevels;  // of the region while the whole object is solved in between
  std::vector<std::int32_t> constrained_;  // fixed vertices and the patch
  std::size_t springs_ = 0;
  kernels::SpringRows rows_;
  std::vector<kernels::SpringConstants<Real>> constants_;
  bool exponential_ = false;                        // some spring has an exponent
  std::vector<kernels::VertexForce> vertex_force_;  // empty: nothing but springs pulls

  std::vector<Lanes> state_;
  std::vector<Lanes> residual_;
  std::vector<Lanes> direction_;
  std::vector<Lanes> product_;
  std::vector<Lanes> saved_state_;
  std::vector<BlockInverse> inverse_;
  std::vector<kernels::SpringTangent> tangent_;
  std::vector<Eigen::Vector3f> correction_;
  std::vector<Precise> position_;  // double only
  std::vector<Precise> saved_position_;
  std::vector<Precise> force_;
  std::vector<double> t_N_per_m_;
  std::vector<kernels::Single> single_position_;  // float only
  kernels::CoarseGrid coarse_;
  kernels::CoarseGrid no_coarse_;
  std::vector<Lanes> coarse_residual_;
  std::vector<Lanes> coarse_correction_;
  bool trend_valid_ = false;  // saved_state_ is a former state, saved_displacement_ its place
  bool preconditioner_valid_ = false;
  Eigen::Vector3d preconditioner_displacement_ = Eigen::Vector3d::Zero();

  Eigen::Vector3d displacement_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d saved_displacement_ = Eigen::Vector3d::Zero();
  double residual_N_ = 0.0;
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
  return implementation_->vertex_count();
}
template <typename Real>
std::size_t ElasticObject<Real>::spring_count() const noexcept {
  return implementation_->spring_count();
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
  implementation_->visit_grabbable(point_W, radius_m, [&count](std::int32_t) { ++count; });
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
Equilibrium ElasticObject<Real>::move_to(const Eigen::Vector3d& displacement_W) noexcept {
  return implementation_->move_to(displacement_W);
}
template <typename Real>
std::vector<Eigen::Vector3d> ElasticObject<Real>::positions_W() const {
  return implementation_->positions_W();
}
template <typename Real>
const std::vector<std::int32_t>& ElasticObject<Real>::patch() const noexcept {
  return implementation_->patch();
}
template <typename Real>
Eigen::Matrix3d ElasticObject<Real>::sensitivity(std::size_t vertex) const {
  return implementation_->sensitivity(vertex);
}

template class ElasticObject<float>;
template class ElasticObject<double>;

}  // namespace forcegrid::simulator
