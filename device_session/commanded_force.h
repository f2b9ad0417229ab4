// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <limits>

#include "forcegrid/core/force_method.h"
#include "rt/clock.h"
#include "rt/mailbox.h"
#include "servo_loop/torque_source.h"

namespace forcegrid::session {

/// Renders the force that a program commands, as it is, and wants the torque that it commands:
///
///   F(t) = F_c clamp(1 - (t - t_c - hold) / kFade, 0, 1),   the torque likewise
///
/// with F_c the newest command, given at t_c. While the program's callback lasts longer than it may
/// the force is zero, and stays zero until the next command.
///
/// Real-time: as ForceMethod. Threads: command(), busy() and idle() on one thread of the program;
/// the rest on the servo's.
class CommandedForce final : public ForceMethod, public servo::TorqueSource {
 public:
  static constexpr double kFade_s = 0.1;

  /// @param longest_callback  a callback that lasts longer gets zero force.
  explicit CommandedForce(rt::Duration longest_callback) noexcept
      : longest_callback_(longest_callback) {}

  /// @param force_W [N], @param torque_W_Nm  finite. @param now the command's time. @param hold how
  /// long it holds.
  void command(const Eigen::Vector3d& force_W, const Eigen::Vector3d& torque_W_Nm,
               rt::TimePoint now, rt::Duration hold) noexcept;
  void busy(rt::TimePoint now) noexcept { busy_since_ns_.store(now.time_since_epoch().count()); }
  void idle() noexcept { busy_since_ns_.store(0); }
  /// @param time_s of the servo's clock.
  [[nodiscard]] bool callback_lasts_too_long(double time_s) const noexcept;

  const char* name() const noexcept override { return "commanded"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample& /*sample*/) noexcept override {}
  void contact_made(std::uint32_t /*epoch*/, const Eigen::Vector3d& /*point_W*/) noexcept override {
  }
  void contact_lost() noexcept override {}
  int work(int /*budget*/) noexcept override { return 0; }
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;
  [[nodiscard]] Eigen::Vector3d torque_W_Nm(double time_s) const noexcept override;

 private:
  struct Command {
    double force_W_N[3] = {0.0, 0.0, 0.0};
    double torque_W_Nm[3] = {0.0, 0.0, 0.0};
    double time_s = -std::numeric_limits<double>::infinity();
    double hold_s = 0.0;
  };

  /// How much of the newest command is left, 1 to 0.
  [[nodiscard]] double share_at(double time_s) const noexcept;

  rt::Duration longest_callback_;
  rt::Mailbox<Command> commands_;
  std::atomic<std::int64_t> busy_since_ns_{0};  ///< 0: not busy
  Command newest_;                              ///< the servo's
};

}  // namespace forcegrid::session
