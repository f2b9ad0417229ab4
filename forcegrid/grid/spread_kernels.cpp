// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/spread_kernels.h"

#include "forcegrid/grid/spread_kernels_scalar.h"

// Compiled once for each instruction set that is worth it. AVX-512 gains nothing on eight lanes.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "forcegrid/grid/spread_kernels.cpp"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace forcegrid {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Lanes = hn::CappedTag<float, kSegmentVertices>;
using Floats = hn::Vec<Lanes>;
constexpr Lanes kLanes{};

Floats splat(float value) { return hn::Set(kLanes, value); }

// Distances along z of the lanes from the segment's first vertex.
Floats z_steps(const SpreadConstants& c, std::size_t first_lane) {
  return hn::Mul(hn::Iota(kLanes, static_cast<float>(first_lane)), splat(c.spacing_z_m));
}

// Zero for vertices that the sample does not reach.
template <WeightKind kKind>
Floats weight_at(const SpreadConstants& c, Floats distance2_m2) {
  const Floats one = splat(1.0F);
  const Floats distance_m = hn::Sqrt(distance2_m2);
  const Floats d = hn::Mul(distance_m, splat(c.inverse_scale_per_m));
  const Floats d2 = hn::Mul(d, d);
  Floats weight;
  if constexpr (kKind == WeightKind::kPaper) {
    const Floats lorentzian = hn::Div(one, hn::Add(one, d2));
    weight = hn::Max(hn::NegMulAdd(d, splat(c.slope), lorentzian), hn::Zero(kLanes));
  } else {
    const Floats fade = hn::NegMulAdd(distance_m, splat(c.inverse_radius_per_m), one);
    const Floats d4 = hn::Mul(d2, d2);
    const Floats falling = kKind == WeightKind::kInverse4 ? d4 : hn::Mul(d4, d2);
    weight = hn::Div(hn::Mul(fade, fade), hn::Add(splat(0.05F), falling));
  }
  return hn::IfThenElseZero(hn::Lt(distance2_m2, splat(c.radius2_m2)), weight);
}

template <WeightKind kKind, bool kStiffness>
void spread_force_of(const SpreadConstants& c, const SpreadSample& sample,
                     const SegmentWork<ForceSegment>* work, std::size_t count) {
  const Floats zero = hn::Zero(kLanes);
  for (std::size_t s = 0; s < count; ++s) {
    const float x = work[s].x_m;
    const float y = work[s].y_m;
    const float xy2 = x * x + y * y;
    std::array<float, 3> target_N = sample.force_W_N;
    const auto& stiffness = sample.stiffness_W_N_per_m;
    if constexpr (kStiffness) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        target_N[axis] += stiffness[3 * axis] * x + stiffness[3 * axis + 1] * y;
      }
    }
    for (std::size_t lane = 0; lane < kSegmentVertices; lane += hn::Lanes(kLanes)) {
      const Floats z = hn::Add(z_steps(c, lane), splat(work[s].z_m));
      const Floats added = weight_at<kKind>(c, hn::MulAdd(z, z, splat(xy2)));
      float* const values = work[s].segment->vertices[lane].force_W_N.data();
      Floats fx, fy, fz, old_weight;
      hn::LoadInterleaved4(kLanes, values, fx, fy, fz, old_weight);
      const Floats weight = hn::Add(hn::Max(old_weight, zero), added);
      const auto reached = hn::Gt(added, zero);
      const Floats share = hn::IfThenElseZero(reached, hn::Div(added, weight));
      const auto target = [&](std::size_t axis) {
        if constexpr (kStiffness) {
          return hn::MulAdd(splat(stiffness[3 * axis + 2]), z, splat(target_N[axis]));
        } else {
          return splat(target_N[axis]);
        }
      };
      fx = hn::MulAdd(share, hn::Sub(target(0), fx), fx);
      fy = hn::MulAdd(share, hn::Sub(target(1), fy), fy);
      fz = hn::MulAdd(share, hn::Sub(target(2), fz), fz);
      hn::StoreInterleaved4(fx, fy, fz, hn::IfThenElse(reached, weight, old_weight), kLanes,
                            values);
    }
  }
}

template <WeightKind kKind>
void spread_force_by(const SpreadConstants& c, const SpreadSample& sample,
                     const SegmentWork<ForceSegment>* work, std::size_t count) {
  if (sample.has_stiffness) {
    spread_force_of<kKind, true>(c, sample, work, count);
  } else {
    spread_force_of<kKind, false>(c, sample, work, count);
  }
}

