// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/device.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <thread>

#include "device_session/device_session.h"
#include "rt/thread.h"

using forcegrid::session::DeviceSession;
using forcegrid::session::SessionError;
using forcegrid::session::SessionHealth;
using forcegrid::session::SessionOptions;
using forcegrid::session::ToolState;
namespace rt = forcegrid::rt;

namespace {

constexpr double kHold_s = 0.1;
constexpr double kLongestWait_s = 1e6;
constexpr double kLongestCallback_s = 0.05;
constexpr double kLongestCallbackOfMethod_s = 0.2;
constexpr double kCyclesPerWait = 1.5;
constexpr rt::Duration kStopTimeout = std::chrono::seconds(1);
constexpr rt::Duration kLook = std::chrono::milliseconds(1);
// The first version of each struct: nobody has a shorter one.
constexpr std::size_t kLeastState = sizeof(forcegrid_state);
constexpr std::size_t kLeastForce = sizeof(forcegrid_force);

std::string& last_error() {
  thread_local std::string text;
  return text;
}

forcegrid_status fail(forcegrid_status status, const char* text) noexcept {
  try {
    last_error() = text;
  } catch (...) {  // the status has to do
  }
  return status;
}

forcegrid_status bad(const char* text) noexcept { return fail(FORCEGRID_BAD_ARGUMENT, text); }

std::string text_or(const char* text, const char* otherwise) {
  return text != nullptr ? text : otherwise;
}

SessionOptions session_options(const forcegrid_options& options) {
  SessionOptions result;
  result.device = text_or(options.device, result.device.c_str());
  result.profile = text_or(options.profile, "");
  result.method = text_or(options.method, "");
  result.rate_Hz = options.rate_Hz;
  result.ramp_in_s = options.ramp_in_s;
  result.open_timeout = rt::from_seconds(options.open_timeout_s);
  const double longest_s = options.longest_callback_s > 0.0 ? options.longest_callback_s
                           : result.method.empty()          ? kLongestCallback_s
                                                            : kLongestCallbackOfMethod_s;
  result.longest_callback = rt::from_seconds(longest_s);
  result.calibrated = options.calibrated != 0;
  result.check_motors = options.check_motors != 0;
  result.gravity_compensation = options.gravity_compensation != 0;
  result.realtime = options.realtime != 0;
  result.falcon_firmware = text_or(options.falcon_firmware, "");
  result.emulator_hand = text_or(options.emulator_hand, result.emulator_hand.c_str());
  result.emulator_motion = text_or(options.emulator_motion, result.emulator_motion.c_str());
  result.emulator_wrist = text_or(options.emulator_wrist, result.emulator_wrist.c_str());
  result.emulator_click_every_s = options.emulator_click_every_s;
  result.emulator_summary = text_or(options.emulator_summary, "");
  if (options.notice != nullptr) {
    result.notice = [notice = options.notice, data = options.notice_data](const std::string& text) {
      notice(text.c_str(), data);
    };
  }
  return result;
}

// How the callbacks of a device do, for any thread.
struct CallbackHealth {
  std::atomic<bool> threw{false};
  std::atomic<bool> slow{false};
};

// The calls of a program's callback, on a thread that outlives a callback that never returns.
struct Calls {
  std::shared_ptr<DeviceSession> session;
  std::shared_ptr<CallbackHealth> health;
  forcegrid_callback callback = nullptr;
  void* data = nullptr;
  bool to_method = false;
  std::uint32_t tool = 0;
  rt::Duration longest{};
  std::atomic<bool> stop{false};
  std::atomic<bool> done{false};
  std::atomic<std::thread::id> thread{};
};

}  // namespace

struct forcegrid_device {
  std::shared_ptr<DeviceSession> session;
  SessionOptions options;
  std::uint32_t tool = 0;
  std::shared_ptr<CallbackHealth> health = std::make_shared<CallbackHealth>();
  std::mutex mutex;              // of `calls`
  std::shared_ptr<Calls> calls;  // the newest
};

