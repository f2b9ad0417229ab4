// SPDX-License-Identifier: Apache-2.0
// Version 3 of the link, which carries orientations, buttons and torques: bytes, ranges, and who
// is served in which version.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "link/seal.h"
#include "link/servo_endpoint.h"
#include "link/simulator_endpoint.h"
#include "tests/link/changed_datagrams.h"
#include "tests/link/raw_peer.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

using namespace std::chrono_literals;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

const Bytes kState = worked::from_hex(worked::kPoseToolStateHex);
const Bytes kState2 = worked::from_hex(worked::kPoseTool2StateHex);
const Bytes kSample = worked::from_hex(worked::kPoseForceSampleHex);

void expect_same_pose(const ToolState& a, const ToolState& b) {
  EXPECT_EQ(a.has_orientation, b.has_orientation);
  EXPECT_EQ(a.has_buttons, b.has_buttons);
  EXPECT_EQ(a.orientation_WT, b.orientation_WT);
  EXPECT_EQ(a.angular_velocity_W_rad_per_s, b.angular_velocity_W_rad_per_s);
  EXPECT_EQ(a.buttons, b.buttons);
}

void expect_same_torque(const ForceSample& a, const ForceSample& b) {
  EXPECT_EQ(a.has_torque, b.has_torque);
  EXPECT_EQ(a.has_rotational_stiffness, b.has_rotational_stiffness);
  EXPECT_EQ(a.torque_W_Nm, b.torque_W_Nm);
  EXPECT_EQ(a.orientation_WT, b.orientation_WT);
  EXPECT_EQ(a.rotational_stiffness_W_Nm_per_rad, b.rotational_stiffness_W_Nm_per_rad);
}

TEST(PoseWire, WritesAndReadsTheWorkedDatagrams) {
  EXPECT_EQ(encoded(worked::pose_tool_state(), 0, Content::kPose), kState);
  EXPECT_EQ(encoded(worked::pose_tool_state(), 2, Content::kPose), kState2);
  EXPECT_EQ(encoded(worked::pose_force_sample(), 0, Content::kPose), kSample);

  const Decoded state = decode(kState2);
  ASSERT_TRUE(std::holds_alternative<ToolState>(state.message));
  EXPECT_EQ(state.tool, 2U);
  EXPECT_EQ(state.content, Content::kPose);
  expect_same_pose(std::get<ToolState>(state.message), worked::pose_tool_state());
  EXPECT_EQ(std::get<ToolState>(state.message).velocity_W_m_per_s,
            worked::tool_state().velocity_W_m_per_s);
  const Decoded sample = decode(kSample);
  ASSERT_TRUE(std::holds_alternative<ForceSample>(sample.message));
  EXPECT_EQ(sample.tool, 0U);
  expect_same_torque(std::get<ForceSample>(sample.message), worked::pose_force_sample());
  EXPECT_EQ(std::get<ForceSample>(sample.message).stiffness_W_N_per_m,
            worked::force_sample().stiffness_W_N_per_m);
}

TEST(PoseWire, OlderVersionsCarryNeitherPoseNorTorque) {
  EXPECT_EQ(encoded(worked::pose_tool_state(), 0, Content::kPosition),
            worked::from_hex(worked::kToolStateHex));
  EXPECT_EQ(encoded(worked::pose_tool_state(), 2, Content::kPosition),
            worked::from_hex(worked::kTool2StateHex));
  EXPECT_EQ(encoded(worked::pose_force_sample(), 0, Content::kPosition),
            worked::from_hex(worked::kForceSampleHex));
  const Decoded older = decode(worked::from_hex(worked::kTool2StateHex));
  EXPECT_EQ(older.content, Content::kPosition);
  expect_same_pose(std::get<ToolState>(older.message), ToolState{});
}

