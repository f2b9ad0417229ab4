// SPDX-License-Identifier: Apache-2.0
// link/forcegrid_link.h against the worked datagrams of docs/link_protocol.md, and against
// strangers.
#include <gtest/gtest.h>
#include <sodium.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <limits>
#include <random>
#include <vector>

#include "link/forcegrid_link.h"
#include "tests/link/worked_datagrams.h"

namespace forcegrid::link {
namespace {

constexpr char kServo[] = "servo";
constexpr char kOther[] = "other";
constexpr std::int64_t kNow_ns = 1'390'500'000;

std::vector<unsigned char> bytes_of(const char* hex) {
  std::vector<unsigned char> bytes;
  for (const std::byte byte : worked::from_hex(hex)) {
    bytes.push_back(static_cast<unsigned char>(byte));
  }
  return bytes;
}

const std::vector<unsigned char> kToolState = bytes_of(worked::kToolStateHex);
const std::vector<unsigned char> kQuery = bytes_of(worked::kQueryHex);
const std::vector<unsigned char> kForceSample = bytes_of(worked::kForceSampleHex);
const std::vector<unsigned char> kGoodbye = bytes_of(worked::kGoodbyeHex);
const std::vector<unsigned char> kSealedToolState = bytes_of(worked::kSealedToolStateHex);
const std::vector<unsigned char> kHello = bytes_of(worked::kHelloHex);

/// The key of the worked examples, and 30 31 ... 3f for random bytes.
struct WorkedCrypto {
  std::array<unsigned char, 32> secret{};
  fg_crypto functions{};

  WorkedCrypto() {
    for (std::size_t i = 0; i < secret.size(); ++i) {
      secret[i] = static_cast<unsigned char>(i);
    }
    functions.context = secret.data();
    constexpr std::array<unsigned char, 8> kId = {0x0a, 0xf9, 0x4c, 0xaa, 0xc9, 0x2e, 0x9c, 0xd0};
    std::ranges::copy(kId, functions.key_id);
    functions.encrypt = [](void* key, unsigned char* to, const unsigned char* from, size_t size,
                           const unsigned char* head, size_t head_size,
                           const unsigned char* nonce) -> int {
      return crypto_aead_xchacha20poly1305_ietf_encrypt(to, nullptr, from, size, head, head_size,
                                                        nullptr, nonce,
                                                        static_cast<unsigned char*>(key)) == 0;
    };
    functions.decrypt = [](void* key, unsigned char* to, const unsigned char* from, size_t size,
                           const unsigned char* head, size_t head_size,
                           const unsigned char* nonce) -> int {
      return crypto_aead_xchacha20poly1305_ietf_decrypt(to, nullptr, nullptr, from, size, head,
                                                        head_size, nonce,
                                                        static_cast<unsigned char*>(key)) == 0;
    };
    functions.random_bytes = [](void*, unsigned char* to, size_t size) -> int {
      for (size_t i = 0; i < size; ++i) {
        to[i] = static_cast<unsigned char>(0x30 + i);
      }
      return 1;
    };
  }
};

class CHeader : public testing::Test {
 protected:
  CHeader() { fg_link_init(&link_, 2.0, nullptr); }

  fg_event take(const std::vector<unsigned char>& datagram, const char* from = kServo,
                std::int64_t now_ns = kNow_ns) {
    return fg_link_take(&link_, datagram.data(), datagram.size(), from, 6, now_ns, reply_.data(),
                        &reply_size_);
  }
  std::vector<unsigned char> reply() const {
    return {reply_.begin(), reply_.begin() + static_cast<std::ptrdiff_t>(reply_size_)};
  }

