// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>

namespace forcegrid::simulator {

/// The way that the tool went, from the positions that the servo has sent, smooth enough for a
/// damper: where it was at any moment between them.
///
/// A position is known in encoder counts, and one of 23 um in 2 ms is 11 mm/s. So at(t) is the
/// parabola that fits the positions of a window of kWindow_s best (least squares), the middle of
/// which is t or, at the way's end, as near to t as it can be:
///
///   p(s) = a + b s + c s^2,  min over a, b, c of sum_i |p(t_i - t) - P_i|^2,  at(t) = a
///
/// A steady motion and a steady acceleration come out as they are, at the end as well: what is at
/// hand there is neither late nor waits for later positions. Of white noise of sigma in N positions
/// a time T apart, sigma sqrt(192 / N^3) / T is left in the speed at the end, with counts of 23 um
/// and positions at 500 Hz 1.3 mm/s; of a sine of angular frequency w, w^2 kWindow_s^2 / 10 of
/// its speed is wrong there, less further back. Where positions are scarce (fewer than
/// kFewestPositions in the window, or half of it without any: a slow servo, datagrams lost) the way
/// is straight from one to the next.
/// Source: Savitzky and Golay, Anal. Chem. 36 (1964); at the ends as Gorry, Anal. Chem. 62 (1990).
/// Real-time: no (allocates). Threads: one.
class ToolPath {
 public:
  static constexpr double kWindow_s = 0.020;
  static constexpr std::size_t kFewestPositions = 6;
  static constexpr std::size_t kMostPositions = 8192;  ///< kept; older ones are forgotten

  /// The tool was at `position_W` [m] at `time_s`. The newest moment again, a time or position that
  /// is not finite, change nothing; a time before the newest begins a new way.
  void add(double time_s, const Eigen::Vector3d& position_W);
  void clear() noexcept { places_.clear(); }
  /// What at() needs for moments from `time_s` on stays.
  void forget_before(double time_s) noexcept;

  bool empty() const noexcept { return places_.empty(); }
  /// [m] at `time_s`, at the way's ends outside it. Not for an empty way.
  Eigen::Vector3d at(double time_s) const noexcept;

 private:
  struct Place {
    double time_s = 0.0;
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
  };
  using Iterator = std::deque<Place>::const_iterator;

  Iterator first_from(double time_s) const noexcept;

  std::deque<Place> places_;
};

}  // namespace forcegrid::simulator
