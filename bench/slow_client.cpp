// SPDX-License-Identifier: Apache-2.0
// A program on libHD that computes the force of an object too slowly for a hand, and what the
// motors of an emulated arm make of it. The arm is in this process, so that its own record of tool
// and torques is the witness. Without $FORCEGRID_HD_METHOD each force is held until the next one.
// usage: forcegrid_slow_client OBJECT RATE_HZ SECONDS FILE.csv     OBJECT: spring or ball
// Writes one row each 2 ms into FILE.csv; prints the error and what it was measured on. Where the
// machine has held up the program or this measurement, rows are not counted until 0.6 s later.

#include <HD/hd.h>
#include <unistd.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "device_emulator/emulator_report.h"
#include "device_emulator/emulator_server.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "rt/thread.h"
#include "rt/vectors.h"

namespace {

using namespace forcegrid;
using Eigen::Vector3d;

constexpr char kProfile[] = "woodenhaptics_v2015";
constexpr double kNear_mm = 30.0;  // the hand's path is within 24 mm of the origin
constexpr rt::Duration kSettled = std::chrono::milliseconds(2500);  // of the hand near there
constexpr rt::Duration kPatience = std::chrono::seconds(30);
constexpr rt::Duration kLook = std::chrono::milliseconds(2);
constexpr rt::Duration kLateLook = std::chrono::milliseconds(20);
constexpr rt::Duration kAfterPause = std::chrono::milliseconds(600);  // fade, ramp, and then some
// Above the rest of the machine's work, so that the program has its rate, and below libHD's
// threads.
constexpr int kProgramPriority = 10;
constexpr int kLookPriority = 5;

/// The force on the tool [N] at a place [mm], both in HD's axes.
using Object = Vector3d (*)(const Vector3d& position_mm);

Vector3d spring(const Vector3d& position_mm) { return -0.12 * position_mm; }

// 0.15 N/mm times the depth in a ball of 70 mm radius, 40 mm below the origin: the whole path is in
// it, 40 to 67 mm from its centre, and the force's direction turns with the place.
Vector3d ball(const Vector3d& position_mm) {
  const Vector3d from_centre_mm = position_mm - Vector3d(0.0, -40.0, 0.0);
  const double depth_mm = std::max(0.0, 70.0 - from_centre_mm.norm());
  return 0.15 * depth_mm * from_centre_mm.normalized();
}

Vector3d in_hd(const Vector3d& vector_D) { return {vector_D.y(), vector_D.z(), vector_D.x()}; }

/// One instant of the arm, as it has it itself. HD's axes.
struct Look {
  Vector3d tip_mm;
  Vector3d felt_N;  ///< J^-T of the motors' torques
};

class EmulatedArm {
 public:
  EmulatedArm() : profile_(profiles::load_device_profile(kProfile)), kinematics_(profile_) {
    emulator::DeviceOptions device;
    device.profile = profile_;
    device.operator_script.motion = emulator::MotionKind::kLissajous;
    device.operator_script.calibrated = true;
    server_ = std::make_unique<emulator::EmulatorServer>(
        emulator::ServerOptions{.listen = "127.0.0.1:0", .devices = {device}});
    server_->start();
  }
  std::string url() const { return "usbip://" + server_->address() + "/1-1"; }
  Look look() const {
    const emulator::EmulatorReport now = server_->report(0);
    const driver::ArmPose pose = kinematics_.forward(now.counters);
    return {1000.0 * in_hd(rt::to_vector(now.tip_position_m)),
            in_hd(pose.jacobian_D.transpose().inverse() * rt::to_vector(now.final_torque_Nm))};
  }
  /// Until the hand has moved the tool about the origin for kSettled.
  void wait_for_hand() const {
    const rt::TimePoint give_up = rt::Clock::now() + kPatience;
    rt::TimePoint since = rt::Clock::now();
    while (rt::Clock::now() - since < kSettled) {
      if (rt::Clock::now() > give_up) {
        throw std::runtime_error(
            "the emulated hand did not come within 30 s; is the machine busy?");
      }
      if (look().tip_mm.norm() > kNear_mm) {
        since = rt::Clock::now();
      }
      rt::sleep_until(rt::Clock::now() + kLook);
    }
  }

 private:
  profiles::DeviceProfile profile_;
  driver::ArmKinematics kinematics_;
  std::unique_ptr<emulator::EmulatorServer> server_;
};

/// The configuration that names the arm, for as long as it lives.
class Configuration {
 public:
  explicit Configuration(const std::string& url) {
    std::string pattern = std::filesystem::temp_directory_path() / "slow_client_XXXXXX";
    if (mkdtemp(pattern.data()) == nullptr) {
      throw std::runtime_error("no folder can be made in the one for temporary files; set TMPDIR");
    }
    folder_ = pattern;
    std::filesystem::create_directory(folder_ / "forcegrid");
    std::ofstream(folder_ / "forcegrid/openhaptics.toml")
        << "[device.Arm]\nurl = \"" << url << "\"\ncalibrated = true\n";
    setenv("XDG_CONFIG_HOME", folder_.c_str(), 1);
    unsetenv("FORCEGRID_DEVICE");
  }
  ~Configuration() {
    std::error_code error;
    std::filesystem::remove_all(folder_, error);
  }
  Configuration(const Configuration&) = delete;
  Configuration& operator=(const Configuration&) = delete;