  WorkedCrypto crypto_;
  fg_link link_;
  std::array<unsigned char, FG_SEAL_OVERHEAD_BYTES> reply_{};
  size_t reply_size_ = 0;
};

TEST_F(CHeader, ReadsTheWorkedToolStateQueryAndGoodbye) {
  ASSERT_EQ(take(kToolState), FG_TOOL_STATE);
  EXPECT_EQ(link_.new_session, 1);
  EXPECT_EQ(link_.session_id, worked::kSession);
  const ToolState expected = worked::tool_state();
  EXPECT_EQ(link_.tool_state.sequence, expected.sequence);
  EXPECT_EQ(link_.tool_state.servo_time_ns, expected.servo_time_ns);
  EXPECT_TRUE(std::ranges::equal(link_.tool_state.position_W_m, expected.position_W_m));
  EXPECT_TRUE(std::ranges::equal(link_.tool_state.velocity_W_m_per_s, expected.velocity_W_m_per_s));
  ASSERT_EQ(take(kQuery), FG_QUERY);
  EXPECT_EQ(link_.new_session, 0);
  EXPECT_EQ(link_.query.query_id, worked::query().query_id);
  EXPECT_TRUE(std::ranges::equal(link_.query.position_W_m, worked::query().position_W_m));
  EXPECT_EQ(take(kGoodbye), FG_GOODBYE);
  EXPECT_EQ(link_.session_id, 0U);
}

TEST_F(CHeader, WritesTheWorkedForceSampleAndGoodbye) {
  ASSERT_EQ(take(kToolState), FG_TOOL_STATE);
  fg_force_sample sample = fg_answer_to_tool_state(&link_.tool_state);
  const ForceSample expected = worked::force_sample();
  sample.contact_epoch = 2;
  sample.in_contact = sample.converged = sample.has_stiffness = 1;
  std::ranges::copy(expected.force_W_N, sample.force_W_N);
  std::ranges::copy(expected.contact_point_W_m, sample.contact_point_W_m);
  std::ranges::copy(expected.stiffness_W_N_per_m, sample.stiffness_W_N_per_m);
  sample.relative_residual = expected.relative_residual;
  sample.solve_time_s = expected.solve_time_s;
  std::vector<unsigned char> made(FG_MAX_DATAGRAM_BYTES);
  size_t size = 0;
  for (int i = 0; i < 3; ++i) {  // the worked one has number 3
    size = fg_link_make_sample(&link_, &sample, kNow_ns, made.data());
  }
  made.resize(size);
  EXPECT_EQ(made, kForceSample);
  made.resize(FG_MAX_DATAGRAM_BYTES);
  made.resize(fg_link_make_goodbye(&link_, kNow_ns, made.data()));
  EXPECT_EQ(made, kGoodbye);
}

TEST_F(CHeader, ReadsTheWorkedPose) {
  ASSERT_EQ(take(bytes_of(worked::kPoseToolStateHex)), FG_TOOL_STATE);
  const ToolState expected = worked::pose_tool_state();
  EXPECT_TRUE(std::ranges::equal(link_.tool_state.position_W_m, expected.position_W_m));
  EXPECT_EQ(link_.tool_state.has_orientation, 1);
  EXPECT_EQ(link_.tool_state.has_buttons, 1);
  EXPECT_TRUE(std::ranges::equal(link_.tool_state.orientation_WT, expected.orientation_WT));
  EXPECT_TRUE(std::ranges::equal(link_.tool_state.angular_velocity_W_rad_per_s,
                                 expected.angular_velocity_W_rad_per_s));
  EXPECT_EQ(link_.tool_state.buttons, expected.buttons);
  EXPECT_EQ(take(bytes_of(worked::kPoseTool2StateHex)), FG_DROPPED) << "one of several tools";
  // A servo tries an older version until it is answered: its pose is what it was.
  ToolState older = worked::tool_state();
  older.sequence = 8;
  std::array<std::byte, kMaxDatagramBytes> buffer;
  const Encoded encoded = encode(older, worked::kSession, buffer);
  const auto* bytes = reinterpret_cast<const unsigned char*>(buffer.data());
  ASSERT_EQ(take({bytes, bytes + encoded.size_bytes}), FG_TOOL_STATE);
  EXPECT_EQ(link_.tool_state.sequence, 8U);
  EXPECT_TRUE(std::ranges::equal(link_.tool_state.orientation_WT, expected.orientation_WT));
  EXPECT_EQ(link_.tool_state.buttons, expected.buttons);
}

TEST_F(CHeader, WritesTheWorkedTorqueForAServoWithAWristOnly) {
  const ForceSample expected = worked::pose_force_sample();
  const auto third_sample = [&](const char* tool_state) {
    fg_link_init(&link_, 2.0, nullptr);
    EXPECT_EQ(take(bytes_of(tool_state)), FG_TOOL_STATE);
    fg_force_sample sample = fg_answer_to_tool_state(&link_.tool_state);
    sample.contact_epoch = 2;
    sample.in_contact = sample.converged = sample.has_stiffness = 1;
    std::ranges::copy(expected.force_W_N, sample.force_W_N);
    std::ranges::copy(expected.contact_point_W_m, sample.contact_point_W_m);
    std::ranges::copy(expected.stiffness_W_N_per_m, sample.stiffness_W_N_per_m);
    sample.relative_residual = expected.relative_residual;
    sample.solve_time_s = expected.solve_time_s;
    sample.has_torque = sample.has_rotational_stiffness = 1;
    std::ranges::copy(expected.torque_W_Nm, sample.torque_W_Nm);
    std::ranges::copy(expected.rotational_stiffness_W_Nm_per_rad,
                      sample.rotational_stiffness_W_Nm_per_rad);
    std::vector<unsigned char> made(FG_MAX_DATAGRAM_BYTES);
    size_t size = 0;
    for (int i = 0; i < 3; ++i) {
      size = fg_link_make_sample(&link_, &sample, kNow_ns, made.data());
    }
    made.resize(size);
    return made;
  };
  EXPECT_EQ(third_sample(worked::kPoseToolStateHex), bytes_of(worked::kPoseForceSampleHex));
  EXPECT_EQ(third_sample(worked::kToolStateHex), kForceSample);
}

TEST_F(CHeader, SendsNoTorqueThatTheServoWouldRefuse) {
  ASSERT_EQ(take(bytes_of(worked::kPoseToolStateHex)), FG_TOOL_STATE);
  std::array<unsigned char, FG_MAX_DATAGRAM_BYTES> to;
  const auto size_with = [&](auto change) {
    fg_force_sample sample = fg_answer_to_tool_state(&link_.tool_state);
    sample.has_torque = 1;
    change(sample);
    return fg_link_make_sample(&link_, &sample, kNow_ns, to.data());
  };
  EXPECT_EQ(size_with([](fg_force_sample&) {}), kPoseForceSampleBytes);
  EXPECT_EQ(size_with([](fg_force_sample& s) { s.torque_W_Nm[2] = 1001.0; }), 0U);
  EXPECT_EQ(size_with([](fg_force_sample& s) { s.torque_W_Nm[0] = NAN; }), 0U);
  EXPECT_EQ(size_with([](fg_force_sample& s) { s.orientation_WT[0] = 0.51; }), 0U);
  EXPECT_EQ(size_with([](fg_force_sample& s) {
              s.has_torque = 0;
              s.has_rotational_stiffness = 1;
            }),
            0U);
}

TEST_F(CHeader, WritesTheWorkedSurfacePatch) {
  ASSERT_EQ(take(kToolState), FG_TOOL_STATE);
  fg_surface_patch patch = fg_patch_for_tool_state(&link_.tool_state);
  const SurfacePatch expected = worked::surface_patch();
  patch.contact_epoch = 2;
  patch.tool_radius_m = expected.tool_radius_m;
  patch.has_stiffness = 1;
  std::ranges::copy(expected.stiffness_W_N_per_m, patch.stiffness_W_N_per_m);
  patch.vertex_count = 4;
  patch.triangle_count = 2;
  for (std::size_t v = 0; v < 4; ++v) {
    std::ranges::copy(expected.vertices_W_m[v], patch.vertices_W_m[v]);
  }
  for (std::size_t t = 0; t < 2; ++t) {
    std::ranges::copy(expected.triangles[t], patch.triangles[t]);
  }
  std::vector<unsigned char> made(FG_MAX_DATAGRAM_BYTES);
  size_t size = 0;
  for (int i = 0; i < 4; ++i) {  // the worked one has number 4
    size = fg_link_make_patch(&link_, &patch, kNow_ns, made.data());
  }
  made.resize(size);
  EXPECT_EQ(made, bytes_of(worked::kSurfacePatchHex));

  const SurfacePatch sliding = worked::sliding_patch();
  patch.has_stiffness = 0;
  patch.has_press_forces = 1;
  patch.tool_length_m = sliding.tool_length_m;
  patch.tool_opening_crad = sliding.tool_opening_crad;
  for (std::size_t depth = 0; depth < SurfacePatch::kPresses; ++depth) {
    std::ranges::copy(sliding.press_forces_W_N[depth], patch.press_forces_W_N[depth]);
  }
  made.resize(FG_MAX_DATAGRAM_BYTES);
  made.resize(fg_link_make_patch(&link_, &patch, kNow_ns, made.data()));
  EXPECT_EQ(made, bytes_of(worked::kSlidingPatchHex));
}

TEST_F(CHeader, ShowsNoSurfaceThatTheServoWouldRefuse) {
  ASSERT_EQ(take(kToolState), FG_TOOL_STATE);
  std::array<unsigned char, FG_MAX_DATAGRAM_BYTES> to;
  const auto size_with = [&](auto change) {
    fg_surface_patch patch = fg_patch_for_tool_state(&link_.tool_state);
    patch.vertex_count = 3;
    patch.triangle_count = 1;
    patch.triangles[0][1] = 1;
    patch.triangles[0][2] = 2;
    change(patch);
    return fg_link_make_patch(&link_, &patch, kNow_ns, to.data());
  };
  EXPECT_EQ(size_with([](fg_surface_patch&) {}), kSurfacePatchBytes);
  EXPECT_EQ(size_with([](fg_surface_patch& p) { p.triangles[0][2] = 3; }), 0U);
  EXPECT_EQ(size_with([](fg_surface_patch& p) { p.vertex_count = 20; }), 0U);
  EXPECT_EQ(size_with([](fg_surface_patch& p) { p.triangle_count = 28; }), 0U);
  EXPECT_EQ(size_with([](fg_surface_patch& p) { p.vertices_W_m[2][1] = NAN; }), 0U);
  EXPECT_EQ(size_with([](fg_surface_patch& p) { p.tool_radius_m = -1.0F; }), 0U);
  EXPECT_EQ(size_with([](fg_surface_patch& p) { p.tool_opening_crad = 161; }), 0U);
  EXPECT_EQ(size_with([](fg_surface_patch& p) { p.has_press_forces = p.has_stiffness = 1; }), 0U);
  EXPECT_EQ(size_with([](fg_surface_patch& p) {
              p.has_press_forces = 1;
              p.press_forces_W_N[1][2] = 1001.0F;
            }),
            0U);
}

TEST_F(CHeader, SendsNothingThatTheServoWouldRefuse) {
  std::array<unsigned char, FG_MAX_DATAGRAM_BYTES> to;
  fg_force_sample sample = fg_answer_to_tool_state(&link_.tool_state);
  EXPECT_EQ(fg_link_make_sample(&link_, &sample, kNow_ns, to.data()), 0U);  // no servo yet
  ASSERT_EQ(take(kToolState), FG_TOOL_STATE);
  sample = fg_answer_to_tool_state(&link_.tool_state);
  EXPECT_EQ(fg_link_make_sample(&link_, &sample, kNow_ns, to.data()), kForceSample.size());
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), 1000.5, HUGE_VAL}) {
    sample.force_W_N[1] = bad;
    EXPECT_EQ(fg_link_make_sample(&link_, &sample, kNow_ns, to.data()), 0U);
  }
}

