// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_simd.h"

#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "forcegrid/pair/pair_simd.cpp"
#include <hwy/foreach_target.h>
// Highway compiles what follows once for each instruction set.
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace forcegrid::pair {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// x, y and z of one tool, a lane for each sample.
template <class V>
struct ToolLanes {
  V x, y, z;
};

template <class D, class V = hn::Vec<D>>
HWY_INLINE ToolLanes<V> offset(D d, const PairTerms& terms, int tool, int first,
                               const ToolLanes<V>& p) {
  return {hn::Sub(p.x, hn::Load(d, terms.position(3 * tool) + first)),
          hn::Sub(p.y, hn::Load(d, terms.position(3 * tool + 1) + first)),
          hn::Sub(p.z, hn::Load(d, terms.position(3 * tool + 2) + first))};
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE ToolLanes<V> weights(D d, const PairTerms& terms, int tool, int first) {
  return {hn::Load(d, terms.weight(3 * tool) + first),
          hn::Load(d, terms.weight(3 * tool + 1) + first),
          hn::Load(d, terms.weight(3 * tool + 2) + first)};
}

template <class V>
HWY_INLINE V dot(const ToolLanes<V>& a, const ToolLanes<V>& b) {
  return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z)));
}

// sum <- sum + phi a - along d.
template <class V>
HWY_INLINE void accumulate(ToolLanes<V>& sum, V phi, const ToolLanes<V>& a, V along,
                           const ToolLanes<V>& d) {
  sum.x = hn::MulAdd(phi, a.x, hn::NegMulAdd(along, d.x, sum.x));
  sum.y = hn::MulAdd(phi, a.y, hn::NegMulAdd(along, d.y, sum.y));
  sum.z = hn::MulAdd(phi, a.z, hn::NegMulAdd(along, d.z, sum.z));
}

// Adds the force of the samples' stiffness.
HWY_INLINE void add_few(const PairTerms& terms, const float* p, float* f) {
  const hn::CappedTag<float, kPairFewLanes> d;
  using W = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  W sum[6];
  for (W& each : sum) {
    each = hn::Zero(d);
  }
  for (int i = 0; i < terms.few; i += lanes) {
    W u[6];
    W along[6];
    W r2 = hn::Zero(d);
    W trace = hn::Zero(d);
    for (int a = 0; a < 6; ++a) {
      u[a] = hn::Sub(hn::Set(d, p[a]), hn::Load(d, terms.few_position(a) + i));
      r2 = hn::MulAdd(u[a], u[a], r2);
      along[a] = hn::Zero(d);
    }
    int number = 0;
    for (int a = 0; a < 6; ++a) {
      const W diagonal = hn::Load(d, terms.few_weight(number++) + i);
      trace = hn::Add(trace, diagonal);
      along[a] = hn::MulAdd(diagonal, u[a], along[a]);
      for (int b = a + 1; b < 6; ++b) {
        const W entry = hn::Load(d, terms.few_weight(number++) + i);
        along[a] = hn::MulAdd(entry, u[b], along[a]);
        along[b] = hn::MulAdd(entry, u[a], along[b]);
      }
    }
    for (int a = 0; a < 6; ++a) {
      trace = hn::NegMulAdd(u[a], along[a], trace);
    }
    const W phi = hn::Exp(d, hn::Mul(r2, hn::Set(d, -0.5F)));
    const W twice = hn::Add(phi, phi);
    const W rest = hn::Mul(phi, trace);
    for (int a = 0; a < 6; ++a) {
      sum[a] = hn::MulAdd(twice, along[a], hn::MulAdd(rest, u[a], sum[a]));
    }
  }
  for (int a = 0; a < 6; ++a) {
    f[a] += hn::GetLane(hn::SumOfLanes(d, sum[a]));
  }
}