void spread_force(const SpreadConstants& c, const SpreadSample& sample,
                  const SegmentWork<ForceSegment>* work, std::size_t count) {
  switch (c.kind) {
    case WeightKind::kPaper:
      return spread_force_by<WeightKind::kPaper>(c, sample, work, count);
    case WeightKind::kInverse4:
      return spread_force_by<WeightKind::kInverse4>(c, sample, work, count);
    case WeightKind::kInverse6:
      return spread_force_by<WeightKind::kInverse6>(c, sample, work, count);
  }
}

template <WeightKind kKind>
void spread_moments_of(const SpreadConstants& c, const SpreadSample& sample,
                       const SegmentWork<MomentSegment>* work, std::size_t count) {
  const auto add = [](std::array<float, kSegmentVertices>& moment, std::size_t lane, Floats value) {
    float* const at = moment.data() + lane;
    hn::Store(hn::Add(hn::Load(kLanes, at), value), kLanes, at);
  };
  const float scale = -c.inverse_radius_per_m;
  for (std::size_t s = 0; s < count; ++s) {
    const float xy2 = work[s].x_m * work[s].x_m + work[s].y_m * work[s].y_m;
    for (std::size_t lane = 0; lane < kSegmentVertices; lane += hn::Lanes(kLanes)) {
      const Floats z = hn::Add(z_steps(c, lane), splat(work[s].z_m));
      const Floats w = weight_at<kKind>(c, hn::MulAdd(z, z, splat(xy2)));
      const Floats u[3] = {splat(scale * work[s].x_m), splat(scale * work[s].y_m),
                           hn::Mul(splat(scale), z)};
      const Floats wu[3] = {hn::Mul(w, u[0]), hn::Mul(w, u[1]), hn::Mul(w, u[2])};
      auto& m = work[s].segment->moments;
      add(m[0], lane, w);
      for (std::size_t i = 0; i < 3; ++i) {
        add(m[1 + i], lane, wu[i]);
        add(m[4 + i], lane, hn::Mul(wu[i], u[i]));
        const Floats force = splat(sample.force_W_N[i]);
        add(m[10 + i], lane, hn::Mul(w, force));
        for (std::size_t j = 0; j < 3; ++j) {
          add(m[13 + 3 * i + j], lane, hn::Mul(wu[j], force));
        }
      }
      add(m[7], lane, hn::Mul(wu[0], u[1]));
      add(m[8], lane, hn::Mul(wu[0], u[2]));
      add(m[9], lane, hn::Mul(wu[1], u[2]));
    }
  }
}

void spread_moments(const SpreadConstants& c, const SpreadSample& sample,
                    const SegmentWork<MomentSegment>* work, std::size_t count) {
  switch (c.kind) {
    case WeightKind::kPaper:
      return spread_moments_of<WeightKind::kPaper>(c, sample, work, count);
    case WeightKind::kInverse4:
      return spread_moments_of<WeightKind::kInverse4>(c, sample, work, count);
    case WeightKind::kInverse6:
      return spread_moments_of<WeightKind::kInverse6>(c, sample, work, count);
  }
}