TEST_F(CHeader, TakesOneServoAtATimeAndNoNumberTwice) {
  ASSERT_EQ(take(kToolState), FG_TOOL_STATE);
  EXPECT_EQ(take(kToolState), FG_DROPPED);
  EXPECT_EQ(link_.dropped[FG_DROP_DUPLICATED], 1U);
  EXPECT_EQ(take(kQuery, kOther), FG_DROPPED);
  EXPECT_EQ(link_.dropped[FG_DROP_ADDRESS], 1U);
  ASSERT_EQ(take(kGoodbye), FG_GOODBYE);
  EXPECT_EQ(take(kToolState), FG_DROPPED);  // an ended session does not come back
  EXPECT_EQ(link_.dropped[FG_DROP_SESSION], 1U);
}

TEST_F(CHeader, FollowsNumbersThatWrap) {
  fg_window window{};
  std::uint32_t number = std::numeric_limits<std::uint32_t>::max() - 3;
  for (int i = 0; i < 8; ++i, ++number) {
    EXPECT_EQ(fg_window_pass(&window, fg_unwrap(&window, number)), 1) << number;
    EXPECT_EQ(fg_window_pass(&window, fg_unwrap(&window, number)), 0) << number;
  }
  EXPECT_EQ(fg_window_pass(&window, fg_unwrap(&window, number - FG_WINDOW - 1)), 0);
}

