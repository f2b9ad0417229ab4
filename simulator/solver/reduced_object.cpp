// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/reduced_object.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/mesh/tetrahedra.h"

namespace forcegrid::simulator {
namespace {

constexpr std::uint64_t kMostTold = 20;
// This many more states are worth another training.
constexpr double kWorthTraining = 0.25;
constexpr std::size_t kFewestNewStates = 5;
constexpr std::size_t kFewestStates = 3;
// Factor on the states' distance when there is no room for more.
constexpr double kThinner = 1.5;
// The same after a failed check, down to a bound.
constexpr double kDenser = 0.5;
constexpr double kNearest_m = 0.5e-3;
constexpr std::size_t kNewAfterFailure = 3;

const SpringMesh& checked(const SpringMesh& mesh, const ReducedObjectOptions& options) {
  check(options.training);
  check_positive(options.check_tolerance, "reduced object: check_tolerance");
  check_positive(options.reach_m, "reduced object: reach_m");
  check_positive(options.spacing.apart_m, "reduced object: spacing.apart_m");
  check_positive(options.patience, "reduced object: patience");
  check_positive(options.passes, "reduced object: passes");
  check_positive(options.passes_again, "reduced object: passes_again");
  check_positive(options.check_every, "reduced object: check_every");
  if (options.first_states < 1 || options.first_states > options.spacing.most_states) {
    throw Error("reduced object: first_states is " + std::to_string(options.first_states) +
                "; give 1 to spacing.most_states, " + std::to_string(options.spacing.most_states));
  }
  refuse_elements(mesh, "solver reduced: ", "leave --solver out");
  return mesh;
}

// A deferred one runs within get().
template <typename Result>
bool is_ready(const std::future<Result>& future) {
  return future.valid() && future.wait_for(std::chrono::seconds(0)) != std::future_status::timeout;
}

double rms_force_N(const ReducedTrainingSet& set) {
  double sum_N2 = 0.0;
  for (const ReducedSnapshot& state : set.snapshots) {
    sum_N2 += state.force_W.squaredNorm();
  }
  return std::sqrt(sum_N2 / static_cast<double>(std::max<std::size_t>(set.snapshots.size(), 1)));
}

std::string percent(double fraction) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f %%", 100.0 * fraction);
  return text;
}

}  // namespace

ReducedObject::ReducedObject(const SpringMesh& mesh, ReducedObjectOptions options)
    : mesh_(checked(mesh, options)), options_(std::move(options)), full_(mesh, options_.solver) {
  options_.training.cancel = &cancel_;
}

ReducedObject::~ReducedObject() { forget(); }

std::launch ReducedObject::policy() const noexcept {
  return options_.own_threads ? std::launch::async : std::launch::deferred;
}

void ReducedObject::tell(const std::string& what) {
  if (!options_.say || told_ > kMostTold) {
    return;
  }
  options_.say("reduced model " + what +
               (told_++ == kMostTold ? "; what follows is only counted" : ""));
}

// Ends the work on other threads, and drops all that was learnt during this grab.
void ReducedObject::forget() noexcept {
  cancel_ = true;
  if (check_.valid()) {
    check_.wait();
    check_ = {};
  }
  if (training_.valid()) {
    training_.wait();
    training_ = {};
  }
  cancel_ = false;
  model_.reset();
  set_.snapshots.clear();
  new_states_ = 0;
  has_failed_ = false;
  since_new_state_ = 0;
  apart_m_ = options_.spacing.apart_m;
  left_branch_ = false;
  use_.in_use = false;
}

int ReducedObject::grab(const Eigen::Vector3d& point_W, double radius_m) {
  if (!full_.grabbed()) {
    forget();
  }
  const int held = full_.grab(point_W, radius_m);
  if (held > 0) {
    held_ = true;
    displacement_W_.setZero();
    set_ = begin_training_set(mesh_, full_);
  }
  return held;
}

