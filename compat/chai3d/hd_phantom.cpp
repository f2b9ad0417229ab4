// SPDX-License-Identifier: Apache-2.0
// The 14 functions by which CHAI3D and AMBF use PHANTOM arms. They return 0, or -1 for an arm that
// is not there; none lets an exception out. CHAI3D's axes and SI units throughout.
#include <cmath>
#include <cstring>
#include <exception>
#include <optional>

#include "compat/chai3d/phantom_arms.h"

namespace {

using forcegrid::chai3d::PhantomArms;
using forcegrid::chai3d::PhantomState;
using forcegrid::chai3d::Vector;

constexpr int kDone = 0;
constexpr int kFailed = -1;
constexpr std::size_t kLongestName = 254;  // programs have room for 255 bytes

template <typename Call>
int guarded(const Call& call) noexcept {
  try {
    return call(PhantomArms::instance()) ? kDone : kFailed;
  } catch (const std::exception&) {
    return kFailed;
  }
}

int read(int id, const Vector PhantomState::*member, double* x, double* y, double* z) noexcept {
  return guarded([&](PhantomArms& arms) {
    PhantomState state;
    if (x == nullptr || y == nullptr || z == nullptr || !arms.state(id, state)) {
      return false;
    }
    const Vector& vector = state.*member;
    *x = vector[0];
    *y = vector[1];
    *z = vector[2];
    return true;
  });
}

// Nothing for a null pointer, a NaN or an infinity: what is set stays.
std::optional<Vector> finite(const double* x, const double* y, const double* z) noexcept {
  if (x == nullptr || y == nullptr || z == nullptr || !std::isfinite(*x) || !std::isfinite(*y) ||
      !std::isfinite(*z)) {
    return std::nullopt;
  }
  return Vector{*x, *y, *z};
}

}  // namespace

#pragma GCC visibility push(default)
// NOLINTBEGIN(readability-identifier-naming): the names are those of the interface.
extern "C" {

int hdPhantomGetNumDevices(void) {
  try {
    return PhantomArms::instance().count();
  } catch (const std::exception&) {
    return 0;
  }
}

int hdPhantomOpen(int id) {
  return guarded([&](PhantomArms& arms) { return arms.open(id); });
}

int hdPhantomClose(int id) {
  return guarded([&](PhantomArms& arms) { return arms.close(id); });
}

int hdPhantomGetPosition(int id, double* x, double* y, double* z) {
  return read(id, &PhantomState::position_m, x, y, z);
}

int hdPhantomGetLinearVelocity(int id, double* x, double* y, double* z) {
  return read(id, &PhantomState::velocity_m_per_s, x, y, z);
}

int hdPhantomGetRotation(int id, double* r00, double* r01, double* r02, double* r10, double* r11,
                         double* r12, double* r20, double* r21, double* r22) {
  return guarded([&](PhantomArms& arms) {
    PhantomState state;
    if (!arms.state(id, state)) {
      return false;
    }
    double* const elements[] = {r00, r01, r02, r10, r11, r12, r20, r21, r22};
    for (std::size_t i = 0; i < 9; ++i) {
      if (elements[i] != nullptr) {
        *elements[i] = state.rotation[i];
      }
    }
    return true;
  });
}

int hdPhantomGetButtons(int id) {
  PhantomState state;
  const int done = guarded([&](PhantomArms& arms) { return arms.state(id, state); });
  return done == kDone ? state.buttons : kFailed;
}

int hdPhantomSetForceAndTorque(int id, double* fx, double* fy, double* fz, double* tx, double* ty,
                               double* tz) {
  return guarded([&](PhantomArms& arms) {
    const auto force_N = finite(fx, fy, fz);
    const auto torque_Nm = finite(tx, ty, tz);
    return force_N && torque_Nm && arms.set(id, &*force_N, &*torque_Nm);
  });
}

int hdPhantomSetForce(int id, double* x, double* y, double* z) {
  return guarded([&](PhantomArms& arms) {
    const auto force_N = finite(x, y, z);
    return force_N && arms.set(id, &*force_N, nullptr);
  });
}

int hdPhantomSetTorque(int id, double* x, double* y, double* z) {
  return guarded([&](PhantomArms& arms) {
    const auto torque_Nm = finite(x, y, z);
    return torque_Nm && arms.set(id, nullptr, &*torque_Nm);
  });
}

int hdPhantomGetWorkspaceRadius(int id, double* radius) {
  return guarded([&](PhantomArms& arms) { return radius != nullptr && arms.radius(id, *radius); });
}

int hdPhantomGetType(int id, char* name) {
  return guarded([&](PhantomArms& arms) {
    if (name == nullptr) {
      return false;
    }
    *name = '\0';
    const std::string type = arms.type(id).substr(0, kLongestName);
    std::memcpy(name, type.c_str(), type.size() + 1);
    return !type.empty();
  });
}

void hdPhantomStartServo(void) {
  guarded([](PhantomArms& arms) {
    arms.start_servo();
    return true;
  });
}

void hdPhantomStopServo(void) {
  guarded([](PhantomArms& arms) {
    arms.stop_servo();
    return true;
  });
}

}  // extern "C"
// NOLINTEND(readability-identifier-naming)
#pragma GCC visibility pop
