// SPDX-License-Identifier: Apache-2.0
#include "compat/openhaptics/parameters.h"

#include <algorithm>
#include <iterator>

namespace forcegrid::openhaptics {
namespace {

constexpr int kAxes = 3;           // of a device without a wrist
constexpr int kAxesWithWrist = 6;  // that it senses, and of its force where the wrist has motors

void zeros(double* values, int count) noexcept { std::fill_n(values, count, 0.0); }

void write3(double* values, const std::array<double, 3>& three) noexcept {
  std::copy(three.begin(), three.end(), values);
}

template <int kCount>
void zero(const Reading& /*reading*/, double* values) noexcept {
  zeros(values, kCount);
}

void one(const Reading& /*reading*/, double* values) noexcept { values[0] = 1.0; }

void buttons(const Reading& r, double* values) noexcept { values[0] = r.state.buttons; }

void encoders(const Reading& r, double* values) noexcept {
  std::copy(r.state.counts.begin(), r.state.counts.end(), values);
}

void position(const Reading& r, double* values) noexcept {
  const auto position_HD_m = to_hd(r.state.position_D_m);
  for (std::size_t i = 0; i < 3; ++i) {
    values[i] = kMm_per_m * position_HD_m[i] - r.facts->origin_mm[i];
  }
}

void velocity(const Reading& r, double* values) noexcept {
  const auto velocity_HD = to_hd(r.state.velocity_D_m_per_s);
  for (std::size_t i = 0; i < 3; ++i) {
    values[i] = kMm_per_m * velocity_HD[i];
  }
}

void transform(const Reading& r, double* values) noexcept {
  zeros(values, 16);
  values[15] = 1.0;
  const std::array<double, 9> rotation = rotation_hd(r.state.orientation_DT_wxyz);
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      values[4 * column + row] = rotation[3 * row + column];
    }
  }
  if (r.facts != nullptr) {
    position(r, values + 12);
  }
}

void angular_velocity(const Reading& r, double* values) noexcept {
  write3(values, to_hd(r.state.angular_velocity_D_rad_per_s));
}

void gimbal_angles(const Reading& r, double* values) noexcept {
  write3(values, r.facts->has_wrist
                     ? gimbal_angles_hd(r.state.gimbal_angle_rad, r.facts->gimbal_sign)
                     : std::array<double, 3>{});
}

void jacobian(const Reading& r, double* values) noexcept {
  zeros(values, 36);
  for (std::size_t joint = 0; joint < 3; ++joint) {
    const auto& rows_D = r.state.jacobian_D_m_per_rad;
    const auto column_HD = to_hd({rows_D[joint], rows_D[3 + joint], rows_D[6 + joint]});
    for (std::size_t row = 0; row < 3; ++row) {
      values[6 * row + joint] = kMm_per_m * column_HD[row] * r.facts->joint_sign[joint];
    }
  }
}

void joint_angles(const Reading& r, double* values) noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    values[i] = r.facts->joint_offset_rad[i] + r.facts->joint_sign[i] * r.state.joint_angle_rad[i];
  }
}

void force(const Reading& r, double* values) noexcept { write3(values, to_hd(r.force_D_N)); }

void torque(const Reading& r, double* values) noexcept {
  write3(values, to_hd(r.torque_D_Nm));
  for (int i = 0; i < kAxes; ++i) {
    values[i] *= kMm_per_m;
  }
}

void joint_torque(const Reading& r, double* values) noexcept {
  write3(values, joint_torque_mNm(*r.facts, r.state, r.force_D_N));
}

void firmware(const Reading& r, double* values) noexcept { values[0] = r.facts->firmware_version; }

void workspace(const Reading& r, double* values) noexcept {
  std::copy(r.facts->workspace_mm.begin(), r.facts->workspace_mm.end(), values);
}

void tabletop(const Reading& r, double* values) noexcept { values[0] = r.facts->tabletop_mm; }

void output_axes(const Reading& r, double* values) noexcept {
  values[0] = r.facts->has_wrist_motors ? kAxesWithWrist : kAxes;
}
void input_axes(const Reading& r, double* values) noexcept {
  values[0] = r.facts->has_wrist ? kAxesWithWrist : kAxes;
}

void calibration_style(const Reading& /*reading*/, double* values) noexcept {
  values[0] = HD_CALIBRATION_AUTO;
}

void update_rate(const Reading& r, double* values) noexcept { values[0] = r.rate_Hz; }

void measured_rate(const Reading& r, double* values) noexcept {
  values[0] = std::max(r.measured_rate_Hz, 1.0);  // programs divide by it
}

