// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/shared_object.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>

#include "rt/checkpoint.h"
#include "rt/rotation.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/energy_descent.h"
#include "simulator/solver/state_with_sensitivities.h"
#include "simulator/solver/turning_sensitivities.h"

namespace forcegrid::simulator {
namespace {

// As in ElasticObject, which explains them.
constexpr int kMaxEvaluationsAStep = 16;
constexpr int kMaxHalvings = 4;
constexpr double kAimBelowTolerance = 0.5;
constexpr double kAimBelowResidual = 0.01;
constexpr double kDivergence = 2.0;
constexpr double kStall = 0.7;
constexpr int kMaxStalls = 3;
constexpr double kOnTheWay = 1e-2;
// A vertex moves about as far as the tools do. Near an instability S is large, and a prediction
// from it is not believed beyond this many times the tools' way.
constexpr double kMostPredicted = 3.0;
// A state with a larger residual has lost its way: the step begins anew, half as long, or goes on
// downhill, so many times.
constexpr double kLost = 0.1;
constexpr int kMaxDescents = 3;
// The preconditioner tolerates this much motion of all tools together.
constexpr double kPreconditionerReach_m = 3e-3;

void check(const SpringMesh& mesh, const SolverOptions& options, std::size_t tools) {
  if (tools == 0) {
    throw Error("shared object: no tool; give 1 or more");
  }
  if (options.border_tolerance > 0.0) {
    throw Error(
        "shared object: border_tolerance must be 0, because several tools are solved on the whole "
        "object; use the solver quasi_static");
  }
  ElasticObject<float>(mesh, options);  // checks both
}

enum class Outcome { kSettled, kOutOfIterations, kUnstable };

}  // namespace

template <typename Real>
class SharedObject<Real>::Implementation {
 public:
  Implementation(const SpringMesh& mesh, const SolverOptions& options, std::size_t tools)
      : options_((check(mesh, options, tools), options)) {
    for (std::size_t k = 0; k < tools; ++k) {
      tools_.push_back(std::make_unique<Tool>(mesh));
    }
    correction_m_.resize(tools_.front()->state.vertex_count());
    holders_.reserve(tools);
  }

  int grab(std::size_t number, const Eigen::Vector3d& point_W, double radius_m) {
    Tool& tool = *tools_[number];
    if (!tool.patch.empty()) {
      throw Error("shared object: tool " + std::to_string(number) +
                  " holds a patch already; call release() first");
    }
    std::vector<std::int32_t> patch;
    const StateWithSensitivities<Real>& now = lead();
    now.visit_grabbable(point_W, radius_m, [&](std::int32_t i) {
      if (now.is_free(static_cast<std::size_t>(i))) {
        patch.push_back(i);
      }
    });
    if (patch.empty()) {
      return 0;
    }
    if (&now != &tool.state) {
      copy_positions(now, tool.state);
    }
    for (const std::int32_t i : patch) {
      tool.anchor.push_back(now.position(static_cast<std::size_t>(i)));
    }
    tool.patch = std::move(patch);
    tool.aim.setZero();
    tool.pivot = point_W - tool.state.origin_W();
    share(&tool);
    settle_anew();
    return static_cast<int>(tool.patch.size());
  }

  void release(std::size_t number) {
    Tool& tool = *tools_[number];
    if (tool.patch.empty()) {
      return;
    }
    tool.patch.clear();
    tool.anchor.clear();
    tool.aim.setZero();
    tool.turn_aim = tool.turn = tool.saved_turn = Eigen::Quaterniond::Identity();
    tool.has_turned = false;
    if (tool.turning) {
      tool.turning->release();
    }
    tool.last = Equilibrium{};
    tool.last.converged = true;
    tool.state.release();
    share(nullptr);
    if (holders_.empty()) {
      return;
    }
    for (Tool* const holder : holders_) {
      holder->state.save();
    }
    if (settle_anew() == Outcome::kUnstable) {
      leave_branch();
      settle_on_branch();
    }
    for (Tool* const holder : holders_) {
      holder->last.left_branch = true;  // the force jumps
    }
  }