namespace {

forcegrid_status status_of(const DeviceSession& session, const CallbackHealth& calls) noexcept {
  switch (session.health()) {
    case SessionHealth::kUncalibrated:
      return FORCEGRID_UNCALIBRATED;
    case SessionHealth::kLost:
      return FORCEGRID_LOST;
    case SessionHealth::kFaulted:
    case SessionHealth::kClosed:
      return FORCEGRID_FAULT;
    case SessionHealth::kRunning:
      break;
  }
  return calls.threw.load() ? FORCEGRID_THREW : calls.slow.load() ? FORCEGRID_SLOW : FORCEGRID_OK;
}

forcegrid_state state_of(const ToolState& from, std::uint32_t tool, forcegrid_status status) {
  forcegrid_state to{};
  to.tool = tool;
  to.cycle = from.cycle;
  to.time_ns = from.time_ns;
  std::copy(from.position_D_m.begin(), from.position_D_m.end(), to.position_m);
  std::copy(from.orientation_DT_wxyz.begin(), from.orientation_DT_wxyz.end(), to.orientation);
  std::copy(from.angular_velocity_D_rad_per_s.begin(), from.angular_velocity_D_rad_per_s.end(),
            to.angular_velocity_rad_per_s);
  std::copy(from.velocity_D_m_per_s.begin(), from.velocity_D_m_per_s.end(), to.velocity_m_per_s);
  std::copy(from.commanded_force_D_N.begin(), from.commanded_force_D_N.end(), to.force_N);
  std::copy(from.commanded_torque_D_Nm.begin(), from.commanded_torque_D_Nm.end(), to.torque_Nm);
  std::copy(from.joint_angle_rad.begin(), from.joint_angle_rad.end(), to.joint_angle_rad);
  std::copy(from.gimbal_angle_rad.begin(), from.gimbal_angle_rad.end(), to.joint_angle_rad + 3);
  to.force_gain = from.force_gain;
  to.motor_warmth = from.motor_warmth;
  std::copy(from.counts.begin(), from.counts.end(), to.counts);
  to.buttons = from.buttons;
  to.limits = from.limits_acted;
  to.missed_deadlines = from.missed_deadlines;
  to.status = status;
  return to;
}

// As much as the caller's version of the struct has room for.
template <typename T>
void copy_out(T value, T* to) noexcept {
  const std::uint32_t size = to->size;
  value.size = size;
  std::memcpy(to, &value, std::min<std::size_t>(size, sizeof value));
}

bool finite(const double* values, int count) noexcept {
  return std::all_of(values, values + count, [](double value) { return std::isfinite(value); });
}

forcegrid_status command(DeviceSession& session, const forcegrid_force& force) noexcept {
  if (!finite(force.force_N, 3) || !finite(force.torque_Nm, 3) || !std::isfinite(force.hold_s) ||
      force.hold_s < 0.0) {
    return bad("forcegrid_command: force, torque and hold_s must be finite");
  }
  const double hold_s = force.hold_s > 0.0 ? std::min(force.hold_s, kLongestWait_s) : kHold_s;
  return session.command_wrench({force.force_N[0], force.force_N[1], force.force_N[2]},
                                {force.torque_Nm[0], force.torque_Nm[1], force.torque_Nm[2]},
                                rt::from_seconds(hold_s))
             ? FORCEGRID_OK
             : fail(FORCEGRID_REFUSED,
                    "forcegrid_command: this device renders a method; use forcegrid_add_sample()");
}

// One call. @returns whether to go on.
bool call_once(Calls& calls, const ToolState& tool_state) {
  DeviceSession& session = *calls.session;
  forcegrid_state state = state_of(tool_state, calls.tool, status_of(session, *calls.health));
  state.size = sizeof state;
  forcegrid_force force{};
  forcegrid_force_init(&force, sizeof force);
  const rt::TimePoint begin = rt::Clock::now();
  session.busy();
  const bool over = calls.callback(&state, &force, calls.data) != 0;
  session.idle();
  calls.health->slow = rt::Clock::now() - begin > calls.longest;
  if (over || calls.stop) {
    return false;
  }
  // What is not finite is not taken, and the last force runs out.
  if (calls.to_method) {
    static_cast<void>(session.push_sample(tool_state.time_ns, tool_state.position_D_m,
                                          {force.force_N[0], force.force_N[1], force.force_N[2]}));
  } else {
    static_cast<void>(command(session, force));
  }
  return true;
}

void run(const std::shared_ptr<Calls>& calls, double rate_Hz) noexcept {
  rt::name_current_thread("fg-callback");
  calls->thread = std::this_thread::get_id();
  const rt::Duration wait = rt::from_seconds(kCyclesPerWait / rate_Hz);
  std::uint64_t cycle = calls->session->newest_state().cycle;
  try {
    while (!calls->stop) {
      static_cast<void>(calls->session->wait_for_cycle(cycle, rt::Clock::now() + wait));
      const ToolState state = calls->session->newest_state();
      cycle = state.cycle;
      if (calls->stop || !call_once(*calls, state)) {
        break;
      }
    }
  } catch (...) {
    calls->health->threw = true;
  }
  calls->session->idle();
  static_cast<void>(calls->session->command_force({}, rt::Duration::zero()));
  calls->done = true;
}

forcegrid_status stop_calls(const std::shared_ptr<Calls>& calls) noexcept {
  if (!calls) {
    return FORCEGRID_OK;
  }
  calls->stop = true;
  if (calls->thread.load() == std::this_thread::get_id()) {
    return FORCEGRID_OK;
  }
  const rt::TimePoint give_up = rt::Clock::now() + kStopTimeout;
  while (!calls->done) {
    if (rt::Clock::now() > give_up) {
      return fail(FORCEGRID_TIMEOUT, "the callback has not returned within 1 s; make it shorter");
    }
    rt::sleep_until(rt::Clock::now() + kLook);
  }
  return calls->health->threw ? fail(FORCEGRID_THREW, "the callback ended with a C++ exception")
                              : FORCEGRID_OK;
}

std::shared_ptr<Calls> calls_of(forcegrid_device& device) {
  const std::lock_guard lock(device.mutex);
  return device.calls;
}

void copy_text(const std::string& from, char* to, std::size_t size) noexcept {
  if (size > 0) {
    const std::size_t length = std::min(from.size(), size - 1);
    std::memcpy(to, from.data(), length);
    to[length] = '\0';
  }
}

}  // namespace

