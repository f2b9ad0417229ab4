// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <HD/hd.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "compat/openhaptics/device_table.h"
#include "compat/openhaptics/priority_mutex.h"
#include "rt/clock.h"

namespace forcegrid::chai3d {

using Vector = std::array<double, 3>;

/// CHAI3D's axes: x toward the user, y to the user's right, z up; HD's z, x and y. SI units.
struct PhantomState {
  Vector position_m{};
  Vector velocity_m_per_s{};
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< row by row
  int buttons = 0;
};

/// The force to send `age` after it was set: all of it for 100 ms, then less, none after 200 ms.
Vector aged(const Vector& force_N, rt::Duration age) noexcept;

/// The arms that CHAI3D sees, over libHD's public functions. There is one of it, which is never
/// destroyed.
///
/// An arm is opened at the first call that needs its state, or by open(); after close() by open()
/// alone. Its radius and type are known before that, from its profile. Each tick of libHD's
/// scheduler one callback reads every open arm and sends its stored force.
///
/// Threads: any. Real-time: no, but for the callback, which neither allocates nor throws.
class PhantomArms {
 public:
  static constexpr int kMostArms = 16;

  static PhantomArms& instance();

  /// Arms that may be there. They are looked for until there is one.
  int count();
  bool open(int id);
  bool close(int id);
  /// The newest tick's. @returns false: no such arm, or it can't be opened.
  bool state(int id, PhantomState& state);
  /// Null keeps what is set. Waits for the tick that sends it, 20 ms at most.
  bool set(int id, const Vector* force_N, const Vector* torque_Nm);
  bool radius(int id, double& radius_m);
  /// "" for an arm that is not there.
  std::string type(int id);

  void start_servo();
  /// Only when no arm is open.
  void stop_servo();

 private:
  struct Arm {
    openhaptics::DeviceEntry entry;
    double radius_m = 0.0;
    std::string type;
    HHD handle = HD_INVALID_HANDLE;
    bool was_closed = false;
    PhantomState state;
    Vector force_N{};
    Vector torque_Nm{};
    rt::TimePoint set_at{};
    bool is_set = false;
    std::uint64_t ticks = 0;  ///< in which it was read and its force sent
  };

  PhantomArms() = default;
  static HDCallbackCode HDCALLBACK tick(void* self);
  void exchange(Arm& arm) noexcept;
  void enumerate();
  Arm* find(int id);
  /// Opened if need be; null if it can't be. Takes opening_, then mutex_.
  Arm* opened(int id, bool also_after_close);
  bool wait_for_tick(Arm& arm);

  openhaptics::PriorityMutex opening_;  ///< taken before mutex_
  openhaptics::PriorityMutex mutex_;
  openhaptics::Condition ticked_;
  std::vector<Arm> arms_;  ///< does not grow once there is one
  HDSchedulerHandle callback_ = HD_INVALID_HANDLE;
};

}  // namespace forcegrid::chai3d
