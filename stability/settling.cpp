// SPDX-License-Identifier: Apache-2.0
#include "stability/settling.h"

#include <algorithm>

namespace forcegrid::stability {
namespace {

double peak_to_peak(const std::vector<double>& values) {
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return *most - *least;
}

// Residuals of `values` from their least-squares line.
std::vector<double> without_line(const std::vector<double>& values) {
  const auto count = static_cast<double>(values.size());
  const double middle = 0.5 * (count - 1.0);
  double mean = 0.0;
  double slope_sum = 0.0;
  double square_sum = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double place = static_cast<double>(i) - middle;
    mean += values[i] / count;
    slope_sum += place * values[i];
    square_sum += place * place;
  }
  const double slope = square_sum > 0.0 ? slope_sum / square_sum : 0.0;
  std::vector<double> left;
  left.reserve(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    left.push_back(values[i] - mean - slope * (static_cast<double>(i) - middle));
  }
  return left;
}

}  // namespace

Settling judge_settling(const std::vector<Eigen::Vector3d>& positions_W) {
  Settling result;
  if (positions_W.empty()) {
    return result;
  }
  std::vector<double> widest_m;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<double> values_m;
    values_m.reserve(positions_W.size());
    for (const Eigen::Vector3d& position_W : positions_W) {
      values_m.push_back(position_W[axis]);
    }
    const double peaks_m = peak_to_peak(values_m);
    if (axis == 0 || peaks_m > result.peak_to_peak_m) {
      result.peak_to_peak_m = peaks_m;
      widest_m = std::move(values_m);
    }
  }
  if (result.peak_to_peak_m >= StatedRun::kSettled_m) {
    result.behaviour = peak_to_peak(without_line(widest_m)) > 0.5 * result.peak_to_peak_m
                           ? Behaviour::kLimitCycle
                           : Behaviour::kCreep;
  }
  return result;
}

}  // namespace forcegrid::stability
