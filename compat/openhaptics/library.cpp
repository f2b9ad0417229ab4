// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/library.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <utility>

#include "compat/openhaptics/error_stack.h"

namespace forcegrid::openhaptics {
namespace {

using session::DeviceSession;
using session::SessionError;
using session::SessionHealth;

constexpr double kDeviceRate_Hz = 1000.0;  // of the motor threads
constexpr std::chrono::milliseconds kLongestCallback{50};
constexpr std::chrono::milliseconds kLongestSampledCallback{200};  // with a force method
constexpr std::chrono::milliseconds kPatienceAtExit{500};

std::string variable(const char* name, const char* otherwise = "") {
  const char* const value = std::getenv(name);
  return value == nullptr || *value == '\0' ? otherwise : value;
}

void say(const std::string& text) { std::fprintf(stderr, "forcegrid: %s\n", text.c_str()); }

}  // namespace

Library& Library::instance() {
  static Library* const library = new Library;
  return *library;
}

Arm* Library::arm(HHD handle) noexcept {
  Arm* const found = handle < kMostArms ? arms_[handle].get() : nullptr;
  if (found == nullptr) {
    push_error(HD_BAD_HANDLE, handle);
  }
  return found;
}

// An emulated device belongs to its name: two names are two emulators.
const Arm* Library::opened(const DeviceEntry& entry) const noexcept {
  const bool emulated = entry.url.starts_with("emulated:");
  for (const auto& one : arms_) {
    if (one && (one->entry().url == entry.url || one->session()->url() == entry.url) &&
        (!emulated || one->entry().name == entry.name)) {
      return one.get();
    }
  }
  return nullptr;
}

std::shared_ptr<DeviceSession> Library::open_session(const DeviceEntry& entry, HHD handle) {
  session::SessionOptions options;
  options.device = entry.url;
  options.profile = entry.profile;
  options.calibrated = entry.calibrated;
  options.falcon_firmware = entry.falcon_firmware;
  options.rate_Hz = kDeviceRate_Hz;
  options.method = method_;
  options.longest_callback = method_.empty() ? kLongestCallback : kLongestSampledCallback;
  options.emulator_hand = variable("FORCEGRID_EMULATOR_HAND", options.emulator_hand.c_str());
  options.emulator_motion = variable("FORCEGRID_EMULATOR_MOTION", options.emulator_motion.c_str());
  options.emulator_wrist = variable("FORCEGRID_EMULATOR_WRIST", options.emulator_wrist.c_str());
  options.emulator_summary = variable("FORCEGRID_EMULATOR_SUMMARY");
  options.timing_file = variable("FORCEGRID_TIMING");
  for (std::string* const file : {&options.emulator_summary, &options.timing_file}) {
    if (!file->empty() && handle > 0) {
      file->append(".").append(std::to_string(handle));
    }
  }
  options.notice = say;
  return DeviceSession::open(options);
}

HHD Library::open(const char* name) {
  const std::lock_guard one_at_a_time(opening_);
  const auto refuse = [](HDerror code, int internal) {
    push_error(code, HD_INVALID_HANDLE, internal);
    return HD_INVALID_HANDLE;
  };
  try {
    const DeviceTable table = load_device_table();
    const DeviceEntry* const entry = table.find(name);
    if (entry == nullptr) {
      return refuse(HD_COMM_ERROR, ENODEV);
    }
    HHD handle = 0;
    {
      const std::lock_guard lock(mutex_);
      if (opened(*entry) != nullptr) {
        return refuse(HD_DEVICE_ALREADY_INITIATED, EALREADY);
      }
      while (handle < kMostArms && arms_[handle]) {
        ++handle;
      }
    }
    if (handle == kMostArms) {
      return refuse(HD_INVALID_OPERATION, EMFILE);
    }
    if (!closes_at_exit_) {
      method_ = variable("FORCEGRID_HD_METHOD");
      closes_at_exit_ = true;
      static const pid_t opener = getpid();  // not a child that a program forks
      std::atexit([] {
        if (getpid() == opener) {
          instance().close_at_exit();
        }
      });
    }
    auto session = open_session(*entry, handle);
    auto fresh = std::make_unique<Arm>(handle, *entry, std::move(session), !method_.empty(),
                                       method_.empty() ? kLongestCallback : kLongestSampledCallback,
                                       rt::from_seconds(table.hold_s));
    const std::lock_guard lock(mutex_);
    arms_[handle] = std::move(fresh);
    current_ = handle;
    return handle;
  } catch (const DeviceTableError& error) {
    say(error.what());
    return refuse(HD_COMM_CONFIG_ERROR, EINVAL);
  } catch (const SessionError& error) {
    say(error.what());
    switch (error.reason()) {
      case SessionError::Reason::kInUse:
        return refuse(HD_DEVICE_FAULT, EBUSY);
      case SessionError::Reason::kAbsent:
        return refuse(HD_COMM_ERROR, ENODEV);
      default:
        return refuse(HD_COMM_CONFIG_ERROR, EINVAL);
    }
  } catch (const std::exception& error) {
    say(error.what());
    return refuse(HD_COMM_ERROR, EIO);
  }
}

void Library::close(HHD handle) {
  const std::lock_guard one_at_a_time(opening_);
  std::unique_ptr<Arm> closing;
  {
    const std::lock_guard lock(mutex_);
    if (arm(handle) == nullptr) {
      return;
    }
    closing = std::move(arms_[handle]);
    if (current_ == handle) {
      const auto next =
          std::find_if(arms_.begin(), arms_.end(), [](const auto& one) { return one != nullptr; });
      current_ = next == arms_.end() ? 0 : (*next)->handle();
    }
  }
  closing->session()->close();
}

void Library::close_at_exit() noexcept {
  stop(kPatienceAtExit);
  for (auto& one : arms_) {
    std::shared_ptr<DeviceSession> session;
    {
      const std::lock_guard lock(mutex_);
      session = one ? one->session() : nullptr;
    }
    if (session) {
      session->close();
    }
  }
}

void Library::make_current(HHD handle) noexcept {
  const std::lock_guard lock(mutex_);
  if (arm(handle) != nullptr) {
    current_ = handle;
  }
}

void Library::begin_frame(HHD handle) noexcept {
  const std::lock_guard lock(mutex_);
  if (Arm* const one = arm(handle)) {
    current_ = handle;
    one->begin_frame(Scheduler::in_servo_thread());
  }
}

void Library::end_frame(HHD handle) noexcept {
  const std::lock_guard lock(mutex_);
  if (Arm* const one = arm(handle)) {
    const HDerror error = one->end_frame(Scheduler::in_servo_thread());
    if (error != HD_SUCCESS) {
      push_error(error, handle);
    }
  }
}

void Library::read(const Parameter& parameter, double* values) noexcept {
  std::fill_n(values, parameter.count, 0.0);
  Reading reading;
  if (parameter.moment != Moment::kScheduler) {
    const std::lock_guard lock(mutex_);
    Arm* const one = current_arm();
    if (one == nullptr) {
      if (parameter.name == HD_CURRENT_TRANSFORM || parameter.name == HD_LAST_TRANSFORM) {
        parameter.get(reading, values);
      }
      return;
    }
    reading = one->read(parameter.moment, Scheduler::in_servo_thread());
    parameter.get(reading, values);
    return;
  }
  reading.rate_Hz = scheduler_.rate_Hz();
  reading.measured_rate_Hz = scheduler_.measured_rate_Hz();
  parameter.get(reading, values);
}

void Library::set(const Parameter& parameter, const double* values) noexcept {
  const std::lock_guard lock(mutex_);
  if (Arm* const one = current_arm()) {
    const HDerror error = one->set(parameter, values, Scheduler::in_servo_thread());
    if (error != HD_SUCCESS) {
      push_error(error, current_);
    }
  }
}

const char* Library::text(HDenum name) noexcept {
  if (name == HD_VERSION || name == HD_DEVICE_DRIVER_VERSION) {
    return text_of(name, nullptr);
  }
  const std::lock_guard lock(mutex_);
  const Arm* const one = current_arm();
  return text_of(name, one == nullptr ? nullptr : &one->facts());
}

void Library::enable(HDenum capability, bool on) noexcept {
  const auto index = capability_index(capability);
  if (!index) {
    push_error(HD_INVALID_ENUM, current_);
    return;
  }
  const std::lock_guard lock(mutex_);
  if (Arm* const one = current_arm()) {
    one->enable(*index, on, scheduler_.running());
  }
}

bool Library::is_enabled(HDenum capability) noexcept {
  const auto index = capability_index(capability);
  if (!index) {
    push_error(HD_INVALID_ENUM, current_);
    return false;
  }
  const std::lock_guard lock(mutex_);
  const Arm* const one = current_arm();
  return one != nullptr && one->is_enabled(*index);
}

HDenum Library::calibration() noexcept {
  const std::lock_guard lock(mutex_);
  Arm* const one = current_arm();
  return one == nullptr ? HD_CALIBRATION_NEEDS_MANUAL_INPUT : one->calibration();
}

void Library::update_calibration() {
  std::shared_ptr<DeviceSession> session;
  {
    const std::lock_guard lock(mutex_);
    Arm* const one = current_arm();
    if (one == nullptr || one->calibration() == HD_CALIBRATION_OK ||
        !one->entry().calibrate_on_update) {
      return;
    }
    session = one->session();
  }
  const std::string trouble = session->calibrate_now();
  if (!trouble.empty()) {
    say(trouble);
  }
}

void Library::start() {
  if (!scheduler_.start()) {
    push_error(HD_TIMER_ERROR, current_, EAGAIN);
    return;
  }
  const std::lock_guard lock(mutex_);
  for (auto& one : arms_) {
    if (one) {
      one->let_flow(true);
    }
  }
}

void Library::stop(rt::Duration patience) {
  {
    const std::lock_guard lock(mutex_);
    for (auto& one : arms_) {
      if (one) {
        one->let_flow(false);
      }
    }
  }
  if (!scheduler_.stop(patience)) {
    push_error(HD_TIMER_ERROR, current_, ETIMEDOUT);
  }
}

void Library::tick_begins() noexcept {
  const std::lock_guard lock(mutex_);
  for (auto& one : arms_) {
    if (one) {
      one->tick_begins();
    }
  }
}

void Library::callback_begins() noexcept {
  const std::lock_guard lock(mutex_);
  for (auto& one : arms_) {
    if (one) {
      one->callback_begins();
    }
  }
}

void Library::callback_ended(bool recurring, rt::Duration took) noexcept {
  const std::lock_guard lock(mutex_);
  for (auto& one : arms_) {
    if (one) {
      one->callback_ended(recurring, took);
    }
  }
}

void Library::tick_ended() noexcept {
  const std::lock_guard lock(mutex_);
  for (auto& one : arms_) {
    if (one) {
      one->tick_ended();
    }
  }
}

TickClient::Wait Library::wait_for_device(double rate_Hz, rt::TimePoint deadline) noexcept {
  if (rate_Hz != kDeviceRate_Hz) {
    return Wait::kNoDevice;
  }
  std::shared_ptr<DeviceSession> session;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& one : arms_) {
      if (one && (one->session()->health() == SessionHealth::kRunning ||
                  one->session()->health() == SessionHealth::kUncalibrated)) {
        session = one->session();
        break;
      }
    }
  }
  if (!session) {
    return Wait::kNoDevice;
  }
  if (pacer_.lock() != session) {
    pacer_ = session;
    seen_cycle_ = session->newest_state().cycle;
  }
  const bool came = session->wait_for_cycle(seen_cycle_, deadline);
  seen_cycle_ = session->newest_state().cycle;
  return came ? Wait::kCycle : Wait::kTimeout;
}

}  // namespace forcegrid::openhaptics
