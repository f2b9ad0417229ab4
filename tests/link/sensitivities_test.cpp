// SPDX-License-Identifier: Apache-2.0
// Version 4 of the link, which carries how force and torque change with position and with other
// tools: bytes, ranges, and who is served in which version.
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <limits>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

#include "link/seal.h"
#include "link/servo_endpoint.h"
#include "link/simulator_endpoint.h"
#include "tests/link/raw_peer.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

using namespace std::chrono_literals;
using Bytes = std::vector<std::byte>;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kFlagsAt = 44;
constexpr std::size_t kGradientAt = 336;
constexpr std::size_t kCountAt = 408;
constexpr std::size_t kFirstAt = 412;
constexpr std::size_t kEntryBytes = 104;

const Bytes kSample = worked::from_hex(worked::kSensitivitiesForceSampleHex);

template <typename Message>
Bytes encoded(const Message& message, ToolId tool, Content content) {
  Bytes buffer(kMaxDatagramBytes);
  const Encoded result = encode(message, worked::kSession, buffer, tool, content);
  EXPECT_EQ(result.status, WireStatus::kOk) << to_string(result.status);
  buffer.resize(result.size_bytes);
  return buffer;
}

template <typename T>
WireStatus status_with(Bytes datagram, std::size_t offset, T value) {
  const auto bytes = std::bit_cast<std::array<std::byte, sizeof(T)>>(value);
  std::copy(bytes.begin(), bytes.end(), datagram.begin() + static_cast<std::ptrdiff_t>(offset));
  const auto crc =
      static_cast<std::uint32_t>(::crc32(0, reinterpret_cast<const Bytef*>(datagram.data()),
                                         static_cast<uInt>(datagram.size() - kChecksumBytes)));
  const auto checksum = std::bit_cast<std::array<std::byte, kChecksumBytes>>(crc);
  std::copy(checksum.begin(), checksum.end(), datagram.end() - kChecksumBytes);
  return decode(datagram).status;
}

void expect_same_sensitivities(const ForceSample& a, const ForceSample& b) {
  EXPECT_EQ(a.has_torque_gradient, b.has_torque_gradient);
  EXPECT_EQ(a.torque_gradient_W_N, b.torque_gradient_W_N);
  EXPECT_EQ(a.influence_count, b.influence_count);
  for (std::size_t i = 0; i < a.influences.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(a.influences[i].tool, b.influences[i].tool);
    EXPECT_EQ(a.influences[i].echo_sequence, b.influences[i].echo_sequence);
    EXPECT_EQ(a.influences[i].position_W_m, b.influences[i].position_W_m);
    EXPECT_EQ(a.influences[i].stiffness_W_N_per_m, b.influences[i].stiffness_W_N_per_m);
  }
}

TEST(SensitivitiesWire, WritesAndReadsTheWorkedSample) {
  const ForceSample sample = worked::sensitivities_force_sample();
  EXPECT_EQ(encoded(sample, 2, Content::kSensitivities), kSample);
  const Decoded decoded = decode(kSample);
  ASSERT_TRUE(std::holds_alternative<ForceSample>(decoded.message));
  EXPECT_EQ(decoded.tool, 2U);
  EXPECT_EQ(decoded.content, Content::kSensitivities);
  const auto& read = std::get<ForceSample>(decoded.message);
  expect_same_sensitivities(read, sample);
  EXPECT_EQ(read.torque_W_Nm, sample.torque_W_Nm);
  EXPECT_EQ(read.rotational_stiffness_W_Nm_per_rad, sample.rotational_stiffness_W_Nm_per_rad);
  EXPECT_EQ(read.stiffness_W_N_per_m, sample.stiffness_W_N_per_m);
}

TEST(SensitivitiesWire, OlderVersionsCarryNone) {
  const ForceSample sample = worked::sensitivities_force_sample();
  EXPECT_EQ(encoded(sample, 0, Content::kPose), worked::from_hex(worked::kPoseForceSampleHex));
  EXPECT_EQ(encoded(sample, 0, Content::kPosition), worked::from_hex(worked::kForceSampleHex));
}

