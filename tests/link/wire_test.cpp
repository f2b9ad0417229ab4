// SPDX-License-Identifier: Apache-2.0
#include "link/wire.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <random>
#include <set>

#include "link/seal.h"
#include "tests/link/changed_datagrams.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

constexpr std::uint32_t kSeed = 20150814;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

const Bytes kToolState = worked::from_hex(worked::kToolStateHex);
const Bytes kQuery = worked::from_hex(worked::kQueryHex);
const Bytes kForceSample = worked::from_hex(worked::kForceSampleHex);
const Bytes kGoodbye = worked::from_hex(worked::kGoodbyeHex);
const Bytes kSurfacePatch = worked::from_hex(worked::kSurfacePatchHex);
const Bytes kSlidingPatch = worked::from_hex(worked::kSlidingPatchHex);
const std::array<Bytes, 6> kEveryType = {kToolState, kQuery,        kForceSample,
                                         kGoodbye,   kSurfacePatch, kSlidingPatch};

void expect_equal(const ToolState& a, const ToolState& b) {
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.servo_time_ns, b.servo_time_ns);
  EXPECT_EQ(a.position_W_m, b.position_W_m);
  EXPECT_EQ(a.velocity_W_m_per_s, b.velocity_W_m_per_s);
}

void expect_equal(const Query& a, const Query& b) {
  EXPECT_EQ(a.query_id, b.query_id);
  EXPECT_EQ(a.servo_time_ns, b.servo_time_ns);
  EXPECT_EQ(a.position_W_m, b.position_W_m);
}

void expect_equal(const ForceSample& a, const ForceSample& b) {
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.echo_sequence, b.echo_sequence);
  EXPECT_EQ(a.echo_servo_time_ns, b.echo_servo_time_ns);
  EXPECT_EQ(a.query_id, b.query_id);
  EXPECT_EQ(a.contact_epoch, b.contact_epoch);
  EXPECT_EQ(a.in_contact, b.in_contact);
  EXPECT_EQ(a.converged, b.converged);
  EXPECT_EQ(a.has_stiffness, b.has_stiffness);
  EXPECT_EQ(a.position_W_m, b.position_W_m);
  EXPECT_EQ(a.force_W_N, b.force_W_N);
  EXPECT_EQ(a.stiffness_W_N_per_m, b.stiffness_W_N_per_m);
  EXPECT_EQ(a.contact_point_W_m, b.contact_point_W_m);
  EXPECT_EQ(a.relative_residual, b.relative_residual);
  EXPECT_EQ(a.solve_time_s, b.solve_time_s);
}

void expect_equal(const SurfacePatch& a, const SurfacePatch& b) {
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.echo_sequence, b.echo_sequence);
  EXPECT_EQ(a.echo_servo_time_ns, b.echo_servo_time_ns);
  EXPECT_EQ(a.contact_epoch, b.contact_epoch);
  EXPECT_EQ(a.has_stiffness, b.has_stiffness);
  EXPECT_EQ(a.has_press_forces, b.has_press_forces);
  EXPECT_EQ(a.tool_opening_crad, b.tool_opening_crad);
  EXPECT_EQ(a.press_forces_W_N, b.press_forces_W_N);
  EXPECT_EQ(a.vertex_count, b.vertex_count);
  EXPECT_EQ(a.triangle_count, b.triangle_count);
  EXPECT_EQ(a.tool_radius_m, b.tool_radius_m);
  EXPECT_EQ(a.tool_length_m, b.tool_length_m);
  EXPECT_EQ(a.stiffness_W_N_per_m, b.stiffness_W_N_per_m);
  EXPECT_EQ(a.position_W_m, b.position_W_m);
  EXPECT_EQ(a.vertices_W_m, b.vertices_W_m);
  EXPECT_EQ(a.triangles, b.triangles);
}

template <typename Message>
void expect_decodes_to(const Bytes& datagram, const Message& message, std::uint64_t session_id) {
  const Decoded decoded = decode(datagram);
  ASSERT_EQ(decoded.status, WireStatus::kOk) << to_string(decoded.status);
  EXPECT_EQ(decoded.session_id, session_id);
  ASSERT_TRUE(std::holds_alternative<Message>(decoded.message));
  expect_equal(std::get<Message>(decoded.message), message);
}

