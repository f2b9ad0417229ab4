// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <type_traits>

#include "simulator/kernels/kernel_support.h"
#include "simulator/mesh/element_material.h"

// Stress and stiffness of elements side by side, one number of each in a SIMD register. The
// energies are those of strain_energy_J_per_m3(). Everything here is inlined into the kernels, so
// that it is compiled for each processor's registers.
namespace forcegrid::simulator::kernels {

template <typename Real>
struct WideOf;
template <>
struct WideOf<float> {
  using Vector = Float8;
};
template <>
struct WideOf<double> {
  using Vector = Double4;
};

template <typename Real>
struct Matrix {
  typename WideOf<Real>::Vector at[3][3];
};

/// Elements side by side.
template <typename Real>
struct ElementState {
  using Vector = typename WideOf<Real>::Vector;
  Matrix<Real> f;         ///< deformation gradient
  Vector gradient[4][3];  ///< [1/m] of the corners' hat functions
  Vector volume;          ///< [m^3]
  Vector stiffness[3];    ///< see ElementConstants
};

template <typename Vector>
FORCEGRID_INLINE Vector dot3(const Vector (&a)[3], const Vector (&b)[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

template <typename Vector>
FORCEGRID_INLINE void cross3(const Vector (&a)[3], const Vector (&b)[3], Vector (&result)[3]) {
  result[0] = a[1] * b[2] - a[2] * b[1];
  result[1] = a[2] * b[0] - a[0] * b[2];
  result[2] = a[0] * b[1] - a[1] * b[0];
}

/// result = m v.
template <typename Real, typename Vector>
FORCEGRID_INLINE void times(const Matrix<Real>& m, const Vector (&v)[3], Vector (&result)[3]) {
  for (int c = 0; c < 3; ++c) {
    result[c] = m.at[c][0] * v[0] + m.at[c][1] * v[1] + m.at[c][2] * v[2];
  }
}

/// result = a b.
template <typename Real>
FORCEGRID_INLINE void product(const Matrix<Real>& a, const Matrix<Real>& b, Matrix<Real>& result) {
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < 3; ++d) {
      result.at[c][d] = a.at[c][0] * b.at[0][d] + a.at[c][1] * b.at[1][d] + a.at[c][2] * b.at[2][d];
    }
  }
}

/// result = a^T b.
template <typename Real>
FORCEGRID_INLINE void transposed_product(const Matrix<Real>& a, const Matrix<Real>& b,
                                         Matrix<Real>& result) {
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < 3; ++d) {
      result.at[c][d] = a.at[0][c] * b.at[0][d] + a.at[1][c] * b.at[1][d] + a.at[2][c] * b.at[2][d];
    }
  }
}

template <typename Real>
FORCEGRID_INLINE void cofactors(const Matrix<Real>& f, Matrix<Real>& result) {
  for (int c = 0; c < 3; ++c) {
    for (int d = 0; d < 3; ++d) {
      const int c1 = (c + 1) % 3, c2 = (c + 2) % 3, d1 = (d + 1) % 3, d2 = (d + 2) % 3;
      result.at[c][d] = f.at[c1][d1] * f.at[c2][d2] - f.at[c1][d2] * f.at[c2][d1];
    }
  }
}

template <typename Real>
FORCEGRID_INLINE typename WideOf<Real>::Vector sum_of_products(const Matrix<Real>& a,
                                                               const Matrix<Real>& b) {
  typename WideOf<Real>::Vector sum{};
  for (int c = 0; c < 3; ++c) {
    sum += a.at[c][0] * b.at[c][0] + a.at[c][1] * b.at[c][1] + a.at[c][2] * b.at[c][2];
  }
  return sum;
}

/// Keeps a division finite where an element has collapsed.
template <typename Vector>
FORCEGRID_INLINE Vector away_from_zero(const Vector& value) {
  const Vector tiny = Vector{} + static_cast<std::remove_reference_t<decltype(value[0])>>(1e-20F);
  return value > tiny ? value : (value < -tiny ? value : tiny);
}

