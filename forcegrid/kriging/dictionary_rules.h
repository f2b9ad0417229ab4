// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

#include "forcegrid/kriging/kriging_kernel.h"
#include "forcegrid/kriging/kriging_simd.h"
#include "forcegrid/kriging/sample_spacing.h"

namespace forcegrid::kriging {

// The rules by which DictionaryField and ContactIndexedField keep a small dictionary of samples.
// `Stored` is a slot of the dictionary: `used`, force_N, doubt_N2, first_position_m and
// first_force_N, the values before other samples replaced it. Rules and reasons: docs/kriging.md,
// "The field". All of them are real-time safe.

/// A sample doubted by this many nuggets more than another is replaced by it, and counts half.
inline constexpr double kDoubtedNuggets = 10.0;
/// [m^2] Distances below the root of this, 10 mm, count about the same in the value of a sample.
inline constexpr double kEvictionReach_m2 = 1e-4;
/// The value of an answer to a query relative to a sample: the tool may never pass there.
inline constexpr double kQueryValue = 0.05;

/// What happens to the newest sample of a dictionary when the next one comes.
struct Settled {
  enum class Fate { kStays, kReplaces, kGoes };
  Fate fate = Fate::kStays;
  int replaced = -1;  ///< the slot to remove, for kReplaces
};

/// The newest sample stays if it is apart from all others. It replaces the nearest if that is
/// doubted more, or if it repeats the place where that one began; otherwise it is dropped.
/// @param distance_m2 callable, [m^2] of a stored sample from the newest.
template <typename Stored, std::size_t kSlots, typename Distance>
Settled settle_newest(std::array<Stored, kSlots>& stored, int newest, const SampleSpacing& spacing,
                      double nugget_N2, const Distance& distance_m2) noexcept {
  Stored& t = stored[static_cast<std::size_t>(newest)];
  int nearest = -1;
  double nearest_m2 = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < kSlots; ++i) {
    const Stored& s = stored[i];
    if (!s.used || &s == &t) {
      continue;
    }
    const double d2 = distance_m2(s);
    if (d2 < nearest_m2) {
      nearest_m2 = d2;
      nearest = static_cast<int>(i);
    }
  }
  if (nearest < 0 || spacing.apart(nearest_m2)) {
    return {};
  }
  const Stored& n = stored[static_cast<std::size_t>(nearest)];
  const double from_first_m2 =
      spacing.distance_m2((n.first_position_m - t.position_m).squaredNorm(),
                          (n.first_force_N - t.force_N).squaredNorm());
  const bool repeated = spacing.repeated(std::max(from_first_m2, nearest_m2));
  if (repeated) {
    t.first_position_m = n.first_position_m;
    t.first_force_N = n.first_force_N;
  } else if (!(n.doubt_N2 - t.doubt_N2 > kDoubtedNuggets * nugget_N2)) {
    return {Settled::Fate::kGoes, -1};
  }
  return {Settled::Fate::kReplaces, nearest};
}

/// The slot to remove when there is no room: that of the least value. @param newest is never
/// removed.
/// @param separation_m2 callable, [m^2] between two stored samples, the same in both orders.
/// @param value callable, of a slot and the squared distance to its nearest neighbour.
template <typename Stored, std::size_t kSlots, typename Separation, typename Value>
int least_valuable(const std::array<Stored, kSlots>& stored, int newest,
                   const Separation& separation_m2, const Value& value) noexcept {
  std::array<double, kSlots> nearest_m2;
  nearest_m2.fill(std::numeric_limits<double>::max());
  for (std::size_t i = 0; i < kSlots; ++i) {
    for (std::size_t j = stored[i].used ? i + 1 : kSlots; j < kSlots; ++j) {
      if (stored[j].used) {
        const double apart_m2 = separation_m2(stored[i], stored[j]);
        nearest_m2[i] = std::min(nearest_m2[i], apart_m2);
        nearest_m2[j] = std::min(nearest_m2[j], apart_m2);
      }
    }
  }
  int worst = -1;
  double worst_value = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < kSlots; ++i) {
    if (!stored[i].used || static_cast<int>(i) == newest) {
      continue;
    }
    const double slot_value = value(static_cast<int>(i), nearest_m2[i]);
    if (slot_value < worst_value) {
      worst_value = slot_value;
      worst = static_cast<int>(i);
    }
  }
  return worst;
}

/// V = scale * covariance + nugget I, which an innovation is expected to have.
inline Eigen::Matrix3d innovation_covariance_N2(const Eigen::Matrix3d& covariance_N2, double scale,
                                                double nugget_N2) noexcept {
  Eigen::Matrix3d v_N2 = covariance_N2 * scale;
  v_N2.diagonal().array() += nugget_N2;
  return v_N2;
}

/// The size of an innovation relative to its prediction: e^T V^-1 e / 3.
inline double normalised_innovation(const Eigen::Vector3d& error_N,
                                    const Eigen::Matrix3d& covariance_N2, double scale,
                                    double nugget_N2) noexcept {
  const Eigen::Matrix3d v_N2 = innovation_covariance_N2(covariance_N2, scale, nugget_N2);
  return error_N.dot(v_N2.inverse() * error_N) / 3.0;
}

/// j <- j + the radial part of a field's stiffness.
template <typename Real>
void add_radial_stiffness(const RadialSlope<Real>& slope, Eigen::Matrix3d& j) noexcept {
  for (int i = 0; i < 6; ++i) {
    const int r = kStiffnessRow[i];
    const int c = kStiffnessColumn[i];
    j(r, c) += static_cast<double>(slope.stiffness_N_per_m[i]);
    if (r != c) {
      j(c, r) += static_cast<double>(slope.stiffness_N_per_m[i]);
    }
  }
}

}  // namespace forcegrid::kriging