TEST(Encode, WritesTheWorkedToolState) { EXPECT_EQ(encoded(worked::tool_state()), kToolState); }
TEST(Encode, WritesTheWorkedQuery) { EXPECT_EQ(encoded(worked::query()), kQuery); }
TEST(Encode, WritesTheWorkedForceSample) {
  EXPECT_EQ(encoded(worked::force_sample()), kForceSample);
}
TEST(Encode, WritesTheWorkedSurfacePatch) {
  EXPECT_EQ(encoded(worked::surface_patch()), kSurfacePatch);
  EXPECT_EQ(encoded(worked::sliding_patch()), kSlidingPatch);
}
TEST(Encode, WritesTheWorkedGoodbye) { EXPECT_EQ(encoded(Goodbye{}), kGoodbye); }

TEST(Decode, ReadsTheWorkedToolState) {
  expect_decodes_to(kToolState, worked::tool_state(), worked::kSession);
}
TEST(Decode, ReadsTheWorkedQuery) { expect_decodes_to(kQuery, worked::query(), worked::kSession); }
TEST(Decode, ReadsTheWorkedForceSample) {
  expect_decodes_to(kForceSample, worked::force_sample(), worked::kSession);
}
TEST(Decode, ReadsTheWorkedSurfacePatch) {
  expect_decodes_to(kSurfacePatch, worked::surface_patch(), worked::kSession);
  expect_decodes_to(kSlidingPatch, worked::sliding_patch(), worked::kSession);
}
TEST(Decode, ReadsTheWorkedGoodbye) {
  const Decoded decoded = decode(kGoodbye);
  EXPECT_EQ(decoded.status, WireStatus::kOk);
  EXPECT_EQ(decoded.session_id, worked::kSession);
  EXPECT_TRUE(std::holds_alternative<Goodbye>(decoded.message));
}

TEST(LinkProtocolDocument, ShowsTheBytesThatAreTestedHere) {
  std::ifstream file(FORCEGRID_SOURCE_DIR "/docs/link_protocol.md");
  ASSERT_TRUE(file.is_open());
  // Each example is a block of lines "0010  88 77 ..." after a line "worked NAME:".
  std::map<std::string, std::string> shown;
  std::string name;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("worked ")) {
      name = line.substr(7, line.find(':') - 7);
    } else if (line.size() > 6 && line.substr(4, 2) == "  " &&
               line.find_first_not_of("0123456789abcdef ") == std::string::npos) {
      shown[name] += line.substr(6) + " ";
    }
  }
  EXPECT_EQ(shown["tool_state"], worked::kToolStateHex);
  EXPECT_EQ(shown["query"], worked::kQueryHex);
  EXPECT_EQ(shown["force_sample"], worked::kForceSampleHex);
  EXPECT_EQ(shown["goodbye"], worked::kGoodbyeHex);
  EXPECT_EQ(shown["surface_patch"], worked::kSurfacePatchHex);
  EXPECT_EQ(shown["sliding_patch"], worked::kSlidingPatchHex);
  EXPECT_EQ(shown["tool_2_state"], worked::kTool2StateHex);
  EXPECT_EQ(shown["other_tools"], worked::kOtherToolsHex);
  EXPECT_EQ(shown["refusal"], worked::kRefusalHex);
  EXPECT_EQ(shown["pose_tool_state"], worked::kPoseToolStateHex);
  EXPECT_EQ(shown["pose_tool_2_state"], worked::kPoseTool2StateHex);
  EXPECT_EQ(shown["pose_force_sample"], worked::kPoseForceSampleHex);
  EXPECT_EQ(shown["sealed_tool_state"], worked::kSealedToolStateHex);
  EXPECT_EQ(shown["hello"], worked::kHelloHex);
}

TEST(Wire, EveryDatagramIsBelow512BytesSealedOrNot) {
  for (const Bytes& datagram : kEveryType) {
    EXPECT_LT(datagram.size() + kSealOverheadBytes, 512U);
  }
}