/// The sum of F's singular values, the smallest one negative where det F is: s = tr(R^T F). It is
/// the largest root of
///
///   (s^2 - I)^2 - 4 C - 8 J s = 0,   I = |F|^2, C = |cof F|^2, J = det F,
///
/// to which Newton's method descends from sqrt(3 I). Source: Lin, Chitalu and Komura, Isotropic
/// ARAP energy using Cauchy-Green invariants, ACM TOG 41(6), 2022, section 4.
template <typename Real>
FORCEGRID_INLINE void sum_of_stretches(const typename WideOf<Real>::Vector& i,
                                       const typename WideOf<Real>::Vector& c,
                                       const typename WideOf<Real>::Vector& j,
                                       typename WideOf<Real>::Vector& s) {
  using Vector = typename WideOf<Real>::Vector;
  constexpr int kSteps = sizeof(Real) == sizeof(float) ? 7 : 10;
  for (std::size_t lane = 0; lane < sizeof(Vector) / sizeof(Real); ++lane) {
    s[lane] = std::sqrt(static_cast<Real>(3) * i[lane]);
  }
  for (int step = 0; step < kSteps; ++step) {
    const Vector d = s * s - i;
    const Vector slope = static_cast<Real>(4) * s * d - static_cast<Real>(8) * j;
    s -= (d * d - static_cast<Real>(4) * c - static_cast<Real>(8) * j * s) / away_from_zero(slope);
  }
}

template <ElementModel kModel, typename Real>
struct ElementLaw;

/// The corotated energy. Its Hessian, with S = R^T F, G = tr(S) I - S and h = R g:
///
///   K_ab = 2 mu (g_a . g_b) I + lambda h_a h_b^T
///          + (lambda (s - 3) - 2 mu) [h_a]^T R G^-1 R^T [h_b]
template <typename Real>
struct ElementLaw<ElementModel::kCorotated, Real> {
  using Vector = typename WideOf<Real>::Vector;