const char* forcegrid_version(void) { return FORCEGRID_VERSION; }

const char* forcegrid_status_text(forcegrid_status status) {
  switch (status) {
    case FORCEGRID_OK:
      return "all is well";
    case FORCEGRID_BAD_ARGUMENT:
      return "an argument that can't be used";
    case FORCEGRID_UNUSABLE:
      return "an option, a profile or a URL that can't be used";
    case FORCEGRID_NOT_FOUND:
      return "no such device, or it does not answer";
    case FORCEGRID_IN_USE:
      return "another program has the device";
    case FORCEGRID_UNCALIBRATED:
      return "the counters are not absolute yet";
    case FORCEGRID_LOST:
      return "the device is gone and is looked for";
    case FORCEGRID_FAULT:
      return "a fault ended the motor thread";
    case FORCEGRID_SLOW:
      return "a callback lasts too long";
    case FORCEGRID_TIMEOUT:
      return "nothing happened in time";
    case FORCEGRID_REFUSED:
      return "not in this mode";
    case FORCEGRID_NO_MEMORY:
      return "out of memory";
    case FORCEGRID_THREW:
      return "a callback ended with an exception";
  }
  return "an unknown status";
}

const char* forcegrid_last_error(void) { return last_error().c_str(); }

void forcegrid_options_init(forcegrid_options* options, size_t size) {
  if (options == nullptr || size < sizeof(std::uint32_t)) {
    return;
  }
  const SessionOptions defaults;
  forcegrid_options value{};
  value.size = static_cast<std::uint32_t>(size);
  value.rate_Hz = defaults.rate_Hz;
  value.ramp_in_s = defaults.ramp_in_s;
  value.open_timeout_s = rt::seconds(defaults.open_timeout);
  value.check_motors = defaults.check_motors ? 1 : 0;
  value.realtime = defaults.realtime ? 1 : 0;
  std::memset(options, 0, size);
  std::memcpy(options, &value, std::min(size, sizeof value));
}

void forcegrid_force_init(forcegrid_force* force, size_t size) {
  if (force == nullptr || size < sizeof(std::uint32_t)) {
    return;
  }
  std::memset(force, 0, size);
  force->size = static_cast<std::uint32_t>(size);
}

