// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/constraint_search.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

constexpr double kAccept_nats = 15.0;
constexpr double kSameDirection = 0.98;  // cosine
constexpr int kStepsOnSearch = 12;
constexpr int kGapsAgainstError = 10;
constexpr int kGapsBesides = 6;
constexpr double kNearError = 0.5;  // cosine
constexpr double kSearchedCurvatures_per_m[] = {-30.0, 20.0, 50.0};
constexpr double kStartingCurvatures_per_m[] = {-40.0, -15.0, 15.0, 40.0, 80.0};
constexpr int kStarts = static_cast<int>(std::size(kStartingCurvatures_per_m));
constexpr int kSolvesOfAStep = 7;  // with three sides, about, and what belongs to them

// Kinds of surfaces: planes against the innovation, balls, planes across lattice directions.
constexpr int kBalls = static_cast<int>(std::size(kSearchedCurvatures_per_m));
constexpr int kLattice = 1 + kBalls;
constexpr int kDirections = 27;
constexpr int kKinds = kLattice + kDirections;
constexpr double kQuarters[] = {0.25, 0.75};
constexpr double kMiddle[] = {0.5};

// A force that falls short along its own direction means an object that gives way (a cut,
// relaxation), not a wall.
bool gives_way(const Vector3d& expected_N, const Vector3d& force_N) noexcept {
  return force_N.norm() < expected_N.norm() &&
         force_N.dot(expected_N) > kSameDirection * force_N.norm() * expected_N.norm();
}

}  // namespace

// Compares up to three new constraints, added to those in use, with the best of this kind, by k1
// alone.
void ConstraintSearch::weigh(const ConstraintFit& fit,
                             std::span<const UnilateralConstraint> shapes) noexcept {
  const int rows = fit.factor().rows();
  int first = rows;
  std::size_t row = 0;
  for (const Vector3d& position_W : fit.positions_W()) {
    for (std::size_t t = 0; t < 3; ++t) {
      Vector3d push_N = Vector3d::Zero();
      if (t < shapes.size() && shapes[t].curvature_per_m == 0.0) {
        push_N = UnilateralConstraint::kStiffness_N_per_m *
                 shapes[t].penetration_m(depth_m_[row / 3] + shapes[t].depth_m) *
                 shapes[t].normal_W;
      } else if (t < shapes.size()) {
        const UnilateralConstraint::At at = shapes[t].at(position_W);
        push_N = UnilateralConstraint::kStiffness_N_per_m * at.penetration_m * at.inward_W;
      }
      for (int a = 0; a < 3; ++a) {
        trial_.x[t][row + static_cast<std::size_t>(a)] = push_N[a];
      }
      if (push_N != Vector3d::Zero()) {
        first = std::min(first, static_cast<int>(row));
      }
    }
    row += 3;
  }
  double* const three[3] = {trial_.x[0].data(), trial_.x[1].data(), trial_.x[2].data()};
  fit.factor().solve_from(first, three);
  done_ += cost(rows);
  for (std::size_t t = 0; t < shapes.size(); ++t) {
    const auto times = [&](const Column& column) {
      return ConstraintFit::dot(trial_.x[t], column, first, rows);
    };
    double own = 1.0 + times(trial_.x[t]);
    const double seen = times(fit.residual());
    Weights crossed = Weights::Zero();
    for (int h = 0; h < fit.count(); ++h) {
      crossed[2 * h] = times(fit.columns(h).x[0]);
      crossed[2 * h + 1] = times(fit.columns(h).x[1]);
    }
    own -= crossed.dot(fit.solution().inverse * crossed);
    const double nats = 0.5 * seen * seen / (own * fit.data_scale()) - 0.5 * std::log(own);
    if (seen < 0.0 && own > 0.0 && nats > weighed_.nats) {
      weighed_ = {shapes[t], nats};
    }
  }
}

