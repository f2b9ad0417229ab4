// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/pair_reference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>

#include "evaluation/files/error.h"
#include "simulator/mesh/lattice_block.h"
#include "tests/simulator/two_tool_newton.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

constexpr double kPatchRadius_m = 0.012;

// A block of 80 vertices under both tools: a vertex each is where they touch.
simulator::SpringMesh little_block() {
  simulator::LatticeBlockOptions options;
  options.vertex_count = {5, 5, 4};
  options.size_m = {0.1, 0.1, 0.06};
  options.law.cubic_coefficient = 5.0;
  options.top_centre_W = first_contact_point_W();
  return simulator::make_lattice_block(options);
}

PairTraceOptions short_trace() {
  PairTraceOptions options;
  options.seconds = 1.2;
  options.servo_rate_Hz = 100.0;
  return options;
}

class EveryPairMotion : public ::testing::TestWithParam<std::string> {};

TEST_P(EveryPairMotion, BeginsAtRestWhereTheToolsTouchAndMovesBothOrHoldsOne) {
  const PairMotion motion(GetParam());
  EXPECT_LT((motion.positions_W(0.0) - PairMotion::contact_points_W()).norm(), 1e-12);
  const PairVector soon_W = motion.positions_W(1e-3) - motion.positions_W(0.0);
  EXPECT_LT(soon_W.norm(), 1e-3);  // no jump
  PairVector low_W = motion.positions_W(0.0);
  PairVector high_W = low_W;
  for (double time_s = 0.0; time_s < PairMotion::kLongest_s; time_s += 0.01) {
    const PairVector at_W = motion.positions_W(time_s);
    low_W = low_W.cwiseMin(at_W);
    high_W = high_W.cwiseMax(at_W);
    // The edges of the two patches never meet.
    EXPECT_GT((at_W.tail<3>() - at_W.head<3>()).norm(), 2.0 * kPatchRadius_m) << time_s;
  }
  EXPECT_GT((high_W - low_W).head<3>().norm(), 0.005);
  EXPECT_GT((high_W - low_W).tail<3>().norm(), 0.005);
  EXPECT_LT((high_W - low_W).cwiseAbs().maxCoeff(), 0.025);
}

// Another way to the same equilibria: Newton's method with a dense factor, from rest each time.
TEST_P(EveryPairMotion, HasTheForcesOfADenseNewtonMethod) {
  const PairMotion motion(GetParam());
  const PairReference made = make_pair_trace(little_block(), motion, short_trace(), 1);
  EXPECT_EQ(made.unconverged, 0U);
  EXPECT_EQ(made.branch_changes, 0U);
  const PairVector touched_W = PairMotion::contact_points_W();
  simulator::TwoToolNewton newton(little_block(),
                                  {Vector3d(touched_W.head<3>()), Vector3d(touched_W.tail<3>())},
                                  kPatchRadius_m);
  for (std::size_t i = 10; i < made.trace.servo.size(); i += 36) {
    const PairInstant& instant = made.trace.servo[i];
    const PairVector moved_m = instant.positions_W - touched_W;
    const auto expected = newton.at({Vector3d(moved_m.head<3>()), Vector3d(moved_m.tail<3>())});
    PairVector expected_W;
    expected_W << expected.tool_W[0], expected.tool_W[1];
    EXPECT_LT((instant.forces_W - expected_W).norm(), 2e-5 * std::max(1.0, expected_W.norm()))
        << GetParam() << " at " << instant.time_s << " s";
  }
}

INSTANTIATE_TEST_SUITE_P(Pairs, EveryPairMotion, ::testing::ValuesIn(pair_motion_names()),
                         [](const auto& each) { return each.param; });

TEST(PairMotion, NamesTheKnownPairs) {
  try {
    static_cast<void>(PairMotion("waltz"));
    FAIL();
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("'waltz' is not known; known pairs: lissajous"));
  }
}