forcegrid_status forcegrid_open(const forcegrid_options* options, forcegrid_device** device) {
  if (device == nullptr) {
    return bad("forcegrid_open: device is null");
  }
  *device = nullptr;
  if (options == nullptr || options->size < sizeof(std::uint32_t)) {
    return bad("forcegrid_open: options is null or has no size; use forcegrid_options_init()");
  }
  try {
    forcegrid_options all;
    forcegrid_options_init(&all, sizeof all);
    std::memcpy(&all, options, std::min<std::size_t>(options->size, sizeof all));
    auto opened = std::make_unique<forcegrid_device>();
    opened->options = session_options(all);
    opened->tool = all.tool;
    opened->session = DeviceSession::open(opened->options);
    *device = opened.release();
    return FORCEGRID_OK;
  } catch (const SessionError& error) {
    return fail(error.reason() == SessionError::Reason::kInUse    ? FORCEGRID_IN_USE
                : error.reason() == SessionError::Reason::kAbsent ? FORCEGRID_NOT_FOUND
                                                                  : FORCEGRID_UNUSABLE,
                error.what());
  } catch (const std::bad_alloc&) {
    return fail(FORCEGRID_NO_MEMORY, "out of memory");
  } catch (const std::exception& error) {
    return fail(FORCEGRID_UNUSABLE, error.what());
  }
}

forcegrid_status forcegrid_close(forcegrid_device* device) {
  if (device == nullptr) {
    return FORCEGRID_OK;
  }
  const std::unique_ptr<forcegrid_device> owned(device);
  const forcegrid_status stopped = stop_calls(calls_of(*device));
  const bool zero_delivered = device->session->close();
  if (stopped == FORCEGRID_TIMEOUT) {
    return stopped;
  }
  return zero_delivered ? FORCEGRID_OK
                        : fail(FORCEGRID_TIMEOUT,
                               "the device did not confirm zero current; its "
                               "own watchdog switches the motors off");
}

forcegrid_status forcegrid_read(forcegrid_device* device, forcegrid_state* state) {
  if (device == nullptr || state == nullptr || state->size < kLeastState) {
    return bad("forcegrid_read: device or state is null, or state->size is not set");
  }
  const ToolState newest = device->session->newest_state();
  copy_out(state_of(newest, device->tool, forcegrid_health(device)), state);
  return FORCEGRID_OK;
}

forcegrid_status forcegrid_wait(forcegrid_device* device, uint64_t cycle, double timeout_s,
                                forcegrid_state* state) {
  if (device == nullptr || state == nullptr || state->size < kLeastState ||
      !std::isfinite(timeout_s)) {
    return bad(
        "forcegrid_wait: device or state is null, state->size is not set, or the time-out "
        "is not finite");
  }
  const double wait_s = std::clamp(timeout_s, 0.0, kLongestWait_s);
  const bool came =
      device->session->wait_for_cycle(cycle, rt::Clock::now() + rt::from_seconds(wait_s));
  static_cast<void>(forcegrid_read(device, state));
  return came ? FORCEGRID_OK
              : fail(FORCEGRID_TIMEOUT, "forcegrid_wait: no cycle within the time-out");
}

forcegrid_status forcegrid_enable(forcegrid_device* device, int on) {
  if (device == nullptr) {
    return bad("forcegrid_enable: device is null");
  }
  device->session->enable_force(on != 0);
  return FORCEGRID_OK;
}

int forcegrid_is_enabled(forcegrid_device* device) {
  return device != nullptr && device->session->force_enabled() ? 1 : 0;
}

forcegrid_status forcegrid_command(forcegrid_device* device, const forcegrid_force* force) {
  if (device == nullptr || force == nullptr || force->size < kLeastForce) {
    return bad(
        "forcegrid_command: device or force is null, or force->size is not set; use "
        "forcegrid_force_init()");
  }
  return command(*device->session, *force);
}

forcegrid_status forcegrid_add_sample(forcegrid_device* device, int64_t time_ns,
                                      const double position_m[3], const double force_N[3]) {
  if (device == nullptr || position_m == nullptr || force_N == nullptr || !finite(position_m, 3) ||
      !finite(force_N, 3)) {
    return bad("forcegrid_add_sample: device, position and force must be there and be finite");
  }
  return device->session->push_sample(time_ns, {position_m[0], position_m[1], position_m[2]},
                                      {force_N[0], force_N[1], force_N[2]})
             ? FORCEGRID_OK
             : fail(FORCEGRID_REFUSED,
                    "forcegrid_add_sample: open the device with a method, e.g. \"auto\", and give "
                    "it samples no faster than its motor thread runs");
}

