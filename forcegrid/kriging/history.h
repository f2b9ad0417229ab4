// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <limits>
#include <vector>

namespace forcegrid {

/// The recent path of the tool at the servo's rate, seen through low-pass filters of several time
/// constants, and looked up at the time for which a sample's force was computed.
///
///   lag_j(t) = P(t) - LP_j(t),   tau_j dLP_j/dt = P - LP_j
///
/// exact to 2e-7 of the lag for a path that is straight between observations. A visco-elastic
/// object's memory of the path is close to linear in a few such lags. Source: the history kernel of
/// docs/kriging.md; filters with a first-order hold. Real-time: only the constructor allocates;
/// find() is a binary search. Threads: one.
class ToolHistory {
 public:
  static constexpr int kLags = 6;
  /// [m] Column j is lag_j. Row by row in memory, so that all lags along an axis are one operation.
  using Lags = Eigen::Matrix<float, 3, kLags, Eigen::RowMajor>;
  using TimeConstants = std::array<double, kLags>;

  /// Entries are kept about a millisecond apart, so that kEntries of them cover about a second at
  /// any rate of the servo.
  static constexpr std::size_t kEntries = 1024;
  static constexpr double kSpacing_s = 1.4e-3;  ///< from an entry to the one after the next

  /// @param time_constants_s tau_j, all positive.
  explicit ToolHistory(const TimeConstants& time_constants_s);

  /// Call once per servo cycle. A time that does not increase or a value that is not finite is
  /// ignored; after a gap of more than kLongestGap_s the path starts again.
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept;

  bool empty() const noexcept { return count_ == 0; }
  /// The lags at the newest observation.
  const Lags& now() const noexcept { return entries_[newest_].lags; }

  /// The lags at `time_s`, linear between the entries around it.
  /// @returns false, with `lags` unchanged, for a time before the oldest kept entry or after the
  ///   newest observation.
  [[nodiscard]] bool find(double time_s, Lags& lags) const noexcept;

  std::size_t allocated_bytes() const noexcept { return entries_.size() * sizeof(Entry); }

  static constexpr double kLongestGap_s = 0.25;

 private:
  struct Entry {
    double time_s = 0.0;
    Lags lags = Lags::Zero();
  };
  /// The `age`-th newest entry.
  const Entry& entry(std::size_t age) const noexcept {
    return entries_[(newest_ + kEntries - age) % kEntries];
  }

  using PerLag = Eigen::Array<double, 1, kLags>;
  PerLag kept_after(double dt_s) noexcept;

  PerLag time_constants_s_;
  PerLag per_time_constant_Hz_;
  double shortest_s_;  ///< of the time constants
  double period_s_ = std::numeric_limits<double>::infinity();
  PerLag kept_after_period_ = PerLag::Zero();
  std::vector<Entry> entries_;
  std::size_t newest_ = 0;
  std::size_t count_ = 0;
  double time_s_ = 0.0;
  Eigen::Vector3d position_W_ = Eigen::Vector3d::Zero();
  std::array<PerLag, 3> lags_{PerLag::Zero(), PerLag::Zero(), PerLag::Zero()};  ///< [m] by axis
};

}  // namespace forcegrid