#if HWY_HAVE_FLOAT64
void fit_corners(const CornerMoments& corners, double ridge, CornerForces& forces) {
  const hn::CappedTag<double, 4> doubles;
  const hn::Rebind<float, decltype(doubles)> halves;
  for (std::size_t corner = 0; corner < 8; corner += hn::Lanes(doubles)) {
    const auto moment = [&](std::size_t i) {
      return hn::PromoteTo(doubles, hn::Load(halves, corners.moments[i].data() + corner));
    };
    const auto zero = hn::Zero(doubles);
    const auto one = hn::Set(doubles, 1.0);
    const auto total = moment(0);
    const auto known = hn::Gt(total, zero);
    const auto scale = hn::Div(one, hn::IfThenElse(known, total, one));
    using Doubles = hn::Vec<decltype(doubles)>;
    const auto minus_product = [](Doubles a, Doubles b, Doubles c) {
      return hn::NegMulAdd(b, c, a);
    };
    const Doubles mean[3] = {hn::Mul(scale, moment(1)), hn::Mul(scale, moment(2)),
                             hn::Mul(scale, moment(3))};
    const auto covariance = [&](std::size_t i, std::size_t a, std::size_t b) {
      return minus_product(hn::Mul(scale, moment(i)), mean[a], mean[b]);
    };
    const Doubles on_diagonal = hn::Set(doubles, ridge);
    const Doubles xx = hn::Add(covariance(4, 0, 0), on_diagonal);
    const Doubles yy = hn::Add(covariance(5, 1, 1), on_diagonal);
    const Doubles zz = hn::Add(covariance(6, 2, 2), on_diagonal);
    const Doubles xy = covariance(7, 0, 1);
    const Doubles xz = covariance(8, 0, 2);
    const Doubles yz = covariance(9, 1, 2);
    // s = C^-1 m by the adjugate of the symmetric C.
    const Doubles a = minus_product(hn::Mul(yy, zz), yz, yz);
    const Doubles b = minus_product(hn::Mul(xz, yz), xy, zz);
    const Doubles d = minus_product(hn::Mul(xy, yz), xz, yy);
    const Doubles e = minus_product(hn::Mul(xx, zz), xz, xz);
    const Doubles f = minus_product(hn::Mul(xy, xz), xx, yz);
    const Doubles g = minus_product(hn::Mul(xx, yy), xy, xy);
    const auto dot = [&](Doubles p, Doubles q, Doubles r) {
      return hn::MulAdd(p, mean[0], hn::MulAdd(q, mean[1], hn::Mul(r, mean[2])));
    };
    const Doubles inverse = hn::Div(one, hn::MulAdd(xx, a, hn::MulAdd(xy, b, hn::Mul(xz, d))));
    const Doubles s[3] = {hn::Mul(inverse, dot(a, b, d)), hn::Mul(inverse, dot(b, e, f)),
                          hn::Mul(inverse, dot(d, f, g))};
    for (std::size_t i = 0; i < 3; ++i) {
      const Doubles mean_force_N = hn::Mul(scale, moment(10 + i));
      Doubles moved_N = mean_force_N;
      for (std::size_t j = 0; j < 3; ++j) {
        const Doubles slope =
            minus_product(hn::Mul(scale, moment(13 + 3 * i + j)), mean_force_N, mean[j]);
        moved_N = minus_product(moved_N, slope, s[j]);
      }
      hn::Store(hn::IfThenElseZero(known, moved_N), doubles, forces.force_W_N[i].data() + corner);
    }
  }
}
#else
void fit_corners(const CornerMoments& corners, double ridge, CornerForces& forces) {
  fit_corners_scalar(corners, ridge, forces);
}
#endif

const char* target_name() { return hwy::TargetName(HWY_TARGET); }

}  // namespace HWY_NAMESPACE
}  // namespace forcegrid
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace forcegrid {
namespace {

HWY_EXPORT(spread_force);
HWY_EXPORT(spread_moments);
HWY_EXPORT(fit_corners);
HWY_EXPORT(target_name);

void best_spread_force(const SpreadConstants& constants, const SpreadSample& sample,
                       const SegmentWork<ForceSegment>* work, std::size_t count) noexcept {
  HWY_DYNAMIC_DISPATCH(spread_force)(constants, sample, work, count);
}

void best_spread_moments(const SpreadConstants& constants, const SpreadSample& sample,
                         const SegmentWork<MomentSegment>* work, std::size_t count) noexcept {
  HWY_DYNAMIC_DISPATCH(spread_moments)(constants, sample, work, count);
}

void best_fit_corners(const CornerMoments& corners, double ridge, CornerForces& forces) noexcept {
  HWY_DYNAMIC_DISPATCH(fit_corners)(corners, ridge, forces);
}

}  // namespace

// Asking for the name selects the instruction set here, before any cycle runs.
SpreadKernel<ForceSegment> spread_force_kernel(Instructions instructions) noexcept {
  static_cast<void>(best_instructions());
  return instructions == Instructions::kScalar ? spread_force_scalar : best_spread_force;
}

SpreadKernel<MomentSegment> spread_moments_kernel(Instructions instructions) noexcept {
  static_cast<void>(best_instructions());
  return instructions == Instructions::kScalar ? spread_moments_scalar : best_spread_moments;
}

FitCorners fit_corners_kernel(Instructions instructions) noexcept {
  static_cast<void>(best_instructions());
  return instructions == Instructions::kScalar ? fit_corners_scalar : best_fit_corners;
}

const char* best_instructions() noexcept { return HWY_DYNAMIC_DISPATCH(target_name)(); }

}  // namespace forcegrid
#endif
