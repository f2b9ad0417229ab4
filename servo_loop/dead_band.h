// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::servo {

/// Removes from a low-passed velocity what quantisation alone makes of a tool at rest, without a
/// step at the edge of the dead band: u_i = v_i max(0, 1 - v_0 / |v_i|), v_0 = counts q_i / tau.
/// One count that comes and goes leaves at most q / tau in a first-order filter.
/// @param velocity_W [m/s] v. @param resolution_W_m [m] q, of one count by axis.
/// Real-time: no allocation, lock or throw. Threads: any.
inline Eigen::Vector3d without_trembling_counts(const Eigen::Vector3d& velocity_W,
                                                const Eigen::Vector3d& resolution_W_m,
                                                double counts, double time_constant_s) noexcept {
  const Eigen::Array3d band_m_per_s = counts / time_constant_s * resolution_W_m.array();
  return (velocity_W.array().sign() * (velocity_W.array().abs() - band_m_per_s).max(0.0)).matrix();
}

}  // namespace forcegrid::servo