void ReducedObject::release() noexcept {
  forget();
  full_.release();
  held_ = false;
}

Equilibrium ReducedObject::move_to(const Eigen::Vector3d& displacement_W) {
  const Equilibrium now = answer(displacement_W);
  displacement_W_ = now.displacement_W;
  return now;
}

// Notes the full object's state, which must be idle.
void ReducedObject::see() noexcept {
  if (!seen_vertices_.empty()) {
    full_.copy(seen_vertices_, seen_);
  }
}

void ReducedObject::copy_positions(const std::vector<std::int32_t>& vertices,
                                   std::vector<Eigen::Vector3d>& position_W) {
  if (vertices != seen_vertices_) {
    if (check_.valid()) {
      finish_check();
    }
    seen_vertices_ = vertices;
    seen_.vertices.resize(vertices.size());
  }
  if (!check_.valid()) {
    see();
  }
  const Eigen::Vector3d moved_W =
      held_ ? Eigen::Vector3d(displacement_W_ - seen_.displacement_W) : Eigen::Vector3d::Zero();
  position_W.resize(vertices.size());
  for (std::size_t n = 0; n < vertices.size(); ++n) {
    const Neighbourhood::Vertex& vertex = seen_.vertices[n];
    position_W[n] = mesh_.top_W + vertex.position_W.cast<double>() +
                    vertex.sensitivity_W.cast<double>() * moved_W;
  }
}

Equilibrium ReducedObject::answer(const Eigen::Vector3d& displacement_W) {
  if (!displacement_W.allFinite() || (!check_.valid() && !full_.grabbed())) {
    if (check_.valid()) {
      finish_check();
    }
    return full_.move_to(displacement_W);
  }
  collect();
  use_.in_use = false;
  if (model_ && passes_left_ == 0 && !left_branch_) {
    const bool near = model_->distance_m(displacement_W) <= options_.reach_m ||
                      displacement_W.norm() <= options_.reach_m;
    Equilibrium answer = near ? model_->move_to(displacement_W) : Equilibrium{};
    if (near && answer.converged) {
      answer.relative_residual = std::max(answer.relative_residual, last_check_);
      ++use_.answers;
      use_.in_use = true;
      start_check(answer);
      return answer;
    }
    ++(near ? use_.not_converged : use_.out_of_reach);
  }
  return full_answer(displacement_W);
}

Equilibrium ReducedObject::full_answer(const Eigen::Vector3d& displacement_W) {
  if (check_.valid()) {
    finish_check();
  }
  Equilibrium answer = full_.move_to(displacement_W);
  ++use_.full_answers;
  ++since_new_state_;
  if (answer.left_branch) {
    forget();
  } else if (model_ && answer.converged && answer.reached &&
             model_->distance_m(displacement_W) <= options_.reach_m) {
    const Equilibrium reduced = model_->move_to(displacement_W);
    judge(reduced.force_W, answer.force_W);
  }
  answer.left_branch = answer.left_branch || left_branch_;
  left_branch_ = false;
  if (!training_.valid() && is_new_state(answer, apart_m_, set_)) {
    keep(take_snapshot(mesh_, full_, answer));
  }
  train_if_worth_it();
  return answer;
}

void ReducedObject::start_check(const Equilibrium& reduced) {
  if (check_.valid() || --until_check_ > 0) {
    return;
  }
  until_check_ = options_.check_every;
  const bool wanted = !training_.valid();
  check_ = std::async(policy(), [this, reduced, wanted] {
    Checked found{full_.move_to(reduced.displacement_W), reduced.force_W, std::nullopt};
    // `wanted`: no training has begun since, as only finish_check() and full_answer() begin one.
    if (wanted && is_new_state(found.full, apart_m_, set_)) {
      found.state = take_snapshot(mesh_, full_, found.full);
    }
    return found;
  });
}

