// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/network.h"
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
///
/// Beside the ticks it answers requests (NetworkCondition::requests_per_s). As in
/// evaluation::judge() an answer arrives one request period after it was asked for; here the
/// network's delay, jitter and loss come on top. Random numbers of requests are a sequence of their
/// own: the samples along the path are the same with and without requests. A fault spoils samples
/// along the path only.
class SlowSimulator {
 public:
  /// A touch within this time is predicted, and the prediction kept until it moves by more than
  /// kExpectedApart_m, as simulator::PredictedContact does.
  static constexpr double kExpectedWithin_s = 0.3;
  static constexpr double kExpectedApart_m = 0.002;

  struct Answer {
    std::int64_t arrives_ns = 0;
    bool in_contact = true;
    /// [m] Out of contact: where the simulator expects the tool to touch.
    std::optional<Eigen::Vector3d> expected_W;
    Sample sample;
  };

  /// @throws std::invalid_argument for a rate that is not positive or a loss outside 0..1.
  SlowSimulator(const evaluation::NetworkCondition& network, SimulatorFault fault,
                std::uint64_t seed);

  /// Publishes the servo's `position_W` [m] and `velocity_W` [m/s] at `now_ns`. The object must
  /// have been advanced to this time.
  void publish(std::int64_t now_ns, const Eigen::Vector3d& position_W,
               const Eigen::Vector3d& velocity_W, const VirtualObject& object);

  /// Asks for the force on a tool at rest at `wanted_W` [m]: one that has touched where the last
  /// tick saw it touch, or, in the air, where that tick expected it to.
  /// @returns false, without an answer to come, if it did neither, or if the network carries no
  /// requests.
  bool ask(std::int64_t now_ns, const Eigen::Vector3d& wanted_W, const VirtualObject& object);

  /// Returns the next answer that has arrived by `now_ns`, in order of arrival.
  std::optional<Answer> receive(std::int64_t now_ns);

  std::uint64_t lost() const noexcept { return lost_; }

 private:
  // Returns false if there is no answer.
  bool spoil(double now_s, Answer& answer);
  void expect_touch(const Eigen::Vector3d& position_W, const Eigen::Vector3d& velocity_W,
                    const VirtualObject& object);
  void add_noise(Sample& sample, evaluation::SeededNumbers& numbers) const;
  void send(const Answer& answer);

  evaluation::NetworkCondition network_;
  SimulatorFault fault_;
  Eigen::Vector3d unconverged_W_N_ = Eigen::Vector3d::Zero();
  evaluation::SeededNumbers numbers_;
  evaluation::SeededNumbers request_numbers_;
  std::int64_t tick_ = 0;
  std::uint64_t lost_ = 0;
  VirtualObject::Contact contact_;             // at the last tick
  std::optional<Eigen::Vector3d> expected_W_;  // likewise
  bool ticked_ = false;
  std::vector<Answer> under_way_;  // by time of arrival
};

}  // namespace forcegrid::stability
