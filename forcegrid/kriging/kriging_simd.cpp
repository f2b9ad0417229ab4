// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_simd.h"

#include <algorithm>
#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "forcegrid/kriging/kriging_simd.cpp"
#include <hwy/foreach_target.h>
// Highway compiles what follows once for each instruction set.
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace forcegrid::kriging {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// exp(x) and exp(x) - 1 for x = scale * r <= 0, each with its own relative precision; exp(x) is
// never below 2^-126. In single precision x = (n + f) ln 2 with |f| <= 1/2, and exp(x) - 1 is
// 2^n (2^f - 1) + (2^n - 1), of which the second part is exact, and zero for small x.
// (2^f - 1) / f is the polynomial of fifth degree in f that has the least relative error (1.1e-8),
// found by the Remez exchange. hn::Exp() and hn::Expm1() also cover cases that do not occur here.
template <class V>
struct Exponential {
  V value, less_one;
};

template <class D, class V = hn::Vec<D>>
HWY_INLINE Exponential<V> exponential_of_negative(D d, V r, hn::TFromD<D> scale) {
  using T = hn::TFromD<D>;
  const V one = hn::Set(d, T(1));
  if constexpr (sizeof(T) == sizeof(float)) {
    constexpr T kLog2E = T(1.44269504088896341);
    // Adding this leaves the nearest integer in the lowest bits.
    constexpr T kRound = T(12582912);
    const V t = hn::Max(hn::Mul(r, hn::Set(d, scale * kLog2E)), hn::Set(d, T(-126)));
    const V rounded = hn::Add(t, hn::Set(d, kRound));
    const V f = hn::Sub(t, hn::Sub(rounded, hn::Set(d, kRound)));
    // Estrin's scheme: three steps deep instead of five.
    const V f2 = hn::Mul(f, f);
    const V low = hn::MulAdd(hn::Set(d, T(0.2402264979)), f, hn::Set(d, T(0.6931471879)));
    const V middle = hn::MulAdd(hn::Set(d, T(0.009618237494)), f, hn::Set(d, T(0.05550357434)));
    const V high = hn::MulAdd(hn::Set(d, T(0.0001540351276)), f, hn::Set(d, T(0.001339073548)));
    const V power_less_one = hn::Mul(f, hn::MulAdd(hn::MulAdd(high, f2, middle), f2, low));
    const hn::RebindToSigned<D> di;
    const V two_to_n =
        hn::BitCast(d, hn::Add(hn::BitCast(di, one), hn::ShiftLeft<23>(hn::BitCast(di, rounded))));
    return {hn::MulAdd(two_to_n, power_less_one, two_to_n),
            hn::MulAdd(two_to_n, power_less_one, hn::Sub(two_to_n, one))};
  } else {
    const V value = hn::Exp(d, hn::Mul(r, hn::Set(d, scale)));
    return {value, hn::Sub(value, one)};
  }
}

// -g', g'' and g''' of Kernel::radial(), lane by lane.
template <RadialShape kShape, class D, class V = hn::Vec<D>>
HWY_INLINE void radial(D d, hn::TFromD<D> length_m, V r2, V& minus_g1, V& g2, V& minus_g3) {
  using T = hn::TFromD<D>;
  const T inverse_l2 = T(1) / (length_m * length_m);
  if constexpr (kShape == RadialShape::kSquaredExponential) {
    minus_g1 = exponential_of_negative(d, r2, T(-0.5) * inverse_l2).value;
    g2 = hn::Mul(minus_g1, hn::Set(d, inverse_l2));
    minus_g3 = hn::Mul(g2, hn::Set(d, inverse_l2));
  } else {
    const T k2 = T(7) * inverse_l2;
    const V s = hn::Sqrt(hn::Mul(r2, hn::Set(d, k2)));
    const V e = exponential_of_negative(d, s, T(-1)).value;
    const V third_e = hn::Mul(e, hn::Set(d, T(1) / T(3)));
    const V third_e_s = hn::Mul(third_e, s);
    g2 = hn::Mul(hn::Add(third_e, third_e_s), hn::Set(d, k2));
    minus_g1 = hn::MulAdd(third_e_s, s, hn::MulAdd(e, s, e));
    minus_g3 = hn::Mul(third_e, hn::Set(d, k2 * k2));
  }
}

// -g' - 1 and g'' l^2 for l = 1, the terms of the samples' sum.
template <RadialShape kShape, class D, class V = hn::Vec<D>>
HWY_INLINE void unit_radial(D d, V r2, V& minus_g1_less_one, V& g2) {
  using T = hn::TFromD<D>;
  if constexpr (kShape == RadialShape::kSquaredExponential) {
    const Exponential<V> e = exponential_of_negative(d, r2, T(-0.5));
    g2 = e.value;
    minus_g1_less_one = e.less_one;
  } else {
    V minus_g1;
    V minus_g3;
    radial<kShape>(d, T(1), r2, minus_g1, g2, minus_g3);
    minus_g1_less_one = hn::Sub(minus_g1, hn::Set(d, T(1)));
  }
}

// A lane's worth of samples: the vector from each to the position, its weight, the squared
// distance.
template <class V>
struct SampleLanes {
  V x, y, z, ax, ay, az, r2;
};

template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE SampleLanes<V> sample_lanes(D d, const RadialTerms<T>& terms, int first, V px, V py,
                                       V pz) {
  SampleLanes<V> lanes;
  lanes.x = hn::Sub(px, hn::Load(d, terms.position(0) + first));
  lanes.y = hn::Sub(py, hn::Load(d, terms.position(1) + first));
  lanes.z = hn::Sub(pz, hn::Load(d, terms.position(2) + first));
  lanes.ax = hn::Load(d, terms.weight(0) + first);
  lanes.ay = hn::Load(d, terms.weight(1) + first);
  lanes.az = hn::Load(d, terms.weight(2) + first);
  lanes.r2 = hn::MulAdd(lanes.x, lanes.x, hn::MulAdd(lanes.y, lanes.y, hn::Mul(lanes.z, lanes.z)));
  return lanes;
}

template <RadialShape kShape, class T>
HWY_INLINE RadialSum<T> sum_terms(const RadialTerms<T>& terms, const T* p_m) {
  const hn::CappedTag<T, kLanePadding> d;
  using V = hn::Vec<decltype(d)>;
  const T inverse_l = terms.inverse_length_per_m;
  const V px = hn::Set(d, p_m[0] * inverse_l);
  const V py = hn::Set(d, p_m[1] * inverse_l);
  const V pz = hn::Set(d, p_m[2] * inverse_l);
  V fx = hn::Zero(d);
  V fy = hn::Zero(d);
  V fz = hn::Zero(d);
  V nearest = hn::Set(d, std::numeric_limits<T>::max());
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = 0; i < terms.samples; i += lanes) {
    const auto [x, y, z, ax, ay, az, r2] = sample_lanes(d, terms, i, px, py, pz);
    nearest = hn::Min(nearest, r2);
    V minus_g1_less_one;
    V g2;
    unit_radial<kShape>(d, r2, minus_g1_less_one, g2);
    const V along = hn::Mul(g2, hn::MulAdd(x, ax, hn::MulAdd(y, ay, hn::Mul(z, az))));
    fx = hn::MulAdd(minus_g1_less_one, ax, hn::NegMulAdd(along, x, fx));
    fy = hn::MulAdd(minus_g1_less_one, ay, hn::NegMulAdd(along, y, fy));
    fz = hn::MulAdd(minus_g1_less_one, az, hn::NegMulAdd(along, z, fz));
  }
  RadialSum<T> sum;
  sum.force_N[0] = hn::GetLane(hn::SumOfLanes(d, fx));
  sum.force_N[1] = hn::GetLane(hn::SumOfLanes(d, fy));
  sum.force_N[2] = hn::GetLane(hn::SumOfLanes(d, fz));
  sum.nearest_m2 = terms.length_m * terms.length_m * hn::GetLane(hn::MinOfLanes(d, nearest));
  if (terms.stiffness_samples == 0) {
    return sum;
  }
  const hn::CappedTag<T, 4> d4;
  using V4 = hn::Vec<decltype(d4)>;
  const int few_lanes = static_cast<int>(hn::Lanes(d4));
  V4 gx = hn::Zero(d4);
  V4 gy = hn::Zero(d4);
  V4 gz = hn::Zero(d4);
  for (int i = 0; i < terms.stiffness_samples; i += few_lanes) {
    const V4 x = hn::Sub(hn::Set(d4, p_m[0]), hn::Load(d4, terms.stiffness_position_m(0) + i));
    const V4 y = hn::Sub(hn::Set(d4, p_m[1]), hn::Load(d4, terms.stiffness_position_m(1) + i));
    const V4 z = hn::Sub(hn::Set(d4, p_m[2]), hn::Load(d4, terms.stiffness_position_m(2) + i));
    const V4 xx = hn::Load(d4, terms.stiffness_weight(0) + i);
    const V4 yy = hn::Load(d4, terms.stiffness_weight(1) + i);
    const V4 zz = hn::Load(d4, terms.stiffness_weight(2) + i);
    const V4 xy = hn::Load(d4, terms.stiffness_weight(3) + i);
    const V4 xz = hn::Load(d4, terms.stiffness_weight(4) + i);
    const V4 yz = hn::Load(d4, terms.stiffness_weight(5) + i);
    const V4 mx = hn::MulAdd(xx, x, hn::MulAdd(xy, y, hn::Mul(xz, z)));
    const V4 my = hn::MulAdd(xy, x, hn::MulAdd(yy, y, hn::Mul(yz, z)));
    const V4 mz = hn::MulAdd(xz, x, hn::MulAdd(yz, y, hn::Mul(zz, z)));
    const V4 r2 = hn::MulAdd(x, x, hn::MulAdd(y, y, hn::Mul(z, z)));
    V4 minus_g1;
    V4 g2;
    V4 minus_g3;
    radial<kShape>(d4, terms.length_m, r2, minus_g1, g2, minus_g3);
    const V4 quadratic = hn::MulAdd(x, mx, hn::MulAdd(y, my, hn::Mul(z, mz)));
    const V4 trace = hn::Add(xx, hn::Add(yy, zz));
    const V4 along = hn::NegMulAdd(minus_g3, quadratic, hn::Mul(g2, trace));
    const V4 twice_g2 = hn::Add(g2, g2);
    gx = hn::MulAdd(twice_g2, mx, hn::MulAdd(along, x, gx));
    gy = hn::MulAdd(twice_g2, my, hn::MulAdd(along, y, gy));
    gz = hn::MulAdd(twice_g2, mz, hn::MulAdd(along, z, gz));
  }
  sum.force_N[0] += hn::GetLane(hn::SumOfLanes(d4, gx));
  sum.force_N[1] += hn::GetLane(hn::SumOfLanes(d4, gy));
  sum.force_N[2] += hn::GetLane(hn::SumOfLanes(d4, gz));
  return sum;
}