  bool grabbed(std::size_t tool) const noexcept { return !tools_[tool]->patch.empty(); }
  const std::vector<std::int32_t>& patch(std::size_t tool) const noexcept {
    return tools_[tool]->patch;
  }
  const Equilibrium& equilibrium(std::size_t tool) const noexcept { return tools_[tool]->last; }
  std::size_t tool_count() const noexcept { return tools_.size(); }

  void turn(const SpringMesh& mesh) {
    if (!holders_.empty()) {
      throw Error("shared object: a tool holds a patch already; call turn() before grab()");
    }
    for (const auto& tool : tools_) {
      tool->turning = std::make_unique<TurningSensitivities<Real>>(mesh);
    }
  }
  bool turns() const noexcept { return tools_.front()->turning != nullptr; }

  void aim(std::size_t tool, const Eigen::Vector3d& displacement_W) noexcept {
    if (displacement_W.allFinite()) {
      tools_[tool]->aim = displacement_W;
    }
  }
  void aim(std::size_t tool, const Eigen::Vector3d& displacement_W,
           const Eigen::Quaterniond& turn_W) noexcept {
    if (turns() && displacement_W.allFinite() && turn_W.coeffs().allFinite()) {
      tools_[tool]->aim = displacement_W;
      tools_[tool]->turn_aim = turn_W;
    }
  }

  std::optional<Eigen::Matrix3d> stiffness_W(std::size_t tool, std::size_t other) const noexcept {
    const Tool& of = *tools_[tool];
    const Tool& by = *tools_[other];
    if (of.patch.empty() || by.patch.empty() || !of.last.converged || !by.last.converged) {
      return std::nullopt;
    }
    const Eigen::Matrix3d found = of.state.mixed_stiffness(by.state);
    return found.allFinite() ? std::optional(found) : std::nullopt;
  }

  // The move in steps of at most max_step_m, or half as long where a step met an unstable state;
  // from rest where that did not help, and downhill in energy where that did not.
  void solve() noexcept {
    if (holders_.empty()) {
      return;
    }
    const auto start = std::chrono::steady_clock::now();
    clear_counts();
    double step_limit_m = options_.max_step_m;
    bool may_begin_at_rest = true;
    for (;;) {
      const double way_m = longest_way_m();
      const double pieces = std::max(1.0, std::ceil(way_m / step_limit_m * (1.0 - 1e-12)));
      ++counts_.steps;
      const bool is_last = pieces <= 1.0 || counts_.steps >= options_.max_steps;
      advance(pieces);
      evaluate();
      Outcome outcome = is_last ? settle() : relax();
      if (outcome == Outcome::kOutOfIterations && lost()) {
        outcome = Outcome::kUnstable;
      }
      if (outcome == Outcome::kUnstable) {
        if (counts_.halvings < kMaxHalvings && way_m > 0.0) {
          restore();
          ++counts_.halvings;
          --counts_.steps;
          step_limit_m = 0.5 * way_m / pieces;
          continue;
        }
        if (std::exchange(may_begin_at_rest, false)) {
          begin_at_rest();
          counts_.steps = counts_.halvings = 0;
          step_limit_m = options_.max_step_m;
          continue;
        }
        leave_branch();
        if (is_last) {
          settle_on_branch();
        }
      }
      if (is_last) {
        counts_.reached = pieces <= 1.0;
        break;
      }
    }
    find_torques();
    counts_.solve_time_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    hand_out_counts();
  }

  const StateWithSensitivities<Real>& lead() const noexcept {
    return holders_.empty() ? tools_.front()->state : holders_.front()->state;
  }

 private:
  struct Tool {
    explicit Tool(const SpringMesh& mesh) : state(mesh) { last.converged = true; }

    StateWithSensitivities<Real> state;
    std::vector<std::int32_t> patch;
    std::vector<Eigen::Vector3d> anchor;  // where each vertex of it is at displacement 0
    std::vector<Eigen::Vector3d> others;  // where the other tools' vertices are; scratch
    Eigen::Vector3d aim = Eigen::Vector3d::Zero();
    Eigen::Vector3d next = Eigen::Vector3d::Zero();
    std::unique_ptr<TurningSensitivities<Real>> turning;  // null: tools do not turn
    Eigen::Vector3d pivot = Eigen::Vector3d::Zero();      // the tool's position at the grab
    Eigen::Quaterniond turn_aim = Eigen::Quaterniond::Identity();
    Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
    Eigen::Quaterniond saved_turn = Eigen::Quaterniond::Identity();
    Eigen::Vector3d theta_W_rad = Eigen::Vector3d::Zero();  // of the present step
    bool has_turned = false;  // until then the patch stands where it was grabbed, to the last digit
    Evaluation found;
    double force_scale_N = 1.0;
    double stiffness_scale_N_per_m = 1.0;
    Equilibrium last;
  };