TEST(PairMotion, DependsOnTheSeedWhereItIsRandom) {
  EXPECT_NE(PairMotion("random", 1).positions_W(2.0), PairMotion("random", 2).positions_W(2.0));
  EXPECT_EQ(PairMotion("random", 2).positions_W(2.0), PairMotion("random", 2).positions_W(2.0));
}

TEST(PairReference, SamplesAreOfTheTickAndArriveAPeriodAndTheDelayLater) {
  PairTraceOptions options = short_trace();
  options.simulator_rate_Hz = 10.0;
  options.delay_s = 0.03;
  const PairReference made = make_pair_trace(little_block(), PairMotion("lissajous"), options, 1);
  ASSERT_EQ(made.trace.servo.size(), 120U);
  ASSERT_EQ(made.trace.samples.size(), 12U);
  for (std::size_t tick = 0; tick < 12; ++tick) {
    const DeliveredPairSample& row = made.trace.samples[tick];
    EXPECT_NEAR(row.sample.time_s, 0.1 * static_cast<double>(tick), 1e-12);
    EXPECT_NEAR(row.delivered_s, 0.1 * static_cast<double>(tick) + 0.13, 1e-12);
    EXPECT_EQ(row.sample.forces_W, made.trace.servo[10 * tick].forces_W);
  }
  ASSERT_EQ(made.trace.contacts.size(), 1U);
  EXPECT_EQ(made.trace.contacts[0].points_W, PairMotion::contact_points_W());
}

TEST(PairReference, AddsSeededNoiseToSamplesAlone) {
  PairTraceOptions options = short_trace();
  options.servo_rate_Hz = 1000.0;
  options.simulator_rate_Hz = 1000.0;
  options.cache = std::filesystem::path(::testing::TempDir()) / "pair_reference_noise";
  const PairMotion motion("hold_chirp");
  const PairReference clean = make_pair_trace(little_block(), motion, options, 4);
  options.noise_N = 0.05;
  const PairReference noisy = make_pair_trace(little_block(), motion, options, 4);
  EXPECT_TRUE(noisy.from_cache);
  double squares_N2 = 0.0;
  for (std::size_t i = 0; i < clean.trace.samples.size(); ++i) {
    EXPECT_EQ(noisy.trace.servo[i].forces_W, clean.trace.servo[i].forces_W);
    squares_N2 += (noisy.trace.samples[i].sample.forces_W - clean.trace.samples[i].sample.forces_W)
                      .squaredNorm();
  }
  // 7,200 numbers: their RMS is within 5 standard deviations, 4 %, of what was asked for.
  const double count = 6.0 * static_cast<double>(clean.trace.samples.size());
  EXPECT_NEAR(std::sqrt(squares_N2 / count), 0.05, 5.0 * 0.05 / std::sqrt(2.0 * count));
  const PairReference again = make_pair_trace(little_block(), motion, options, 4);
  EXPECT_EQ(again.trace.samples[7].sample.forces_W, noisy.trace.samples[7].sample.forces_W);
  std::filesystem::remove_all(options.cache);
}