PairSum pair_sum_lanes(const PairTerms& terms, const float* p) {
  const hn::CappedTag<float, kPairLanes> d;
  using V = hn::Vec<decltype(d)>;
  const ToolLanes<V> p1{hn::Set(d, p[0]), hn::Set(d, p[1]), hn::Set(d, p[2])};
  const ToolLanes<V> p2{hn::Set(d, p[3]), hn::Set(d, p[4]), hn::Set(d, p[5])};
  ToolLanes<V> f1{hn::Zero(d), hn::Zero(d), hn::Zero(d)};
  ToolLanes<V> f2{hn::Zero(d), hn::Zero(d), hn::Zero(d)};
  V nearest = hn::Set(d, std::numeric_limits<float>::max());
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = 0; i < terms.samples; i += lanes) {
    const ToolLanes<V> d1 = offset(d, terms, 0, i, p1);
    const ToolLanes<V> d2 = offset(d, terms, 1, i, p2);
    const ToolLanes<V> a1 = weights(d, terms, 0, i);
    const ToolLanes<V> a2 = weights(d, terms, 1, i);
    const V r2 = hn::Add(dot(d1, d1), dot(d2, d2));
    nearest = hn::Min(nearest, r2);
    const V phi = hn::Exp(d, hn::Mul(r2, hn::Set(d, -0.5F)));
    const V along = hn::Mul(phi, hn::Add(dot(d1, a1), dot(d2, a2)));
    accumulate(f1, phi, a1, along, d1);
    accumulate(f2, phi, a2, along, d2);
  }
  PairSum sum;
  sum.force_N[0] = hn::GetLane(hn::SumOfLanes(d, f1.x));
  sum.force_N[1] = hn::GetLane(hn::SumOfLanes(d, f1.y));
  sum.force_N[2] = hn::GetLane(hn::SumOfLanes(d, f1.z));
  sum.force_N[3] = hn::GetLane(hn::SumOfLanes(d, f2.x));
  sum.force_N[4] = hn::GetLane(hn::SumOfLanes(d, f2.y));
  sum.force_N[5] = hn::GetLane(hn::SumOfLanes(d, f2.z));
  sum.nearest2 = hn::GetLane(hn::MinOfLanes(d, nearest));
  if (terms.few > 0) {
    add_few(terms, p, sum.force_N);
  }
  return sum;
}

}  // namespace HWY_NAMESPACE
}  // namespace forcegrid::pair
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <cmath>

#include "forcegrid/pair/pair_kernel.h"

namespace forcegrid::pair {

HWY_EXPORT(pair_sum_lanes);

PairSum pair_sum(const PairTerms& terms, const float p[6]) noexcept {
  return HWY_DYNAMIC_DISPATCH(pair_sum_lanes)(terms, p);
}

PairSum pair_sum_scalar(const PairTerms& terms, const float p[6]) noexcept {
  PairSum sum{{}, std::numeric_limits<float>::max()};
  for (int i = 0; i < terms.samples; ++i) {
    float d[6];
    float r2 = 0.0F;
    float along = 0.0F;
    for (int a = 0; a < 6; ++a) {
      d[a] = p[a] - terms.position(a)[i];
      r2 += d[a] * d[a];
      along += d[a] * terms.weight(a)[i];
    }
    sum.nearest2 = std::min(sum.nearest2, r2);
    const float phi = std::exp(-0.5F * r2);
    for (int a = 0; a < 6; ++a) {
      sum.force_N[a] += phi * (terms.weight(a)[i] - along * d[a]);
    }
  }
  for (int i = 0; i < terms.few; ++i) {
    float d[6];
    float along[6] = {};
    float r2 = 0.0F;
    float rest = 0.0F;
    for (int a = 0; a < 6; ++a) {
      d[a] = p[a] - terms.few_position(a)[i];
      r2 += d[a] * d[a];
    }
    for (int number = 0; number < kStiffnessNumbers; ++number) {
      const int a = kStiffnessRow[number];
      const int b = kStiffnessColumn[number];
      const float entry = terms.few_weight(number)[i];
      along[a] += entry * d[b];
      if (a == b) {
        rest += entry;
      } else {
        along[b] += entry * d[a];
      }
    }
    for (int a = 0; a < 6; ++a) {
      rest -= d[a] * along[a];
    }
    const float phi = std::exp(-0.5F * r2);
    for (int a = 0; a < 6; ++a) {
      sum.force_N[a] += phi * (2.0F * along[a] + rest * d[a]);
    }
  }
  return sum;
}

}  // namespace forcegrid::pair
#endif  // HWY_ONCE