TEST(SensitivitiesWire, OtherMessagesAreThoseOfVersion3ButForTheNumber) {
  for (const char* hex : {worked::kPoseToolStateHex, worked::kPoseTool2StateHex, worked::kQueryHex,
                          worked::kGoodbyeHex, worked::kSurfacePatchHex, worked::kOtherToolsHex,
                          worked::kRefusalHex}) {
    EXPECT_EQ(status_with<std::uint16_t>(worked::from_hex(hex), 4, 4), WireStatus::kOk) << hex;
  }
  EXPECT_EQ(status_with<std::uint16_t>(worked::from_hex(worked::kToolStateHex), 4, 4),
            WireStatus::kBadLength);
  EXPECT_EQ(status_with<std::uint16_t>(worked::from_hex(worked::kPoseForceSampleHex), 4, 4),
            WireStatus::kBadLength);
  EXPECT_EQ(status_with<std::uint16_t>(kSample, 4, 3), WireStatus::kBadLength);
  EXPECT_EQ(status_with<std::uint16_t>(kSample, 4, 5), WireStatus::kBadVersion);
  EXPECT_EQ(status_with<std::uint16_t>(kSample, 10, 0), WireStatus::kOk) << "of the only tool";
  EXPECT_EQ(status_with<std::uint16_t>(kSample, 10, kMaxToolId + 1), WireStatus::kOutOfRange);
}

TEST(SensitivitiesWire, HoldsEachFieldToItsRange) {
  for (std::size_t i = 0; i < 9; ++i) {
    for (const std::size_t at : {kGradientAt + 8 * i, kFirstAt + 32 + 8 * i}) {
      EXPECT_EQ(status_with(kSample, at, -1e7), WireStatus::kOk) << at;
      EXPECT_EQ(status_with(kSample, at, 1.1e7), WireStatus::kOutOfRange) << at;
      EXPECT_EQ(status_with(kSample, at, kNaN), WireStatus::kNotFinite) << at;
    }
  }
  EXPECT_EQ(status_with<std::uint32_t>(kSample, kFlagsAt, 31), WireStatus::kBadReserved)
      << "a gradient";
  EXPECT_EQ(status_with<std::uint32_t>(kSample, kFlagsAt, 127), WireStatus::kBadReserved);
  const Bytes without_torque = encoded(worked::force_sample(), 2, Content::kSensitivities);
  EXPECT_EQ(status_with<std::uint32_t>(without_torque, kFlagsAt, 7 + 32), WireStatus::kBadReserved)
      << "a gradient of no torque";

  EXPECT_EQ(status_with<std::uint32_t>(kSample, kCountAt, 0), WireStatus::kBadReserved);
  EXPECT_EQ(status_with<std::uint32_t>(kSample, kCountAt, 3), WireStatus::kOk);
  EXPECT_EQ(status_with<std::uint32_t>(kSample, kCountAt, 4), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint32_t>(kSample, kCountAt, 0xFFFFFFFFU), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint16_t>(kSample, kFirstAt, 0), WireStatus::kOk) << "of version 1";
  EXPECT_EQ(status_with<std::uint16_t>(kSample, kFirstAt, kMaxToolId + 1), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with<std::uint16_t>(kSample, kFirstAt + 2, 1), WireStatus::kBadReserved);
  EXPECT_EQ(status_with(kSample, kFirstAt + 8, 10.5), WireStatus::kOutOfRange);
  EXPECT_EQ(status_with(kSample, kFirstAt + 8, kNaN), WireStatus::kNotFinite);
  // Beyond the count all is zero.
  const std::size_t second = kFirstAt + kEntryBytes;
  EXPECT_EQ(status_with<std::uint16_t>(kSample, second, 1), WireStatus::kBadReserved);
  EXPECT_EQ(status_with<std::uint32_t>(kSample, second + 4, 1), WireStatus::kBadReserved);
  EXPECT_EQ(status_with(kSample, second + 8, 1.0), WireStatus::kBadReserved);
  EXPECT_EQ(status_with(kSample, second + 2 * kEntryBytes - 8, 1.0), WireStatus::kBadReserved)
      << "the last number";
}

TEST(SensitivitiesWire, RandomSamplesComeBackUnchangedAndFitADatagram) {
  constexpr unsigned kSeed = 20261126;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937_64 random(kSeed);
  const auto real = [&](double bound) {
    return std::uniform_real_distribution<double>(-bound, bound)(random);
  };
  for (int i = 0; i < 1000; ++i) {
    ForceSample sample = worked::pose_force_sample();
    sample.has_torque_gradient = random() % 2 == 0;
    if (sample.has_torque_gradient) {
      std::ranges::generate(sample.torque_gradient_W_N, [&] { return real(1e7); });
    }
    sample.influence_count = static_cast<std::uint32_t>(random() % 4);
    for (std::size_t k = 0; k < sample.influence_count; ++k) {
      ToolInfluence& other = sample.influences[k];
      other.tool = static_cast<ToolId>(random() % (kMaxToolId + 1));
      other.echo_sequence = static_cast<std::uint32_t>(random());
      other.position_W_m = {real(10.0), real(10.0), real(10.0)};
      std::ranges::generate(other.stiffness_W_N_per_m, [&] { return real(1e7); });
    }
    const Bytes bytes = encoded(sample, static_cast<ToolId>(i % 3), Content::kSensitivities);
    expect_same_sensitivities(std::get<ForceSample>(decode(bytes).message), sample);
    EXPECT_EQ(bytes.size(), 728U);
    EXPECT_LE(bytes.size() + kSealOverheadBytes, kMaxDatagramBytes);
    ASSERT_FALSE(HasFailure()) << "case " << i;
  }
}