// The solver's linearisation against differences of forces that a dense Newton method finds.
TEST(PairReference, TellsHowTheForcesChangeAtEachSampleIfAsked) {
  PairTraceOptions options = short_trace();
  options.simulator_rate_Hz = 10.0;
  options.cache = std::filesystem::path(::testing::TempDir()) / "pair_reference_stiffness";
  std::filesystem::remove_all(options.cache);
  const PairMotion motion("lissajous");
  EXPECT_FALSE(
      make_pair_trace(little_block(), motion, options, 1).trace.samples[3].sample.has_stiffness);
  options.stiffness = true;
  const PairReference made = make_pair_trace(little_block(), motion, options, 1);
  EXPECT_FALSE(made.from_cache);
  const PairVector touched_W = PairMotion::contact_points_W();
  simulator::TwoToolNewton newton(little_block(),
                                  {Vector3d(touched_W.head<3>()), Vector3d(touched_W.tail<3>())},
                                  kPatchRadius_m);
  const auto forces_N = [&](const PairVector& moved_m) {
    const auto found = newton.at({Vector3d(moved_m.head<3>()), Vector3d(moved_m.tail<3>())});
    PairVector both;
    both << found.tool_W[0], found.tool_W[1];
    return both;
  };
  const PairSample& sample = made.trace.samples[7].sample;
  ASSERT_TRUE(sample.has_stiffness);
  constexpr double kStep_m = 1e-4;
  PairMatrix expected;
  for (int c = 0; c < 6; ++c) {
    const PairVector step = kStep_m * PairVector::Unit(c);
    const PairVector at_m = sample.positions_W - touched_W;
    expected.col(c) = (forces_N(at_m + step) - forces_N(at_m - step)) / (2.0 * kStep_m);
  }
  // The square of the tolerance of the sensitivities, 5 %, and as much for the differences.
  EXPECT_LT((sample.stiffness_W - expected).norm(), 0.005 * expected.norm());
  const PairReference again = make_pair_trace(little_block(), motion, options, 1);
  EXPECT_TRUE(again.from_cache);
  for (std::size_t i = 0; i < made.trace.samples.size(); ++i) {
    EXPECT_EQ(again.trace.samples[i].sample.stiffness_W, made.trace.samples[i].sample.stiffness_W);
    EXPECT_TRUE(again.trace.samples[i].sample.has_stiffness);
  }
  std::filesystem::remove_all(options.cache);
}

TEST(PairReference, IsFoundAgainInTheCacheUnlessAnythingDiffers) {
  PairTraceOptions options = short_trace();
  options.cache = std::filesystem::path(::testing::TempDir()) / "pair_reference_cache";
  std::filesystem::remove_all(options.cache);
  const PairMotion motion("stretch");
  const PairReference first = make_pair_trace(little_block(), motion, options, 1);
  EXPECT_FALSE(first.from_cache);
  options.delay_s = 0.05;  // of the samples, not of the forces
  const PairReference again = make_pair_trace(little_block(), motion, options, 1);
  EXPECT_TRUE(again.from_cache);
  EXPECT_EQ(again.key, first.key);
  ASSERT_EQ(again.trace.servo.size(), first.trace.servo.size());
  EXPECT_EQ(again.trace.servo[70].forces_W, first.trace.servo[70].forces_W);
  EXPECT_NEAR(again.trace.samples[2].delivered_s - first.trace.samples[2].delivered_s, 0.05, 1e-12);
  options.patch_radius_m = 0.03;
  EXPECT_FALSE(make_pair_trace(little_block(), motion, options, 1).from_cache);
  std::filesystem::remove_all(options.cache);
}

TEST(PairReference, RefusesWhatItCannotMake) {
  const PairMotion motion("poke");
  PairTraceOptions options = short_trace();
  options.seconds = 1.0;
  EXPECT_THROW(make_pair_trace(little_block(), motion, options, 1), ChartError);
  options = short_trace();
  options.delay_s = -0.1;
  EXPECT_THROW(make_pair_trace(little_block(), motion, options, 1), ChartError);
  options = short_trace();
  options.noise_N = 2.0;
  EXPECT_THROW(make_pair_trace(little_block(), motion, options, 1), ChartError);
  options = short_trace();
  options.servo_rate_Hz = 20.0;
  EXPECT_THROW(make_pair_trace(little_block(), motion, options, 1), ChartError);
  options = short_trace();
  options.cache = "/proc/no folder";
  EXPECT_THROW(make_pair_trace(little_block(), motion, options, 1), ChartError);
  options = short_trace();
  options.patch_radius_m = 1e-4;
  simulator::SpringMesh aside = little_block();
  for (Vector3d& position_W : aside.rest_position_W) {
    position_W.x() += 0.003;
  }
  EXPECT_THROW(make_pair_trace(aside, motion, options, 1), ChartError);
}

}  // namespace
}  // namespace forcegrid::evaluation
