// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace forcegrid::paper {

/// Fraction of correct answers, with a 95 % confidence interval.
struct Proportion {
  std::size_t right = 0;
  std::size_t trials = 0;

  double percent() const noexcept;
  /// Ends of Wilson's score interval, z = 1.96; 0 and 100 without trials.
  /// Source: Wilson, J. American Statistical Association 22 (1927), 209-212.
  double low_percent() const noexcept;
  double high_percent() const noexcept;
};

/// Accuracy of a person's sense of force. Each observation of a force F gives F + e, with e normal
/// in each axis,
///
///   sigma^2 = looks_per_s ((w |F|)^2 + floor^2)
///
/// so that the observations of one second together have the accuracy of one presentation in a
/// discrimination experiment: a force that is larger by a fraction w is one standard deviation away
/// (d' = 1, the just noticeable difference).
struct FeltNoise {
  double weber_fraction = 0.07;  ///< w
  double floor_N = 0.02;         ///< error without force
  double looks_per_s = 10.0;

  double sigma_N(const Eigen::Vector3d& force_W) const noexcept;
};

/// Returns one noisy observation of each of `forces_W` [N]. The same seed gives the same errors in
/// units of their standard deviation, for any forces.
std::vector<Eigen::Vector3d> feel(const std::vector<Eigen::Vector3d>& forces_W,
                                  const FeltNoise& noise, std::uint64_t seed);

/// The ideal observer: which of `known_W` (each with as many forces as `felt_W`) most likely caused
/// the observations, with equal prior probabilities.
///
///   ln L_i = sum_k [ -|felt_k - F_ik|^2 / (2 sigma_ik^2) - 3 ln sigma_ik ]
///
/// @returns its index; the first of several equally likely ones.
std::size_t most_likely(const std::vector<Eigen::Vector3d>& felt_W,
                        const std::vector<std::vector<Eigen::Vector3d>>& known_W,
                        const FeltNoise& noise);

}  // namespace forcegrid::paper