 private:
  std::filesystem::path folder_;
};

HDCallbackCode HDCALLBACK compute(void* object) {
  Vector3d position_mm;
  hdBeginFrame(hdGetCurrentDevice());
  hdGetDoublev(HD_CURRENT_POSITION, position_mm.data());
  const Vector3d force_N = (*static_cast<Object*>(object))(position_mm);
  hdSetDoublev(HD_CURRENT_FORCE, force_N.data());
  hdEndFrame(hdGetCurrentDevice());
  return HD_CALLBACK_DONE;
}

/// A thread that computes an object's force `rate_Hz` times a second.
class SlowProgram {
 public:
  SlowProgram(Object object, double rate_Hz)
      : object_(object),
        period_(rt::from_seconds(1.0 / rate_Hz)),
        late_(period_ + period_ / 2 + kLook),
        newest_(rt::Clock::now()),
        thread_([this] { run(); }) {}
  ~SlowProgram() {
    ends_ = true;
    thread_.join();
  }
  SlowProgram(const SlowProgram&) = delete;
  SlowProgram& operator=(const SlowProgram&) = delete;

  /// Its newest force is no older than its rate says.
  bool keeps_its_rate(rt::TimePoint now) const { return now - newest_.load() < late_; }
  /// The last time at which it had not.
  rt::TimePoint last_pause() const { return last_pause_; }

 private:
  void run() {
    rt::make_current_thread_realtime(kProgramPriority);
    rt::TimePoint next = rt::Clock::now();
    while (!ends_) {
      hdScheduleSynchronous(compute, &object_, HD_DEFAULT_SCHEDULER_PRIORITY);
      const rt::TimePoint now = rt::Clock::now();
      if (!keeps_its_rate(now)) {
        last_pause_ = now;
      }
      newest_ = now;
      next = std::max(next + period_, now);
      rt::sleep_until(next);
    }
  }

  Object object_;
  rt::Duration period_;
  rt::Duration late_;
  std::atomic<rt::TimePoint> newest_;
  std::atomic<rt::TimePoint> last_pause_{rt::TimePoint{}};
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

void measure(const EmulatedArm& arm, Object object, const SlowProgram& program, double seconds,
             const std::string& file) {
  std::ofstream rows(file);
  rows << "time_s,tip_x_mm,tip_y_mm,tip_z_mm,felt_x_N,felt_y_N,felt_z_N,exact_x_N,exact_y_N,"
          "exact_z_N,counts\n";
  const Eigen::IOFormat row(Eigen::StreamPrecision, Eigen::DontAlignCols, ",", ",");
  double error2 = 0.0;
  double exact2 = 0.0;
  int looks = 0;
  int left_out = 0;
  const rt::TimePoint began = rt::Clock::now();
  rt::TimePoint last = began;
  rt::TimePoint own_pause{};
  for (rt::TimePoint now = began; rt::seconds(now - began) < seconds; now = rt::Clock::now()) {
    const Look look = arm.look();
    const Vector3d exact_N = object(look.tip_mm);
    rows << rt::seconds(now - began) << ',' << look.tip_mm.transpose().format(row) << ','
         << look.felt_N.transpose().format(row) << ',' << exact_N.transpose().format(row) << ',';
    own_pause = now - last > kLateLook ? now : own_pause;
    last = now;
    const bool counts = program.keeps_its_rate(now) &&
                        now - std::max(program.last_pause(), own_pause) > kAfterPause;
    rows << (counts ? 1 : 0) << '\n';
    if (counts) {
      error2 += (look.felt_N - exact_N).squaredNorm();
      exact2 += exact_N.squaredNorm();
      ++looks;
    } else {
      ++left_out;
    }
    rt::sleep_until(now + kLook);
  }
  rows.close();
  if (!rows) {
    throw std::runtime_error("'" + file + "' can't be written; name another file");
  }
  if (looks == 0) {
    throw std::runtime_error("the machine held up the program all the time; try again");
  }
  std::printf("error_percent %.3f rms_N %.3f looks %d left_out %d\n",
              100.0 * std::sqrt(error2 / exact2), std::sqrt(exact2 / looks), looks, left_out);
}

void run(Object object, double rate_Hz, double seconds, const std::string& file) {
  const EmulatedArm arm;
  const Configuration configuration(arm.url());
  const HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
  if (device == HD_INVALID_HANDLE) {
    throw std::runtime_error("libHD opens no device; its reason is above");
  }
  hdEnable(HD_FORCE_OUTPUT);
  hdStartScheduler();
  rt::make_current_thread_realtime(kLookPriority);
  {
    const SlowProgram program(object, rate_Hz);
    arm.wait_for_hand();
    measure(arm, object, program, seconds, file);
  }
  hdStopScheduler();
  hdDisableDevice(device);
}

double number(const char* text, const char* name, double low, double high) {
  char* end = nullptr;
  const double value = std::strtod(text, &end);
  if (end == text || *end != '\0' || !(value >= low && value <= high)) {
    throw std::invalid_argument(std::string(name) + " '" + text + "' is not a number from " +
                                std::to_string(low) + " to " + std::to_string(high));
  }
  return value;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 5) {
      throw std::invalid_argument(
          "usage: forcegrid_slow_client spring|ball RATE_HZ SECONDS FILE.csv");
    }
    const std::string name = argv[1];
    if (name != "spring" && name != "ball") {
      throw std::invalid_argument("OBJECT '" + name + "' is neither spring nor ball");
    }
    run(name == "spring" ? spring : ball, number(argv[2], "RATE_HZ", 5.0, 1000.0),
        number(argv[3], "SECONDS", 0.1, 600.0), argv[4]);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forcegrid_slow_client: %s\n", error.what());
    return 1;
  }
}