ToolState state_with(std::uint32_t sequence, bool pose) {
  ToolState state = pose ? worked::pose_tool_state() : worked::tool_state();
  state.sequence = sequence;
  return state;
}

TEST(SensitivitiesLink, ReachAServoThatAsksForThem) {
  for (const auto& [tool, pose] :
       {std::pair{ToolId{0}, true}, std::pair{ToolId{7}, true}, std::pair{ToolId{7}, false}}) {
    SCOPED_TRACE(testing::Message() << "tool " << tool << ", pose " << pose);
    SimulatorEndpoint simulator("127.0.0.1:0", 1h);
    ServoEndpoint servo(simulator.address(), 1, {}, tool, Content::kSensitivities);
    EXPECT_TRUE(servo.simulator_knows_sensitivities()) << "not shown otherwise";
    ASSERT_EQ(servo.send(state_with(1, pose)), SendStatus::kSent);
    const auto news = simulator.receive(20s);
    ASSERT_TRUE(news.tool_state);
    EXPECT_EQ(news.tool_state->has_orientation, pose);
    EXPECT_TRUE(simulator.knows_sensitivities());
    EXPECT_TRUE(simulator.knows_poses());
    ForceSample sample = worked::sensitivities_force_sample();
    sample.echo_sequence = 1;
    ASSERT_EQ(simulator.send(sample), SendStatus::kSent);
    ASSERT_TRUE(servo.wait(20s));
    const auto received = servo.receive();
    ASSERT_TRUE(received);
    expect_same_sensitivities(*received, sample);
    EXPECT_TRUE(servo.simulator_knows_sensitivities());
    // Answered, it tries no older version.
    for (std::uint32_t number = 2; number < 200; ++number) {
      ASSERT_EQ(servo.send(state_with(number, pose)), SendStatus::kSent);
    }
    servo.say_goodbye();
    EXPECT_TRUE(simulator.receive(20s).servo_ended);
    EXPECT_FALSE(simulator.knows_sensitivities());
  }
}

TEST(SensitivitiesLink, AServoThatDoesNotAskIsServedAsBefore) {
  // Version 3 with an orientation, version 2 with a number; neither gets more.
  for (const auto& [tool, pose, content] : {std::tuple{ToolId{0}, true, Content::kPose},
                                            std::tuple{ToolId{7}, false, Content::kPosition}}) {
    SimulatorEndpoint simulator("127.0.0.1:0", 1h);
    const RawPeer servo;
    servo.send_message(simulator.port(), state_with(7, pose), worked::kSession, tool, content);
    ASSERT_TRUE(simulator.receive(20s).tool_state);
    EXPECT_FALSE(simulator.knows_sensitivities());
    ASSERT_EQ(simulator.send(worked::sensitivities_force_sample()), SendStatus::kSent);
    const auto decoded = servo.receive();
    ASSERT_TRUE(decoded);
    EXPECT_EQ(decoded->content, content);
    expect_same_sensitivities(std::get<ForceSample>(decoded->message), ForceSample{});
  }
}

TEST(SensitivitiesLink, TheOnlyToolWithoutAnOrientationSpeaksVersion1AsBefore) {
  const RawPeer simulator;
  ServoEndpoint servo(simulator.address(), worked::kSession, {}, 0, Content::kSensitivities);
  for (std::uint32_t number = 1; number <= 130; ++number) {
    ASSERT_EQ(servo.send(state_with(number, false)), SendStatus::kSent);
    EXPECT_EQ(simulator.receive()->content, Content::kPosition);
  }
  EXPECT_TRUE(servo.simulator_knows_sensitivities()) << "it has none to send";
}

/// What a simulator knows; it answers in the newest version that it has been asked in.
struct Known {
  Content newest = Content::kPosition;
  bool tools = false;
};