template <class T>
HWY_INLINE RadialSum<T> sum_terms(const RadialTerms<T>& terms, const T* p_m) {
  return terms.shape == RadialShape::kSquaredExponential
             ? sum_terms<RadialShape::kSquaredExponential>(terms, p_m)
             : sum_terms<RadialShape::kMatern72>(terms, p_m);
}

RadialSum<float> radial_sum_float(const RadialTerms<float>& terms, const float* p_m) {
  return sum_terms(terms, p_m);
}

RadialSum<double> radial_sum_double(const RadialTerms<double>& terms, const double* p_m) {
  return sum_terms(terms, p_m);
}

template <RadialShape kShape, class T>
HWY_INLINE RadialSlope<T> slope_of_terms(const RadialTerms<T>& terms, const T* p_m) {
  const hn::CappedTag<T, kLanePadding> d;
  using V = hn::Vec<decltype(d)>;
  const T inverse_l = terms.inverse_length_per_m;
  const V px = hn::Set(d, p_m[0] * inverse_l);
  const V py = hn::Set(d, p_m[1] * inverse_l);
  const V pz = hn::Set(d, p_m[2] * inverse_l);
  const V half = hn::Set(d, T(0.5));
  V xx = hn::Zero(d);
  V yy = hn::Zero(d);
  V zz = hn::Zero(d);
  V xy = hn::Zero(d);
  V xz = hn::Zero(d);
  V yz = hn::Zero(d);
  V all = hn::Zero(d);
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = 0; i < terms.samples; i += lanes) {
    const auto [x, y, z, ax, ay, az, r2] = sample_lanes(d, terms, i, px, py, pz);
    V minus_g1;
    V g2;
    V minus_g3;
    radial<kShape>(d, T(1), r2, minus_g1, g2, minus_g3);
    const V s = hn::MulAdd(x, ax, hn::MulAdd(y, ay, hn::Mul(z, az)));
    const V along = hn::Mul(hn::Mul(half, minus_g3), s);
    const V wx = hn::NegMulAdd(along, x, hn::Mul(g2, ax));
    const V wy = hn::NegMulAdd(along, y, hn::Mul(g2, ay));
    const V wz = hn::NegMulAdd(along, z, hn::Mul(g2, az));
    xx = hn::MulAdd(wx, x, xx);
    yy = hn::MulAdd(wy, y, yy);
    zz = hn::MulAdd(wz, z, zz);
    xy = hn::MulAdd(wx, y, hn::MulAdd(wy, x, xy));
    xz = hn::MulAdd(wx, z, hn::MulAdd(wz, x, xz));
    yz = hn::MulAdd(wy, z, hn::MulAdd(wz, y, yz));
    all = hn::MulAdd(g2, s, all);
  }
  const T trace = hn::GetLane(hn::SumOfLanes(d, all));
  RadialSlope<T> slope;
  slope.stiffness_N_per_m[0] = -inverse_l * (T(2) * hn::GetLane(hn::SumOfLanes(d, xx)) + trace);
  slope.stiffness_N_per_m[1] = -inverse_l * (T(2) * hn::GetLane(hn::SumOfLanes(d, yy)) + trace);
  slope.stiffness_N_per_m[2] = -inverse_l * (T(2) * hn::GetLane(hn::SumOfLanes(d, zz)) + trace);
  slope.stiffness_N_per_m[3] = -inverse_l * hn::GetLane(hn::SumOfLanes(d, xy));
  slope.stiffness_N_per_m[4] = -inverse_l * hn::GetLane(hn::SumOfLanes(d, xz));
  slope.stiffness_N_per_m[5] = -inverse_l * hn::GetLane(hn::SumOfLanes(d, yz));
  return slope;
}

