// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/spring_laws.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "simulator/kernels/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

// Keeps a collapsed spring's direction finite; far below any length that a mesh has.
constexpr float kSmallestSquaredLength_m2 = 1e-20F;
// No spring is stretched so far that its force is finite in single precision.
constexpr float kLargestArgument = 60.0F;

// Springs whose laws are evaluated side by side; the compiler turns the loops into SIMD.
constexpr std::int32_t kRun = kSpringPadding;

// The inputs and results of a run of springs, number by number.
template <typename Real>
struct Run {
  alignas(32) Real d[3][kRun];
  alignas(32) Real inverse_length_per_m[kRun];
  alignas(32) Real scale_N[kRun];
  alignas(32) Real cubic[kRun];
  alignas(32) Real exponent[kRun];
  alignas(32) Real t_N_per_m[kRun];
  alignas(32) Real root[kRun];  // sqrt(f' - f/l) / l
};

template <typename Real>
struct Hyperbolic {
  Real sinh_over_z;
  Real cosh;
};

// Has no call and no branch, so that a run uses SIMD: e^|z| = 2^n e^r with |r| <= ln(2)/2, and
// sinh's series where the difference of two exponentials would lose its digits.
FORCEGRID_INLINE Hyperbolic<float> hyperbolic(float z) {
  constexpr float kRound = 12582912.0F;  // 1.5 * 2^23: adding it rounds to a whole number
  constexpr std::int32_t kRoundBits = 0x4B400000;
  constexpr float kLn2High = 0.693359375F;
  constexpr float kLn2Low = -2.12194440e-4F;
  const float m = std::min(std::abs(z), kLargestArgument);
  const float shifted = m * 1.44269504F + kRound;
  const std::int32_t n = std::bit_cast<std::int32_t>(shifted) - kRoundBits;
  const float whole = shifted - kRound;
  const float r = (m - whole * kLn2High) - whole * kLn2Low;
  const float exp_r =
      1.0F +
      r * (1.0F +
           r / 2.0F *
               (1.0F +
                r / 3.0F *
                    (1.0F + r / 4.0F * (1.0F + r / 5.0F * (1.0F + r / 6.0F * (1.0F + r / 7.0F))))));
  const float up = std::bit_cast<float>((n + 127) << 23) * exp_r;
  const float down = 1.0F / up;
  const float m2 = m * m;
  const float series =
      1.0F + m2 / 6.0F * (1.0F + m2 / 20.0F * (1.0F + m2 / 42.0F * (1.0F + m2 / 72.0F)));
  const float direct = 0.5F * (up - down) / std::max(m, 1.0F);
  return {m < 1.0F ? series : direct, 0.5F * (up + down)};
}

FORCEGRID_INLINE Hyperbolic<double> hyperbolic(double z) {
  const double m = std::abs(z);
  return {m > 1e-4 ? std::sinh(m) / m : 1.0 + m * m / 6.0, std::cosh(m)};
}

// Eight springs' four numbers each, spring k beside spring k + 4 in row k, become four numbers of
// eight springs each.
FORCEGRID_INLINE void transpose(Float8 (&row)[4]) {
  const Float8 low01 = __builtin_shufflevector(row[0], row[1], 0, 8, 1, 9, 4, 12, 5, 13);
  const Float8 high01 = __builtin_shufflevector(row[0], row[1], 2, 10, 3, 11, 6, 14, 7, 15);
  const Float8 low23 = __builtin_shufflevector(row[2], row[3], 0, 8, 1, 9, 4, 12, 5, 13);
  const Float8 high23 = __builtin_shufflevector(row[2], row[3], 2, 10, 3, 11, 6, 14, 7, 15);
  row[0] = __builtin_shufflevector(low01, low23, 0, 1, 8, 9, 4, 5, 12, 13);
  row[1] = __builtin_shufflevector(low01, low23, 2, 3, 10, 11, 6, 7, 14, 15);
  row[2] = __builtin_shufflevector(high01, high23, 0, 1, 8, 9, 4, 5, 12, 13);
  row[3] = __builtin_shufflevector(high01, high23, 2, 3, 10, 11, 6, 7, 14, 15);
}

FORCEGRID_INLINE void load_run(const std::int32_t* owner, const std::int32_t* other,
                               const Single* position, const SpringConstants<float>* constants,
                               Run<float>& run) {
  for (std::int32_t k = 0; k < kRun; k += 8) {
    Float8 d[4];
    Float8 law[4];
    for (std::int32_t n = 0; n < 4; ++n) {
      const std::int32_t s = k + n;
      d[n] = FORCEGRID_PAIR(position[other[s]].xyz, position[other[s + 4]].xyz) -
             FORCEGRID_PAIR(position[owner[s]].xyz, position[owner[s + 4]].xyz);
      law[n] = FORCEGRID_PAIR(load<Float4>(&constants[s]), load<Float4>(&constants[s + 4]));
    }
    transpose(d);
    transpose(law);
    for (int c = 0; c < 3; ++c) {
      store(&run.d[c][k], d[c]);
    }
    store(&run.inverse_length_per_m[k], law[0]);
    store(&run.scale_N[k], law[1]);
    store(&run.cubic[k], law[2]);
    store(&run.exponent[k], law[3]);
  }
}

