// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace forcegrid::rt {

/// Percentiles of a stream of non-negative numbers in fixed memory: a histogram with 512 bins an
/// octave from 1/64 up to 2^34 gives any percentile to within 0.2 %, never below; the extremes are
/// exact.
/// Real-time: add() neither allocates, locks nor throws.
class Percentiles {
 public:
  /// Negative and non-finite values are counted apart and otherwise ignored.
  void add(double value) noexcept {
    if (!(value >= 0.0) || !std::isfinite(value)) {
      ++ignored_;
      return;
    }
    ++count_;
    sum_ += value;
    min_ = std::min(min_, value);
    max_ = std::max(max_, value);
    ++bins_[bin_of(value)];
  }

  std::uint64_t count() const noexcept { return count_; }
  std::uint64_t ignored() const noexcept { return ignored_; }
  double min() const noexcept { return count_ == 0 ? 0.0 : min_; }
  double max() const noexcept { return max_; }
  double mean() const noexcept { return count_ == 0 ? 0.0 : sum_ / static_cast<double>(count_); }

  /// The smallest bin edge below which a fraction `p` in [0, 1] of the values lie, clamped to the
  /// exact extremes; 0 without values.
  double at(double p) const noexcept {
    if (count_ == 0) {
      return 0.0;
    }
    const auto wanted = static_cast<std::uint64_t>(std::ceil(p * static_cast<double>(count_)));
    std::uint64_t below = 0;
    for (std::size_t bin = 0; bin < bins_.size(); ++bin) {
      below += bins_[bin];
      if (below >= wanted && below > 0) {
        return std::clamp(upper_edge(bin), min_, max_);
      }
    }
    return max_;
  }

  /// How many values are at most `value`; those up to 0.2 % above it may be among them.
  std::uint64_t count_up_to(double value) const noexcept {
    if (value >= max_) {
      return count_;
    }
    std::uint64_t below = 0;
    for (std::size_t bin = 0; value >= 0.0 && bin <= bin_of(value); ++bin) {
      below += bins_[bin];
    }
    return below;
  }

 private:
  static constexpr int kBinsPerOctave = 512;
  static constexpr int kLowestExponent = -6;
  static constexpr int kHighestExponent = 34;
  static constexpr std::size_t kBins =
      static_cast<std::size_t>((kHighestExponent - kLowestExponent) * kBinsPerOctave) + 1;

  static std::size_t bin_of(double value) noexcept {
    int exponent = 0;
    const double mantissa = std::frexp(value, &exponent);  // value = mantissa * 2^exponent
    const int octave = exponent - 1 - kLowestExponent;
    if (value <= 0.0 || octave < 0) {
      return 0;
    }
    const auto within = static_cast<int>((mantissa - 0.5) * 2.0 * kBinsPerOctave);
    return std::min(static_cast<std::size_t>(octave * kBinsPerOctave + within) + 1, kBins - 1);
  }
  static double upper_edge(std::size_t bin) noexcept {
    const auto octave = static_cast<int>(bin / kBinsPerOctave);
    const auto within = static_cast<double>(bin % kBinsPerOctave);
    return std::ldexp(1.0 + within / kBinsPerOctave, octave + kLowestExponent);
  }

  std::array<std::uint64_t, kBins> bins_{};
  std::uint64_t count_ = 0;
  std::uint64_t ignored_ = 0;
  double sum_ = 0.0;
  double min_ = std::numeric_limits<double>::infinity();
  double max_ = 0.0;
};

}  // namespace forcegrid::rt
