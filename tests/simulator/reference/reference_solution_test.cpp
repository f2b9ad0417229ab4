// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/reference_solution.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

const Vector3d kContact(0.001, -0.002, -0.0005);

// 3-D motion about the contact point at 500 Hz with a hold (repeated positions) in its middle.
std::vector<Vector3d> path(int cycles) {
  std::vector<Vector3d> positions;
  for (int i = 0; i < cycles; ++i) {
    const int moving = i < cycles / 2 ? i : std::max(cycles / 2, i - 20);
    const double t = 0.002 * moving;
    constexpr double kTwoPi = 2.0 * std::numbers::pi;
    positions.push_back(kContact + Vector3d(0.006 * std::sin(kTwoPi * 0.7 * t),
                                            0.005 * std::sin(kTwoPi * 1.1 * t),
                                            0.008 * (1.0 - std::cos(kTwoPi * 0.9 * t))));
  }
  return positions;
}

ReferenceOptions options_for(unsigned threads) {
  ReferenceOptions options;
  options.scene = "small";
  options.contact_point_W = kContact;
  options.threads = threads;
  return options;
}

TEST(SimulateReference, PartsOnSeveralThreadsAgreeWithOneThread) {
  const auto positions = path(600);
  const ReferenceSolution one = simulate_reference(positions, options_for(1));
  const ReferenceSolution three = simulate_reference(positions, options_for(3));
  EXPECT_EQ(one.threads, 1U);
  EXPECT_EQ(three.threads, 3U);
  EXPECT_EQ(one.unconverged, 0U);
  EXPECT_EQ(three.unconverged, 0U);
  EXPECT_LE(one.worst_relative_residual, 1e-6);
  EXPECT_LT(three.worst_seam_N, 1e-6);
  double largest_N = 0.0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    EXPECT_EQ(one.known[i], 1);
    EXPECT_LT((one.forces_W[i] - three.forces_W[i]).norm(), 1e-6) << i;
    largest_N = std::max(largest_N, one.forces_W[i].norm());
  }
  EXPECT_GT(largest_N, 1.0);
}

TEST(SimulateReference, IsFarCloserToAFinerSolutionThanItsTolerance) {
  const auto positions = path(200);
  const ReferenceSolution reference = simulate_reference(positions, options_for(1));
  SolverOptions finer;
  finer.relative_tolerance = 1e-9;
  finer.max_iterations = 4000;
  ElasticObject<double> object(make_scene("small").mesh, finer);
  object.grab(kContact, 0.012);
  for (std::size_t i = 0; i < positions.size(); i += 10) {
    const Equilibrium exact = object.move_to(positions[i] - kContact);
    ASSERT_TRUE(exact.converged);
    EXPECT_LT((reference.forces_W[i] - exact.force_W).norm(),
              1e-6 * std::max(exact.force_W.norm(), 0.05))
        << i;
  }
}

TEST(SimulateReference, ForcesAreZeroBeforeContact) {
  auto positions = path(100);
  positions.insert(positions.begin(), 30, kContact + Vector3d(0, 0, 0.05));
  ReferenceOptions options = options_for(1);
  options.first_contact_cycle = 30;
  const ReferenceSolution shifted = simulate_reference(positions, options);
  const ReferenceSolution plain = simulate_reference(path(100), options_for(1));
  for (std::size_t i = 0; i < 30; ++i) {
    EXPECT_EQ(shifted.forces_W[i], Vector3d::Zero());
    EXPECT_EQ(shifted.known[i], 1);
  }
  EXPECT_EQ(shifted.forces_W[90], plain.forces_W[60]);
}

TEST(SimulateReference, ReportsProgressUpToTheEnd) {
  ReferenceOptions options = options_for(2);
  std::vector<double> fractions;
  options.progress = [&fractions](double done, double remaining_s) {
    EXPECT_GE(remaining_s, 0.0);
    fractions.push_back(done);
  };
  simulate_reference(path(300), options);
  ASSERT_FALSE(fractions.empty());
  EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
  EXPECT_EQ(fractions.back(), 1.0);
}

TEST(SimulateReference, CancelledItSaysWhatIsKnown) {
  const std::atomic<bool> cancel{true};
  ReferenceOptions options = options_for(2);
  options.cancel = &cancel;
  const ReferenceSolution reference = simulate_reference(path(2000), options);
  EXPECT_TRUE(reference.cancelled);
  EXPECT_EQ(reference.known.back(), 0);
  EXPECT_EQ(reference.forces_W.size(), 2000U);
  EXPECT_TRUE(reference.to_json().at("cancelled"));
}

TEST(SimulateReference, RefusesWhatItCannotSolveByName) {
  const auto message = [](const std::vector<Vector3d>& positions, const ReferenceOptions& options) {
    try {
      simulate_reference(positions, options);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  ReferenceOptions options = options_for(1);
  options.scene = "nothing";
  EXPECT_THAT(message(path(10), options), HasSubstr("unknown scene 'nothing'"));
  options = options_for(1);
  options.contact_point_W = {0, 0, 1};
  EXPECT_THAT(message(path(10), options), HasSubstr("contact point"));
  options = options_for(1);
  options.first_contact_cycle = 10;
  EXPECT_THAT(message(path(10), options), HasSubstr("begins at cycle 10"));
  options = options_for(1);
  options.relative_tolerance = 0.0;
  EXPECT_THAT(message(path(10), options), HasSubstr("relative_tolerance"));
  auto positions = path(10);
  positions[4].y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message(positions, options_for(1)), HasSubstr("position 4"));
}

}  // namespace
}  // namespace forcegrid::simulator
