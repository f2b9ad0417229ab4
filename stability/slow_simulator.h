// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "evaluation/network.h"
#include "evaluation/trajectories.h"
#include "forcegrid/core/force_method.h"
#include "stability/virtual_object.h"

namespace forcegrid::stability {

/// Faults of a simulator in addition to its delay.
enum class SimulatorFault : std::uint8_t {
  kNone,
  kUnconverged,  ///< each answer corrects 60 % of the force error
  kPauses,       ///< no answer in the first 0.2 s of every second, from 1 s on
  kRestarts,     ///< kPauses, and a new contact epoch after each pause
  kClockJump,    ///< time stamps are 0.5 s late in 2..4 s
  kClockSkew,    ///< time stamps run 1 % fast
  kBias,         ///< every force is 0.1 N too large along x
  kOutliers,     ///< one answer in twenty is off by up to 2 N on each axis
  kNotFinite,    ///< one answer in twenty is not a number
};

/// A simulator with exact forces and realistic delay. At each tick it takes the newest position
/// that the servo has published. The force there arrives one period later, plus the network's delay
/// and jitter, unless it is lost. Times are in nanoseconds of the servo's clock, so that
/// simultaneous ticks and cycles coincide exactly. Threads: one.
class SlowSimulator {
 public:
  struct Answer {
    std::int64_t arrives_ns = 0;
    bool in_contact = true;
    Sample sample;
  };

  /// @throws std::invalid_argument for a rate that is not positive or a loss outside 0..1.
  SlowSimulator(const evaluation::NetworkCondition& network, SimulatorFault fault,
                std::uint64_t seed);

  /// Publishes the servo's `position_W` [m] at `now_ns`. The object must have been advanced to this
  /// time.
  void publish(std::int64_t now_ns, const Eigen::Vector3d& position_W, const VirtualObject& object);

  /// Returns the next answer that has arrived by `now_ns`, in order of arrival.
  std::optional<Answer> receive(std::int64_t now_ns);

  std::uint64_t lost() const noexcept { return lost_; }

 private:
  // Returns false if there is no answer.
  bool spoil(double now_s, Answer& answer);

  evaluation::NetworkCondition network_;
  SimulatorFault fault_;
  Eigen::Vector3d unconverged_W_N_ = Eigen::Vector3d::Zero();
  evaluation::SeededNumbers numbers_;
  std::int64_t tick_ = 0;
  std::uint64_t lost_ = 0;
  std::vector<Answer> under_way_;  // by time of arrival
};

}  // namespace forcegrid::stability
