// SPDX-License-Identifier: Apache-2.0
#include "compat/chai3d/phantom_arms.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <mutex>

#include "profiles/device_profile.h"

namespace forcegrid::chai3d {
namespace {

using openhaptics::DeviceEntry;
using rt::Clock;

constexpr double kM_per_mm = 1e-3;
constexpr double kMNm_per_Nm = 1e3;
constexpr double kHold_s = 0.1;
constexpr double kFade_s = 0.1;
constexpr std::chrono::milliseconds kLongestWait{20};
constexpr std::size_t kHdAxis[3] = {2, 0, 1};  // CHAI3D's x, y, z in HD
constexpr char kEmulated[] = "emulated:";
constexpr char kUsualProfile[] = "woodenhaptics_v2015";

// The profile that device_session/ takes for it.
std::string profile_of(const DeviceEntry& entry) {
  if (!entry.profile.empty()) {
    return entry.profile;
  }
  if (entry.url.starts_with(kEmulated)) {
    return entry.url.substr(sizeof kEmulated - 1);
  }
  return entry.url.starts_with("falcon") ? "falcon" : kUsualProfile;
}

double half_diagonal_m(const profiles::DeviceProfile& profile) {
  const auto& low = profile.limits.workspace_min_m;
  const auto& high = profile.limits.workspace_max_m;
  return std::hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) / 2;
}

Vector to_hd(const Vector& chai3d, double scale) noexcept {
  Vector hd{};
  for (std::size_t i = 0; i < 3; ++i) {
    hd[kHdAxis[i]] = scale * chai3d[i];
  }
  return hd;
}

}  // namespace

Vector aged(const Vector& force_N, rt::Duration age) noexcept {
  const double share = std::clamp(1.0 - (rt::seconds(age) - kHold_s) / kFade_s, 0.0, 1.0);
  return {share * force_N[0], share * force_N[1], share * force_N[2]};
}

PhantomArms& PhantomArms::instance() {
  static PhantomArms* const arms = new PhantomArms;
  return *arms;
}

int PhantomArms::count() {
  const std::lock_guard lock(opening_);
  enumerate();
  return static_cast<int>(arms_.size());
}

void PhantomArms::enumerate() {
  if (!arms_.empty()) {
    return;
  }
  try {
    std::vector<Arm> found;
    for (const DeviceEntry& entry : openhaptics::load_device_table().devices) {
      if (found.size() < kMostArms && openhaptics::may_be_present(entry)) {
        const auto profile = profiles::load_device_profile(profile_of(entry));
        Arm arm;
        arm.entry = entry;
        arm.radius_m = half_diagonal_m(profile);
        arm.type = entry.model.empty() ? profile.name.substr(0, 254) : entry.model;
        found.push_back(arm);
      }
    }
    const std::lock_guard lock(mutex_);
    arms_ = std::move(found);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forcegrid: %s\n", error.what());
  }
}

PhantomArms::Arm* PhantomArms::find(int id) {
  enumerate();
  return id >= 0 && id < static_cast<int>(arms_.size()) ? &arms_[static_cast<std::size_t>(id)]
                                                        : nullptr;
}

PhantomArms::Arm* PhantomArms::opened(int id, bool also_after_close) {
  {
    const std::lock_guard lock(opening_);
    Arm* const arm = find(id);
    if (arm == nullptr || (arm->was_closed && !also_after_close)) {
      return nullptr;
    }
    if (arm->handle != HD_INVALID_HANDLE) {
      return arm;
    }
    const HHD handle = hdInitDevice(arm->entry.name.empty() ? nullptr : arm->entry.name.c_str());
    if (handle == HD_INVALID_HANDLE) {
      hdGetError();  // its text is on stderr
      return nullptr;
    }
    hdEnable(HD_FORCE_OUTPUT);
    const std::lock_guard state_lock(mutex_);
    arm->handle = handle;
    arm->was_closed = false;
    arm->is_set = false;
  }
  start_servo();
  const std::lock_guard lock(mutex_);
  wait_for_tick(arms_[static_cast<std::size_t>(id)]);  // there is a state now
  return &arms_[static_cast<std::size_t>(id)];
}

bool PhantomArms::open(int id) { return opened(id, true) != nullptr; }