  FORCEGRID_INLINE void find(const ElementState<Real>& element) {
    const Vector two_mu = element.stiffness[0] + element.stiffness[0];
    const Vector lambda = element.stiffness[1];
    Matrix<Real> r;
    find_rotation(element.f, r);
    Matrix<Real> s;
    Matrix<Real> inverse;
    transposed_product(r, element.f, s);
    invert_turning(s, inverse);
    turn_on(s, inverse, r);  // once more, since the closed form cancels digits
    transposed_product(r, element.f, s);
    const Vector stretch = s.at[0][0] + s.at[1][1] + s.at[2][2] - static_cast<Real>(3);
    const Vector twist = lambda * stretch - two_mu;
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        stress.at[c][d] =
            two_mu * (element.f.at[c][d] - r.at[c][d]) + lambda * stretch * r.at[c][d];
      }
    }
    Matrix<Real> turned;
    product(r, inverse, turned);
    Matrix<Real> q;
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        q.at[c][d] = twist * (turned.at[c][0] * r.at[d][0] + turned.at[c][1] * r.at[d][1] +
                              turned.at[c][2] * r.at[d][2]);
      }
    }
    for (int a = 0; a < 4; ++a) {
      times(r, element.gradient[a], h_[a]);
      for (int c = 0; c < 3; ++c) {
        cross3(q.at[c], h_[a], t_[a].at[c]);  // row c of Q [h]
      }
    }
  }

  FORCEGRID_INLINE void block(const ElementState<Real>& element, int a, int b,
                              Matrix<Real>& k) const {
    const Vector lambda = element.stiffness[1];
    const Vector alike = (element.stiffness[0] + element.stiffness[0]) *
                         dot3(element.gradient[a], element.gradient[b]);
    const Matrix<Real>& tb = t_[b];
    for (int d = 0; d < 3; ++d) {
      k.at[0][d] = h_[a][2] * tb.at[1][d] - h_[a][1] * tb.at[2][d];
      k.at[1][d] = h_[a][0] * tb.at[2][d] - h_[a][2] * tb.at[0][d];
      k.at[2][d] = h_[a][1] * tb.at[0][d] - h_[a][0] * tb.at[1][d];
      for (int c = 0; c < 3; ++c) {
        k.at[c][d] += lambda * h_[a][c] * h_[b][d];
      }
      k.at[d][d] += alike;
    }
  }

  Matrix<Real> stress;

 private:
  // R = (s^2 F + I F - 2 F F^T F + 2 s cof F) / (s^3 - I s - 2 J): the derivative of s after F.
  static FORCEGRID_INLINE void find_rotation(const Matrix<Real>& f, Matrix<Real>& r) {
    Matrix<Real> cofactor;
    cofactors(f, cofactor);
    const Vector i = sum_of_products(f, f);
    const Vector j = dot3(f.at[0], cofactor.at[0]);
    Vector s;
    sum_of_stretches<Real>(i, sum_of_products(cofactor, cofactor), j, s);
    Matrix<Real> squared;
    transposed_product(f, f, squared);
    Matrix<Real> cubed;
    product(f, squared, cubed);
    const Vector scale = static_cast<Real>(1) / away_from_zero<Vector>(s * (s * s - i) - j - j);
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        r.at[c][d] = scale * ((s * s + i) * f.at[c][d] +
                              static_cast<Real>(2) * (s * cofactor.at[c][d] - cubed.at[c][d]));
      }
    }
    make_orthogonal(r);
  }

  // R <- R (3 I - R^T R) / 2, Newton's and Schulz's step.
  static FORCEGRID_INLINE void make_orthogonal(Matrix<Real>& r) {
    Matrix<Real> gram;
    transposed_product(r, r, gram);
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        gram.at[c][d] = (c == d ? Vector{} + static_cast<Real>(1.5) : Vector{}) -
                        static_cast<Real>(0.5) * gram.at[c][d];
      }
    }
    const Matrix<Real> before = r;
    product(before, gram, r);
  }

  // (tr(S) I - S)^-1, of S's symmetric part.
  static FORCEGRID_INLINE void invert_turning(const Matrix<Real>& s, Matrix<Real>& inverse) {
    const auto half = static_cast<Real>(0.5);
    const Vector xx = s.at[1][1] + s.at[2][2];
    const Vector yy = s.at[2][2] + s.at[0][0];
    const Vector zz = s.at[0][0] + s.at[1][1];
    const Vector xy = -half * (s.at[0][1] + s.at[1][0]);
    const Vector yz = -half * (s.at[1][2] + s.at[2][1]);
    const Vector zx = -half * (s.at[2][0] + s.at[0][2]);
    const Vector c_x = yy * zz - yz * yz;
    const Vector c_y = yz * zx - xy * zz;
    const Vector c_z = xy * yz - yy * zx;
    const Vector scale =
        static_cast<Real>(1) / away_from_zero<Vector>(xx * c_x + xy * c_y + zx * c_z);
    inverse.at[0][0] = scale * c_x;
    inverse.at[1][1] = scale * (xx * zz - zx * zx);
    inverse.at[2][2] = scale * (xx * yy - xy * xy);
    inverse.at[0][1] = inverse.at[1][0] = scale * c_y;
    inverse.at[1][2] = inverse.at[2][1] = scale * (xy * zx - xx * yz);
    inverse.at[2][0] = inverse.at[0][2] = scale * c_z;
  }

  // R <- R (I + [w]), w such that R^T F loses its skew part.
  static FORCEGRID_INLINE void turn_on(const Matrix<Real>& s, const Matrix<Real>& inverse,
                                       Matrix<Real>& r) {
    const Vector skew[3] = {s.at[2][1] - s.at[1][2], s.at[0][2] - s.at[2][0],
                            s.at[1][0] - s.at[0][1]};
    Vector w[3];
    times(inverse, skew, w);
    for (int c = 0; c < 3; ++c) {
      const Vector x = r.at[c][0];
      const Vector y = r.at[c][1];
      const Vector z = r.at[c][2];
      r.at[c][0] += y * w[2] - z * w[1];
      r.at[c][1] += z * w[0] - x * w[2];
      r.at[c][2] += x * w[1] - y * w[0];
    }
  }

  Vector h_[4][3];
  Matrix<Real> t_[4];
};

/// St. Venant and Kirchhoff's energy. With S = 2 mu G + lambda tr(G) I and h = F g:
///
///   K_ab = (g_a . S g_b) I + lambda h_a h_b^T + mu h_b h_a^T + mu (g_a . g_b) F F^T
template <typename Real>
struct ElementLaw<ElementModel::kStVenantKirchhoff, Real> {
  using Vector = typename WideOf<Real>::Vector;

