// SPDX-License-Identifier: Apache-2.0
// The parts of libHD that need no device.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <set>
#include <thread>

#include "compat/openhaptics/arm_facts.h"
#include "compat/openhaptics/device_table.h"
#include "compat/openhaptics/error_stack.h"
#include "compat/openhaptics/frame_rule.h"
#include "compat/openhaptics/parameters.h"
#include "tests/support/program.h"

namespace forcegrid::openhaptics {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Kind = FrameRule::Kind;

TEST(ErrorStack, GivesTheNewestFirstThenSuccessForEver) {
  ErrorStack errors;
  errors.push({HD_COMM_ERROR, 1, 2});
  errors.push({HD_FRAME_ERROR, 3, 4});
  const HDErrorInfo newest = errors.pop();
  EXPECT_EQ(newest.errorCode, HD_FRAME_ERROR);
  EXPECT_EQ(newest.internalErrorCode, 3);
  EXPECT_EQ(newest.hHD, 4U);
  EXPECT_EQ(errors.pop().errorCode, HD_COMM_ERROR);
  EXPECT_EQ(errors.pop().errorCode, HD_SUCCESS);
  EXPECT_EQ(errors.pop().errorCode, HD_SUCCESS);
}

TEST(ErrorStack, DropsTheOldestOfMoreThan64) {
  ErrorStack errors;
  for (int i = 0; i < 100; ++i) {
    errors.push({HD_COMM_ERROR, i, 0});
  }
  EXPECT_EQ(errors.size(), 64U);
  for (int i = 99; i > 99 - 64; --i) {
    EXPECT_EQ(errors.pop().internalErrorCode, i);
  }
  EXPECT_EQ(errors.pop().errorCode, HD_SUCCESS);
}

TEST(ErrorStack, IsEachThreadsOwn) {
  push_error(HD_COMM_ERROR, 0);
  std::thread([] { EXPECT_EQ(errors_of_this_thread().pop().errorCode, HD_SUCCESS); }).join();
  EXPECT_EQ(errors_of_this_thread().pop().errorCode, HD_COMM_ERROR);
}

TEST(ErrorText, IsThereForEveryCode) {
  std::set<std::string> texts;
  for (HDerror code = 0; code < 0x0700; ++code) {
    const char* const text = error_text(code);
    ASSERT_NE(text, nullptr);
    texts.insert(text);
  }
  EXPECT_EQ(texts.size(), 22U + 1U);  // of the known codes, and the one for all others
}

FrameForce force_of(double x_N) { return {{x_N, 0, 0}, {}, 1}; }

TEST(FrameRule, SendsTheLastForceOfATick) {
  FrameRule rule;
  rule.frame_ended(true, true, force_of(1));
  rule.callback_returned(true);
  rule.frame_ended(true, true, force_of(2));
  rule.callback_returned(true);
  rule.frame_ended(true, false, force_of(9));  // reads only
  rule.callback_returned(true);
  const auto command = rule.tick_ended();
  EXPECT_EQ(command.kind, Kind::kForce);
  EXPECT_EQ(command.force.force_D_N[0], 2);
}

TEST(FrameRule, GivesZeroWhenARecurringCallbackEndsAFrameWithoutForce) {
  FrameRule rule;
  rule.frame_ended(true, false, force_of(3));
  rule.callback_returned(true);
  const auto command = rule.tick_ended();
  EXPECT_EQ(command.kind, Kind::kZero);
  EXPECT_EQ(command.force.force_D_N[0], 0);
  EXPECT_EQ(rule.tick_ended().kind, Kind::kHold);  // the next tick begins anew
}

TEST(FrameRule, HoldsWhereOnlyOneShotCallbacksOrOtherThreadsRead) {
  FrameRule rule;
  EXPECT_EQ(rule.tick_ended().kind, Kind::kHold);
  rule.frame_ended(true, false, force_of(0));
  rule.callback_returned(false);
  rule.frame_ended(false, false, force_of(0));
  EXPECT_EQ(rule.tick_ended().kind, Kind::kHold);
  rule.callback_returned(true);  // a callback without a frame
  EXPECT_EQ(rule.tick_ended().kind, Kind::kHold);
}

TEST(FrameRule, PrefersAForceOfAnotherThreadToAFrameWithoutOne) {
  FrameRule rule;
  rule.frame_ended(false, true, force_of(4));
  rule.frame_ended(true, false, force_of(0));
  rule.callback_returned(true);
  EXPECT_EQ(rule.tick_ended().kind, Kind::kForce);
}

// The sheet's table: name, count. What is not here is a text or is refused.
struct Known {
  HDenum name;
  int count;
};
constexpr Known kKnown[] = {
    {0x2000, 1},  {0x2001, 1},  {0x2002, 1}, {0x2010, 6},  {0x2011, 1}, {0x2012, 1},  {0x2050, 3},
    {0x2051, 3},  {0x2052, 16}, {0x2053, 3}, {0x2054, 36}, {0x2100, 3}, {0x2150, 3},  {0x2200, 1},
    {0x2201, 1},  {0x2202, 1},  {0x2210, 6}, {0x2250, 3},  {0x2251, 3}, {0x2252, 16}, {0x2253, 3},
    {0x2254, 36}, {0x2300, 3},  {0x2350, 3}, {0x2505, 1},  {0x2550, 6}, {0x2551, 6},  {0x2552, 1},
    {0x2553, 1},  {0x2554, 1},  {0x2555, 1}, {0x2600, 1},  {0x2601, 1}, {0x2602, 1},  {0x2603, 1},
    {0x2604, 1},  {0x2605, 3},  {0x2606, 1}, {0x2607, 1},  {0x2608, 1}, {0x2609, 1},  {0x2620, 1},
    {0x2621, 1},  {0x2622, 1},  {0x2623, 1}, {0x2700, 3},  {0x2701, 3}, {0x2702, 3},  {0x2703, 3},
    {0x2704, 3},  {0x2800, 3},  {0x2801, 3}, {0x2802, 3},  {0x2803, 3}, {0x2900, 1}};

TEST(Parameters, AreThoseOfTheTable) {
  EXPECT_EQ(all_parameters().size(), std::size(kKnown));
  for (const Known& known : kKnown) {
    const Parameter* const parameter = find_parameter(known.name);
    ASSERT_NE(parameter, nullptr) << std::hex << known.name;
    EXPECT_EQ(parameter->count, known.count) << std::hex << known.name;
  }
  for (const HDenum none : {0x0u, 0x2003u, 0x2750u, 0x2850u, 0x2501u, 0x4000u, 0xFFFFFFFFu}) {
    EXPECT_EQ(find_parameter(none), nullptr) << std::hex << none;
  }
}

TEST(Parameters, WriteExactlyTheirCount) {
  ArmFacts facts;
  const ArmSettings settings;
  Reading reading;
  reading.facts = &facts;
  reading.settings = &settings;
  constexpr double kGuard = -12345.0;
  for (const Parameter& parameter : all_parameters()) {
    std::array<double, kMostValues + 1> values;
    values.fill(kGuard);
    parameter.get(reading, values.data());
    for (std::size_t i = 0; i < values.size(); ++i) {
      EXPECT_EQ(values[i] == kGuard, i >= parameter.count) << std::hex << parameter.name;
    }
  }
}

// A pose by hand: turned by 0.2 rad to the right, thigh 0.3 rad from the vertical, shin 1.1 rad.
TEST(Parameters, JointAnglesPointLeftUpUpAndTorquesAreTheirs) {
  ArmFacts facts;
  facts.has_joints = true;
  facts.joint_sign = {-1, -1, 1};
  facts.joint_offset_rad = {0, 1.5707963267948966, 0};
  Reading reading;
  reading.facts = &facts;
  reading.state.joint_angle_rad = {0.2, 0.3, 1.1};
  double angles[3];
  find_parameter(HD_CURRENT_JOINT_ANGLES)->get(reading, angles);
  EXPECT_NEAR(angles[0], -0.2, 1e-12);
  EXPECT_NEAR(angles[1], 1.2707963267948966, 1e-12);
  EXPECT_NEAR(angles[2], 1.1, 1e-12);

  reading.state.jacobian_D_m_per_rad = {0, 0.1, 0.2, 0.3, 0, 0, 0, -0.05, 0.15};
  reading.force_D_N = {1, 2, 3};
  double torque_mNm[3];
  find_parameter(HD_CURRENT_JOINT_TORQUE)->get(reading, torque_mNm);
  EXPECT_NEAR(torque_mNm[0], -600, 1e-9);  // -(0.3 * 2)
  EXPECT_NEAR(torque_mNm[1], 50, 1e-9);    // -(0.1 * 1 - 0.05 * 3)
  EXPECT_NEAR(torque_mNm[2], 650, 1e-9);   // 0.2 * 1 + 0.15 * 3
  const auto force_D_N =
      force_of_joint_torque_D(facts, reading.state, {torque_mNm[0], torque_mNm[1], torque_mNm[2]});
  EXPECT_NEAR(force_D_N[0], 1, 1e-9);
  EXPECT_NEAR(force_D_N[1], 2, 1e-9);
  EXPECT_NEAR(force_D_N[2], 3, 1e-9);

  double jacobian[36];
  find_parameter(HD_CURRENT_JACOBIAN)->get(reading, jacobian);
  EXPECT_NEAR(jacobian[0], -300, 1e-9);       // dx/d[0]: D's y, to the left
  EXPECT_NEAR(jacobian[6 + 2], 150, 1e-9);    // dy/d[2]: D's z
  EXPECT_NEAR(jacobian[12 + 1], -100, 1e-9);  // dz/d[1]: D's x
}

TEST(Axes, AreRightUpAndTowardTheUser) {
  EXPECT_THAT(to_hd({1, 0, 0}), ElementsAre(0, 0, 1));  // toward the user
  EXPECT_THAT(to_hd({0, 1, 0}), ElementsAre(1, 0, 0));  // to the right
  EXPECT_THAT(to_hd({0, 0, 1}), ElementsAre(0, 1, 0));  // up
  EXPECT_THAT(to_device(to_hd({1, 2, 3})), ElementsAre(1, 2, 3));
}

std::string written(const std::string& text) {
  const std::string file = testing::fresh_folder("table") + "/openhaptics.toml";
  std::ofstream(file) << text;
  return file;
}

constexpr char kTwo[] =
    "hold_ms = 250\n"
    "[device.Right]\nurl = \"hid:path=1-2\"\nmodel = \"PHANTOM Omni\"\norigin_mm = [1, 2, 3]\n"
    "[device.\"Left Device\"]\nurl = \"emulated:phantom_desktop\"\ncalibrated = true\n";

TEST(DeviceTable, KeepsTheFilesOrder) {
  const DeviceTable table = read_device_table(written(kTwo), "");
  ASSERT_EQ(table.devices.size(), 2U);
  EXPECT_EQ(table.hold_s, 0.25);
  EXPECT_EQ(table.devices[0].name, "Right");
  EXPECT_EQ(table.devices[0].model, "PHANTOM Omni");
  EXPECT_THAT(table.devices[0].origin_mm, ElementsAre(1, 2, 3));
  EXPECT_TRUE(table.devices[1].calibrated);
  for (const char* name : {"", "Default Device", "Default PHANToM", "Default PHANTOM"}) {
    EXPECT_EQ(table.find(name), &table.devices[0]) << name;
  }
  EXPECT_EQ(table.find(nullptr), &table.devices[0]);
  EXPECT_EQ(table.find("Left Device"), &table.devices[1]);
  for (const char* name : {"Left", "left device", "Phantom2", "right"}) {
    EXPECT_EQ(table.find(name), nullptr) << name;
  }
}

TEST(DeviceTable, TheVariableNamesTheDefault) {
  const DeviceTable by_name = read_device_table(written(kTwo), "Left Device");
  EXPECT_EQ(by_name.find("")->url, "emulated:phantom_desktop");
  EXPECT_EQ(by_name.devices.size(), 2U);
  const DeviceTable by_url = read_device_table(written(kTwo), "falcon");
  EXPECT_EQ(by_url.find("")->url, "falcon");
  EXPECT_EQ(by_url.find("Right")->url, "hid:path=1-2");
  const DeviceTable chosen =
      read_device_table(written("default = \"Left Device\"\n" + std::string(kTwo)), "");
  EXPECT_EQ(chosen.find("")->name, "Left Device");
}

TEST(DeviceTable, NamesFileLineAndRemedyOfWhatIsWrong) {
  const auto complaint = [](const std::string& text) -> std::string {
    try {
      read_device_table(written(text), "");
      return "none";
    } catch (const DeviceTableError& error) {
      return error.what();
    }
  };
  EXPECT_THAT(complaint("[device.A]\nurl = 3\n"), HasSubstr("openhaptics.toml:2"));
  EXPECT_THAT(complaint("[device.A]\nurl = \"falcon\"\nmodle = \"x\"\n"), HasSubstr("model"));
  EXPECT_THAT(complaint("hold_ms = 501\n[device.A]\nurl = \"falcon\"\n"), HasSubstr("500"));
  EXPECT_THAT(complaint("default = \"B\"\n[device.A]\nurl = \"falcon\"\n"), HasSubstr("one of: A"));
  EXPECT_THAT(complaint("hold_ms = 100\n"), HasSubstr("[device.NAME]"));
  EXPECT_THAT(complaint("[device.A\n"), HasSubstr("openhaptics.toml:1"));
}

}  // namespace
}  // namespace forcegrid::openhaptics