  // Tells every state what each tool holds now.
  void share(const Tool* anew) {
    holders_.clear();
    for (const auto& tool : tools_) {
      if (!tool->patch.empty()) {
        holders_.push_back(tool.get());
      }
    }
    for (Tool* const tool : holders_) {
      std::vector<std::int32_t> others;
      for (const Tool* const other : holders_) {
        if (other != tool) {
          others.insert(others.end(), other->patch.begin(), other->patch.end());
        }
      }
      tool->others.resize(others.size());
      tool->state.share(tool->patch, tool->anchor, others, tool == anew);
      if (tool->turning && tool == anew) {
        tool->turning->hold(tool->state, tool->pivot, others);
      } else if (tool->turning) {
        tool->turning->share(tool->state, others);
      }
    }
    since_preconditioner_m_ = 0.0;
  }

  // After a change of what is held: S, and x where it is not in equilibrium. Allocates.
  Outcome settle_anew() {
    clear_counts();
    evaluate();
    for (Tool* const tool : holders_) {
      tool->state.invert_coarse();
    }
    const Outcome outcome = settle();
    find_torques();
    hand_out_counts();
    return outcome;
  }

  void clear_counts() noexcept {
    counts_ = Equilibrium{};
    for (Tool* const tool : holders_) {
      tool->last.left_branch = false;
    }
  }
  void hand_out_counts() noexcept {
    for (Tool* const tool : holders_) {
      Equilibrium& last = tool->last;
      last.displacement_W = tool->state.displacement_W();
      last.turn_W = tool->turn;
      last.steps = counts_.steps;
      last.evaluations = counts_.evaluations;
      last.iterations = counts_.iterations;
      last.halvings = counts_.halvings;
      last.reached = counts_.reached;
      last.solve_time_s = counts_.solve_time_s;
    }
  }

  double longest_way_m() const noexcept {
    double longest_m = 0.0;
    for (const Tool* const tool : holders_) {
      double way_m = (tool->aim - tool->state.displacement_W()).norm();
      if (tool->turning) {
        way_m +=
            rt::rotation_vector_rad(tool->turn, tool->turn_aim).norm() * tool->turning->reach_m();
      }
      longest_m = std::max(longest_m, way_m);
    }
    return longest_m;
  }

  // The tool's patch where it is turned to.
  static void place_turned(Tool& tool) noexcept {
    if (tool.has_turned) {
      tool.anchor = tool.turning->anchor(tool.turn);  // as many as before
      tool.state.set_patch_anchor(tool.anchor);
    }
  }

  void find_torques() noexcept {
    int iterations = 0;
    for (Tool* const tool : holders_) {
      if (!tool->turning) {
        continue;
      }
      const auto found = tool->turning->solve(
          tool->state, tool->found, options_.sensitivity_tolerance, options_.max_iterations);
      iterations = std::max(iterations, found.iterations);
      tool->last.torque_known = tool->last.rotational_stiffness_known = found.known;
      tool->last.torque_W_Nm = found.torque_W_Nm;
      tool->last.rotational_stiffness_W_Nm_per_rad = found.stiffness_W_Nm_per_rad;
      tool->last.torque_gradient_W_N = found.gradient_W_N;
    }
    counts_.iterations += iterations;
  }

  void copy_positions(const StateWithSensitivities<Real>& from,
                      StateWithSensitivities<Real>& to) const noexcept {
    for (std::size_t i = 0; i < correction_m_.size(); ++i) {
      to.set_position(i, from.position(i));
    }
  }
  // After a correction, in which every state has found x anew.
  void follow_lead() noexcept {
    for (std::size_t k = 1; k < holders_.size(); ++k) {
      copy_positions(lead(), holders_[k]->state);
    }
  }