  FORCEGRID_INLINE void find(const ElementState<Real>& element) {
    const Vector mu = element.stiffness[0];
    const Vector lambda = element.stiffness[1];
    Matrix<Real> s;
    transposed_product(element.f, element.f, s);
    const Vector trace = s.at[0][0] + s.at[1][1] + s.at[2][2] - static_cast<Real>(3);
    for (int c = 0; c < 3; ++c) {
      s.at[c][c] -= static_cast<Real>(1);
      for (int d = 0; d < 3; ++d) {
        s.at[c][d] *= mu;
        spread_.at[c][d] = mu * dot3(element.f.at[c], element.f.at[d]);
      }
      s.at[c][c] += static_cast<Real>(0.5) * lambda * trace;
    }
    product(element.f, s, stress);
    for (int a = 0; a < 4; ++a) {
      times(element.f, element.gradient[a], h_[a]);
      times(s, element.gradient[a], pulled_[a]);
    }
  }

  FORCEGRID_INLINE void block(const ElementState<Real>& element, int a, int b,
                              Matrix<Real>& k) const {
    const Vector alike = dot3(element.gradient[a], element.gradient[b]);
    const Vector along = dot3(element.gradient[a], pulled_[b]);
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        k.at[c][d] = element.stiffness[1] * h_[a][c] * h_[b][d] +
                     element.stiffness[0] * h_[b][c] * h_[a][d] + alike * spread_.at[c][d];
      }
      k.at[c][c] += along;
    }
  }

  Matrix<Real> stress;

 private:
  Matrix<Real> spread_;  // mu F F^T
  Vector h_[4][3];
  Vector pulled_[4][3];  // S g
};

/// The stable neo-Hookean energy. With h = F g, c = cof(F) g and r = 1 / (Ic + 1):
///
///   K_ab = m (1 - r) (g_a . g_b) I + 2 m r^2 h_a h_b^T + l c_a c_b^T + l (J - a) [F (g_b x g_a)]
template <typename Real>
struct ElementLaw<ElementModel::kNeoHookean, Real> {
  using Vector = typename WideOf<Real>::Vector;

  FORCEGRID_INLINE void find(const ElementState<Real>& element) {
    const Vector m = element.stiffness[0];
    Matrix<Real> cofactor;
    cofactors(element.f, cofactor);
    const Vector j = dot3(element.f.at[0], cofactor.at[0]);
    const Vector r =
        static_cast<Real>(1) / (sum_of_products(element.f, element.f) + static_cast<Real>(1));
    stretch_ = m - m * r;
    spread_ = (m + m) * r * r;
    pressure_ = element.stiffness[1] * (j - element.stiffness[2]);
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        stress.at[c][d] = stretch_ * element.f.at[c][d] + pressure_ * cofactor.at[c][d];
      }
    }
    for (int a = 0; a < 4; ++a) {
      times(element.f, element.gradient[a], h_[a]);
      times(cofactor, element.gradient[a], normal_[a]);
    }
  }

  FORCEGRID_INLINE void block(const ElementState<Real>& element, int a, int b,
                              Matrix<Real>& k) const {
    const Vector alike = stretch_ * dot3(element.gradient[a], element.gradient[b]);
    Vector across[3];
    cross3(element.gradient[b], element.gradient[a], across);
    Vector turn[3];
    times(element.f, across, turn);
    for (int c = 0; c < 3; ++c) {
      for (int d = 0; d < 3; ++d) {
        k.at[c][d] =
            spread_ * h_[a][c] * h_[b][d] + element.stiffness[1] * normal_[a][c] * normal_[b][d];
      }
      k.at[c][c] += alike;
    }
    k.at[0][1] -= pressure_ * turn[2];
    k.at[0][2] += pressure_ * turn[1];
    k.at[1][0] += pressure_ * turn[2];
    k.at[1][2] -= pressure_ * turn[0];
    k.at[2][0] -= pressure_ * turn[1];
    k.at[2][1] += pressure_ * turn[0];
  }

  Matrix<Real> stress;

 private:
  Vector stretch_;
  Vector spread_;
  Vector pressure_;
  Vector h_[4][3];
  Vector normal_[4][3];
};

}  // namespace forcegrid::simulator::kernels