void stiffness(const Reading& r, double* v) noexcept { v[0] = r.facts->max_stiffness_N_per_mm; }
void damping(const Reading& r, double* v) noexcept { v[0] = r.facts->max_damping_N_s_per_mm; }
void max_torque(const Reading& r, double* v) noexcept { v[0] = r.facts->max_torque_mNm; }
void max_force(const Reading& r, double* v) noexcept { v[0] = r.facts->max_force_N; }
void continuous(const Reading& r, double* v) noexcept { v[0] = r.facts->continuous_force_N; }
void warmth(const Reading& r, double* v) noexcept { std::fill_n(v, kAxes, r.state.motor_warmth); }
void velocity_limit(const Reading& r, double* v) noexcept {
  v[0] = r.settings->velocity_limit_mm_per_s;
}
void impulse_limit(const Reading& r, double* v) noexcept { v[0] = r.settings->impulse_limit; }
void ramping_rate(const Reading& r, double* v) noexcept { v[0] = r.settings->ramping_rate; }
void light(const Reading& r, double* v) noexcept { v[0] = r.settings->light; }

using F = Family;
using M = Moment;
using S = Setting;

constexpr Parameter kParameters[] = {
    {HD_CURRENT_BUTTONS, F::kInteger, 1, M::kCurrent, S::kNone, buttons},
    {HD_CURRENT_SAFETY_SWITCH, F::kBoolean, 1, M::kCurrent, S::kNone, zero<1>},
    {HD_CURRENT_INKWELL_SWITCH, F::kBoolean, 1, M::kCurrent, S::kNone, one},
    {HD_CURRENT_ENCODER_VALUES, F::kLong, 6, M::kCurrent, S::kNone, encoders},
    {HD_CURRENT_PINCH_VALUE, F::kReal, 1, M::kCurrent, S::kNone, zero<1>},
    {HD_LAST_PINCH_VALUE, F::kReal, 1, M::kLast, S::kNone, zero<1>},
    {HD_CURRENT_POSITION, F::kReal, 3, M::kCurrent, S::kNone, position},
    {HD_CURRENT_VELOCITY, F::kReal, 3, M::kCurrent, S::kNone, velocity},
    {HD_CURRENT_TRANSFORM, F::kReal, 16, M::kCurrent, S::kNone, transform},
    {HD_CURRENT_ANGULAR_VELOCITY, F::kReal, 3, M::kCurrent, S::kNone, angular_velocity},
    {HD_CURRENT_JACOBIAN, F::kReal, 36, M::kCurrent, S::kNone, jacobian},
    {HD_CURRENT_JOINT_ANGLES, F::kReal, 3, M::kCurrent, S::kNone, joint_angles},
    {HD_CURRENT_GIMBAL_ANGLES, F::kReal, 3, M::kCurrent, S::kNone, gimbal_angles},
    {HD_LAST_BUTTONS, F::kInteger, 1, M::kLast, S::kNone, buttons},
    {HD_LAST_SAFETY_SWITCH, F::kBoolean, 1, M::kLast, S::kNone, zero<1>},
    {HD_LAST_INKWELL_SWITCH, F::kBoolean, 1, M::kLast, S::kNone, one},
    {HD_LAST_ENCODER_VALUES, F::kLong, 6, M::kLast, S::kNone, encoders},
    {HD_LAST_POSITION, F::kReal, 3, M::kLast, S::kNone, position},
    {HD_LAST_VELOCITY, F::kReal, 3, M::kLast, S::kNone, velocity},
    {HD_LAST_TRANSFORM, F::kReal, 16, M::kLast, S::kNone, transform},
    {HD_LAST_ANGULAR_VELOCITY, F::kReal, 3, M::kLast, S::kNone, angular_velocity},
    {HD_LAST_JACOBIAN, F::kReal, 36, M::kLast, S::kNone, jacobian},
    {HD_LAST_JOINT_ANGLES, F::kReal, 3, M::kLast, S::kNone, joint_angles},
    {HD_LAST_GIMBAL_ANGLES, F::kReal, 3, M::kLast, S::kNone, gimbal_angles},
    {HD_DEVICE_FIRMWARE_VERSION, F::kReal, 1, M::kDevice, S::kNone, firmware},
    {HD_MAX_WORKSPACE_DIMENSIONS, F::kReal, 6, M::kDevice, S::kNone, workspace},
    {HD_USABLE_WORKSPACE_DIMENSIONS, F::kReal, 6, M::kDevice, S::kNone, workspace},
    {HD_TABLETOP_OFFSET, F::kReal, 1, M::kDevice, S::kNone, tabletop},
    {HD_INPUT_DOF, F::kInteger, 1, M::kDevice, S::kNone, input_axes},
    {HD_OUTPUT_DOF, F::kInteger, 1, M::kDevice, S::kNone, output_axes},
    {HD_CALIBRATION_STYLE, F::kInteger, 1, M::kDevice, S::kNone, calibration_style},
    {HD_UPDATE_RATE, F::kInteger, 1, M::kScheduler, S::kNone, update_rate},
    {HD_INSTANTANEOUS_UPDATE_RATE, F::kInteger, 1, M::kScheduler, S::kNone, measured_rate},
    {HD_NOMINAL_MAX_STIFFNESS, F::kReal, 1, M::kDevice, S::kNone, stiffness},
    {HD_NOMINAL_MAX_FORCE, F::kReal, 1, M::kDevice, S::kNone, max_force},
    {HD_NOMINAL_MAX_CONTINUOUS_FORCE, F::kReal, 1, M::kDevice, S::kNone, continuous},
    {HD_MOTOR_TEMPERATURE, F::kReal, kAxes, M::kCurrent, S::kNone, warmth},
    {HD_SOFTWARE_VELOCITY_LIMIT, F::kReal, 1, M::kDevice, S::kLimit, velocity_limit},
    {HD_SOFTWARE_FORCE_IMPULSE_LIMIT, F::kReal, 1, M::kDevice, S::kLimit, impulse_limit},
    {HD_FORCE_RAMPING_RATE, F::kReal, 1, M::kDevice, S::kLimit, ramping_rate},
    {HD_NOMINAL_MAX_DAMPING, F::kReal, 1, M::kDevice, S::kNone, damping},
    {HD_NOMINAL_MAX_TORQUE_STIFFNESS, F::kReal, 1, M::kDevice, S::kNone, zero<1>},
    {HD_NOMINAL_MAX_TORQUE_DAMPING, F::kReal, 1, M::kDevice, S::kNone, zero<1>},
    {HD_NOMINAL_MAX_TORQUE_FORCE, F::kReal, 1, M::kDevice, S::kNone, max_torque},
    {HD_NOMINAL_MAX_TORQUE_CONTINUOUS_FORCE, F::kReal, 1, M::kDevice, S::kNone, max_torque},
    {HD_CURRENT_FORCE, F::kReal, 3, M::kCurrent, S::kForce, force},
    {HD_CURRENT_TORQUE, F::kReal, 3, M::kCurrent, S::kTorque, torque},
    {HD_JOINT_ANGLE_REFERENCES, F::kReal, 3, M::kDevice, S::kNone, zero<3>},
    {HD_CURRENT_JOINT_TORQUE, F::kReal, 3, M::kCurrent, S::kJointTorque, joint_torque},
    {HD_CURRENT_GIMBAL_TORQUE, F::kReal, 3, M::kCurrent, S::kIgnored, zero<3>},
    {HD_LAST_FORCE, F::kReal, 3, M::kLast, S::kNone, force},
    {HD_LAST_TORQUE, F::kReal, 3, M::kLast, S::kNone, torque},
    {HD_LAST_JOINT_TORQUE, F::kReal, 3, M::kLast, S::kNone, joint_torque},
    {HD_LAST_GIMBAL_TORQUE, F::kReal, 3, M::kLast, S::kNone, zero<3>},
    {HD_USER_STATUS_LIGHT, F::kInteger, 1, M::kDevice, S::kLight, light},
};