template <class T>
HWY_INLINE RadialSlope<T> slope_by_shape(const RadialTerms<T>& terms, const T* p_m) {
  return terms.shape == RadialShape::kSquaredExponential
             ? slope_of_terms<RadialShape::kSquaredExponential>(terms, p_m)
             : slope_of_terms<RadialShape::kMatern72>(terms, p_m);
}
RadialSlope<float> radial_slope_float(const RadialTerms<float>& terms, const float* p_m) {
  return slope_by_shape(terms, p_m);
}
RadialSlope<double> radial_slope_double(const RadialTerms<double>& terms, const double* p_m) {
  return slope_by_shape(terms, p_m);
}

// Columns of a triangle that are subtracted in one pass over the right-hand sides.
constexpr int kColumnsAtOnce = 3;

// x - a b, rounded as the lanes' is.
double less_product(double x, double a, double b) {
  const hn::CappedTag<double, 1> one;
  return hn::GetLane(hn::NegMulAdd(hn::Set(one, a), hn::Set(one, b), hn::Set(one, x)));
}

void solve_lower_lanes(const PackedLower& l, double* const* x) {
  const hn::CappedTag<double, kLanePadding> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  double* HWY_RESTRICT x0 = x[0];
  double* HWY_RESTRICT x1 = x[1];
  double* HWY_RESTRICT x2 = x[2];
  for (int r = l.rows; r < l.rows + kLanePadding; ++r) {
    x0[r] = x1[r] = x2[r] = 0.0;
  }
  int j = 0;
  for (; j + kColumnsAtOnce <= l.rows; j += kColumnsAtOnce) {
    const double* HWY_RESTRICT a = l.column(j);
    const double* HWY_RESTRICT b = l.column(j + 1);
    const double* HWY_RESTRICT c = l.column(j + 2);
    for (double* HWY_RESTRICT y : {x0, x1, x2}) {
      y[j] *= l.inverse_diagonal[j];
      y[j + 1] = less_product(y[j + 1], y[j], a[j + 1]) * l.inverse_diagonal[j + 1];
      y[j + 2] = less_product(less_product(y[j + 2], y[j], a[j + 2]), y[j + 1], b[j + 2]) *
                 l.inverse_diagonal[j + 2];
    }
    const V a0 = hn::Set(d, x0[j]), b0 = hn::Set(d, x0[j + 1]), c0 = hn::Set(d, x0[j + 2]);
    const V a1 = hn::Set(d, x1[j]), b1 = hn::Set(d, x1[j + 1]), c1 = hn::Set(d, x1[j + 2]);
    const V a2 = hn::Set(d, x2[j]), b2 = hn::Set(d, x2[j + 1]), c2 = hn::Set(d, x2[j + 2]);
    for (int r = j + kColumnsAtOnce; r < l.rows; r += lanes) {
      const V va = hn::LoadU(d, a + r);
      const V vb = hn::LoadU(d, b + r);
      const V vc = hn::LoadU(d, c + r);
      V y0 = hn::NegMulAdd(a0, va, hn::LoadU(d, x0 + r));
      V y1 = hn::NegMulAdd(a1, va, hn::LoadU(d, x1 + r));
      V y2 = hn::NegMulAdd(a2, va, hn::LoadU(d, x2 + r));
      y0 = hn::NegMulAdd(b0, vb, y0);
      y1 = hn::NegMulAdd(b1, vb, y1);
      y2 = hn::NegMulAdd(b2, vb, y2);
      hn::StoreU(hn::NegMulAdd(c0, vc, y0), d, x0 + r);
      hn::StoreU(hn::NegMulAdd(c1, vc, y1), d, x1 + r);
      hn::StoreU(hn::NegMulAdd(c2, vc, y2), d, x2 + r);
    }
  }
  for (; j < l.rows; ++j) {
    const double* HWY_RESTRICT column = l.column(j);
    for (double* HWY_RESTRICT y : {x0, x1, x2}) {
      y[j] *= l.inverse_diagonal[j];
      for (int r = j + 1; r < l.rows; ++r) {
        y[r] = less_product(y[r], y[j], column[r]);
      }
    }
  }
}

