// SPDX-License-Identifier: Apache-2.0
#include "link/message_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

namespace forcegrid::link {
namespace {

template <typename T, std::size_t N>
bool finite(const std::array<T, N>& values) noexcept {
  return std::ranges::all_of(values, [](T value) { return std::isfinite(value); });
}

template <typename T, std::size_t N>
bool within(const std::array<T, N>& values, double bound) noexcept {
  return std::ranges::all_of(values, [bound](T value) { return std::abs(value) <= bound; });
}

bool is_unit(const Quaternion& q) noexcept {
  const double squares = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  return std::abs(squares - 1.0) <= kMaxNormError;
}

// Without its flag a field has one form.
bool nothing_undeclared(const ToolState& message) noexcept {
  return (message.has_orientation || (message.orientation_WT == kIdentity &&
                                      within(message.angular_velocity_W_rad_per_s, 0.0))) &&
         (message.has_buttons || message.buttons == 0);
}

bool nothing_undeclared(const ForceSample& message) noexcept {
  return (message.has_stiffness || within(message.stiffness_W_N_per_m, 0.0)) &&
         (message.has_torque ||
          (within(message.torque_W_Nm, 0.0) && !message.has_rotational_stiffness)) &&
         (message.has_rotational_stiffness ||
          within(message.rotational_stiffness_W_Nm_per_rad, 0.0)) &&
         (message.has_torque_gradient ? message.has_torque
                                      : within(message.torque_gradient_W_N, 0.0)) &&
         std::ranges::all_of(std::span(message.influences).subspan(message.influence_count),
                             [](const ToolInfluence& rest) {
                               return rest.tool == 0 && rest.echo_sequence == 0 &&
                                      within(rest.position_W_m, 0.0) &&
                                      within(rest.stiffness_W_N_per_m, 0.0);
                             });
}

// Everything beyond the counts must be zero, so that a message has one form.
bool nothing_undeclared(const SurfacePatch& message) noexcept {
  for (std::size_t v = message.vertex_count; v < message.vertices_W_m.size(); ++v) {
    if (!within(message.vertices_W_m[v], 0.0)) {
      return false;
    }
  }
  for (std::size_t t = message.triangle_count; t < message.triangles.size(); ++t) {
    if (message.triangles[t] != SurfacePatch::Triangle{}) {
      return false;
    }
  }
  const bool press_undeclared =
      !message.has_press_forces &&
      !std::ranges::all_of(message.press_forces_W_N, [](const auto& f) { return within(f, 0.0); });
  return !press_undeclared && !(message.has_stiffness && message.has_press_forces) &&
         (message.has_stiffness || within(message.stiffness_W_N_per_m, 0.0));
}

}  // namespace

WireStatus check(const ToolState& message) noexcept {
  if (!finite(message.position_W_m) || !finite(message.velocity_W_m_per_s) ||
      !finite(message.orientation_WT) || !finite(message.angular_velocity_W_rad_per_s)) {
    return WireStatus::kNotFinite;
  }
  if (!nothing_undeclared(message)) {
    return WireStatus::kBadReserved;
  }
  if (message.servo_time_ns < 0 || !within(message.position_W_m, kMaxPosition_m) ||
      !within(message.velocity_W_m_per_s, kMaxVelocity_m_per_s) ||
      !is_unit(message.orientation_WT) ||
      !within(message.angular_velocity_W_rad_per_s, kMaxAngularVelocity_rad_per_s)) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

WireStatus check(const Query& message) noexcept {
  if (!finite(message.position_W_m)) {
    return WireStatus::kNotFinite;
  }
  if (message.query_id == 0 || message.servo_time_ns < 0 ||
      !within(message.position_W_m, kMaxPosition_m)) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

WireStatus check(const ForceSample& message) noexcept {
  if (message.influence_count > message.influences.size()) {
    return WireStatus::kOutOfRange;
  }
  const auto influence_finite = [](const ToolInfluence& other) {
    return finite(other.position_W_m) && finite(other.stiffness_W_N_per_m);
  };
  const auto influence_usual = [](const ToolInfluence& other) {
    return other.tool <= kMaxToolId && within(other.position_W_m, kMaxPosition_m) &&
           within(other.stiffness_W_N_per_m, kMaxStiffness_N_per_m);
  };
  if (!finite(message.position_W_m) || !finite(message.force_W_N) ||
      !finite(message.stiffness_W_N_per_m) || !finite(message.contact_point_W_m) ||
      !std::isfinite(message.relative_residual) || !std::isfinite(message.solve_time_s) ||
      !finite(message.torque_W_Nm) || !finite(message.orientation_WT) ||
      !finite(message.rotational_stiffness_W_Nm_per_rad) || !finite(message.torque_gradient_W_N) ||
      !std::ranges::all_of(message.influences, influence_finite)) {
    return WireStatus::kNotFinite;
  }
  if (!nothing_undeclared(message)) {
    return WireStatus::kBadReserved;
  }
  if (message.echo_servo_time_ns < 0 || !within(message.position_W_m, kMaxPosition_m) ||
      !within(message.force_W_N, kMaxForce_N) ||
      !within(message.stiffness_W_N_per_m, kMaxStiffness_N_per_m) ||
      !within(message.contact_point_W_m, kMaxPosition_m) || message.relative_residual < 0.0 ||
      message.solve_time_s < 0.0 || message.solve_time_s > kMaxSolveTime_s ||
      !within(message.torque_W_Nm, kMaxTorque_Nm) || !is_unit(message.orientation_WT) ||
      !within(message.rotational_stiffness_W_Nm_per_rad, kMaxRotationalStiffness_Nm_per_rad) ||
      !within(message.torque_gradient_W_N, kMaxTorqueGradient_N) ||
      !std::ranges::all_of(message.influences, influence_usual)) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

WireStatus check(const Goodbye&) noexcept { return WireStatus::kOk; }

WireStatus check(const OtherTools& message) noexcept {
  if (message.count > OtherTools::kMost) {
    return WireStatus::kOutOfRange;
  }
  const auto told = std::span(message.tools).first(message.count);
  const auto rest = std::span(message.tools).subspan(message.count);
  if (!std::ranges::all_of(message.tools,
                           [](const OtherTool& other) { return finite(other.position_W_m); })) {
    return WireStatus::kNotFinite;
  }
  if (!std::ranges::all_of(rest, [](const OtherTool& other) {
        return other.tool == 0 && !other.in_contact && other.age_ns == 0 &&
               within(other.position_W_m, 0.0);
      })) {
    return WireStatus::kBadReserved;
  }
  // A tool of version 1 is told as number 0.
  const bool in_range = std::ranges::all_of(told, [](const OtherTool& other) {
    return other.tool <= kMaxToolId && other.age_ns >= 0 &&
           within(other.position_W_m, kMaxPosition_m);
  });
  return in_range ? WireStatus::kOk : WireStatus::kOutOfRange;
}

WireStatus check(const Refusal& message) noexcept {
  const bool known = message.reason == Refusal::Reason::kAllPlacesTaken ||
                     message.reason == Refusal::Reason::kToolTaken ||
                     message.reason == Refusal::Reason::kOtherFault;
  return known && message.most_tools > 0 && message.most_tools <= kMostTools
             ? WireStatus::kOk
             : WireStatus::kOutOfRange;
}

WireStatus check(const SurfacePatch& message) noexcept {
  if (message.vertex_count > SurfacePatch::kMaxVertices ||
      message.triangle_count > SurfacePatch::kMaxTriangles) {
    return WireStatus::kOutOfRange;
  }
  const auto all_finite = [](const auto& vector) { return finite(vector); };
  if (!finite(message.position_W_m) || !finite(message.stiffness_W_N_per_m) ||
      !std::isfinite(message.tool_radius_m) || !std::isfinite(message.tool_length_m) ||
      !std::ranges::all_of(message.press_forces_W_N, all_finite) ||
      !std::ranges::all_of(message.vertices_W_m, all_finite)) {
    return WireStatus::kNotFinite;
  }
  if (!nothing_undeclared(message)) {
    return WireStatus::kBadReserved;
  }
  const auto vertex_near = [](const auto& vertex) {
    return within(vertex, SurfacePatch::kMaxOffset_m);
  };
  const auto force_usual = [](const auto& force) { return within(force, kMaxForce_N); };
  const auto declared = [&message](const SurfacePatch::Triangle& triangle) {
    return std::ranges::all_of(triangle, [&](auto v) { return v < message.vertex_count; });
  };
  const auto triangles = std::span(message.triangles).first(message.triangle_count);
  if (message.echo_servo_time_ns < 0 || !within(message.position_W_m, kMaxPosition_m) ||
      !within(message.stiffness_W_N_per_m, kMaxStiffness_N_per_m) || message.tool_radius_m < 0.0F ||
      message.tool_radius_m > SurfacePatch::kMaxToolRadius_m || message.tool_length_m < 0.0F ||
      message.tool_length_m > SurfacePatch::kMaxToolLength_m ||
      message.tool_opening_crad > SurfacePatch::kMaxToolOpening_crad ||
      !std::ranges::all_of(message.press_forces_W_N, force_usual) ||
      !std::ranges::all_of(message.vertices_W_m, vertex_near) ||
      !std::ranges::all_of(triangles, declared)) {
    return WireStatus::kOutOfRange;
  }
  return WireStatus::kOk;
}

}  // namespace forcegrid::link