constexpr bool before(const Parameter& a, const Parameter& b) { return a.name < b.name; }
static_assert(std::is_sorted(std::begin(kParameters), std::end(kParameters), before));

}  // namespace

const Parameter* find_parameter(HDenum name) noexcept {
  const auto* const found =
      std::lower_bound(std::begin(kParameters), std::end(kParameters), name,
                       [](const Parameter& one, HDenum value) { return one.name < value; });
  return found != std::end(kParameters) && found->name == name ? found : nullptr;
}

std::span<const Parameter> all_parameters() noexcept { return kParameters; }

bool is_text(HDenum name) noexcept { return name >= HD_VERSION && name <= HD_DEVICE_SERIAL_NUMBER; }

const char* text_of(HDenum name, const ArmFacts* facts) noexcept {
  switch (name) {
    case HD_VERSION:
      return "3.30.0";
    case HD_DEVICE_DRIVER_VERSION:
      return "forcegrid " FORCEGRID_VERSION;
    case HD_DEVICE_MODEL_TYPE:
      return facts == nullptr ? "" : facts->model.c_str();
    case HD_DEVICE_VENDOR:
      return facts == nullptr ? "" : facts->vendor.c_str();
    case HD_DEVICE_SERIAL_NUMBER:
      return facts == nullptr ? "" : facts->serial.c_str();
    default:
      return "";
  }
}

}  // namespace forcegrid::openhaptics
