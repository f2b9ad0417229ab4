// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>

namespace forcegrid::simulator {

/// The tool's path, from the positions that the servo has sent: where the tool was at any moment
/// between them, smooth enough for a damper.
///
/// A position is known in encoder counts only, and one count of 23 um in 2 ms is 11 mm/s. So at(t)
/// comes from the parabola that fits the positions in a window of kWindow_s best (least squares).
/// The middle of the window is t or, near the path's ends, as close to t as possible:
/// which is t or, at the way's end, as near to t as it can be:
///
///   p(s) = a + b s + c s^2,  min over a, b, c of sum_i |p(t_i - t) - P_i|^2,  at(t) = a
///
/// Constant velocity and constant acceleration are reproduced exactly, at the path's end too: the
/// value there has no delay and does not wait for later positions. White noise of sigma in N
/// positions, a time T apart, leaves sigma sqrt(192 / N^3) / T in the speed at the end: 1.3 mm/s
/// with counts of 23 um and positions at 500 Hz. For a sine of angular frequency w, the speed at
/// the end is wrong by w^2 kWindow_s^2 / 10 of it, further back by less. Where positions are scarce
/// (fewer than kFewestPositions in the window, or none in half of it: a slow servo, lost datagrams)
/// the path is straight from one position to the next.
/// Source: Savitzky and Golay, Anal. Chem. 36 (1964); at the ends as Gorry, Anal. Chem. 62 (1990).
/// Real-time: no (allocates). Threads: one.
class ToolPath {
 public:
  static constexpr double kWindow_s = 0.020;
  static constexpr std::size_t kFewestPositions = 6;
  static constexpr std::size_t kMostPositions = 8192;  ///< kept; older ones are forgotten

  /// Adds that the tool was at `position_W` [m] at `time_s`. A time or position that is not finite,
  /// or the newest time again, changes nothing. A time before the newest one begins a new path.
  void add(double time_s, const Eigen::Vector3d& position_W);
  void clear() noexcept { places_.clear(); }
  /// Forgets the positions that at() does not need for moments from `time_s` on.
  void forget_before(double time_s) noexcept;

  bool empty() const noexcept { return places_.empty(); }
  /// [m] The position at `time_s`; outside the path, the position at its nearer end. Not for an
  /// empty path.
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