void solve_upper_lanes(const PackedLower& l, double* x) {
  const hn::CappedTag<double, kLanePadding> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int r = l.rows; r < l.rows + kLanePadding; ++r) {
    x[r] = 0.0;
  }
  for (int j = l.rows - 1; j >= 0; --j) {
    const double* HWY_RESTRICT column = l.column(j);
    V sum = hn::Zero(d);
    for (int r = j + 1; r < l.rows; r += lanes) {
      sum = hn::MulAdd(hn::LoadU(d, column + r), hn::LoadU(d, x + r), sum);
    }
    x[j] = (x[j] - hn::GetLane(hn::SumOfLanes(d, sum))) * l.inverse_diagonal[j];
  }
}

void rotate_lanes(const double* column, double* const others[3], double* moved, int count,
                  const Rotations& by) {
  const hn::CappedTag<double, kLanePadding> d;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const V c0 = hn::Set(d, by.c[0]);
  const V c1 = hn::Set(d, by.c[1]);
  const V c2 = hn::Set(d, by.c[2]);
  const V s0 = hn::Set(d, by.s[0]);
  const V s1 = hn::Set(d, by.s[1]);
  const V s2 = hn::Set(d, by.s[2]);
  double* const other0 = others[0];
  double* const other1 = others[1];
  double* const other2 = others[2];
  const auto rotate_one = [&](V a, double* other, V c, V s) {
    const V b = hn::LoadU(d, other);
    hn::StoreU(hn::NegMulAdd(s, a, hn::Mul(c, b)), d, other);
    return hn::MulAdd(c, a, hn::Mul(s, b));
  };
  for (int r = 0; r < count; r += lanes) {
    V a = hn::LoadU(d, column + r);
    a = rotate_one(a, other0 + r, c0, s0);
    a = rotate_one(a, other1 + r, c1, s1);
    a = rotate_one(a, other2 + r, c2, s2);
    hn::StoreU(a, d, moved + r);
  }
}

