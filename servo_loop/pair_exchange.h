// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "forcegrid/core/force_method.h"
#include "rt/mailbox.h"
#include "rt/spsc_ring.h"
#include "servo_loop/cycle_record.h"

namespace forcegrid::servo {

/// Where one of two tools is and what it holds, as its servo loop tells the other one's in each
/// cycle. The workspace frame W is the same for both.
struct PairPlace {
  double time_s = 0.0;  ///< of the servo's clock, the cycle that read the position
  Triple position_W_m{};
  Triple velocity_W_m_per_s{};  ///< by end_velocity()
  bool in_contact = false;
  std::uint32_t contact_epoch = 0;
  Triple contact_point_W_m{};
};

/// Velocity [m/s] at the end of two cycles, v = v1 + h1 / (h1 + h2) (v1 - v2), by backward
/// differentiation of second order: exact for a steady acceleration. Real-time: yes.
/// @param last, before  mean velocities v1, v2 of the last cycle and the one before.
/// @param last_s, before_s  their lengths h1, h2 [s], above zero.
inline Eigen::Vector3d end_velocity(const Eigen::Vector3d& last, double last_s,
                                    const Eigen::Vector3d& before, double before_s) noexcept {
  return last + last_s / (last_s + before_s) * (last - before);
}

/// Lock-free queues between the two servo loops of one program that render a force over both
/// tools: the newest place of each, and each one's samples in order. One for each such method.
/// Real-time: wait-free, no allocation, lock or throw after construction. Threads: loop 0 and loop
/// 1 call with their own number as `tool`.
class PairExchange {
 public:
  static constexpr int kSamples = 64;  ///< that may wait

  void publish(std::size_t tool, const PairPlace& place) noexcept { places_[tool].publish(place); }
  /// The other tool's. False leaves `place` untouched: nothing new has come.
  [[nodiscard]] bool fetch(std::size_t tool, PairPlace& place) noexcept {
    return places_[1 - tool].fetch(place);
  }
  /// False: too many wait, and this one is lost.
  [[nodiscard]] bool tell(std::size_t tool, const Sample& sample) noexcept {
    return samples_[tool].push(sample);
  }
  /// The next sample of the other tool. False leaves `sample` untouched: there is none.
  [[nodiscard]] bool hear(std::size_t tool, Sample& sample) noexcept {
    return samples_[1 - tool].pop(sample);
  }

 private:
  std::array<rt::Mailbox<PairPlace>, 2> places_;
  std::array<rt::SpscRing<Sample>, 2> samples_{rt::SpscRing<Sample>(kSamples),
                                               rt::SpscRing<Sample>(kSamples)};
};

}  // namespace forcegrid::servo