  // Predicts the state with every tool 1 / `pieces` of its way further on.
  void advance(double pieces) noexcept {
    double moved_m = 0.0;
    for (Tool* const tool : holders_) {
      const Eigen::Vector3d& from = tool->state.displacement_W();
      tool->next = pieces > 1.0 ? Eigen::Vector3d(from + (tool->aim - from) / pieces) : tool->aim;
      moved_m += (tool->next - from).norm();
      if (tool->turning) {
        tool->saved_turn = tool->turn;
        tool->turn = pieces > 1.0 ? tool->turn.slerp(1.0 / pieces, tool->turn_aim) : tool->turn_aim;
        tool->theta_W_rad = rt::rotation_vector_rad(tool->saved_turn, tool->turn);
        tool->has_turned = tool->has_turned || !tool->theta_W_rad.isZero(0.0);
        moved_m += tool->theta_W_rad.norm() * tool->turning->reach_m();
        place_turned(*tool);
      }
    }
    since_preconditioner_m_ += moved_m;
    if (since_preconditioner_m_ > kPreconditionerReach_m) {
      since_preconditioner_m_ = 0.0;
      for (Tool* const tool : holders_) {
        tool->state.forget_preconditioner();
      }
    }
    go_to_next();
    for (Tool* const tool : holders_) {
      if (tool->has_turned) {
        tool->turning->predict(tool->theta_W_rad, tool->state);
      }
    }
    // Each state has moved under its own tool; together they have moved by the sum.
    const StateWithSensitivities<Real>& first = lead();
    for (std::size_t i = 0; i < correction_m_.size(); ++i) {
      if (!first.is_free(i)) {
        continue;
      }
      const Eigen::Vector3d before = first.saved_position(i);
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const Tool* const tool : holders_) {
        sum += tool->state.position(i) - before;
      }
      const double most_m = kMostPredicted * moved_m;
      const bool too_far = !(sum.squaredNorm() <= most_m * most_m);
      if (holders_.size() < 2 && !too_far) {
        continue;
      }
      if (too_far) {
        sum *= sum.allFinite() ? most_m / sum.norm() : 0.0;
      }
      for (Tool* const tool : holders_) {
        tool->state.set_position(i, before + sum);
      }
    }
  }

  // Every patch where its tool is next, and what each state predicts under its own tool.
  void go_to_next() noexcept {
    for (Tool* const tool : holders_) {
      std::size_t n = 0;
      for (const Tool* const other : holders_) {
        for (std::size_t v = 0; other != tool && v < other->anchor.size(); ++v) {
          tool->others[n++] = other->anchor[v] + other->next;
        }
      }
      tool->state.place_others(tool->others);
      tool->state.advance_to(tool->next);
    }
  }

  // The object left its branch of equilibria: it is at rest, and every tool where it grabbed.
  void begin_at_rest() noexcept {
    for (Tool* const tool : holders_) {
      tool->next.setZero();
      if (tool->turning) {
        tool->turn = Eigen::Quaterniond::Identity();
        place_turned(*tool);
      }
    }
    go_to_next();
    for (Tool* const tool : holders_) {
      tool->state.begin_at_rest();
      tool->last.left_branch = true;
    }
    evaluate();
    settle();
  }

  void restore() noexcept {
    for (Tool* const tool : holders_) {
      tool->state.restore();
      tool->state.forget_preconditioner();
      if (tool->turning) {
        tool->turn = tool->saved_turn;
        place_turned(*tool);
      }
    }
  }

  void evaluate() noexcept {
    for (Tool* const tool : holders_) {
      Evaluation& found = tool->found;
      Equilibrium& last = tool->last;
      found = tool->state.evaluate();
      last.force_W = found.force_W;
      last.raw_force_W = found.raw_force_W;
      last.stiffness_W = found.stiffness_W;
      last.force_gap_N = (found.force_W - found.raw_force_W).norm();
      tool->force_scale_N = std::max(found.force_W.norm(), options_.force_floor_N);
      tool->stiffness_scale_N_per_m = std::max(found.stiffness_W.norm(), 1e-12);
      last.relative_residual = found.residual_N / tool->force_scale_N;
      last.sensitivity_residual =
          found.sensitivity_residual_N_per_m / tool->stiffness_scale_N_per_m;
      last.converged = found.finite() && last.relative_residual <= options_.relative_tolerance;
      last.vertices = tool->state.evaluated_vertices();
    }
    ++counts_.evaluations;
  }