TEST(Wire, RandomMessagesComeBackUnchanged) {
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937_64 random(kSeed);
  const auto real = [&](double bound) {
    return std::uniform_real_distribution<double>(-bound, bound)(random);
  };
  const auto vector = [&](double bound) { return Vector3{real(bound), real(bound), real(bound)}; };
  for (int i = 0; i < 2000; ++i) {
    const std::uint64_t session_id = random() | 1U;
    const ToolState state{.sequence = static_cast<std::uint32_t>(random()),
                          .servo_time_ns = static_cast<std::int64_t>(random() >> 1U),
                          .position_W_m = vector(kMaxPosition_m),
                          .velocity_W_m_per_s = vector(kMaxVelocity_m_per_s)};
    const Query query{.query_id = static_cast<std::uint32_t>(random()) | 1U,
                      .servo_time_ns = static_cast<std::int64_t>(random() >> 1U),
                      .position_W_m = vector(kMaxPosition_m)};
    ForceSample sample{.sequence = static_cast<std::uint32_t>(random()),
                       .echo_sequence = static_cast<std::uint32_t>(random()),
                       .echo_servo_time_ns = static_cast<std::int64_t>(random() >> 1U),
                       .query_id = static_cast<std::uint32_t>(random()),
                       .contact_epoch = static_cast<std::uint32_t>(random()),
                       .in_contact = random() % 2 == 0,
                       .converged = random() % 2 == 0,
                       .has_stiffness = random() % 2 == 0,
                       .position_W_m = vector(kMaxPosition_m),
                       .force_W_N = vector(kMaxForce_N),
                       .contact_point_W_m = vector(kMaxPosition_m),
                       .relative_residual = std::abs(real(1.0)),
                       .solve_time_s = std::abs(real(kMaxSolveTime_s))};
    if (sample.has_stiffness) {
      std::ranges::generate(sample.stiffness_W_N_per_m,
                            [&] { return real(kMaxStiffness_N_per_m); });
    }
    expect_decodes_to(encoded(state, 0, Content::kPosition, session_id), state, session_id);
    expect_decodes_to(encoded(query, 0, Content::kPosition, session_id), query, session_id);
    expect_decodes_to(encoded(sample, 0, Content::kPosition, session_id), sample, session_id);
    if (HasFailure()) {
      break;
    }
  }
}

TEST(Decode, RejectsEveryTruncation) {
  for (const Bytes& datagram : kEveryType) {
    for (std::size_t size = 0; size < datagram.size(); ++size) {
      const WireStatus expected =
          size < kHeaderBytes + kChecksumBytes ? WireStatus::kTooShort : WireStatus::kBadLength;
      EXPECT_EQ(decode(std::span(datagram).first(size)).status, expected) << size << " bytes";
    }
  }
}

TEST(Decode, RejectsEveryTruncationWithAChecksumOfItsOwn) {
  for (const Bytes& datagram : kEveryType) {
    for (std::size_t size = 4; size < datagram.size(); ++size) {
      const Bytes cut(datagram.begin(), datagram.begin() + static_cast<std::ptrdiff_t>(size));
      EXPECT_NE(decode(with_checksum(cut)).status, WireStatus::kOk) << size << " bytes";
    }
  }
}

TEST(Decode, RejectsBytesBehindTheDatagram) {
  for (Bytes datagram : kEveryType) {
    datagram.push_back(std::byte{0});
    EXPECT_EQ(decode(with_checksum(datagram)).status, WireStatus::kBadLength);
  }
}

TEST(Decode, RejectsEveryChangeOfASingleByte) {
  for (const Bytes& datagram : kEveryType) {
    for (std::size_t i = 0; i < datagram.size(); ++i) {
      for (unsigned int change = 1; change < 256; ++change) {
        Bytes corrupted = datagram;
        corrupted[i] ^= static_cast<std::byte>(change);
        ASSERT_NE(decode(corrupted).status, WireStatus::kOk) << "byte " << i << " ^ " << change;
      }
    }
  }
}

TEST(Decode, RejectsRandomBytes) {
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  for (int i = 0; i < 5000; ++i) {
    Bytes noise(random() % 600);
    std::ranges::generate(noise, [&] { return static_cast<std::byte>(random() & 0xFFU); });
    ASSERT_NE(decode(noise).status, WireStatus::kOk);
  }
}