bool PhantomArms::close(int id) {
  const std::lock_guard lock(opening_);
  Arm* const arm = find(id);
  if (arm == nullptr) {
    return false;
  }
  HHD handle = HD_INVALID_HANDLE;
  {
    const std::lock_guard state_lock(mutex_);
    std::swap(handle, arm->handle);
    arm->was_closed = true;
    arm->is_set = false;
  }
  if (handle != HD_INVALID_HANDLE) {
    hdDisableDevice(handle);
  }
  return true;
}

bool PhantomArms::state(int id, PhantomState& state) {
  Arm* const arm = opened(id, false);
  if (arm == nullptr) {
    return false;
  }
  start_servo();
  const std::lock_guard lock(mutex_);
  state = arm->state;
  return true;
}

bool PhantomArms::set(int id, const Vector* force_N, const Vector* torque_Nm) {
  Arm* const arm = opened(id, false);
  if (arm == nullptr) {
    return false;
  }
  start_servo();
  const std::lock_guard lock(mutex_);
  if (force_N != nullptr) {
    arm->force_N = *force_N;
  }
  if (torque_Nm != nullptr) {
    arm->torque_Nm = *torque_Nm;
  }
  arm->set_at = Clock::now();
  arm->is_set = true;
  wait_for_tick(*arm);
  return true;
}

// With mutex_ held.
bool PhantomArms::wait_for_tick(Arm& arm) {
  const std::uint64_t before = arm.ticks;
  return ticked_.wait_until(mutex_, Clock::now() + kLongestWait,
                            [&] { return arm.ticks > before; });
}

bool PhantomArms::radius(int id, double& radius_m) {
  const std::lock_guard lock(opening_);
  const Arm* const arm = find(id);
  radius_m = arm == nullptr ? 0.0 : arm->radius_m;
  return arm != nullptr;
}

std::string PhantomArms::type(int id) {
  const std::lock_guard lock(opening_);
  const Arm* const arm = find(id);
  return arm == nullptr ? "" : arm->type;
}

void PhantomArms::start_servo() {
  const std::lock_guard lock(opening_);
  if (callback_ == HD_INVALID_HANDLE) {
    callback_ = hdScheduleAsynchronous(tick, this, HD_DEFAULT_SCHEDULER_PRIORITY);
    hdStartScheduler();
  }
}

void PhantomArms::stop_servo() {
  const std::lock_guard lock(opening_);
  const bool none_open = std::all_of(
      arms_.begin(), arms_.end(), [](const Arm& arm) { return arm.handle == HD_INVALID_HANDLE; });
  if (none_open && callback_ != HD_INVALID_HANDLE) {
    hdUnschedule(callback_);
    hdStopScheduler();
    callback_ = HD_INVALID_HANDLE;
  }
}

HDCallbackCode HDCALLBACK PhantomArms::tick(void* self) {
  auto& arms = *static_cast<PhantomArms*>(self);
  const HHD current = hdGetCurrentDevice();
  const std::lock_guard lock(arms.mutex_);
  bool changed_current = false;
  for (Arm& arm : arms.arms_) {
    if (arm.handle != HD_INVALID_HANDLE) {
      arms.exchange(arm);
      changed_current = changed_current || arm.handle != current;
    }
  }
  if (changed_current) {
    hdMakeCurrentDevice(current);
  }
  arms.ticked_.wake_all();
  return HD_CALLBACK_CONTINUE;
}

void PhantomArms::exchange(Arm& arm) noexcept {
  double transform[16];
  double velocity_mm_per_s[3];
  HDint buttons = 0;
  hdBeginFrame(arm.handle);
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  hdGetDoublev(HD_CURRENT_VELOCITY, velocity_mm_per_s);
  hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
  for (std::size_t row = 0; row < 3; ++row) {
    arm.state.position_m[row] = kM_per_mm * transform[12 + kHdAxis[row]];
    arm.state.velocity_m_per_s[row] = kM_per_mm * velocity_mm_per_s[kHdAxis[row]];
    for (std::size_t column = 0; column < 3; ++column) {
      arm.state.rotation[3 * row + column] = transform[4 * kHdAxis[column] + kHdAxis[row]];
    }
  }
  arm.state.buttons = buttons;
  if (arm.is_set) {
    const rt::Duration age = Clock::now() - arm.set_at;
    hdSetDoublev(HD_CURRENT_FORCE, to_hd(aged(arm.force_N, age), 1.0).data());
    hdSetDoublev(HD_CURRENT_TORQUE, to_hd(aged(arm.torque_Nm, age), kMNm_per_Nm).data());
  }
  hdEndFrame(arm.handle);
  ++arm.ticks;
}

}  // namespace forcegrid::chai3d