// Tries surfaces behind and parallel to `through`, whose own depth is zero: some in each of the
// first gaps between samples.
void ConstraintSearch::weigh_behind(const ConstraintFit& fit, const UnilateralConstraint& through,
                                    int gaps, std::span<const double> parts) noexcept {
  std::array<double, ConstraintFit::kMaxSamples> behind_m{};
  int behind = 0;
  std::size_t sample = 0;
  for (const Vector3d& position_W : fit.positions_W()) {
    const double depth_m = through.at(position_W).depth_m;
    depth_m_[sample++] = depth_m;
    if (depth_m < 0.0) {
      behind_m[static_cast<std::size_t>(behind++)] = -depth_m;
    }
  }
  std::sort(behind_m.begin(), behind_m.begin() + behind);
  std::array<UnilateralConstraint, 3> shapes;
  std::size_t pending = 0;
  double from_m = 0.0;
  for (int i = 0; i < std::min(gaps, behind); ++i) {
    const double to_m = behind_m[static_cast<std::size_t>(i)];
    for (const double part : parts) {
      shapes[pending] = through;
      shapes[pending].depth_m = from_m + part * (to_m - from_m);
      if (++pending == shapes.size()) {
        weigh(fit, shapes);
        pending = 0;
      }
    }
    from_m = to_m;
  }
  weigh(fit, std::span(shapes).first(pending));
}

void ConstraintSearch::begin(const Observation& o, const Vector3d& error_N) noexcept {
  observation_ = o;
  error_N_ = error_N;
  stage_ = Stage::kBegins;
  found_ = false;
  pieces_ = 0;
}

// What the next piece may cost. An answer that has not converged lags, which is seldom a wall.
int ConstraintSearch::piece() const noexcept {
  constexpr int kSwift[] = {kSwiftestPiece, kSwiftestPiece, kSwiftestPiece, kSwiftPiece};
  const auto later = static_cast<std::size_t>(pieces_ + 2 * in_vain_);
  const int swift = observation_.unfinished ? kUnfinishedPiece : kSwiftestPiece;
  return later < std::size(kSwift) ? std::min(swift, kSwift[later]) : kPiece;
}

bool ConstraintSearch::step(ConstraintFit& fit) noexcept {
  const int most = piece();
  ++pieces_;
  done_ = 0;
  while (stage_ != Stage::kOver && done_ < most) {
    go_on(fit);
  }
  return stage_ != Stage::kOver;
}

void ConstraintSearch::end(bool found) noexcept {
  stage_ = Stage::kOver;
  found_ = found;
  in_vain_ = found ? std::max(0, in_vain_ - 1) : std::min(in_vain_ + 1, kMostInVain);
}

void ConstraintSearch::go_on(ConstraintFit& fit) noexcept {
  const int solve = cost(fit.factor().rows());
  switch (stage_) {
    case Stage::kBegins:
      fit.refit();
      done_ += fit.count() * solve;
      if (fit.count() == 0) {
        begin_comparing(fit);
        return;
      }
      at_ = 0;
      stage_ = Stage::kRefining;
      fit.begin_refining(0, ConstraintFit::kStepsOnSurprise);
      return;
    case Stage::kRefining:
      done_ += kSolvesOfAStep * solve;
      if (fit.refine_once()) {
        return;
      }
      if (++at_ < fit.count()) {
        fit.begin_refining(at_, ConstraintFit::kStepsOnSurprise);
      } else if (fit.explains_all_samples()) {
        end(true);
      } else {
        at_ = 0;
        stage_ = Stage::kRefiningAnew;
        begin_anew(fit);
      }
      return;
    case Stage::kRefiningAnew:
      done_ += kSolvesOfAStep * solve;
      if (!fit.refine_once()) {
        go_on_anew(fit);
      }
      return;
    case Stage::kComparing:
      compare(fit);
      return;
    case Stage::kRefiningFound:
      done_ += kSolvesOfAStep * solve;
      if (fit.refine_once()) {
        return;
      }
      if (--at_ >= 0) {
        fit.begin_refining(at_, kStepsOnSearch);
      } else {
        judge_found(fit);
      }
      return;
    case Stage::kOver:
      return;
  }
}

// Constraint `at_` of the present ones, from the first of the other curvatures.
void ConstraintSearch::begin_anew(ConstraintFit& fit) noexcept {
  fit.refit();
  before_ = best_start_ = fit.constraints()[static_cast<std::size_t>(at_)];
  best_start_nats_ = fit.gain();
  start_ = 0;
  fit.begin_refining_from(at_, before_.bent(kStartingCurvatures_per_m[0]),
                          ConstraintFit::kStepsOnSurprise);
}