FORCEGRID_INLINE void load_run(const std::int32_t* owner, const std::int32_t* other,
                               const Precise* position, const SpringConstants<double>* constants,
                               Run<double>& run) {
  for (std::int32_t k = 0; k < kRun; ++k) {
    const Double4 d = position[other[k]].xyz - position[owner[k]].xyz;
    run.d[0][k] = d[0];
    run.d[1][k] = d[1];
    run.d[2][k] = d[2];
    run.inverse_length_per_m[k] = constants[k].inverse_length_per_m;
    run.scale_N[k] = constants[k].scale_N;
    run.cubic[k] = constants[k].cubic;
    run.exponent[k] = constants[k].exponent;
  }
}

template <bool kExponential, typename Real>
FORCEGRID_INLINE void spring_law(Run<Real>& run) {
  for (std::int32_t k = 0; k < kRun; ++k) {
    const Real squared =
        run.d[0][k] * run.d[0][k] + run.d[1][k] * run.d[1][k] + run.d[2][k] * run.d[2][k];
    const Real length = std::sqrt(std::max(squared, Real{kSmallestSquaredLength_m2}));
    const Real inverse = Real{1} / length;
    const Real strain = length * run.inverse_length_per_m[k] - Real{1};
    const Real c_strain2 = run.cubic[k] * strain * strain;
    Hyperbolic<Real> h{Real{1}, Real{1}};
    if constexpr (kExponential) {
      h = hyperbolic(run.exponent[k] * strain);
    }
    const Real t = run.scale_N[k] * strain * (h.sinh_over_z + c_strain2) * inverse;
    const Real slope =
        run.scale_N[k] * run.inverse_length_per_m[k] * (h.cosh + Real{3} * c_strain2);
    run.t_N_per_m[k] = t;
    run.root[k] = std::sqrt(std::max(slope - t, Real{0})) * inverse;
  }
}

FORCEGRID_INLINE void store_run(const Run<float>& run, SpringTangent* tangent) {
  for (std::int32_t k = 0; k < kRun; k += 8) {
    Float8 row[4];
    const auto root = load<Float8>(&run.root[k]);
    for (int c = 0; c < 3; ++c) {
      row[c] = load<Float8>(&run.d[c][k]) * root;
    }
    row[3] = load<Float8>(&run.t_N_per_m[k]);
    transpose(row);
    for (std::int32_t n = 0; n < 4; ++n) {
      store(&tangent[k + n], FORCEGRID_LOW(row[n]));
      store(&tangent[k + n + 4], FORCEGRID_HIGH(row[n]));
    }
  }
}

FORCEGRID_INLINE void store_run(const Run<double>& run, SpringTangent* tangent) {
  for (std::int32_t k = 0; k < kRun; ++k) {
    tangent[k].w_x = static_cast<float>(run.d[0][k] * run.root[k]);
    tangent[k].w_y = static_cast<float>(run.d[1][k] * run.root[k]);
    tangent[k].w_z = static_cast<float>(run.d[2][k] * run.root[k]);
    tangent[k].t_N_per_m = static_cast<float>(run.t_N_per_m[k]);
  }
}

template <bool kExponential>
FORCEGRID_INLINE void single_tangents(const SpringRows& rows,
                                      const SpringConstants<float>* constants,
                                      const Single* position, SpringTangent* tangent) {
  const std::int32_t springs = rows.row_begin[static_cast<std::size_t>(rows.active)];
  for (std::int32_t s = 0; s < springs; s += kRun) {
    Run<float> run;
    load_run(&rows.owner[s], &rows.other[s], position, &constants[s], run);
    spring_law<kExponential>(run);
    store_run(run, &tangent[s]);
  }
}

template <bool kExponential>
FORCEGRID_INLINE void precise_tangents(const SpringRows& rows,
                                       const SpringConstants<double>* constants,
                                       const Precise* position, double* t_N_per_m,
                                       SpringTangent* tangent) {
  const std::int32_t springs = rows.row_begin[static_cast<std::size_t>(rows.active)];
  for (std::int32_t s = 0; s < springs; s += kRun) {
    Run<double> run;
    load_run(&rows.owner[s], &rows.other[s], position, &constants[s], run);
    spring_law<kExponential>(run);
    store_run(run, &tangent[s]);
    std::copy(run.t_N_per_m, run.t_N_per_m + kRun, &t_N_per_m[s]);
  }
}

FORCEGRID_MULTIVERSION void find_single(const SpringRows& rows,
                                        const SpringConstants<float>* constants, bool exponential,
                                        const Single* position, SpringTangent* tangent) noexcept {
  if (exponential) {
    single_tangents<true>(rows, constants, position, tangent);
  } else {
    single_tangents<false>(rows, constants, position, tangent);
  }
}

FORCEGRID_MULTIVERSION void find_precise(const SpringRows& rows,
                                         const SpringConstants<double>* constants, bool exponential,
                                         const Precise* position, double* t_N_per_m,
                                         SpringTangent* tangent) noexcept {
  if (exponential) {
    precise_tangents<true>(rows, constants, position, t_N_per_m, tangent);
  } else {
    precise_tangents<false>(rows, constants, position, t_N_per_m, tangent);
  }
}

}  // namespace

void find_tangents(const SpringRows& rows, const SpringConstants<float>* constants,
                   bool exponential, const Single* position, SpringTangent* tangent) noexcept {
  find_single(rows, constants, exponential, position, tangent);
}

void find_tangents(const SpringRows& rows, const SpringConstants<double>* constants,
                   bool exponential, const Precise* position, double* t_N_per_m,
                   SpringTangent* tangent) noexcept {
  find_precise(rows, constants, exponential, position, t_N_per_m, tangent);
}

}  // namespace forcegrid::simulator::kernels