const char* target_name() { return hwy::TargetName(HWY_TARGET); }

}  // namespace HWY_NAMESPACE
}  // namespace forcegrid::kriging
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace forcegrid::kriging {

HWY_EXPORT(radial_sum_float);
HWY_EXPORT(radial_sum_double);
HWY_EXPORT(radial_slope_float);
HWY_EXPORT(radial_slope_double);
HWY_EXPORT(solve_lower_lanes);
HWY_EXPORT(solve_upper_lanes);
HWY_EXPORT(rotate_lanes);
HWY_EXPORT(target_name);

RadialSum<float> radial_sum(const RadialTerms<float>& terms, const float p_m[3]) noexcept {
  return HWY_DYNAMIC_DISPATCH(radial_sum_float)(terms, p_m);
}

RadialSum<double> radial_sum(const RadialTerms<double>& terms, const double p_m[3]) noexcept {
  return HWY_DYNAMIC_DISPATCH(radial_sum_double)(terms, p_m);
}

RadialSlope<float> radial_slope(const RadialTerms<float>& terms, const float p_m[3]) noexcept {
  return HWY_DYNAMIC_DISPATCH(radial_slope_float)(terms, p_m);
}

RadialSlope<double> radial_slope(const RadialTerms<double>& terms, const double p_m[3]) noexcept {
  return HWY_DYNAMIC_DISPATCH(radial_slope_double)(terms, p_m);
}

void solve_lower(const PackedLower& l, double* const x[3]) noexcept {
  HWY_DYNAMIC_DISPATCH(solve_lower_lanes)(l, x);
}

void solve_upper(const PackedLower& l, double* x) noexcept {
  HWY_DYNAMIC_DISPATCH(solve_upper_lanes)(l, x);
}

void rotate(const double* column, double* const others[3], double* moved, int count,
            const Rotations& by) noexcept {
  HWY_DYNAMIC_DISPATCH(rotate_lanes)(column, others, moved, count, by);
}

const char* instruction_set() noexcept { return HWY_DYNAMIC_DISPATCH(target_name)(); }

}  // namespace forcegrid::kriging
#endif  // HWY_ONCE
