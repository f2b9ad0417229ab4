// SPDX-License-Identifier: Apache-2.0
#include "paper/observer.h"

#include <cmath>
#include <limits>

#include "evaluation/motions/trajectories.h"

namespace forcegrid::paper {
namespace {

constexpr double kZ = 1.96;  // half width of a normal distribution's middle 95 %

// Centre and half width of Wilson's interval, as fractions.
struct Interval {
  double centre = 0.5;
  double half = 0.5;
};

Interval wilson(const Proportion& proportion) noexcept {
  if (proportion.trials == 0) {
    return {};
  }
  const auto n = static_cast<double>(proportion.trials);
  const double p = static_cast<double>(proportion.right) / n;
  const double scale = 1.0 / (1.0 + kZ * kZ / n);
  return {scale * (p + kZ * kZ / (2.0 * n)),
          scale * kZ * std::sqrt(p * (1.0 - p) / n + kZ * kZ / (4.0 * n * n))};
}

}  // namespace

double Proportion::percent() const noexcept {
  return trials == 0 ? std::numeric_limits<double>::quiet_NaN()
                     : 100.0 * static_cast<double>(right) / static_cast<double>(trials);
}

double Proportion::low_percent() const noexcept {
  const Interval interval = wilson(*this);
  return 100.0 * (interval.centre - interval.half);
}

double Proportion::high_percent() const noexcept {
  const Interval interval = wilson(*this);
  return 100.0 * (interval.centre + interval.half);
}

double FeltNoise::sigma_N(const Eigen::Vector3d& force_W) const noexcept {
  return std::sqrt(looks_per_s *
                   (weber_fraction * weber_fraction * force_W.squaredNorm() + floor_N * floor_N));
}

std::vector<Eigen::Vector3d> feel(const std::vector<Eigen::Vector3d>& forces_W,
                                  const FeltNoise& noise, std::uint64_t seed) {
  evaluation::SeededNumbers numbers(seed);
  std::vector<Eigen::Vector3d> felt_W;
  for (const Eigen::Vector3d& force_W : forces_W) {
    const double sigma_N = noise.sigma_N(force_W);
    Eigen::Vector3d felt = force_W;
    for (int axis = 0; axis < 3; ++axis) {
      felt[axis] += sigma_N * numbers.normal();
    }
    felt_W.push_back(felt);
  }
  return felt_W;
}

std::size_t most_likely(const std::vector<Eigen::Vector3d>& felt_W,
                        const std::vector<std::vector<Eigen::Vector3d>>& known_W,
                        const FeltNoise& noise) {
  std::size_t best = 0;
  double most = -std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < known_W.size(); ++i) {
    double log_likelihood = 0.0;
    for (std::size_t k = 0; k < felt_W.size(); ++k) {
      const double sigma_N = noise.sigma_N(known_W[i][k]);
      log_likelihood -= (felt_W[k] - known_W[i][k]).squaredNorm() / (2.0 * sigma_N * sigma_N) +
                        3.0 * std::log(sigma_N);
    }
    if (log_likelihood > most) {
      most = log_likelihood;
      best = i;
    }
  }
  return best;
}

}  // namespace forcegrid::paper
