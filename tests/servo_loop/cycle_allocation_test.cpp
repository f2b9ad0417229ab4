// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>

#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "servo_loop/pair_half.h"
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

// Of a method over two tools; the other half is called beside the loop, with its own samples.
TEST(PairCycleAllocations, AreNone) {
  for (const std::string& name : pair_method_names()) {
    ServoOptions options;
    options.check_motors = false;
    options.watch_encoders = false;
    const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
    ScriptedDevice device(profile);
    PairExchange exchange;
    const auto half_of = [&](std::size_t tool) {
      return PairHalf(make_pair_force_method(name, {}), make_force_method("auto", {}), exchange,
                      tool);
    };
    PairHalf half = half_of(0);
    PairHalf other = half_of(1);
    ServoPorts ports;
    ServoLoop loop(device, profile, {&half}, ports, options);
    rt::TimePoint now(std::chrono::seconds(10));
    std::uint64_t allocations = 0;
    std::uint64_t over_both = 0;
    for (int i = 0; i < 1000; ++i) {
      now += std::chrono::milliseconds(2);
      const Eigen::Vector3d at_W(0.0, 0.01 * std::sin(0.02 * i), -0.01 * std::sin(0.03 * i));
      const Eigen::Vector3d other_W(0.005 * std::sin(0.01 * i), 0.05, 0.0);
      device.show(at_W, now);
      Sample of_other;
      if (i % 16 == 0) {
        const int contact = i / 400;
        ArrivedSample arrived;
        arrived.sample.time_s = of_other.time_s = servo_time_s(now);
        arrived.sample.position_W = at_W;
        arrived.sample.force_W = -200.0 * at_W - 100.0 * (at_W - other_W);
        arrived.sample.contact_epoch = of_other.contact_epoch =
            static_cast<std::uint32_t>(1 + contact);
        arrived.sample.solution = of_other.solution = static_cast<std::uint64_t>(1 + i);
        arrived.in_contact = true;
        arrived.arrived = now;
        of_other.position_W = other_W;
        of_other.force_W = -200.0 * other_W - 100.0 * (other_W - at_W);
        ASSERT_TRUE(ports.samples.push(arrived));
      }
      const testing::AllocationCount count;
      if (i % 400 == 0) {
        other.contact_made(of_other.contact_epoch, other_W);
      }
      if (of_other.solution != 0) {
        other.take_sample(of_other);
      }
      if (i % 300 < 250) {  // late now and then
        other.observe(servo_time_s(now), other_W);
        static_cast<void>(other.force(servo_time_s(now), other_W));
        other.work(1000);
      }
      static_cast<void>(loop.run_cycle(now, now + std::chrono::milliseconds(2)));
      allocations += count.value();
      for (CycleRecord record; ports.records.pop(record);) {
        over_both += record.rendered_candidate == PairHalf::kBoth ? 1 : 0;
      }
    }
    EXPECT_EQ(allocations, 0U) << name;
    EXPECT_GT(over_both, 400U) << name;
  }
}

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

// The pushes of all six motors, answered as springs answer them; and with a motor that turns the
// wrong way.
TEST(MotorCheckAllocations, AreNone) {
  constexpr double kArm_counts_per_A = 20.0;
  constexpr double kWrist_counts_per_A = 50.0;
  const auto profile = profiles::load_device_profile("emulated_6dof");
  for (const double sign_of_last : {1.0, -1.0}) {
    ServoOptions options;
    options.watch_encoders = false;
    ScriptedDevice device(profile);
    const auto rendered = make_force_method("hold", MethodOptions());
    ServoPorts ports;
    ServoLoop loop(device, profile, {rendered.get()}, ports, options);
    rt::TimePoint now(std::chrono::seconds(10));
    std::uint64_t allocations = 0;
    Fault fault = Fault::kNone;
    HeldBack held_back = HeldBack::kMotorCheck;
    for (int i = 0; i < 1000 && fault == Fault::kNone && held_back != HeldBack::kNot; ++i) {
      now += std::chrono::milliseconds(2);
      device.show(Eigen::Vector3d::Zero(), now);
      if (!device.commands.empty()) {
        const driver::MotorCommand& last = device.commands.back();
        for (std::size_t joint = 0; joint < 3; ++joint) {
          const double sign = joint == 2 ? sign_of_last : 1.0;
          device.report.counts[joint] +=
              static_cast<std::int32_t>(std::lround(kArm_counts_per_A * last.current_A[joint]));
          device.report.counts[3 + joint] = static_cast<std::int32_t>(
              std::lround(sign * kWrist_counts_per_A * last.wrist_current_A[joint]));
        }
      }
      ArrivedSample arrived;
      arrived.sample.time_s = rt::seconds(now.time_since_epoch());
      arrived.sample.contact_epoch = 1;
      arrived.in_contact = true;
      arrived.arrived = now;
      ASSERT_TRUE(ports.samples.push(arrived));
      const testing::AllocationCount count;
      fault = loop.run_cycle(now, now + std::chrono::milliseconds(2));
      allocations += count.value();
      for (CycleRecord record; ports.records.pop(record);) {
        held_back = record.held_back;
      }
    }
    EXPECT_EQ(allocations, 0u);
    EXPECT_EQ(fault, sign_of_last > 0.0 ? Fault::kNone : Fault::kMotorWrongWay) << name_of(fault);
    EXPECT_EQ(held_back == HeldBack::kNot, sign_of_last > 0.0) << "the check has come to its end";
    EXPECT_EQ(device.commands.back().wrist_current_A, (std::array<double, 3>{}));
  }
}

TEST(AllocationCount, SeesWhatTheCycleIsCheckedFor) {
  const testing::AllocationCount count;
  std::string allocating(1000, 'x');
  EXPECT_EQ(allocating.size(), 1000u);
  EXPECT_GE(count.value(), 1u);
}

}  // namespace
}  // namespace forcegrid::servo
