#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "evaluation/network.h"
#include "evaluation/trajectories.h"
#include "forcegrid/core/force_method.h"
#include "stability/virtual_object.h"

namespace forcegrid::stability {

/// What a simulator can do beside answering late.
enum class SimulatorFault : std::uint8_t {
  kNone,
  kUnconverged,  ///< each answer covers 60 % of what was left of the force
  kPauses,       ///< the first 0.2 s of every second from 1 s on pass without an answer
  kRestarts,     ///< kPauses, and a new contact epoch after each of them
  kClockJump,    ///< time stamps are 0.5 s late in 2..4 s
  kClockSkew,    ///< time stamps run 1 % fast
  kBias,         ///< 0.1 N along x on top of every force
  kOutliers,     ///< one answer in twenty is off by up to 2 N on each axis
  kNotFinite,    ///< one answer in twenty is not a number
};

/// A simulator that is as right as can be and as slow as it is: at its ticks it takes the newest
/// position that the servo has published, and the force there arrives one of its periods later,
/// plus the network's delay and jitter, if it isn't lost. Times are in nanoseconds of the servo's
/// clock, so that ticks and cycles that ought to meet do meet. Threads: one.
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

  /// The servo is at `position_W` at `now_ns`, and the object has been advanced to that.
  void publish(std::int64_t now_ns, const Eigen::Vector3d& position_W, const VirtualObject& object);

  /// The next answer that has arrived by `now_ns`, in the order of arrival.
  std::optional<Answer> receive(std::int64_t now_ns);

  std::uint64_t lost() const noexcept { return lost_; }

 private:
  // Returns false when nothing is answered.
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