TEST_F(CHeader, TakesTheWorkedSealedToolStateOnce) {
  ASSERT_EQ(fg_link_init(&link_, 2.0, &crypto_.functions), 1);
  EXPECT_EQ(take(kSealedToolState), FG_TOOL_STATE);
  EXPECT_EQ(link_.tool_state.sequence, 7U);
  EXPECT_EQ(take(kSealedToolState), FG_DROPPED);
  EXPECT_EQ(link_.dropped[FG_DROP_REPLAYED], 1U);
  EXPECT_EQ(take(kToolState), FG_DROPPED);
  EXPECT_EQ(link_.dropped[FG_DROP_SEALED], 1U);
}

TEST_F(CHeader, AnswersWhatIsStaleWithTheWorkedHello) {
  ASSERT_EQ(fg_link_init(&link_, 2.0, &crypto_.functions), 1);
  std::ranges::fill(link_.own_stream, static_cast<unsigned char>(0));  // another start than heard
  ASSERT_EQ(take(kSealedToolState), FG_DROPPED);
  EXPECT_EQ(link_.dropped[FG_DROP_STALE], 1U);
  EXPECT_EQ(reply().size(), kHello.size());
  // The same with the stream of the example: its times are by two readings of the clock.
  ASSERT_EQ(fg_link_init(&link_, 2.0, &crypto_.functions), 1);
  std::vector<unsigned char> hello(FG_SEAL_OVERHEAD_BYTES);
  constexpr std::int64_t kSent_ns = 1'501'000'000;
  constexpr std::int64_t kHelloSent_ns = 1'391'000'000;
  EXPECT_EQ(fg_seal(&link_, hello.data(), 0, kSealedToolState.data() + 16, kSent_ns, kNow_ns,
                    kHelloSent_ns),
            hello.size());
  EXPECT_EQ(hello, kHello);
}

TEST_F(CHeader, TakesNoneOfAHundredThousandDamagedDatagrams) {
  constexpr unsigned int kSeed = 6;
  std::cout << "seed " << kSeed << "\n";
  std::mt19937 random(kSeed);
  for (const bool sealed : {false, true}) {
    fg_link_init(&link_, 2.0, sealed ? &crypto_.functions : nullptr);
    ASSERT_EQ(take(sealed ? kSealedToolState : kToolState), FG_TOOL_STATE);
    const auto& good = sealed ? kSealedToolState : kQuery;
    for (int i = 0; i < 50'000; ++i) {
      std::vector<unsigned char> bad = good;
      if (i % 3 == 0) {
        bad.resize(random() % (2 * bad.size()));
      }
      if (i % 3 != 0 || bad.size() == good.size()) {
        bad[random() % bad.size()] ^= static_cast<unsigned char>(1U << (random() % 8));
      }
      ASSERT_EQ(take(bad), FG_DROPPED) << i;
      ASSERT_EQ(reply_size_, 0U) << i;
    }
  }
}

}  // namespace
}  // namespace forcegrid::link
