// SPDX-License-Identifier: Apache-2.0
// The servo loop on a device's own processor, without an operating system: a force method that
// learns from a simulator at the other end of a serial line.
//
//   encoders, amplifiers  <-- UART 1: arm_link.h -->  this  <-- UART 0: the link -->  simulator
//
// serial_bridge.py beside this file joins UART 0 to any simulator of this project's link. On a
// board with encoders and amplifiers of its own, read them where arm_state_of() is called, and
// drive them where an ArmCommand is sent.
//
// The arm paces the loop: each of its frames is one cycle. Its board sets the motors to zero when
// answers stop.
#include <array>
#include <cstdint>

#include "examples/firmware/arm_link.h"
#include "examples/firmware/simulator_link.h"
#include "firmware/arena.h"
#include "firmware/board.h"
#include "firmware/on_board_cycle.h"
#include "firmware/on_board_method.h"
#include "firmware/profile.h"

namespace forcegrid::firmware {
namespace {

constexpr double kToolState_s = 0.01;       // 100 a second; each takes 1 ms of the line
constexpr double kOldestSample_s = 0.5;     // then the force is gone
constexpr std::uint64_t kSession = 0x4d37;  // one device on one line: any number but 0

/// The board's timer as one that never wraps; read it at least once in two minutes.
class Clock {
 public:
  std::int64_t now_ns() noexcept {
    const std::uint32_t ticks = timer_ticks();
    ticks_ += ticks - last_;
    last_ = ticks;
    return ticks_ * (1'000'000'000 / kBoardClock_Hz);
  }

 private:
  std::uint32_t last_ = 0;
  std::int64_t ticks_ = 0;
};

/// Gives the method what the line brought.
class Learning {
 public:
  explicit Learning(ForceMethod& method) noexcept : method_(method) {}

  void take(const SimulatorLink::Arrived& arrived, double time_s) noexcept {
    newest_s_ = time_s;
    if (!arrived.in_contact) {
      lose_contact();
      return;
    }
    const Sample& sample = arrived.sample;
    if (!in_contact_ || sample.contact_epoch != epoch_) {
      epoch_ = sample.contact_epoch;
      in_contact_ = true;
      method_.contact_made(epoch_, sample.contact_point_W);
    }
    method_.take_sample(sample);
  }
  /// A simulator that has fallen silent no longer counts.
  void forget_old(double time_s) noexcept {
    if (time_s - newest_s_ > kOldestSample_s) {
      lose_contact();
    }
  }

 private:
  void lose_contact() noexcept {
    if (in_contact_) {
      method_.contact_lost();
      in_contact_ = false;
    }
  }

  ForceMethod& method_;
  bool in_contact_ = false;
  std::uint32_t epoch_ = 0;
  double newest_s_ = 0.0;
};

/// One port with its frames.
class Line {
 public:
  static constexpr int kMostBytes = 16;  ///< that a call sends; it takes at most one

  explicit Line(Port port) noexcept : port_(port) { start_serial(port); }

  /// @returns a frame that has just ended, or an empty one.
  std::span<const std::uint8_t> poll() noexcept {
    for (int i = 0; i < kMostBytes; ++i) {
      const auto byte = out_.next();
      if (!byte || !serial_write(port_, *byte)) {
        break;
      }
      out_.pop();
    }
    std::uint8_t byte = 0;
    idle_ = !serial_read(port_, byte);
    return idle_ ? std::span<const std::uint8_t>{} : in_.take(byte);
  }
  void send(std::span<const std::uint8_t> frame) noexcept { out_.put(frame); }
  /// Nothing came at the last poll(), and nothing waits to be sent.
  bool idle() const noexcept { return idle_ && !out_.next(); }

 private:
  Port port_;
  FrameReader in_;
  FrameWriter out_;
  bool idle_ = false;
};

[[noreturn]] void run() noexcept {
  const driver::ArmKinematics kinematics(kKinematics, kMotors, kGravity);
  ForceMethod& method = make_method();
  seal_arena();
  OnBoardCycle cycle(kinematics, kLimits.max_force_N, method);
  Learning learning(method);
  SimulatorLink link(kSession);
  static Line arm(Port::kArm), simulator(Port::kSimulator);
  Clock clock;
  start_timer();
  double sent_s = -kToolState_s;
  Eigen::Vector3d sent_W = Eigen::Vector3d::Zero();
  arm.send(bytes_of({}));  // ready
  for (;;) {
    const std::int64_t now_ns = clock.now_ns();
    const double now_s = 1e-9 * static_cast<double>(now_ns);
    if (const auto frame = simulator.poll(); !frame.empty()) {
      if (const auto arrived = link.sample(frame)) {
        learning.take(*arrived, now_s);
      }
    }
    const auto frame = arm.poll();
    const auto state = arm_state_of(frame);
    if (!state) {
      if (arm.idle() && simulator.idle()) {
        wait_for_serial();
      }
      continue;
    }
    learning.forget_old(now_s);
    const CycleResult result = cycle.run(now_s, state->counts);
    arm.send(
        bytes_of({state->number, result.current_mA, static_cast<std::uint8_t>(result.pose.status),
                  static_cast<std::uint8_t>(result.estimate.status)}));
    const double since_s = now_s - sent_s;
    if (result.pose.status == driver::KinematicsStatus::kOk && since_s >= kToolState_s) {
      const Eigen::Vector3d& position_W = result.pose.position_D;
      const bool known = since_s < 10.0 * kToolState_s;  // where it was a moment ago
      const Eigen::Vector3d velocity_W =
          known ? Eigen::Vector3d((position_W - sent_W) / since_s) : Eigen::Vector3d::Zero();
      simulator.send(link.tool_state(now_ns, position_W, velocity_W));
      sent_s = now_s;
      sent_W = position_W;
    }
  }
}

}  // namespace

// No frames, no currents: the arm's board stops the motors.
[[noreturn]] void stop_device() noexcept {
  for (;;) {
  }
}

}  // namespace forcegrid::firmware

int main() { forcegrid::firmware::run(); }