TEST(PoseWire, OtherMessagesDifferInTheVersionAlone) {
  for (const char* hex : {worked::kQueryHex, worked::kGoodbyeHex, worked::kSurfacePatchHex,
                          worked::kOtherToolsHex, worked::kRefusalHex}) {
    EXPECT_EQ(status_with<std::uint16_t>(worked::from_hex(hex), 4, 3), WireStatus::kOk) << hex;
  }
  EXPECT_EQ(status_with<std::uint16_t>(encoded(worked::refusal(), 2, Content::kPose), 10, 0),
            WireStatus::kBadType)
      << "of a servo without a number";
  EXPECT_EQ(status_with<std::uint16_t>(kState, 4, 1), WireStatus::kBadLength);
  EXPECT_EQ(status_with<std::uint16_t>(worked::from_hex(worked::kToolStateHex), 4, 3),
            WireStatus::kBadLength);
  EXPECT_EQ(status_with<std::uint16_t>(kState, 10, kMaxToolId), WireStatus::kOk);
  EXPECT_EQ(status_with<std::uint16_t>(kState, 10, kMaxToolId + 1), WireStatus::kOutOfRange);
}

TEST(PoseWire, AGoodbyeTellsAFaultWithAToolsNumberOnly) {
  EXPECT_TRUE(std::get<Goodbye>(decode(encoded(Goodbye{true}, 2, Content::kPose)).message).fault);
  EXPECT_FALSE(std::get<Goodbye>(decode(encoded(Goodbye{true}, 0, Content::kPose)).message).fault);
  EXPECT_EQ(status_with<std::uint32_t>(encoded(Goodbye{}, 0, Content::kPose), 12, 1),
            WireStatus::kBadReserved);
}

TEST(PoseWire, HoldsEachFieldOfAToolStateToItsRange) {
  // 0.5^2 + 0.5^2 + 0.5^2 + w^2 = 1 +- 1e-6
  EXPECT_EQ(status_with(kState, 80, std::sqrt(0.25 + 0.99e-6)), WireStatus::kOk);
  EXPECT_EQ(status_with(kState, 80, std::sqrt(0.25 - 0.99e-6)), WireStatus::kOk);
  EXPECT_EQ(status_with(kState, 80, std::sqrt(0.25 + 1.01e-6)), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with(kState, 80, std::sqrt(0.25 - 1.01e-6)), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with(kState, 80, -0.5), WireStatus::kOk) << "-q is the rotation of q";
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(status_with(kState, 80 + 8 * i, kNaN), WireStatus::kNotFinite) << i;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(status_with(kState, 112 + 8 * i, 1000.0), WireStatus::kOk);
    EXPECT_EQ(status_with(kState, 112 + 8 * i, -1000.5), WireStatus::kOutOfRange);
    EXPECT_EQ(status_with(kState, 112 + 8 * i, kNaN), WireStatus::kNotFinite);
  }
  EXPECT_EQ(status_with<std::uint32_t>(kState, 136, 0xFFFFFFFFU), WireStatus::kOk);
  EXPECT_EQ(status_with<std::uint32_t>(kState, 140, 1), WireStatus::kBadReserved) << "buttons";
  EXPECT_EQ(status_with<std::uint32_t>(kState, 140, 2), WireStatus::kBadReserved) << "orientation";
  for (unsigned bit = 2; bit < 32; ++bit) {
    EXPECT_EQ(status_with<std::uint32_t>(kState, 140, 3U | (1U << bit)), WireStatus::kBadReserved);
  }
  ToolState turning_unseen = worked::tool_state();
  turning_unseen.angular_velocity_W_rad_per_s[1] = 0.5;
  Bytes buffer(kMaxDatagramBytes);
  EXPECT_EQ(encode(turning_unseen, 1, buffer, 0, Content::kPose).status, WireStatus::kBadReserved);
}

