#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace forcegrid::paper {

/// How often something was right, with a 95 % confidence interval.
struct Proportion {
  std::size_t right = 0;
  std::size_t trials = 0;

  double percent() const noexcept;
  /// Ends of Wilson's score interval, z = 1.96; 0 and 100 without trials.
  /// Source: Wilson, J. American Statistical Association 22 (1927), 209-212.
  double low_percent() const noexcept;
  double high_percent() const noexcept;
};

/// How well a person feels forces. A look at a force F gives F + e, e normal in each axis,
///
///   sigma^2 = looks_per_s ((w |F|)^2 + floor^2)
///
/// so that the looks of one second together have the accuracy of one presentation in a
/// discrimination experiment: a force that is a fraction w larger is one standard deviation away
/// (d' = 1, which is what a just noticeable difference means there).
struct FeltNoise {
  double weber_fraction = 0.07;  ///< w
  double floor_N = 0.02;         ///< what is felt of no force
  double looks_per_s = 10.0;

  double sigma_N(const Eigen::Vector3d& force_W) const noexcept;
};

/// What is felt of `forces_W` [N], one look each. The same seed gives the same errors, in units of
/// their standard deviation, whatever the forces are.
std::vector<Eigen::Vector3d> feel(const std::vector<Eigen::Vector3d>& forces_W,
                                  const FeltNoise& noise, std::uint64_t seed);

/// The ideal observer: which of `known_W` (each of as many forces) most likely gave what was felt,
/// all being as likely beforehand.
///
///   ln L_i = sum_k [ -|felt_k - F_ik|^2 / (2 sigma_ik^2) - 3 ln sigma_ik ]
///
/// @returns its index; the first of several that are equally likely.
std::size_t most_likely(const std::vector<Eigen::Vector3d>& felt_W,
                        const std::vector<std::vector<Eigen::Vector3d>>& known_W,
                        const FeltNoise& noise);

}  // namespace forcegrid::paper
