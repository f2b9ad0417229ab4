// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <HD/hd.h>

#include <Eigen/Core>
#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "device_emulator/emulator_report.h"
#include "device_emulator/emulator_server.h"
#include "rt/clock.h"

namespace forcegrid::testing {

struct RigOptions {
  int arms = 1;
  emulator::MotionKind motion = emulator::MotionKind::kStill;
  std::vector<std::string> faults{};  ///< of the first arm
  bool calibrated = true;
  const char* profile = "woodenhaptics_v2015";
  std::vector<emulator::PathPoint> path{};  ///< of motion kPath
  double click_every_s = 0.0;               ///< of a stylus with a button
  std::string lines{};                      ///< at the top of the configuration file
};

/// Emulated arms in this process as the witness of what libHD does, and a configuration file that
/// names them: "Right", the default, "Left", "Arm3" and so on. libHD is this process's; after a
/// test it is stopped and its arms are closed.
class Rig {
 public:
  explicit Rig(const RigOptions& options = {});
  ~Rig();
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  [[nodiscard]] emulator::EmulatorReport report(int arm = 0) const;
  /// [mm] The tool in HD's axes, as the emulator has it.
  [[nodiscard]] Eigen::Vector3d tip_mm(int arm = 0) const;
  /// [N] What the motors exert on the hand, in HD's axes: J^-T tau of the emulator's torques.
  [[nodiscard]] Eigen::Vector3d felt_N(int arm = 0) const;
  /// The hand holds the tool where it stays. @returns whether it came.
  [[nodiscard]] bool hand_is_there(int arm = 0) const;
  [[nodiscard]] const std::string& folder() const { return folder_; }

  /// Scheduled with libHD; lives as long as the rig.
  HDSchedulerHandle recurring(std::function<HDCallbackCode()> body,
                              HDushort priority = HD_DEFAULT_SCHEDULER_PRIORITY);
  /// Unschedules all of them.
  void clear();
  void synchronous(std::function<void()> body);
  /// A recurring callback with one frame that sets this force [N, HD's axes].
  HDSchedulerHandle push(HHD arm, const Eigen::Vector3d& force_N);

 private:
  using Body = std::function<HDCallbackCode()>;
  void* keep(Body body);

  std::string folder_;
  std::unique_ptr<emulator::EmulatorServer> server_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Body>> bodies_;
  std::vector<HDSchedulerHandle> handles_;
};

/// To be declared after the variables that callbacks refer to, which run until they are
/// unscheduled: at the end of the scope that happens first.
class ClearsAtEnd {
 public:
  explicit ClearsAtEnd(Rig& rig) : rig_(rig) {}
  ~ClearsAtEnd() { rig_.clear(); }
  ClearsAtEnd(const ClearsAtEnd&) = delete;
  ClearsAtEnd& operator=(const ClearsAtEnd&) = delete;

 private:
  Rig& rig_;
};

/// Looks every millisecond. @returns whether it came to hold within `patience`.
bool wait_until(const std::function<bool()>& holds,
                rt::Duration patience = std::chrono::seconds(15));

/// The newest error of this thread.
HDerror last_error();
/// How many errors this thread has; takes them.
int count_errors();

}  // namespace forcegrid::testing
