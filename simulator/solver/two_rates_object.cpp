// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/two_rates_object.h"

#include <sys/resource.h>

#include <algorithm>
#include <string>
#include <utility>

#include "rt/thread.h"
#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

constexpr int kNice = 15;  // so that answers come first
// Of the force: with so much work on the border, the object outside is no longer known.
constexpr double kBorderMoved = 0.1;

const TwoRatesOptions& checked(const TwoRatesOptions& options) {
  if (!(options.near.border_tolerance > 0.0) || options.near.most_vertices <= 0) {
    throw Error("two rates: near.border_tolerance is " +
                std::to_string(options.near.border_tolerance) + " and near.most_vertices " +
                std::to_string(options.near.most_vertices) + "; both must be > 0");
  }
  if (options.whole.border_tolerance != 0.0) {
    throw Error("two rates: whole.border_tolerance is " +
                std::to_string(options.whole.border_tolerance) +
                "; it must be 0, which is the whole object");
  }
  return options;
}

}  // namespace

TwoRatesObject::TwoRatesObject(const SpringMesh& mesh, const TwoRatesOptions& options)
    : options_(checked(options)), near_(mesh, options.near), whole_(mesh, options.whole) {
  if (options_.own_thread) {
    solver_ = std::jthread([this] { run(); });
  }
}

TwoRatesObject::~TwoRatesObject() {
  if (solver_.joinable()) {
    // A solution in progress sets kNear at its end, and would overwrite a value set before that.
    turn_.wait(Turn::kWhole);
    turn_ = Turn::kQuit;
    turn_.notify_all();
  }
}

int TwoRatesObject::grab(const Eigen::Vector3d& point_W, double radius_m) {
  const int held = near_.grab(point_W, radius_m);
  if (held > 0) {
    point_W_ = point_W;
    radius_m_ = radius_m;
    vertices_ = near_.neighbourhood();
    grip_waits_ = true;
    if (turn_ == Turn::kNear) {
      ask({});
    }
  }
  return held;
}

void TwoRatesObject::release() noexcept {
  near_.release();
  grip_waits_ = false;
  jumped_ = false;
  if (turn_ == Turn::kNear) {
    job_.held = false;
  }
}

Equilibrium TwoRatesObject::move_to(const Eigen::Vector3d& displacement_W) noexcept {
  if (turn_ == Turn::kNear) {
    take();
  }
  Equilibrium answer = near_.move_to(displacement_W);
  if (!grabbed()) {
    return answer;
  }
  answer.left_branch |= std::exchange(jumped_, false);
  const double scale_N = std::max(answer.force_W.norm(), options_.near.force_floor_N);
  answer.converged = answer.converged && answer.border_work_N <= kBorderMoved * scale_N;
  if (turn_ == Turn::kNear) {
    ask(answer);
  }
  return answer;
}

void TwoRatesObject::take() noexcept {
  if (std::exchange(job_.solved, false) && job_.held && grabbed() && !grip_waits_) {
    near_.correct(job_.was, job_.is);
    jumped_ |= job_.left_branch;
    ++whole_solutions_;
  }
}

void TwoRatesObject::ask(const Equilibrium& answer) noexcept {
  job_.solved = false;
  job_.grab = std::exchange(grip_waits_, false);
  if (job_.grab) {
    job_.point_W = point_W_;
    job_.radius_m = radius_m_;
    job_.vertices.swap(vertices_);
  } else if (job_.held && answer.force_W.allFinite() &&
             answer.displacement_W != job_.is.displacement_W) {
    near_.copy(job_.vertices, job_.was);
  } else {
    return;
  }
  turn_ = Turn::kWhole;
  turn_.notify_all();
}

void TwoRatesObject::grab_whole() noexcept {
  job_.held = false;
  try {
    job_.was.vertices.resize(job_.vertices.size());
    job_.is.vertices.resize(job_.vertices.size());
    whole_.release();
    job_.held = whole_.grab(job_.point_W, job_.radius_m) > 0;
  } catch (...) {
    // Out of memory: nothing is handed over, and the border's work shows it.
    whole_.release();
  }
  job_.is.displacement_W.setZero();
}

void TwoRatesObject::solve_whole() noexcept {
  if (job_.grab) {
    grab_whole();
    return;
  }
  const Equilibrium found = whole_.move_to(job_.was.displacement_W);
  job_.solved = found.reached && found.force_W.allFinite() && found.stiffness_W.allFinite();
  job_.left_branch = found.left_branch;
  whole_.copy(job_.vertices, job_.is);
}

void TwoRatesObject::hand_over() noexcept {
  turn_ = Turn::kNear;
  turn_.notify_all();
}

void TwoRatesObject::run() noexcept {
  rt::name_current_thread("fg-whole");
  // If this is refused, the answers only come later.
  static_cast<void>(::setpriority(PRIO_PROCESS, 0, kNice));
  for (;;) {
    turn_.wait(Turn::kNear);
    if (turn_ == Turn::kQuit) {
      return;
    }
    solve_whole();
    hand_over();
  }
}

}  // namespace forcegrid::simulator