TEST(PoseWire, HoldsEachFieldOfAForceSampleToItsRange) {
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(status_with(kSample, 208 + 8 * i, -1000.0), WireStatus::kOk);
    EXPECT_EQ(status_with(kSample, 208 + 8 * i, 1000.5), WireStatus::kOutOfRange);
    EXPECT_EQ(status_with(kSample, 208 + 8 * i, kNaN), WireStatus::kNotFinite);
  }
  EXPECT_EQ(status_with(kSample, 240, 0.51), WireStatus::kOutOfRange) << "not a unit quaternion";
  for (std::size_t i = 0; i < 9; ++i) {
    EXPECT_EQ(status_with(kSample, 264 + 8 * i, 1e7), WireStatus::kOk);
    EXPECT_EQ(status_with(kSample, 264 + 8 * i, -1.1e7), WireStatus::kOutOfRange);
  }
  EXPECT_EQ(status_with<std::uint32_t>(kSample, 44, 15), WireStatus::kBadReserved) << "stiffness";
  EXPECT_EQ(status_with<std::uint32_t>(kSample, 44, 7), WireStatus::kBadReserved) << "torque";
  EXPECT_EQ(status_with<std::uint32_t>(kSample, 44, 23), WireStatus::kBadReserved)
      << "rotational stiffness without torque";
  EXPECT_EQ(status_with<std::uint32_t>(kSample, 44, 63), WireStatus::kBadReserved);
  const Bytes without = encoded(worked::force_sample(), 0, Content::kPose);
  EXPECT_EQ(status_with(without, 232, 1.0), WireStatus::kOk);
  EXPECT_EQ(status_with(without, 232, -1.0), WireStatus::kBadReserved) << "an orientation";
}

TEST(PoseWire, RandomMessagesComeBackUnchangedAndBelow512Bytes) {
  constexpr unsigned kSeed = 20261125;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937_64 random(kSeed);
  const auto real = [&](double bound) {
    return std::uniform_real_distribution<double>(-bound, bound)(random);
  };
  const auto unit = [&] {
    std::normal_distribution<double> normal;
    Quaternion q = {normal(random), normal(random), normal(random), normal(random)};
    const double norm = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
    std::ranges::for_each(q, [norm](double& component) { component /= norm; });
    return q;
  };
  for (int i = 0; i < 1000; ++i) {
    ToolState state = worked::tool_state();
    state.has_orientation = random() % 2 == 0;
    if (state.has_orientation) {
      state.orientation_WT = unit();
      state.angular_velocity_W_rad_per_s = {real(1000.0), real(1000.0), real(1000.0)};
    }
    state.has_buttons = random() % 2 == 0;
    state.buttons = state.has_buttons ? static_cast<std::uint32_t>(random()) : 0;
    const Bytes state_bytes = encoded(state, 0, Content::kPose);
    expect_same_pose(std::get<ToolState>(decode(state_bytes).message), state);

    ForceSample sample = worked::force_sample();
    sample.has_torque = true;
    sample.torque_W_Nm = {real(1000.0), real(1000.0), real(1000.0)};
    sample.orientation_WT = unit();
    sample.has_rotational_stiffness = random() % 2 == 0;
    if (sample.has_rotational_stiffness) {
      std::ranges::generate(sample.rotational_stiffness_W_Nm_per_rad, [&] { return real(1e7); });
    }
    const Bytes sample_bytes = encoded(sample, 3, Content::kPose);
    expect_same_torque(std::get<ForceSample>(decode(sample_bytes).message), sample);
    EXPECT_LT(sample_bytes.size() + kSealOverheadBytes, 512U);
    ASSERT_FALSE(HasFailure()) << "case " << i;
  }
}

/// Both ends of a link on loopback; the servo's device has a wrist.
class PoseLink : public testing::Test {
 protected:
  static ToolState state(std::uint32_t sequence) {
    ToolState result = worked::pose_tool_state();
    result.sequence = sequence;
    return result;
  }
};

