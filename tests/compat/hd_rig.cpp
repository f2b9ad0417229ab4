// SPDX-License-Identifier: Apache-2.0
#include "tests/compat/hd_rig.h"

#include <Eigen/LU>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "rt/vectors.h"
#include "tests/support/program.h"

namespace forcegrid::testing {
namespace {

using namespace std::chrono_literals;

constexpr char kProfile[] = "woodenhaptics_v2015";
constexpr double kNear_m = 0.003;  // friction holds the tool beside the hand's target
constexpr std::chrono::milliseconds kStill{150};
constexpr const char* kNames[] = {"Right", "Left", "Arm3", "Arm4"};

HDCallbackCode run(void* body) { return (*static_cast<std::function<HDCallbackCode()>*>(body))(); }

Eigen::Vector3d in_hd(const Eigen::Vector3d& vector_D) {
  return {vector_D.y(), vector_D.z(), vector_D.x()};
}

}  // namespace

Rig::Rig(const RigOptions& options) : folder_(fresh_folder("hd")) {
  emulator::ServerOptions server;
  server.listen = "127.0.0.1:0";
  for (int i = 0; i < options.arms; ++i) {
    emulator::DeviceOptions device;
    device.profile = profiles::load_device_profile(options.profile);
    device.operator_script.motion = options.motion;
    device.operator_script.path = options.path;
    device.operator_script.click_every_s = options.click_every_s;
    device.operator_script.calibrated = options.calibrated;
    if (i == 0) {
      for (const std::string& fault : options.faults) {
        device.faults.push_back(emulator::parse_fault(fault));
      }
    }
    server.devices.push_back(device);
  }
  if (options.arms > 0) {
    server_ = std::make_unique<emulator::EmulatorServer>(server);
    server_->start();
  }
  std::filesystem::create_directories(folder_ + "/forcegrid");
  std::ofstream file(folder_ + "/forcegrid/openhaptics.toml");
  file << options.lines;
  for (int i = 0; i < options.arms; ++i) {
    file << "[device." << kNames[i] << "]\nurl = \"usbip://" << server_->address() << "/1-" << i + 1
         << "\"\nprofile = \"" << options.profile
         << "\"\ncalibrated = " << (options.calibrated ? "true" : "false") << "\n";
  }
  setenv("XDG_CONFIG_HOME", folder_.c_str(), 1);
  unsetenv("FORCEGRID_DEVICE");
}

Rig::~Rig() {
  hdStopScheduler();
  clear();
  for (HHD arm = 0; arm < 4; ++arm) {
    hdDisableDevice(arm);
  }
  count_errors();
}

void Rig::clear() {
  std::vector<HDSchedulerHandle> handles;
  {
    const std::lock_guard lock(mutex_);
    handles.swap(handles_);
  }
  for (const HDSchedulerHandle handle : handles) {
    hdUnschedule(handle);
  }
}

emulator::EmulatorReport Rig::report(int arm) const {
  return server_->report(static_cast<std::size_t>(arm));
}

Eigen::Vector3d Rig::tip_mm(int arm) const {
  return 1000.0 * in_hd(rt::to_vector(report(arm).tip_position_m));
}

Eigen::Vector3d Rig::felt_N(int arm) const {
  const emulator::EmulatorReport now = report(arm);
  const driver::ArmKinematics kinematics(profiles::load_device_profile(kProfile));
  const driver::ArmPose pose = kinematics.forward(now.counters);
  return in_hd(pose.jacobian_D.transpose().inverse() * rt::to_vector(now.final_torque_Nm));
}

bool Rig::hand_is_there(int arm) const {
  std::array<std::int32_t, 6> counters{};
  rt::TimePoint since = rt::Clock::now();
  return wait_until([&] {
    const emulator::EmulatorReport now = report(arm);
    if (now.counters != counters || rt::to_vector(now.tip_position_m).norm() > kNear_m) {
      counters = now.counters;
      since = rt::Clock::now();
    }
    return rt::Clock::now() - since > kStill;
  });
}

void* Rig::keep(Body body) {
  const std::lock_guard lock(mutex_);
  bodies_.push_back(std::make_unique<Body>(std::move(body)));
  return bodies_.back().get();
}

HDSchedulerHandle Rig::recurring(std::function<HDCallbackCode()> body, HDushort priority) {
  const HDSchedulerHandle handle = hdScheduleAsynchronous(run, keep(std::move(body)), priority);
  const std::lock_guard lock(mutex_);
  handles_.push_back(handle);
  return handle;
}

void Rig::synchronous(std::function<void()> body) {
  hdScheduleSynchronous(run, keep([body = std::move(body)] {
                          body();
                          return HDCallbackCode{HD_CALLBACK_DONE};
                        }),
                        HD_DEFAULT_SCHEDULER_PRIORITY);
}

HDSchedulerHandle Rig::push(HHD arm, const Eigen::Vector3d& force_N) {
  return recurring([arm, force_N] {
    hdBeginFrame(arm);
    hdSetDoublev(HD_CURRENT_FORCE, force_N.data());
    hdEndFrame(arm);
    return HDCallbackCode{HD_CALLBACK_CONTINUE};
  });
}

bool wait_until(const std::function<bool()>& holds, rt::Duration patience) {
  const rt::TimePoint give_up = rt::Clock::now() + patience;
  while (rt::Clock::now() < give_up) {
    if (holds()) {
      return true;
    }
    std::this_thread::sleep_for(1ms);
  }
  return holds();
}

HDerror last_error() { return hdGetError().errorCode; }

int count_errors() {
  int count = 0;
  while (last_error() != HD_SUCCESS) {
    ++count;
  }
  return count;
}

}  // namespace forcegrid::testing
