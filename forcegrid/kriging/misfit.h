// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

namespace forcegrid::kriging {

/// Whether a candidate's predictions are as good as it says: Page's test on its innovations.
///
///   S <- max(0, S + ln p(e | k^2 V) / p(e | V)),   ln ... = 3 n (1 - 1/k^2) / 2 - 3 ln k
///
/// with the normalised square n = e^T V^-1 e / 3 of an innovation and k = 3: the hypothesis that
/// errors are three times as large as predicted. A misfit is found when S exceeds `threshold` nats.
/// If the predictions are right, that happens at most once in exp(threshold) samples on average
/// (Lorden's bound for Page's test).
/// Real-time: yes. Threads: one.
class Misfit {
 public:
  /// @param threshold [nats] > 0
  explicit Misfit(double threshold) noexcept : threshold_(threshold) {}

  void add(double normalised) noexcept {
    constexpr double kLarger = 3.0;
    const double gain =
        1.5 * normalised * (1.0 - 1.0 / (kLarger * kLarger)) - 3.0 * std::log(kLarger);
    sum_ = std::clamp(sum_ + gain, 0.0, 2.0 * threshold_);
  }
  bool found() const noexcept { return sum_ > threshold_; }
  void restart() noexcept { sum_ = 0.0; }

 private:
  double threshold_;
  double sum_ = 0.0;
};

}  // namespace forcegrid::kriging