// It has been refined from one of them.
void ConstraintSearch::go_on_anew(ConstraintFit& fit) noexcept {
  if (fit.gain() > best_start_nats_) {
    best_start_nats_ = fit.gain();
    best_start_ = fit.constraints()[static_cast<std::size_t>(at_)];
  }
  if (++start_ < kStarts) {
    fit.begin_refining_from(at_, before_.bent(kStartingCurvatures_per_m[start_]),
                            ConstraintFit::kStepsOnSurprise);
    return;
  }
  fit.begin_refining_from(at_, best_start_, 0);
  if (++at_ < fit.count()) {
    begin_anew(fit);
  } else if (fit.explains_all_samples()) {
    end(true);
  } else {
    begin_comparing(fit);
  }
}

// Finds new constraints, in addition to those in use or to all but one of them, that could explain
// the sample.
void ConstraintSearch::begin_comparing(ConstraintFit& fit) noexcept {
  if (gives_way(observation_.force_N - error_N_, observation_.force_N)) {
    end(false);
    return;
  }
  refined_ = fit.constraints();
  refined_count_ = fit.count();
  best_count_ = 0;
  best_nats_ = std::max(0.0, fit.gain()) + kAccept_nats;
  replaced_ = 0;
  begin_replacing(fit);
}

void ConstraintSearch::begin_replacing(ConstraintFit& fit) noexcept {
  others_ = refined_;
  others_count_ = refined_count_;
  if (refined_count_ == ConstraintFit::kMaxConstraints) {
    others_[static_cast<std::size_t>(replaced_)] = refined_[ConstraintFit::kMaxConstraints - 1];
    --others_count_;
  }
  fit.set_constraints(others_, others_count_);
  fit.refit();
  fit.update_residual();
  kind_ = 0;
  new_count_ = 0;
  weighed_ = {};
  stage_ = Stage::kComparing;
}

// Surfaces of one kind. The best plane and the best ball against the innovation, and the best plane
// across a lattice direction, are kept.
void ConstraintSearch::compare(ConstraintFit& fit) noexcept {
  UnilateralConstraint through;
  through.anchor_W = observation_.position_m + observation_.origin_W;
  through.normal_W = -error_N_.normalized();
  through.softness_m = UnilateralConstraint::kHardest_m;
  if (kind_ >= kLattice) {
    const int i = kind_ - kLattice;
    const Vector3d lattice(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
    if (lattice.dot(through.normal_W) > kNearError * lattice.norm()) {
      through.normal_W = lattice.normalized();
      weigh_behind(fit, through, kGapsBesides, kMiddle);
    }
  } else if (kind_ >= 1) {
    through.curvature_per_m = kSearchedCurvatures_per_m[kind_ - 1];
    weigh_behind(fit, through, kGapsBesides, kQuarters);
  } else {
    weigh_behind(fit, through, kGapsAgainstError, kQuarters);
  }
  ++kind_;
  if (kind_ == 1 || kind_ == kLattice || kind_ == kKinds) {
    keep_weighed();
  }
  if (kind_ == kKinds) {
    tried_ = -1;
    begin_refining_found(fit);
  }
}

void ConstraintSearch::keep_weighed() noexcept {
  if (weighed_.nats > 0.0) {
    UnilateralConstraint& kept = new_[static_cast<std::size_t>(new_count_++)];
    kept = weighed_.constraint;
    kept.softness_m = UnilateralConstraint::kUsualSoftness_m;
  }
  weighed_ = {};
}

// The next of the new ones or, if there is none, the next one to replace.
void ConstraintSearch::begin_refining_found(ConstraintFit& fit) noexcept {
  if (++tried_ < new_count_) {
    Shapes tried = others_;
    tried[static_cast<std::size_t>(others_count_)] = new_[static_cast<std::size_t>(tried_)];
    fit.set_constraints(tried, others_count_ + 1);
    fit.refit();
    at_ = others_count_;
    fit.begin_refining(at_, kStepsOnSearch);
    stage_ = Stage::kRefiningFound;
    return;
  }
  if (refined_count_ == ConstraintFit::kMaxConstraints &&
      ++replaced_ < ConstraintFit::kMaxConstraints) {
    begin_replacing(fit);
    return;
  }
  fit.set_constraints(best_, best_count_);
  fit.refit();
  end(best_count_ > 0);
}

void ConstraintSearch::judge_found(ConstraintFit& fit) noexcept {
  if (fit.gain() > best_nats_) {
    best_nats_ = fit.gain();
    best_ = fit.constraints();
    best_count_ = fit.count();
  }
  begin_refining_found(fit);
}

}  // namespace forcegrid::kriging