TEST(Decode, SaysWhatIsWrongWithAHeader) {
  for (const Bytes& datagram : kEveryType) {
    EXPECT_EQ(decode(with<char>(datagram, 3, 'X')).status, WireStatus::kBadMagic);
    EXPECT_EQ(decode(with<std::uint16_t>(datagram, 4, 0)).status, WireStatus::kBadVersion);
    EXPECT_EQ(decode(with<std::uint16_t>(datagram, 4, 5)).status, WireStatus::kBadVersion);
    EXPECT_EQ(decode(with<std::uint16_t>(datagram, 4, 2)).status, WireStatus::kOutOfRange)
        << "version 2 without a tool";
    EXPECT_EQ(decode(with<std::uint16_t>(datagram, 6, 0)).status, WireStatus::kBadType);
    EXPECT_EQ(decode(with<std::uint16_t>(datagram, 6, 6)).status, WireStatus::kBadType);
    EXPECT_EQ(decode(with<std::uint16_t>(datagram, 8, 57)).status, WireStatus::kBadLength);
    EXPECT_EQ(decode(with<std::uint16_t>(datagram, 10, 1)).status, WireStatus::kBadReserved);
    EXPECT_EQ(decode(with<std::uint64_t>(datagram, 16, 0)).status, WireStatus::kOutOfRange);
    Bytes wrong_checksum = datagram;
    wrong_checksum.back() ^= std::byte{1};
    EXPECT_EQ(decode(wrong_checksum).status, WireStatus::kBadChecksum);
  }
}

struct RealField {
  const char* name;
  const Bytes& datagram;
  std::size_t offset;  ///< of the first component, from docs/link_protocol.md
  std::size_t components;
  double lower;
  double upper;
};

const std::array<RealField, 10> kRealFields = {{
    {"tool state position", kToolState, 32, 3, -10.0, 10.0},
    {"tool state velocity", kToolState, 56, 3, -100.0, 100.0},
    {"query position", kQuery, 32, 3, -10.0, 10.0},
    {"sample position", kForceSample, 48, 3, -10.0, 10.0},
    {"sample force", kForceSample, 72, 3, -1000.0, 1000.0},
    {"sample contact point", kForceSample, 96, 3, -10.0, 10.0},
    {"sample residual", kForceSample, 120, 1, 0.0, std::numeric_limits<double>::max()},
    {"sample solve time", kForceSample, 128, 1, 0.0, 3600.0},
    {"sample stiffness", kForceSample, 136, 9, -1e7, 1e7},
    {"patch position", kSurfacePatch, 76, 3, -10.0, 10.0},
}};

TEST(Decode, HoldsEveryRealToItsRange) {
  for (const RealField& field : kRealFields) {
    for (std::size_t i = 0; i < field.components; ++i) {
      SCOPED_TRACE(testing::Message() << field.name << "[" << i << "]");
      const auto status = [&](double value) {
        return decode(with(field.datagram, field.offset + 8 * i, value)).status;
      };
      EXPECT_EQ(status(field.lower), WireStatus::kOk);
      EXPECT_EQ(status(field.upper), WireStatus::kOk);
      EXPECT_EQ(status(std::nextafter(field.lower, -kInfinity)), WireStatus::kOutOfRange);
      const double above = std::nextafter(field.upper, kInfinity);
      EXPECT_EQ(status(above),
                std::isfinite(above) ? WireStatus::kOutOfRange : WireStatus::kNotFinite);
      EXPECT_EQ(status(kNaN), WireStatus::kNotFinite);
      EXPECT_EQ(status(-kNaN), WireStatus::kNotFinite);
      EXPECT_EQ(status(std::numeric_limits<double>::signaling_NaN()), WireStatus::kNotFinite);
      EXPECT_EQ(status(kInfinity), WireStatus::kNotFinite);
      EXPECT_EQ(status(-kInfinity), WireStatus::kNotFinite);
    }
  }
}

struct FloatField {
  Bytes datagram;
  const char* name;
  std::size_t offset;  ///< in a surface patch, of the first component
  std::size_t components;
  float lower;
  float upper;
};

TEST(Decode, HoldsEveryFloatOfASurfacePatchToItsRange) {
  constexpr float kFloatInfinity = std::numeric_limits<float>::infinity();
  for (const FloatField& field :
       {FloatField{kSurfacePatch, "tool radius", 44, 1, 0.0F, 0.1F},
        FloatField{kSurfacePatch, "tool length", 48, 1, 0.0F, 0.5F},
        FloatField{kSurfacePatch, "stiffness", 52, 6, -1e7F, 1e7F},
        FloatField{kSlidingPatch, "press forces", 52, 6, -1000.0F, 1000.0F},
        FloatField{kSurfacePatch, "declared vertices", 100, 12, -1.0F, 1.0F}}) {
    for (std::size_t i = 0; i < field.components; ++i) {
      SCOPED_TRACE(testing::Message() << field.name << "[" << i << "]");
      const auto status = [&](float value) {
        return decode(with(field.datagram, field.offset + 4 * i, value)).status;
      };
      EXPECT_EQ(status(field.lower), WireStatus::kOk);
      EXPECT_EQ(status(field.upper), WireStatus::kOk);
      EXPECT_EQ(status(std::nextafter(field.lower, -kFloatInfinity)), WireStatus::kOutOfRange);
      EXPECT_EQ(status(std::nextafter(field.upper, kFloatInfinity)), WireStatus::kOutOfRange);
      EXPECT_EQ(status(std::numeric_limits<float>::quiet_NaN()), WireStatus::kNotFinite);
      EXPECT_EQ(status(-kFloatInfinity), WireStatus::kNotFinite);
    }
  }
}