  template <typename What>
  bool all(What what) const noexcept {
    return std::ranges::all_of(holders_, what);
  }
  bool finite() const noexcept {
    return all([](const Tool* tool) { return tool->found.finite(); });
  }
  bool converged() const noexcept {
    return all([](const Tool* tool) { return tool->last.converged; });
  }
  bool settled() const noexcept {
    return converged() && all([this](const Tool* tool) {
             return tool->last.sensitivity_residual <= options_.sensitivity_tolerance;
           });
  }
  double residual_N() const noexcept { return holders_.front()->found.residual_N; }
  // The least force decides how far the residual has to fall.
  double force_scale_N() const noexcept {
    double scale_N = holders_.front()->force_scale_N;
    for (const Tool* const tool : holders_) {
      scale_N = std::min(scale_N, tool->force_scale_N);
    }
    return scale_N;
  }

  /// @param sensitivity_aim  of |K S|, relative to the stiffness
  bool correct(int max_iterations, double residual_aim_N, double sensitivity_aim) noexcept {
    bool stable = true;
    int iterations = 0;
    for (Tool* const tool : holders_) {
      const Descent descent = tool->state.descend(max_iterations, residual_aim_N,
                                                  sensitivity_aim * tool->stiffness_scale_N_per_m);
      iterations = std::max(iterations, descent.iterations);
      tool->state.absorb_correction();
      stable = stable && !descent.unstable;
    }
    follow_lead();
    counts_.iterations += iterations;
    return stable;
  }

  // A step on the way, after its evaluation: a bounded number of iterations.
  Outcome relax() noexcept {
    if (!finite()) {
      return Outcome::kUnstable;
    }
    const double aim_N = kOnTheWay * force_scale_N();
    const bool near_enough =
        residual_N() <= aim_N && all([this](const Tool* tool) {
          return tool->last.sensitivity_residual <= options_.sensitivity_tolerance;
        });
    return near_enough ||
                   correct(options_.iterations_per_step, aim_N, options_.sensitivity_tolerance)
               ? Outcome::kSettled
               : Outcome::kUnstable;
  }

  // The last step, after its evaluation: corrections until the tolerances hold.
  Outcome settle() noexcept {
    int iterations_left = options_.max_iterations;
    int stalls = 0;
    for (int round = 0; round < kMaxEvaluationsAStep; ++round) {
      rt::note_progress();
      if (!finite()) {
        return Outcome::kUnstable;
      }
      if (settled()) {
        return Outcome::kSettled;
      }
      if (iterations_left <= 0) {
        return Outcome::kOutOfIterations;
      }
      const double before_N = residual_N();
      const bool was_converged = converged();
      const int done_before = counts_.iterations;
      const bool stable =
          correct(iterations_left,
                  std::max(kAimBelowTolerance * options_.relative_tolerance * force_scale_N(),
                           kAimBelowResidual * before_N),
                  kAimBelowTolerance * options_.sensitivity_tolerance);
      iterations_left -= std::max(1, counts_.iterations - done_before);
      if (!stable) {
        return Outcome::kUnstable;
      }
      evaluate();
      if (!was_converged && residual_N() > kDivergence * before_N) {
        return Outcome::kUnstable;
      }
      if (residual_N() > kStall * before_N && ++stalls >= kMaxStalls) {
        break;
      }
    }
    return converged() ? Outcome::kSettled : Outcome::kOutOfIterations;
  }
  bool lost() const noexcept { return !(residual_N() <= kLost * force_scale_N()); }

  void leave_branch() noexcept {
    const EnergyDescent spent =
        descend_in_energy(holders_.front()->state, options_.max_recovery_steps,
                          options_.relative_tolerance, options_.force_floor_N, correction_m_);
    counts_.evaluations += spent.evaluations;
    counts_.iterations += spent.iterations;
    for (Tool* const tool : holders_) {
      tool->last.left_branch = true;
      if (tool != holders_.front()) {
        tool->state.restore_under_tool();
      }
      tool->state.forget_preconditioner();
    }
    follow_lead();
  }