/// Plays it for 1000 tool states. @returns how often the servo asked in each version that it
/// does not know after it had been answered three times.
int states_in_vain(ServoEndpoint& servo, const RawPeer& simulator, const Known& known, bool pose) {
  std::uint32_t answers = 0;
  int in_vain = 0;
  Content spoken = Content::kPosition;
  for (std::uint32_t number = 1; number <= 1000; ++number) {
    EXPECT_EQ(servo.send(state_with(number, pose)), SendStatus::kSent);
    const auto asked = simulator.receive();
    if (!asked || asked->content > known.newest || (asked->tool != 0 && !known.tools)) {
      in_vain += answers >= 3 ? 1 : 0;
      continue;
    }
    spoken = std::max(spoken, asked->content);
    ForceSample sample = answer_to(std::get<ToolState>(asked->message));
    sample.sequence = ++answers;
    simulator.send_message(servo.local_address().port, sample, 1, servo.tool(), spoken);
    EXPECT_TRUE(servo.wait(20s));
    EXPECT_TRUE(servo.receive());
  }
  return in_vain;
}

TEST(SensitivitiesLink, AnOlderSimulatorShowsItselfAndServesOnInItsOwnVersion) {
  for (const auto& [tool, pose, known] :
       {std::tuple{ToolId{0}, true, Known{Content::kPose, false}},
        std::tuple{ToolId{0}, true, Known{Content::kPosition, false}},
        std::tuple{ToolId{2}, true, Known{Content::kPose, true}},
        std::tuple{ToolId{2}, true, Known{Content::kPosition, true}},
        std::tuple{ToolId{2}, false, Known{Content::kPosition, true}}}) {
    SCOPED_TRACE(testing::Message() << "tool " << tool << ", pose " << pose << ", knows "
                                    << static_cast<int>(known.newest));
    const RawPeer simulator;
    ServoEndpoint servo(simulator.address(), 1, {}, tool, Content::kSensitivities);
    EXPECT_EQ(states_in_vain(servo, simulator, known, pose), 0);
    EXPECT_FALSE(servo.simulator_knows_sensitivities());
    EXPECT_EQ(servo.simulator_knows_poses(), !pose || known.newest == Content::kPose);
    EXPECT_FALSE(servo.simulator_knows_one_tool());
    ASSERT_EQ(servo.send(worked::query()), SendStatus::kSent);
    const auto query = simulator.receive();
    ASSERT_TRUE(query);
    EXPECT_EQ(query->content, pose ? known.newest : Content::kPosition);
    EXPECT_EQ(query->tool, tool);
  }
}

TEST(SensitivitiesLink, ASimulatorOfVersion1ShowsItselfToAServoWithAToolsNumber) {
  const RawPeer simulator;
  ServoEndpoint servo(simulator.address(), 1, {}, 2, Content::kSensitivities);
  std::uint32_t answers = 0;
  for (std::uint32_t number = 1; number <= 1000 && !servo.simulator_knows_one_tool(); ++number) {
    ASSERT_EQ(servo.send(state_with(number, true)), SendStatus::kSent);
    const auto asked = simulator.receive();
    ASSERT_TRUE(asked);
    if (asked->content != Content::kPosition || asked->tool != 0) {
      continue;
    }
    ForceSample sample = answer_to(std::get<ToolState>(asked->message));
    sample.sequence = ++answers;
    simulator.send_message(servo.local_address().port, sample, 1);
    ASSERT_TRUE(servo.wait(20s));
    EXPECT_FALSE(servo.receive()) << "the force on this tool alone";
  }
  EXPECT_EQ(answers, 3U) << "every third of its tries names no tool";
  EXPECT_TRUE(servo.simulator_knows_one_tool());
}

TEST(SensitivitiesLink, AnAnswerInVersion3IsNotOneToAServoThatToldNoPose) {
  const RawPeer simulator;
  ServoEndpoint servo(simulator.address(), worked::kSession, {}, 2, Content::kSensitivities);
  ASSERT_EQ(servo.send(worked::tool_state()), SendStatus::kSent);
  ASSERT_EQ(simulator.receive()->content, Content::kSensitivities);
  simulator.send_message(servo.local_address().port, worked::force_sample(), worked::kSession, 2,
                         Content::kPose);
  ASSERT_TRUE(servo.wait(20s));
  EXPECT_FALSE(servo.receive());
  EXPECT_EQ(servo.statistics().malformed[static_cast<std::size_t>(WireStatus::kBadVersion)], 1U);
  EXPECT_EQ(servo.statistics().received,
            servo.statistics().accepted + servo.statistics().dropped());
}

}  // namespace
}  // namespace forcegrid::link