TEST(Decode, RefusesAPatchWithMoreThanItHasRoomForOrThanItDeclares) {
  const auto status = [](std::size_t offset, std::uint8_t value) {
    return decode(with(kSurfacePatch, offset, value)).status;
  };
  EXPECT_EQ(status(40, 20), WireStatus::kOutOfRange) << "vertices";
  EXPECT_EQ(status(41, 28), WireStatus::kOutOfRange) << "triangles";
  EXPECT_EQ(status(40, 3), WireStatus::kBadReserved) << "a fourth vertex";
  EXPECT_EQ(status(41, 1), WireStatus::kBadReserved) << "a second triangle";
  EXPECT_EQ(status(41, 3), WireStatus::kOk) << "one of a single corner has no area, and is no harm";
  EXPECT_EQ(status(328, 4), WireStatus::kOutOfRange) << "a corner without a vertex";
  EXPECT_EQ(status(327, 1), WireStatus::kBadReserved) << "in the last vertex";
  EXPECT_EQ(status(408, 1), WireStatus::kBadReserved) << "in the last triangle";
  EXPECT_EQ(status(42, 0), WireStatus::kBadReserved) << "stiffness without its flag";
  EXPECT_EQ(status(42, 3), WireStatus::kBadReserved) << "a tool that both sticks and slides";
  EXPECT_EQ(status(42, 5), WireStatus::kBadReserved) << "an unknown flag";
  EXPECT_EQ(status(43, 160), WireStatus::kOk) << "the widest opening";
  EXPECT_EQ(status(43, 161), WireStatus::kOutOfRange);
  EXPECT_EQ(decode(with<std::uint8_t>(kSlidingPatch, 42, 0)).status, WireStatus::kBadReserved)
      << "press forces without their flag";
}

TEST(Decode, RefusesTimesBelowZeroAndAQueryWithoutNumber) {
  EXPECT_EQ(decode(with<std::int64_t>(kToolState, 24, -1)).status, WireStatus::kOutOfRange);
  EXPECT_EQ(decode(with<std::int64_t>(kQuery, 24, -1)).status, WireStatus::kOutOfRange);
  EXPECT_EQ(decode(with<std::int64_t>(kForceSample, 24, -1)).status, WireStatus::kOutOfRange);
  EXPECT_EQ(decode(with<std::int64_t>(kSurfacePatch, 24, -1)).status, WireStatus::kOutOfRange);
  EXPECT_EQ(decode(with<std::uint32_t>(kQuery, 12, 0)).status, WireStatus::kOutOfRange);
}

TEST(Decode, RefusesUnknownFlagsAndAStiffnessThatIsNotDeclared) {
  for (unsigned int bit = 3; bit < 32; ++bit) {
    const std::uint32_t flags = 7U | (1U << bit);
    EXPECT_EQ(decode(with(kForceSample, 44, flags)).status, WireStatus::kBadReserved);
  }
  EXPECT_EQ(decode(with<std::uint32_t>(kForceSample, 44, 3)).status, WireStatus::kBadReserved);
  EXPECT_EQ(decode(with<std::uint32_t>(kGoodbye, 12, 1)).status, WireStatus::kBadReserved);
}

template <std::size_t N>
void expect_within(const std::array<double, N>& values, double bound) {
  for (const double value : values) {
    EXPECT_TRUE(value >= -bound && value <= bound) << value;
  }
}