forcegrid_status forcegrid_start(forcegrid_device* device, forcegrid_callback callback,
                                 void* data) {
  if (device == nullptr || callback == nullptr) {
    return bad("forcegrid_start: device or callback is null");
  }
  try {
    const std::lock_guard lock(device->mutex);
    if (device->calls && !device->calls->done) {
      return fail(FORCEGRID_REFUSED, "forcegrid_start: it runs already; use forcegrid_stop()");
    }
    auto calls = std::make_shared<Calls>();
    calls->session = device->session;
    calls->health = device->health;
    calls->health->threw = false;
    calls->health->slow = false;
    calls->callback = callback;
    calls->data = data;
    calls->to_method = !device->options.method.empty();
    calls->tool = device->tool;
    calls->longest = device->options.longest_callback;
    device->calls = calls;
    std::thread([calls, rate_Hz = device->options.rate_Hz] { run(calls, rate_Hz); }).detach();
    return FORCEGRID_OK;
  } catch (const std::exception& error) {
    return fail(FORCEGRID_NO_MEMORY, error.what());
  }
}

forcegrid_status forcegrid_stop(forcegrid_device* device) {
  return device == nullptr ? bad("forcegrid_stop: device is null") : stop_calls(calls_of(*device));
}

forcegrid_status forcegrid_health(forcegrid_device* device) {
  if (device == nullptr) {
    return bad("forcegrid_health: device is null");
  }
  return status_of(*device->session, *device->health);
}

size_t forcegrid_failure(forcegrid_device* device, char* text, size_t size) {
  if (device == nullptr || (text == nullptr && size > 0)) {
    return 0;
  }
  try {
    std::string why = device->session->failure();
    if (why.empty()) {
      const forcegrid_status status = forcegrid_health(device);
      why = status == FORCEGRID_OK ? "" : forcegrid_status_text(status);
    }
    copy_text(why, text, size);
    return why.size();
  } catch (const std::exception&) {
    copy_text("", text, size);
    return 0;
  }
}

forcegrid_status forcegrid_calibrate_now(forcegrid_device* device) {
  if (device == nullptr) {
    return bad("forcegrid_calibrate_now: device is null");
  }
  try {
    const std::string why_not = device->session->calibrate_now();
    return why_not.empty() ? FORCEGRID_OK : fail(FORCEGRID_UNCALIBRATED, why_not.c_str());
  } catch (const std::exception& error) {
    return fail(FORCEGRID_NO_MEMORY, error.what());
  }
}

forcegrid_status forcegrid_get_limits(forcegrid_device* device, forcegrid_limits* limits) {
  if (device == nullptr || limits == nullptr || limits->size < sizeof(std::uint32_t)) {
    return bad("forcegrid_get_limits: device or limits is null, or limits->size is not set");
  }
  const auto& from = device->session->profile().limits;
  forcegrid_limits value{};
  value.tool = device->tool;
  value.max_force_N = from.max_force_N;
  value.max_torque_Nm = device->session->profile().gimbal_motors.max_torque_Nm;
  value.max_stiffness_N_per_m = from.max_stiffness_N_per_m;
  value.max_damping_N_s_per_m = from.max_damping_N_s_per_m;
  value.max_speed_m_per_s = from.max_speed_m_per_s;
  std::copy(from.workspace_min_m.begin(), from.workspace_min_m.end(), value.workspace_min_m);
  std::copy(from.workspace_max_m.begin(), from.workspace_max_m.end(), value.workspace_max_m);
  value.rate_Hz = device->options.rate_Hz;
  copy_out(value, limits);
  return FORCEGRID_OK;
}

forcegrid_status forcegrid_get_identity(forcegrid_device* device, forcegrid_identity* identity) {
  if (device == nullptr || identity == nullptr || identity->size < sizeof(std::uint32_t)) {
    return bad("forcegrid_get_identity: device or identity is null, or identity->size is not set");
  }
  try {
    forcegrid_identity value{};
    value.degrees_of_freedom = forcegrid::profiles::has_wrist(device->session->profile()) ? 6 : 3;
    copy_text(device->session->url(), value.url, sizeof value.url);
    copy_text(device->session->profile().name, value.profile, sizeof value.profile);
    copy_text(device->session->manufacturer(), value.manufacturer, sizeof value.manufacturer);
    copy_text(device->session->product(), value.product, sizeof value.product);
    copy_text(device->session->serial(), value.serial, sizeof value.serial);
    copy_out(value, identity);
    return FORCEGRID_OK;
  } catch (const std::exception& error) {
    return fail(FORCEGRID_NO_MEMORY, error.what());
  }
}
