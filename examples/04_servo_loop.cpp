// SPDX-License-Identifier: Apache-2.0
// A servo loop of your own from the libraries' parts: report, kinematics, your force, limits,
// motors. Here your force damps the hand. What servo_loop/ adds to this: guards against implausible
// counters, a check of the motors, ramps, recordings, passivity.
// usage: 04_servo_loop [DEVICE [SECONDS]]    DEVICE: usbip://..., hid:...; none: an emulated arm
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>

#include "device_emulator/emulator_server.h"
#include "driver/force_limiter.h"
#include "driver/mechanism.h"
#include "driver/open_device.h"
#include "rt/thread.h"

namespace driver = forcegrid::driver;
namespace emulator = forcegrid::emulator;
namespace rt = forcegrid::rt;

int main(int argc, char** argv) try {
  const auto profile = forcegrid::profiles::load_device_profile("woodenhaptics_v2015");
  std::unique_ptr<emulator::EmulatorServer> arm;
  std::string url = argc > 1 ? argv[1] : "";
  if (url.empty()) {
    emulator::DeviceOptions options;
    options.profile = profile;
    options.operator_script.motion = emulator::MotionKind::kLissajous;
    options.operator_script.calibrated = true;
    arm = std::make_unique<emulator::EmulatorServer>(
        emulator::ServerOptions{.listen = "127.0.0.1:0", .devices = {options}});
    arm->start();
    url = "usbip://" + arm->address() + "/1-1";
  }
  const auto device = driver::open_device(url, profile);
  const auto mechanism = driver::make_mechanism(profile);
  driver::ForceLimiter limiter(profile);
  const rt::Scheduling scheduling = rt::make_current_thread_realtime(rt::kServoPriority);
  if (!scheduling.realtime) {
    std::fprintf(stderr, "%s\n", scheduling.reason.c_str());
  }

  constexpr double kPeriod_s = 1e-3;
  const int cycles = static_cast<int>((argc > 2 ? std::atof(argv[2]) : 5.0) / kPeriod_s);
  Eigen::Vector3d last_D_m = mechanism->forward(device->newest_report().counts).position_D;
  Eigen::Vector3d velocity_D_m_per_s = Eigen::Vector3d::Zero();
  rt::TimePoint deadline = rt::Clock::now();
  int cycle = 0;
  for (; cycle < cycles && device->health() == driver::DeviceHealth::kRunning; ++cycle) {
    deadline += rt::from_seconds(kPeriod_s);
    rt::sleep_until(deadline);
    const driver::ArmPose pose = mechanism->forward(device->newest_report().counts);
    velocity_D_m_per_s += 0.1 * ((pose.position_D - last_D_m) / kPeriod_s - velocity_D_m_per_s);
    last_D_m = pose.position_D;

    const Eigen::Vector3d force_D_N = -2.0 * velocity_D_m_per_s;  // yours

    const driver::LimitedForce limited = limiter.apply(force_D_N, pose, kPeriod_s);
    driver::MotorCommand command;
    command.current_A = limited.current_A;
    for (Eigen::Index i = 0; i < 3; ++i) {
      command.joint_torque_Nm[static_cast<std::size_t>(i)] = limited.joint_torque_Nm[i];
    }
    device->command(command);
  }
  std::printf("%d cycles, %s\n", cycle, driver::to_string(device->health()));
  return device->stop() && cycle == cycles ? 0 : 1;  // zero current was delivered
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