void ReducedObject::finish_check() {
  Checked found = check_.get();
  see();
  if (found.full.left_branch) {
    tell("forgotten: the object has left its branch of equilibria");
    forget();
    left_branch_ = true;
    return;
  }
  if (!found.full.converged || !found.full.reached) {
    return;
  }
  judge(found.reduced_force_W, found.full.force_W);
  if (found.state && !training_.valid()) {
    keep(std::move(*found.state));
  }
  train_if_worth_it();
}

void ReducedObject::collect() {
  if (is_ready(check_)) {
    finish_check();
  }
  if (is_ready(training_)) {
    finish_training();
  }
}

void ReducedObject::judge(const Eigen::Vector3d& reduced_force_W,
                          const Eigen::Vector3d& full_force_W) {
  const double scale_N = std::max(full_force_W.norm(), model_force_N_);
  const double error = (reduced_force_W - full_force_W).norm() / scale_N;
  last_check_ = error;
  ++use_.checks;
  if (error <= options_.check_tolerance) {
    use_.worst_check = std::max(use_.worst_check, error);
    if (passes_left_ > 0 && --passes_left_ == 0) {
      tell("in use: " + std::to_string(model_->modes()) + " modes and " +
           std::to_string(model_->springs()) + " springs from " + std::to_string(use_.states) +
           " states");
    }
    return;
  }
  use_.worst_check = std::isfinite(error) ? std::max(use_.worst_check, error) : use_.worst_check;
  ++use_.failed_checks;
  has_failed_ = true;
  if (set_.snapshots.size() < options_.spacing.most_states / 2) {
    apart_m_ = std::max(std::min(kNearest_m, apart_m_), kDenser * apart_m_);
  }
  if (passes_left_ == 0) {
    tell("not used for now: its force is off by " + percent(error) + ", more than " +
         percent(options_.check_tolerance) + "; the full object answers");
  }
  passes_left_ = options_.passes_again;
}

void ReducedObject::keep(ReducedSnapshot state) {
  set_.snapshots.push_back(std::move(state));
  ++new_states_;
  since_new_state_ = 0;
  if (set_.snapshots.size() < options_.spacing.most_states) {
    return;
  }
  apart_m_ *= kThinner;
  std::vector<ReducedSnapshot> kept;
  for (ReducedSnapshot& known : set_.snapshots) {
    const bool far = std::all_of(kept.begin(), kept.end(), [&](const ReducedSnapshot& other) {
      return (other.displacement_W - known.displacement_W).norm() >= apart_m_;
    });
    if (far) {
      kept.push_back(std::move(known));
    }
  }
  set_.snapshots = std::move(kept);
}

void ReducedObject::train_if_worth_it() {
  const std::size_t count = set_.snapshots.size();
  const auto quarter = static_cast<std::size_t>(kWorthTraining * static_cast<double>(count));
  const bool settled = since_new_state_ >= options_.patience;
  const bool enough = count >= options_.first_states || (count >= kFewestStates && settled);
  const bool more =
      new_states_ >= (has_failed_ ? kNewAfterFailure : std::max(kFewestNewStates, quarter)) ||
      (new_states_ > 0 && settled);
  if (training_.valid() || !(model_ ? more : enough)) {
    return;
  }
  new_states_ = 0;
  has_failed_ = false;
  training_ =
      std::async(policy(), [this] { return train_reduced_model(mesh_, set_, options_.training); });
}

void ReducedObject::finish_training() {
  ReducedTraining training = training_.get();
  if (!training.model) {
    return;
  }
  model_ = std::move(training.model);
  model_force_N_ = rms_force_N(set_);
  passes_left_ = options_.passes;
  until_check_ = 0;
  ++use_.trainings;
  use_.training_s = training.time_s;
  use_.states = set_.snapshots.size();
  use_.modes = model_->modes();
  use_.springs = model_->springs();
}

}  // namespace forcegrid::simulator
