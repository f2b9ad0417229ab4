// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/constraint_search.h"

#include <algorithm>
#include <cmath>

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

// A force that falls short along its own direction means an object that gives way (a cut,
// relaxation), not a wall.
bool gives_way(const Vector3d& expected_N, const Vector3d& force_N) noexcept {
  return force_N.norm() < expected_N.norm() &&
         force_N.dot(expected_N) > kSameDirection * force_N.norm() * expected_N.norm();
}

}  // namespace

// Compares up to three new constraints, added to those in use, with the best so far, by k1 alone.
void ConstraintSearch::weigh(const ConstraintFit& fit, std::span<const UnilateralConstraint> shapes,
                             Candidate& best) noexcept {
  const auto rows = static_cast<std::size_t>(fit.factor().rows());
  int first = static_cast<int>(rows);
  std::size_t row = 0;
  for (const Vector3d& position_W : fit.positions_W()) {
    for (std::size_t t = 0; t < 3; ++t) {
      Vector3d push_N = Vector3d::Zero();
      if (t < shapes.size()) {
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
  for (std::size_t t = 0; t < shapes.size(); ++t) {
    const Column& x = trial_.x[t];
    double own = 1.0;
    double seen = 0.0;
    Weights crossed = Weights::Zero();
    for (std::size_t r = static_cast<std::size_t>(first); r < rows; ++r) {
      own += x[r] * x[r];
      seen += x[r] * fit.residual()[r];
      for (int h = 0; h < fit.count(); ++h) {
        const Columns& c = fit.columns(h);
        crossed[2 * h] += c.x[0][r] * x[r];
        crossed[2 * h + 1] += c.x[1][r] * x[r];
      }
    }
    own -= crossed.dot(fit.solution().inverse * crossed);
    const double nats = 0.5 * seen * seen / (own * fit.data_scale()) - 0.5 * std::log(own);
    if (seen < 0.0 && own > 0.0 && nats > best.nats) {
      best = {shapes[t], nats};
    }
  }
}

// Tries surfaces behind and parallel to `through`: some in each of the first gaps between samples.
void ConstraintSearch::weigh_behind(const ConstraintFit& fit, const UnilateralConstraint& through,
                                    int gaps, std::span<const double> parts,
                                    Candidate& best) noexcept {
  std::array<double, ConstraintFit::kMaxSamples> behind_m{};
  int behind = 0;
  for (const Vector3d& position_W : fit.positions_W()) {
    const double depth_m = through.at(position_W).depth_m;
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
        weigh(fit, shapes, best);
        pending = 0;
      }
    }
    from_m = to_m;
  }
  weigh(fit, std::span(shapes).first(pending), best);
}

// Finds new constraints, in addition to those in use, that could explain the newest sample: the
// best plane and the best ball against the innovation, and the best plane across a lattice
// direction. @returns how many.
int ConstraintSearch::search(ConstraintFit& fit, const Observation& o, const Vector3d& error_N,
                             Found& found) noexcept {
  fit.update_residual();
  int count = 0;
  Candidate best;
  const auto keep = [&] {
    if (best.nats > 0.0) {
      found[static_cast<std::size_t>(count)] = best.constraint;
      found[static_cast<std::size_t>(count++)].softness_m = UnilateralConstraint::kUsualSoftness_m;
    }
    best = {};
  };
  UnilateralConstraint through;
  through.anchor_W = o.position_m + o.origin_W;
  through.normal_W = -error_N.normalized();
  through.softness_m = UnilateralConstraint::kHardest_m;
  const Vector3d against = through.normal_W;
  constexpr double kQuarters[] = {0.25, 0.75};
  constexpr double kMiddle[] = {0.5};
  weigh_behind(fit, through, kGapsAgainstError, kQuarters, best);
  keep();
  for (const double curvature_per_m : kSearchedCurvatures_per_m) {
    through.curvature_per_m = curvature_per_m;
    weigh_behind(fit, through, kGapsBesides, kQuarters, best);
  }
  keep();
  through.curvature_per_m = 0.0;
  for (int i = 0; i < 27; ++i) {
    const Vector3d lattice(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
    if (lattice.dot(against) > kNearError * lattice.norm()) {
      through.normal_W = lattice.normalized();
      weigh_behind(fit, through, kGapsBesides, kMiddle, best);
    }
  }
  keep();
  return count;
}

// Refines the constraints in use. @returns whether that explains all samples.
bool ConstraintSearch::refine_known(ConstraintFit& fit) const noexcept {
  if (fit.count() == 0) {
    return false;
  }
  for (int h = 0; h < fit.count(); ++h) {
    fit.refine(h, ConstraintFit::kStepsOnSurprise);
  }
  if (fit.explains_all_samples()) {
    return true;
  }
  for (int h = 0; h < fit.count(); ++h) {
    fit.refine_anew(h);
  }
  return fit.explains_all_samples();
}

bool ConstraintSearch::explain(ConstraintFit& fit, const Observation& o,
                               const Vector3d& error_N) noexcept {
  fit.refit();
  if (refine_known(fit)) {
    return true;
  }
  if (gives_way(o.force_N - error_N, o.force_N)) {
    return false;
  }
  const Shapes refined = fit.constraints();
  const int refined_count = fit.count();
  Shapes best = refined;
  int best_count = 0;
  double best_nats = std::max(0.0, fit.gain()) + kAccept_nats;
  const bool replacing = refined_count == ConstraintFit::kMaxConstraints;
  for (int replaced = 0; replaced < (replacing ? ConstraintFit::kMaxConstraints : 1); ++replaced) {
    Shapes others = refined;
    int count = refined_count;
    if (replacing) {
      others[static_cast<std::size_t>(replaced)] = refined[ConstraintFit::kMaxConstraints - 1];
      --count;
    }
    fit.set_constraints(others, count);
    fit.refit();
    Found found;
    const int found_count = search(fit, o, error_N, found);
    for (int c = 0; c < found_count; ++c) {
      Shapes tried = others;
      tried[static_cast<std::size_t>(count)] = found[static_cast<std::size_t>(c)];
      fit.set_constraints(tried, count + 1);
      fit.refit();
      for (int h = count; h >= 0; --h) {
        fit.refine(h, kStepsOnSearch);
      }
      const double nats = fit.gain();
      if (nats > best_nats) {
        best_nats = nats;
        best = fit.constraints();
        best_count = fit.count();
      }
    }
  }
  fit.set_constraints(best, best_count);
  return best_count > 0;
}

}  // namespace forcegrid::kriging
