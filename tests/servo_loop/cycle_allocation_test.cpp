// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>

#include "forcegrid/methods.h"
#include "servo_loop/servo_loop.h"
#include "tests/servo_loop/scripted_device.h"
#include "tests/servo_loop/square_patch.h"
#include "tests/support/allocation_count.h"

namespace forcegrid::servo {
namespace {

// A square of 40 mm, 0.05 mm below the tool, through which that goes a few cycles later.
NearSurface surface_below(rt::TimePoint now, double height_m, bool slides) {
  link::SurfacePatch patch = square_patch(now.time_since_epoch().count(), 0.0, 500.0);
  patch.contact_epoch = 1;
  patch.position_W_m[2] = height_m - 0.00005;
  if (slides) {
    patch.has_stiffness = false;
    patch.stiffness_W_N_per_m = {};
    patch.has_press_forces = true;
    patch.press_forces_W_N = {{{0.05F, 0.0F, 0.5F}, {0.1F, 0.0F, 1.4F}}};
  }
  return near_surface(patch).value();
}

// The force grows and the tool goes along with it, so that the passivity guard has to act; out of
// contact it touches a surface that the loop itself has.
class CycleAllocations : public ::testing::TestWithParam<std::tuple<bool, bool>> {};

TEST_P(CycleAllocations, AreNone) {
  ServoOptions options;
  options.check_motors = false;
  const auto [with_coupling, slides] = GetParam();
  if (with_coupling) {
    options.rendering.coupling = CouplingOptions{};
  }
  ToolExchange exchange(2);  // another tool comes 2 mm behind
  options.tool_touch.exchange = &exchange;
  options.tool_touch.stiffness_N_per_m = 200.0;
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  MethodOptions grid;
  grid.grid.min_W = Eigen::Vector3d(-0.06, -0.08, -0.06);
  grid.grid.max_W = Eigen::Vector3d(0.06, 0.08, 0.06);
  grid.grid.cells.setConstant(20);
  grid.influence_radius_m = 0.02;
  const auto rendered = make_force_method("forcegrid", grid);
  const auto evaluated = make_force_method("hold", grid);
  ServoPorts ports;
  ServoLoop loop(device, profile, {rendered.get(), evaluated.get()}, ports, options);
  rt::TimePoint now(std::chrono::seconds(10));
  std::uint64_t allocations = 0;
  bool guard_acted = false;
  bool pushed_on = false;
  for (int i = 0; i < 1000; ++i) {
    now += std::chrono::milliseconds(2);
    device.show(Eigen::Vector3d(0.0, 0.0, -0.00001 * i), now);
    if (i % 16 == 0) {
      ArrivedSample arrived;
      arrived.sample.force_W = Eigen::Vector3d(0.0, 0.0, -0.001 * i);
      arrived.sample.time_s = rt::seconds(now.time_since_epoch());
      arrived.sample.contact_epoch = 1 + i / 500;
      arrived.in_contact = i % 400 > 10;
      arrived.arrived = now;
      ASSERT_TRUE(ports.samples.push(arrived));
      ports.surface.publish(surface_below(now, -0.00001 * i, slides));
    }
    if (i == 900) {
      device.state = driver::DeviceHealth::kUnplugged;  // a fault does not allocate, either
    }
    exchange.publish(1, 0,
                     {.position_W_m = {0.0, 0.0, 0.002 - 0.00001 * i},
                      .time_ns = now.time_since_epoch().count(),
                      .gain = 1.0});
    const testing::AllocationCount count;
    static_cast<void>(loop.run_cycle(now, now + std::chrono::milliseconds(2)));
    allocations += count.value();
    for (CycleRecord record; ports.records.pop(record);) {
      guard_acted = guard_acted || record.passivity_scale < 1.0;
      pushed_on = pushed_on || record.tool_force_W_N[2] < 0.0;
    }
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_TRUE(guard_acted);
  EXPECT_TRUE(pushed_on);
  const std::atomic<bool> stop{true};
  EXPECT_GT(loop.run(stop, 0.0).first_touches.touches, 0u);
}

INSTANTIATE_TEST_SUITE_P(ToolAndCoupling, CycleAllocations,
                         ::testing::Combine(::testing::Bool(), ::testing::Bool()),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param) ? "coupling" : "tool") +
                                  (std::get<1>(test.param) ? "_that_slides" : "_that_sticks");
                         });

// The same of a wrist with motors, whose torque follows the simulator's samples.
TEST(WristCycleAllocations, AreNone) {
  ServoOptions options;
  options.check_motors = false;
  options.watch_encoders = false;
  const auto profile = profiles::load_device_profile("emulated_6dof");
  ScriptedDevice device(profile);
  const auto rendered = make_force_method("hold", MethodOptions());
  ServoPorts ports;
  ServoLoop loop(device, profile, {rendered.get()}, ports, options);
  rt::TimePoint now(std::chrono::seconds(10));
  std::uint64_t allocations = 0;
  double largest_A = 0.0;
  for (int i = 0; i < 1000; ++i) {
    now += std::chrono::milliseconds(2);
    device.show(Eigen::Vector3d::Zero(), now);
    device.report.counts[4] = i == 900 ? 5000 : i / 10;  // a fault does not allocate, either
    ArrivedSample arrived;
    arrived.sample.time_s = rt::seconds(now.time_since_epoch());
    arrived.sample.force_W = Eigen::Vector3d(0.0, 0.0, 1.0);
    arrived.sample.contact_epoch = 1;
    arrived.in_contact = arrived.has_torque = true;
    arrived.torque_W_Nm = Eigen::Vector3d(0.05, -0.02, 0.03);
    arrived.arrived = now;
    ASSERT_TRUE(ports.samples.push(arrived));
    const testing::AllocationCount count;
    static_cast<void>(loop.run_cycle(now, now + std::chrono::milliseconds(2)));
    allocations += count.value();
    if (i == 900) {
      EXPECT_EQ(device.commands.back().wrist_current_A, (std::array<double, 3>{}));
    }
    for (CycleRecord record; ports.records.pop(record);) {
      largest_A = std::max(largest_A, std::abs(record.wrist_current_A[0]));
    }
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_GT(largest_A, 0.05) << "its motors had current";
}

TEST(AllocationCount, SeesWhatTheCycleIsCheckedFor) {
  const testing::AllocationCount count;
  std::string allocating(1000, 'x');
  EXPECT_EQ(allocating.size(), 1000u);
  EXPECT_GE(count.value(), 1u);
}

}  // namespace
}  // namespace forcegrid::servo
