#include <algorithm>
#include <bit>
#include <cmath>

#include "simulator/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

// Keeps a collapsed spring's direction finite; far below any length that a mesh has.
constexpr float kSmallestSquaredLength_m2 = 1e-20F;
// No spring is stretched so far that its force is finite in single precision.
constexpr float kLargestArgument = 60.0F;

// Springs whose laws are worked out side by side; the compiler turns the loops into SIMD.
constexpr std::int32_t kRun = kSpringPadding;

template <typename Real>
struct Run {
  Real d[3][kRun];
  Real t_N_per_m[kRun];
  Real root[kRun];  // sqrt(f' - f/l) / l
};

template <typename Real>
struct Hyperbolic {
  Real sinh_over_z;
  Real cosh;
};

// Without a call or a branch, so that a run goes through SIMD: e^|z| = 2^n e^r with |r| <= ln(2)/2,
// and sinh's series where the difference of two exponentials would lose its digits.
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

template <typename Real, typename Position>
FORCEGRID_INLINE void load_run(const std::int32_t* owner, const std::int32_t* other,
                               const Position* position, Run<Real>& run) {
  for (std::int32_t k = 0; k < kRun; ++k) {
    const auto d = position[other[k]].xyz - position[owner[k]].xyz;
    run.d[0][k] = d[0];
    run.d[1][k] = d[1];
    run.d[2][k] = d[2];
  }
}

template <bool kExponential, typename Real>
FORCEGRID_INLINE void spring_law(const SpringConstants<Real>* constants, Run<Real>& run) {
  for (std::int32_t k = 0; k < kRun; ++k) {
    const Real squared =
        run.d[0][k] * run.d[0][k] + run.d[1][k] * run.d[1][k] + run.d[2][k] * run.d[2][k];
    const Real length = std::sqrt(std::max(squared, Real{kSmallestSquaredLength_m2}));
    const Real inverse = Real{1} / length;
    const Real strain = length * constants[k].inverse_length_per_m - Real{1};
    const Real c_strain2 = constants[k].cubic * strain * strain;
    Hyperbolic<Real> h{Real{1}, Real{1}};
    if constexpr (kExponential) {
      h = hyperbolic(constants[k].exponent * strain);
    }
    const Real t = constants[k].scale_N * strain * (h.sinh_over_z + c_strain2) * inverse;
    const Real slope =
        constants[k].scale_N * constants[k].inverse_length_per_m * (h.cosh + Real{3} * c_strain2);
    run.t_N_per_m[k] = t;
    run.root[k] = std::sqrt(std::max(slope - t, Real{0})) * inverse;
  }
}

template <typename Real>
FORCEGRID_INLINE void store_run(const Run<Real>& run, SpringTangent* tangent) {
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
    load_run(&rows.owner[s], &rows.other[s], position, run);
    spring_law<kExponential>(&constants[s], run);
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
    load_run(&rows.owner[s], &rows.other[s], position, run);
    spring_law<kExponential>(&constants[s], run);
    store_run(run, &tangent[s]);
    std::copy(run.t_N_per_m, run.t_N_per_m + kRun, &t_N_per_m[s]);
  }
}

FORCEGRID_MULTIVERSION void find_single(const SpringRows& rows,
                                        const SpringConstants<float>* constants, bool exponential,
                                        const Lanes* state, Single* position,
                                        SpringTangent* tangent) noexcept {
  const std::int32_t vertices = rows.reach;
  for (std::int32_t i = 0; i < vertices; ++i) {
    position[i].xyz =
        Float4{state[i].component[0][0], state[i].component[1][0], state[i].component[2][0], 0.0F};
  }
  if (exponential) {
    single_tangents<true>(rows, constants, position, tangent);
  } else {
    single_tangents<false>(rows, constants, position, tangent);
  }
}

FORCEGRID_MULTIVERSION void find_at(const SpringRows& rows, const SpringConstants<float>* constants,
                                    bool exponential, const Single* position,
                                    SpringTangent* tangent) noexcept {
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
                   bool exponential, const Lanes* state, Single* position,
                   SpringTangent* tangent) noexcept {
  find_single(rows, constants, exponential, state, position, tangent);
}

void find_tangents_at(const SpringRows& rows, const SpringConstants<float>* constants,
                      bool exponential, const Single* position, SpringTangent* tangent) noexcept {
  find_at(rows, constants, exponential, position, tangent);
}

void find_tangents(const SpringRows& rows, const SpringConstants<double>* constants,
                   bool exponential, const Precise* position, double* t_N_per_m,
                   SpringTangent* tangent) noexcept {
  find_precise(rows, constants, exponential, position, t_N_per_m, tangent);
}

}  // namespace forcegrid::simulator::kernels