TEST_F(PoseLink, ATorqueReachesAServoThatToldItsOrientation) {
  for (const ToolId tool : {ToolId{0}, ToolId{7}}) {
    SimulatorEndpoint simulator("127.0.0.1:0", 1h);
    ServoEndpoint servo(simulator.address(), 1, {}, tool);
    EXPECT_TRUE(servo.simulator_knows_poses()) << "not shown otherwise";
    ASSERT_EQ(servo.send(state(1)), SendStatus::kSent);
    const auto news = simulator.receive(20s);
    ASSERT_TRUE(news.tool_state);
    expect_same_pose(*news.tool_state, worked::pose_tool_state());
    EXPECT_TRUE(simulator.knows_poses());
    EXPECT_EQ(simulator.tool(0), tool);
    ForceSample sample = answer_to(*news.tool_state);
    EXPECT_EQ(sample.orientation_WT, worked::pose_tool_state().orientation_WT);
    sample.has_torque = true;
    sample.torque_W_Nm = {0.25, 0.5, -0.75};
    ASSERT_EQ(simulator.send(sample), SendStatus::kSent);
    ASSERT_TRUE(servo.wait(20s));
    const auto received = servo.receive();
    ASSERT_TRUE(received);
    expect_same_torque(*received, sample);
    EXPECT_TRUE(servo.simulator_knows_poses());
    servo.say_goodbye();
    EXPECT_TRUE(simulator.receive(20s).servo_ended);
    EXPECT_FALSE(simulator.knows_poses());
  }
}

TEST_F(PoseLink, AServoWithoutAWristIsServedInItsVersionWithoutATorque) {
  SimulatorEndpoint simulator("127.0.0.1:0", 1h);
  const RawPeer servo;
  const Bytes asked = worked::from_hex(worked::kToolStateHex);
  servo.send_to(simulator.port(), asked);
  const auto news = simulator.receive(20s);
  ASSERT_TRUE(news.tool_state);
  EXPECT_FALSE(simulator.knows_poses());
  ForceSample sample = worked::pose_force_sample();
  for (int i = 0; i < 3; ++i) {  // the worked one has number 3
    ASSERT_EQ(simulator.send(sample), SendStatus::kSent);
  }
  static_cast<void>(servo.receive());
  static_cast<void>(servo.receive());
  const auto decoded = servo.receive();
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->content, Content::kPosition);
  EXPECT_EQ(encoded(std::get<ForceSample>(decoded->message), 0, decoded->content),
            worked::from_hex(worked::kForceSampleHex));
}

TEST_F(PoseLink, TheSimulatorKeepsThePoseForStatesOfAnOlderVersion) {
  SimulatorEndpoint simulator("127.0.0.1:0", 1h);
  const RawPeer servo;
  ToolState older = worked::tool_state();
  older.sequence = 8;
  servo.send_message(simulator.port(), worked::pose_tool_state(), 1, 0, Content::kPose);
  servo.send_message(simulator.port(), older, 1);
  const auto news = simulator.receive(20s);
  ASSERT_TRUE(news.tool_state);
  const auto first = simulator.next_tool_state();
  const auto second = simulator.next_tool_state();
  ASSERT_TRUE(first && second);
  EXPECT_EQ(second->sequence, 8U);
  expect_same_pose(*second, worked::pose_tool_state());
  EXPECT_TRUE(simulator.knows_poses());
  // Another session does not inherit it.
  servo.send_message(simulator.port(), older, 2);
  const auto next = simulator.receive(20s);
  ASSERT_TRUE(next.tool_state && next.new_session);
  expect_same_pose(*next.tool_state, ToolState{});
  EXPECT_FALSE(simulator.knows_poses());
}

/// Plays a simulator that knows no poses and, unless `knows_tools`, no tool numbers. Counts the
/// tool states until the servo sends it nothing but what it knows.
int states_until_understood(ServoEndpoint& servo, const RawPeer& simulator, bool knows_tools) {
  constexpr int kMost = 1000;
  std::uint32_t samples = 0;
  for (int number = 1; number <= kMost; ++number) {
    ToolState state = worked::pose_tool_state();
    state.sequence = static_cast<std::uint32_t>(number);
    EXPECT_EQ(servo.send(state), SendStatus::kSent);
    const auto asked = simulator.receive();
    if (!asked) {
      return kMost;
    }
    if (asked->content == Content::kPose || (asked->tool != 0 && !knows_tools)) {
      continue;  // which such a simulator drops
    }
    ForceSample sample = answer_to(std::get<ToolState>(asked->message));
    sample.sequence = ++samples;
    simulator.send_message(servo.local_address().port, sample, 1, asked->tool);
    EXPECT_TRUE(servo.wait(20s));
    const bool used = servo.receive().has_value();
    EXPECT_EQ(used, asked->tool == servo.tool()) << "the force on this tool alone";
    if (!servo.simulator_knows_poses() || servo.simulator_knows_one_tool()) {
      return number;
    }
  }
  return kMost;
}