TEST(Decode, NeverAcceptsUnusableNumbersUnderAMatchingChecksum) {
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  int accepted = 0;
  int refused = 0;
  for (int i = 0; i < 40000; ++i) {
    Bytes datagram = kEveryType[random() % kEveryType.size()];
    const std::size_t changes = 1 + random() % 4;
    for (std::size_t k = 0; k < changes; ++k) {
      datagram[random() % datagram.size()] = static_cast<std::byte>(random() & 0xFFU);
    }
    const Decoded decoded = decode(with_checksum(datagram));
    if (decoded.status != WireStatus::kOk) {
      ++refused;
      EXPECT_TRUE(std::holds_alternative<std::monostate>(decoded.message));
      EXPECT_EQ(decoded.session_id, 0U);
      continue;
    }
    ++accepted;
    EXPECT_NE(decoded.session_id, 0U);
    if (const auto* state = std::get_if<ToolState>(&decoded.message)) {
      EXPECT_GE(state->servo_time_ns, 0);
      expect_within(state->position_W_m, 10.0);
      expect_within(state->velocity_W_m_per_s, 100.0);
    } else if (const auto* query = std::get_if<Query>(&decoded.message)) {
      EXPECT_NE(query->query_id, 0U);
      EXPECT_GE(query->servo_time_ns, 0);
      expect_within(query->position_W_m, 10.0);
    } else if (const auto* sample = std::get_if<ForceSample>(&decoded.message)) {
      EXPECT_GE(sample->echo_servo_time_ns, 0);
      expect_within(sample->position_W_m, 10.0);
      expect_within(sample->force_W_N, 1000.0);
      expect_within(sample->contact_point_W_m, 10.0);
      expect_within(sample->stiffness_W_N_per_m, sample->has_stiffness ? 1e7 : 0.0);
      EXPECT_TRUE(sample->relative_residual >= 0.0 && std::isfinite(sample->relative_residual));
      EXPECT_TRUE(sample->solve_time_s >= 0.0 && sample->solve_time_s <= 3600.0);
    } else if (const auto* patch = std::get_if<SurfacePatch>(&decoded.message)) {
      expect_within(patch->position_W_m, 10.0);
      ASSERT_LE(patch->vertex_count, SurfacePatch::kMaxVertices);
      ASSERT_LE(patch->triangle_count, SurfacePatch::kMaxTriangles);
      for (std::size_t t = 0; t < patch->triangle_count; ++t) {
        EXPECT_LT(std::ranges::max(patch->triangles[t]), patch->vertex_count);
      }
    }
    ASSERT_FALSE(HasFailure()) << "case " << i;
  }
  // Both outcomes must have been exercised for the loop to mean anything.
  EXPECT_GT(accepted, 1000);
  EXPECT_GT(refused, 1000);
}

TEST(Encode, RefusesWhatTheOtherSideWould) {
  Bytes buffer(kMaxDatagramBytes);
  ToolState state = worked::tool_state();
  state.position_W_m[1] = kNaN;
  EXPECT_EQ(encode(state, 1, buffer).status, WireStatus::kNotFinite);
  state.position_W_m[1] = -10.5;
  EXPECT_EQ(encode(state, 1, buffer).status, WireStatus::kOutOfRange);
  Query query = worked::query();
  query.query_id = 0;
  EXPECT_EQ(encode(query, 1, buffer).status, WireStatus::kOutOfRange);
  ForceSample sample = worked::force_sample();
  sample.force_W_N[2] = 1000.5;
  EXPECT_EQ(encode(sample, 1, buffer).status, WireStatus::kOutOfRange);
  sample = worked::force_sample();
  sample.has_stiffness = false;
  EXPECT_EQ(encode(sample, 1, buffer).status, WireStatus::kBadReserved);
  EXPECT_EQ(encode(Goodbye{}, 0, buffer).status, WireStatus::kOutOfRange);
  EXPECT_EQ(encode(worked::query(), 1, std::span(buffer).first(59)).status, WireStatus::kTooShort);
  EXPECT_EQ(encode(worked::query(), 1, std::span(buffer).first(59)).size_bytes, 0U);
}

TEST(WireStatus, EveryOneHasWordsOfItsOwn) {
  std::set<std::string> words;
  for (std::size_t i = 0; i < kWireStatusCount; ++i) {
    words.insert(to_string(static_cast<WireStatus>(i)));
  }
  EXPECT_EQ(words.size(), kWireStatusCount);
  EXPECT_FALSE(words.contains(to_string(static_cast<WireStatus>(kWireStatusCount))));
}

}  // namespace
}  // namespace forcegrid::link