  // After leave_branch(): a state that is far from the new branch's equilibrium goes on downhill.
  void settle_on_branch() noexcept {
    for (int more = 0;; ++more) {
      evaluate();
      if (settle() == Outcome::kSettled || !lost() || more == kMaxDescents) {
        return;
      }
      leave_branch();
    }
  }

  SolverOptions options_;
  std::vector<std::unique_ptr<Tool>> tools_;
  std::vector<Tool*> holders_;                 // those that hold a patch; the first one leads
  std::vector<Eigen::Vector3f> correction_m_;  // one per vertex, for leave_branch()
  double since_preconditioner_m_ = 0.0;
  Equilibrium counts_;
};

template <typename Real>
SharedObject<Real>::SharedObject(const SpringMesh& mesh, const SolverOptions& options,
                                 std::size_t tools)
    : implementation_(std::make_unique<Implementation>(mesh, options, tools)) {}
template <typename Real>
SharedObject<Real>::~SharedObject() = default;
template <typename Real>
SharedObject<Real>::SharedObject(SharedObject&&) noexcept = default;
template <typename Real>
SharedObject<Real>& SharedObject<Real>::operator=(SharedObject&&) noexcept = default;

template <typename Real>
std::size_t SharedObject<Real>::vertex_count() const noexcept {
  return implementation_->lead().vertex_count();
}
template <typename Real>
std::size_t SharedObject<Real>::spring_count() const noexcept {
  return implementation_->lead().spring_count();
}
template <typename Real>
std::size_t SharedObject<Real>::tool_count() const noexcept {
  return implementation_->tool_count();
}
template <typename Real>
int SharedObject<Real>::grab(std::size_t tool, const Eigen::Vector3d& point_W, double radius_m) {
  return implementation_->grab(tool, point_W, radius_m);
}
template <typename Real>
void SharedObject<Real>::release(std::size_t tool) {
  implementation_->release(tool);
}
template <typename Real>
bool SharedObject<Real>::grabbed(std::size_t tool) const noexcept {
  return implementation_->grabbed(tool);
}
template <typename Real>
void SharedObject<Real>::aim(std::size_t tool, const Eigen::Vector3d& displacement_W) noexcept {
  implementation_->aim(tool, displacement_W);
}
template <typename Real>
void SharedObject<Real>::aim(std::size_t tool, const Eigen::Vector3d& displacement_W,
                             const Eigen::Quaterniond& turn_W) noexcept {
  implementation_->aim(tool, displacement_W, turn_W);
}
template <typename Real>
void SharedObject<Real>::turn(const SpringMesh& mesh) {
  implementation_->turn(mesh);
}
template <typename Real>
bool SharedObject<Real>::turns() const noexcept {
  return implementation_->turns();
}
template <typename Real>
std::optional<Eigen::Matrix3d> SharedObject<Real>::stiffness_W(std::size_t tool,
                                                               std::size_t other) const noexcept {
  return implementation_->stiffness_W(tool, other);
}
template <typename Real>
void SharedObject<Real>::solve() noexcept {
  implementation_->solve();
}
template <typename Real>
const Equilibrium& SharedObject<Real>::equilibrium(std::size_t tool) const noexcept {
  return implementation_->equilibrium(tool);
}
template <typename Real>
const std::vector<std::int32_t>& SharedObject<Real>::patch(std::size_t tool) const noexcept {
  return implementation_->patch(tool);
}
template <typename Real>
void SharedObject<Real>::copy_positions(const std::vector<std::int32_t>& vertices,
                                        std::vector<Eigen::Vector3d>& position_W) const {
  const StateWithSensitivities<Real>& state = implementation_->lead();
  position_W.resize(vertices.size());
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    position_W[i] = state.origin_W() + state.position(static_cast<std::size_t>(vertices[i]));
  }
}
template <typename Real>
std::vector<Eigen::Vector3d> SharedObject<Real>::positions_W() const {
  const StateWithSensitivities<Real>& state = implementation_->lead();
  std::vector<Eigen::Vector3d> positions_W(state.vertex_count());
  for (std::size_t i = 0; i < positions_W.size(); ++i) {
    positions_W[i] = state.origin_W() + state.position(i);
  }
  return positions_W;
}

template class SharedObject<float>;
template class SharedObject<double>;

}  // namespace forcegrid::simulator
