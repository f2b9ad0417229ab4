// SPDX-License-Identifier: Apache-2.0
// libhdPhantom.so as CHAI3D loads it: both libraries by dlopen, 14 symbols by name.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "tests/compat/hd_rig.h"

namespace forcegrid::testing {
namespace {

using namespace std::chrono_literals;
using Eigen::Vector3d;

// Of the library, by the names that CHAI3D asks for.
struct Phantom {
  template <typename Function>
  static Function* symbol(const char* name) {
    static void* const hd = dlopen(FORCEGRID_COMPAT_DIR "/libHD.so", RTLD_LAZY | RTLD_GLOBAL);
    static void* const library =
        dlopen(FORCEGRID_COMPAT_DIR "/libhdPhantom.so", RTLD_LAZY | RTLD_GLOBAL);
    EXPECT_NE(hd, nullptr);
    EXPECT_NE(library, nullptr) << dlerror();
    void* const found = dlsym(library, name);
    EXPECT_NE(found, nullptr) << name;
    return reinterpret_cast<Function*>(found);
  }
  using Three = int(int, double*, double*, double*);
  using Six = int(int, double*, double*, double*, double*, double*, double*);
  using Nine = int(int, double*, double*, double*, double*, double*, double*, double*, double*,
                   double*);
  int (*count)() = symbol<int()>("hdPhantomGetNumDevices");
  int (*open)(int) = symbol<int(int)>("hdPhantomOpen");
  int (*close)(int) = symbol<int(int)>("hdPhantomClose");
  Three* position = symbol<Three>("hdPhantomGetPosition");
  Three* velocity = symbol<Three>("hdPhantomGetLinearVelocity");
  Nine* rotation = symbol<Nine>("hdPhantomGetRotation");
  int (*buttons)(int) = symbol<int(int)>("hdPhantomGetButtons");
  Three* set_force = symbol<Three>("hdPhantomSetForce");
  Three* set_torque = symbol<Three>("hdPhantomSetTorque");
  Six* set_both = symbol<Six>("hdPhantomSetForceAndTorque");
  int (*radius)(int, double*) = symbol<int(int, double*)>("hdPhantomGetWorkspaceRadius");
  int (*type)(int, char*) = symbol<int(int, char*)>("hdPhantomGetType");
  void (*start)() = symbol<void()>("hdPhantomStartServo");
  void (*stop)() = symbol<void()>("hdPhantomStopServo");
};

Vector3d in_chai3d(const Vector3d& hd) { return {hd.z(), hd.x(), hd.y()}; }

TEST(HdPhantom, N24_WithoutAnArmItStartsAtOnce) {
  const Rig rig({.arms = 0, .lines = "[device.Absent]\nurl = \"hid:/dev/hidraw999\"\n"});
  const Phantom phantom;
  const rt::TimePoint began = rt::Clock::now();
  EXPECT_EQ(phantom.count(), 0);
  EXPECT_LT(rt::Clock::now() - began, 200ms);
  std::array<char, 255> name;
  name.fill('x');
  EXPECT_EQ(phantom.type(0, name.data()), -1);
  EXPECT_STREQ(name.data(), "");
  double value = 1;
  EXPECT_EQ(phantom.radius(0, &value), -1);
  EXPECT_EQ(phantom.open(0), -1);
  EXPECT_EQ(phantom.open(-1), -1);
  EXPECT_EQ(phantom.position(0, &value, &value, &value), -1);
}

// As CHAI3D does it: what an arm is, before it is open; then its loop.
TEST(HdPhantom, N24_AnArmIsInChai3dsAxesAndTheLoopAtTheServosRate) {
  const Rig rig({.arms = 2});
  const Phantom phantom;
  ASSERT_EQ(phantom.count(), 2);
  std::array<char, 255> name{};
  double radius_m = 0;
  EXPECT_EQ(phantom.radius(0, &radius_m), 0);
  EXPECT_NEAR(radius_m, std::hypot(0.06, 0.06, 0.08), 1e-9);
  EXPECT_EQ(phantom.type(0, name.data()), 0);
  EXPECT_STREQ(name.data(), "woodenhaptics_v2015");
  EXPECT_FALSE(rig.report(0).attached);
  for (const int id : {0, 1}) {
    ASSERT_EQ(phantom.open(id), 0);
  }
  std::array<double, 9> r{};
  EXPECT_EQ(phantom.rotation(0, &r[0], &r[1], &r[2], &r[3], &r[4], &r[5], &r[6], &r[7], &r[8]), 0);
  EXPECT_EQ(r, (std::array<double, 9>{1, 0, 0, 0, 1, 0, 0, 0, 1}));
  EXPECT_EQ(phantom.buttons(0), 0);
  ASSERT_TRUE(rig.hand_is_there(0));
  ASSERT_TRUE(rig.hand_is_there(1));
  Vector3d position_m;
  Vector3d velocity_m_per_s;
  EXPECT_EQ(phantom.position(0, &position_m[0], &position_m[1], &position_m[2]), 0);
  EXPECT_LT((1000 * position_m - in_chai3d(rig.tip_mm())).norm(), 0.4);
  EXPECT_EQ(phantom.velocity(0, &velocity_m_per_s[0], &velocity_m_per_s[1], &velocity_m_per_s[2]),
            0);
  EXPECT_LT(velocity_m_per_s.norm(), 0.01);

  Vector3d force_N(0.5, -1.0, 1.5);  // toward the user, to the left, up
  Vector3d torque_Nm(0, 0, 0);
  const auto set = [&](int id) {
    return phantom.set_both(id, &force_N[0], &force_N[1], &force_N[2], &torque_Nm[0], &torque_Nm[1],
                            &torque_Nm[2]);
  };
  EXPECT_TRUE(wait_until([&] {
    EXPECT_EQ(set(0), 0);
    EXPECT_EQ(set(1), 0);
    return (in_chai3d(rig.felt_N(0)) - force_N).norm() < 0.05 &&
           (in_chai3d(rig.felt_N(1)) - force_N).norm() < 0.05;
  }));
  double not_finite = NAN;
  EXPECT_EQ(phantom.set_force(0, &force_N[0], &not_finite, &force_N[2]), -1);
  EXPECT_EQ(phantom.set_torque(0, nullptr, &torque_Nm[1], &torque_Nm[2]), -1);
  EXPECT_EQ(phantom.set_torque(0, &torque_Nm[0], &torque_Nm[1], &torque_Nm[2]), 0);
  EXPECT_EQ(phantom.set_force(0, &force_N[0], &force_N[1], &force_N[2]), 0);
  // One force a cycle of 1 ms: by the mean never faster, however late this thread is woken at
  // times; by the median, which a busy machine's late wake-ups leave where it is, not slower.
  std::vector<double> took_s;
  rt::TimePoint last = rt::Clock::now();
  const rt::TimePoint began = last;
  for (int k = 0; k < 500; ++k) {
    set(0);
    const rt::TimePoint now = rt::Clock::now();
    took_s.push_back(rt::seconds(now - last));
    last = now;
  }
  EXPECT_LT(500 / rt::seconds(last - began), 1200);
  std::nth_element(took_s.begin(), took_s.begin() + 250, took_s.end());
  EXPECT_GT(1 / took_s[250], 800);

  EXPECT_EQ(phantom.close(0), 0);
  EXPECT_TRUE(
      wait_until([&] { return rig.report(0).final_current_mA == std::array<double, 3>{}; }, 200ms));
  phantom.stop();  // not while the other arm is open
  EXPECT_TRUE(wait_until([&] {
    EXPECT_EQ(set(1), 0);
    return (in_chai3d(rig.felt_N(1)) - force_N).norm() < 0.05;
  }));
  EXPECT_EQ(set(0), -1);
  EXPECT_EQ(phantom.type(0, name.data()), 0);
  // What is not set again fades.
  EXPECT_TRUE(
      wait_until([&] { return rig.report(1).final_current_mA == std::array<double, 3>{}; }, 2s));
  EXPECT_EQ(phantom.open(0), 0);
  EXPECT_EQ(phantom.close(0), 0);
  EXPECT_EQ(phantom.close(1), 0);
  phantom.stop();
}

}  // namespace
}  // namespace forcegrid::testing
