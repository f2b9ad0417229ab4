// SPDX-License-Identifier: Apache-2.0
// The plain loops of kriging_simd.h.
#include <algorithm>
#include <cmath>
#include <limits>

#include "forcegrid/kriging/kriging_simd.h"

namespace forcegrid::kriging {

template <typename Real>
RadialSum<Real> radial_sum_scalar(const RadialTerms<Real>& terms, const Real p_m[3]) noexcept {
  const Real inverse_l2 = Real(1) / (terms.length_m * terms.length_m);
  const auto radial = [&](Real r2, Real& minus_g1_less_one, Real& g2, Real& minus_g3) {
    if (terms.shape == RadialShape::kSquaredExponential) {
      minus_g1_less_one = std::expm1(Real(-0.5) * r2 * inverse_l2);
      g2 = (Real(1) + minus_g1_less_one) * inverse_l2;
      minus_g3 = g2 * inverse_l2;
    } else {
      const Real k2 = Real(7) * inverse_l2;
      const Real s = std::sqrt(k2 * r2);
      const Real e = std::exp(-s);
      minus_g1_less_one = (Real(1) + s + s * s / Real(3)) * e - Real(1);
      g2 = k2 / Real(3) * (Real(1) + s) * e;
      minus_g3 = k2 * k2 / Real(3) * e;
    }
  };
  RadialSum<Real> sum{{0, 0, 0}, std::numeric_limits<Real>::max()};
  Real minus_g1_less_one = 0;
  Real g2 = 0;
  Real minus_g3 = 0;
  for (int i = 0; i < terms.samples; ++i) {
    const Real d[3] = {p_m[0] - terms.length_m * terms.position(0)[i],
                       p_m[1] - terms.length_m * terms.position(1)[i],
                       p_m[2] - terms.length_m * terms.position(2)[i]};
    const Real r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    sum.nearest_m2 = std::min(sum.nearest_m2, r2);
    radial(r2, minus_g1_less_one, g2, minus_g3);
    const Real along =
        g2 * (d[0] * terms.weight(0)[i] + d[1] * terms.weight(1)[i] + d[2] * terms.weight(2)[i]);
    for (int a = 0; a < 3; ++a) {
      sum.force_N[a] += minus_g1_less_one * terms.weight(a)[i] - along * d[a];
    }
  }
  for (int i = 0; i < terms.stiffness_samples; ++i) {
    const Real d[3] = {p_m[0] - terms.stiffness_position_m(0)[i],
                       p_m[1] - terms.stiffness_position_m(1)[i],
                       p_m[2] - terms.stiffness_position_m(2)[i]};
    Real m_d[3] = {0, 0, 0};
    for (int k = 0; k < 6; ++k) {
      const int b = kStiffnessRow[k];
      const int c = kStiffnessColumn[k];
      m_d[b] += terms.stiffness_weight(k)[i] * d[c];
      if (b != c) {
        m_d[c] += terms.stiffness_weight(k)[i] * d[b];
      }
    }
    radial(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], minus_g1_less_one, g2, minus_g3);
    const Real quadratic = d[0] * m_d[0] + d[1] * m_d[1] + d[2] * m_d[2];
    const Real trace =
        terms.stiffness_weight(0)[i] + terms.stiffness_weight(1)[i] + terms.stiffness_weight(2)[i];
    for (int a = 0; a < 3; ++a) {
      sum.force_N[a] += Real(2) * g2 * m_d[a] + (g2 * trace - minus_g3 * quadratic) * d[a];
    }
  }
  return sum;
}
template RadialSum<float> radial_sum_scalar(const RadialTerms<float>&, const float*) noexcept;
template RadialSum<double> radial_sum_scalar(const RadialTerms<double>&, const double*) noexcept;

template <typename Real>
RadialSlope<Real> radial_slope_scalar(const RadialTerms<Real>& terms, const Real p_m[3]) noexcept {
  Kernel kernel;
  kernel.shape = terms.shape;
  kernel.length_m = static_cast<double>(terms.length_m);
  RadialSlope<Real> slope{};
  for (int i = 0; i < terms.samples; ++i) {
    Real d[3];
    Real weight[3];
    Real r2 = 0;
    Real s = 0;
    for (int a = 0; a < 3; ++a) {
      d[a] = p_m[a] - terms.position(a)[i] * terms.length_m;
      weight[a] = terms.weight(a)[i];
      r2 += d[a] * d[a];
      s += d[a] * weight[a];
    }
    const RadialDerivatives g = kernel.radial(static_cast<double>(r2));
    const auto g2 = static_cast<Real>(g.g2);
    const auto g3 = static_cast<Real>(g.g3);
    for (int k = 0; k < 6; ++k) {
      const int b = kStiffnessRow[k];
      const int c = kStiffnessColumn[k];
      slope.stiffness_N_per_m[k] -= g2 * (weight[b] * d[c] + d[b] * weight[c]) +
                                    (b == c ? g2 * s : Real(0)) + g3 * s * d[b] * d[c];
    }
  }
  return slope;
}
template RadialSlope<float> radial_slope_scalar(const RadialTerms<float>&, const float*) noexcept;
template RadialSlope<double> radial_slope_scalar(const RadialTerms<double>&,
                                                 const double*) noexcept;

void solve_lower_scalar(const PackedLower& l, double* const x[3]) noexcept {
  for (int j = 0; j < l.rows; ++j) {
    const double* column = l.column(j);
    for (int k = 0; k < 3; ++k) {
      x[k][j] *= l.inverse_diagonal[j];
      for (int r = j + 1; r < l.rows; ++r) {
        x[k][r] -= x[k][j] * column[r];
      }
    }
  }
}

void solve_upper_scalar(const PackedLower& l, double* x) noexcept {
  for (int j = l.rows - 1; j >= 0; --j) {
    const double* column = l.column(j);
    double sum = x[j];
    for (int r = j + 1; r < l.rows; ++r) {
      sum -= column[r] * x[r];
    }
    x[j] = sum * l.inverse_diagonal[j];
  }
}

void rotate_scalar(const double* column, double* const others[3], double* moved, int count,
                   const Rotations& by) noexcept {
  for (int r = 0; r < count; ++r) {
    double a = column[r];
    for (int i = 0; i < 3; ++i) {
      const double b = others[i][r];
      others[i][r] = by.c[i] * b - by.s[i] * a;
      a = by.c[i] * a + by.s[i] * b;
    }
    moved[r] = a;
  }
}

}  // namespace forcegrid::kriging