TEST_F(PoseLink, ASimulatorWithoutPosesShowsItselfAndServesOn) {
  // The third try is the 192nd tool state; with a tool's number every other try names none.
  for (const auto& [tool, expected] : {std::pair{ToolId{0}, 192}, std::pair{ToolId{2}, 192}}) {
    const RawPeer simulator;
    ServoEndpoint servo(simulator.address(), 1, {}, tool);
    EXPECT_EQ(states_until_understood(servo, simulator, true), expected);
    EXPECT_FALSE(servo.simulator_knows_one_tool());
    ToolState next = worked::pose_tool_state();
    for (std::uint32_t number = 1001; number < 1200; ++number) {
      next.sequence = number;
      ASSERT_EQ(servo.send(next), SendStatus::kSent);
      const auto asked = simulator.receive();
      ASSERT_TRUE(asked);
      EXPECT_EQ(asked->content, Content::kPosition);
      EXPECT_EQ(asked->tool, tool);
    }
    ASSERT_EQ(servo.send(worked::query()), SendStatus::kSent);
    EXPECT_EQ(simulator.receive()->content, Content::kPosition);
    servo.say_goodbye();
    EXPECT_EQ(simulator.receive()->content, Content::kPosition);
  }
}

TEST_F(PoseLink, ASimulatorOfVersion1ShowsItselfToAServoWithAToolsNumber) {
  const RawPeer simulator;
  ServoEndpoint servo(simulator.address(), 1, {}, 2);
  EXPECT_EQ(states_until_understood(servo, simulator, false), 6 * 64);
  EXPECT_TRUE(servo.simulator_knows_one_tool());
}

TEST_F(PoseLink, APoseThatComesLaterRaisesTheVersion) {
  SimulatorEndpoint simulator("127.0.0.1:0", 1h);
  ServoEndpoint servo(simulator.address(), 1);
  ToolState plain = worked::tool_state();
  ASSERT_EQ(servo.send(plain), SendStatus::kSent);
  ASSERT_TRUE(simulator.receive(20s).tool_state);
  EXPECT_FALSE(simulator.knows_poses());
  ToolState pressed = worked::tool_state();
  pressed.sequence = 8;
  pressed.has_buttons = true;
  pressed.buttons = 2;
  ASSERT_EQ(servo.send(pressed), SendStatus::kSent);
  const auto news = simulator.receive(20s);
  ASSERT_TRUE(news.tool_state);
  EXPECT_EQ(news.tool_state->buttons, 2U);
  EXPECT_FALSE(news.tool_state->has_orientation);
  EXPECT_FALSE(news.new_session);
}

TEST_F(PoseLink, AnAnswerInAVersionThatWasNotAskedForIsDropped) {
  const RawPeer simulator;
  ServoEndpoint servo(simulator.address(), 1);
  ASSERT_EQ(servo.send(worked::tool_state()), SendStatus::kSent);
  ASSERT_TRUE(simulator.receive());
  simulator.send_message(servo.local_address().port, worked::pose_force_sample(), 1, 0,
                         Content::kPose);
  ASSERT_TRUE(servo.wait(20s));
  EXPECT_FALSE(servo.receive());
  EXPECT_EQ(servo.statistics().malformed[static_cast<std::size_t>(WireStatus::kBadVersion)], 1U);
  EXPECT_EQ(servo.statistics().received,
            servo.statistics().accepted + servo.statistics().dropped());
}

}  // namespace
}  // namespace forcegrid::link
