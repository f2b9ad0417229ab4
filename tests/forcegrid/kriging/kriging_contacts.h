// SPDX-License-Identifier: Apache-2.0
#pragma once

// Contacts at several places of an object that is not alike all over.

#include <cmath>
#include <cstdint>

#include "forcegrid/core/force_method.h"
#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::testing {

inline constexpr unsigned kSeed = 3;
inline constexpr int kAllWork = 1 << 30;
inline const Eigen::Vector3d kPlace_W(0.08, 0.06, 0.05);

// Twice as stiff 20 mm further along x.
inline Eigen::Vector3d force_N(const Eigen::Vector3d& point_W, const Eigen::Vector3d& d_m) {
  static const AnchoredSprings springs(kSeed);
  return (1.0 + (point_W.x() - kPlace_W.x()) / 0.020) * springs.force_N(d_m);
}

inline Sample sample_at(double time_s, const Eigen::Vector3d& point_W, const Eigen::Vector3d& d_m) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = point_W + d_m;
  sample.contact_point_W = point_W;
  sample.force_W = force_N(point_W, d_m);
  return sample;
}

inline Sample answer_at(double time_s, const Eigen::Vector3d& point_W,
                        const Eigen::Vector3d& wanted_W) {
  Sample answer = sample_at(time_s, point_W, wanted_W - point_W);
  answer.from_query = true;
  answer.before_contact = true;
  return answer;
}

inline void work(ForceMethod& method) {
  while (method.work(kAllWork) > 0) {
  }
}

// A second of contact, samples at 30 Hz.
inline void hold(ForceMethod& method, std::uint32_t epoch, const Eigen::Vector3d& point_W,
                 double begin_s) {
  const HandMotion hand(kSeed + epoch);
  method.contact_made(epoch, point_W);
  for (int i = 1; i <= 30; ++i) {
    method.take_sample(sample_at(begin_s + i / 30.0, point_W, hand.position_m(i / 30.0)));
    work(method);
  }
  method.contact_lost();
}

// RMS, of the RMS of the true force, within some 8 mm of the point.
inline double error_before_the_first_sample(ForceMethod& method, const Eigen::Vector3d& point_W) {
  double squares_N2 = 0.0;
  double reference_N2 = 0.0;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d d_m = 0.7 * HandMotion(kSeed + 9).position_m(0.01 * i);
    const Eigen::Vector3d reference_N = force_N(point_W, d_m);
    squares_N2 += (method.force(100.0, point_W + d_m).force_W - reference_N).squaredNorm();
    reference_N2 += reference_N.squaredNorm();
  }
  return std::sqrt(squares_N2 / reference_N2);
}

}  // namespace forcegrid::testing
