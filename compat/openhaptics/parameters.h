// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <HD/hdDefines.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "compat/openhaptics/arm_facts.h"
#include "device_session/device_session.h"

namespace forcegrid::openhaptics {

/// What a parameter is by nature. Reals and integers are read with the calls for floats, doubles
/// and integers; booleans and longs with their own alone.
enum class Family : std::uint8_t { kReal, kInteger, kBoolean, kLong };

/// Of which frame it speaks.
enum class Moment : std::uint8_t {
  kDevice,     ///< none; it needs a device
  kScheduler,  ///< none, and needs no device
  kCurrent,
  kLast,
};

/// How a parameter is set.
enum class Setting : std::uint8_t {
  kNone,
  kForce,        ///< in a frame only
  kJointTorque,  ///< likewise
  kTorque,       ///< likewise; without motors in the wrist taken anywhere, without effect
  kIgnored,      ///< the torques of a gimbal's joints: taken, without effect
  kLimit,        ///< kept, and read back
  kLight,
};

/// What a device's program may set besides forces.
struct ArmSettings {
  double velocity_limit_mm_per_s = 1200.0;
  double impulse_limit = 4.0;
  double ramping_rate = 1.0;
  double light = 0.0;
};

/// What getters read.
struct Reading {
  session::ToolState state;           ///< of the parameter's moment
  std::array<double, 3> force_D_N{};  ///< of the program, likewise
  std::array<double, 3> torque_D_Nm{};
  const ArmFacts* facts = nullptr;  ///< null: no device
  const ArmSettings* settings = nullptr;
  double rate_Hz = 0.0;
  double measured_rate_Hz = 0.0;
};

struct Parameter {
  HDenum name;
  Family family;
  std::uint8_t count;
  Moment moment;
  Setting setting;
  void (*get)(const Reading& reading, double* values) noexcept;  ///< writes `count` values
};

inline constexpr std::size_t kMostValues = 36;

/// Null for a name that is none, for texts, and for HD_*_MOTOR_DAC_VALUES, which are refused.
/// Real-time.
const Parameter* find_parameter(HDenum name) noexcept;
/// All of them, by rising name.
std::span<const Parameter> all_parameters() noexcept;

/// Whether `name` is a text, for hdGetString().
bool is_text(HDenum name) noexcept;
/// Never null; `facts` null: "". Lives as long as `facts`.
const char* text_of(HDenum name, const ArmFacts* facts) noexcept;

}  // namespace forcegrid::openhaptics
