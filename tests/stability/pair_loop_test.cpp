// SPDX-License-Identifier: Apache-2.0
#include "stability/pair_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include "evaluation/files/error.h"
#include "evaluation/motions/pair_motions.h"
#include "evaluation/objects/force_table.h"
#include "forcegrid/pair_methods.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/shared_object.h"
#include "stability/pair_limits.h"
#include "stability/search.h"
#include "stability/theory.h"

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;

constexpr double kLinear = std::numeric_limits<double>::infinity();
constexpr double kScanStep = 0.022;  // of StiffnessScan

const PairMethodMaker kExact = [] { return nullptr; };

PairMethodMaker maker(const std::string& name) {
  return [name] { return make_pair_force_method(name, {}); };
}

PairObjectMaker springs(double hardens_m) {
  return [hardens_m](double k) { return std::make_unique<SpringPair>(k, hardens_m); };
}

// Exact, linear and without quantisation: what the theory of sampled springs is about.
PairLoopSetup textbook() {
  PairLoopSetup setup;
  setup.hand = hand_of("light");
  setup.timing = device_timing("ideal");
  setup.device.position_step_m = 0.0;
  setup.device.max_force_N = kLinear;
  setup.object = springs(kLinear);
  return setup;
}

double limit_N_per_m(const PairLoopSetup& setup, const PairMethodMaker& make) {
  return find_limit([&](double k) { return run_pair_loop(setup, k, make).behaviour; })
      .largest_stable_N_per_m;
}

TEST(SpringPair, IsTheGradientOfItsEnergy) {
  SpringPair object(300.0);
  const double k = 300.0 / (1.0 + SpringPair::kBetween);
  const auto well_J = [k](const Vector3d& d) {
    const double r2 = d.squaredNorm();
    return k * (0.5 * r2 + 0.25 * r2 * r2 / (SpringPair::kHardens_m * SpringPair::kHardens_m));
  };
  const auto energy_J = [&](const PairVector& p) {
    const Vector3d first = p.head<3>();
    const Vector3d second = p.tail<3>();
    return well_J(first) + well_J(second) + SpringPair::kBetween * well_J(first - second);
  };
  const PairVector at = (PairVector() << 0.004, -0.003, 0.006, -0.002, 0.005, 0.001).finished();
  constexpr double kStep_m = 1e-5;
  for (int c = 0; c < 6; ++c) {
    const PairVector step = kStep_m * PairVector::Unit(c);
    EXPECT_NEAR(object.forces_N(at)[c],
                -(energy_J(at + step) - energy_J(at - step)) / (2.0 * kStep_m), 1e-6);
  }
  // K is what a tool feels at rest while the other one stands still.
  EXPECT_NEAR(object.forces_N(1e-6 * PairVector::Unit(1))[1], -300.0 * 1e-6, 1e-9);
}

void expect_stiffness_is_the_forces_gradient(PairObject& object, const PairVector& at,
                                             double step_m, double tolerance_N_per_m) {
  object.forces_N(at);
  const PairMatrix stiffness = object.stiffness_N_per_m().value();
  for (int c = 0; c < 6; ++c) {
    const PairVector step = step_m * PairVector::Unit(c);
    const PairVector numerical =
        (object.forces_N(at + step) - object.forces_N(at - step)) / (2.0 * step_m);
    EXPECT_LT((stiffness.col(c) - numerical).cwiseAbs().maxCoeff(), tolerance_N_per_m) << c;
  }
}

const PairVector kAside_m = (PairVector() << 0.004, -0.003, 0.006, -0.002, 0.005, 0.001).finished();

TEST(SpringPair, KnowsItsStiffness) {
  SpringPair object(300.0);
  expect_stiffness_is_the_forces_gradient(object, kAside_m, 1e-5, 1e-3);
}

TEST(ScenePair, HasTheStiffnessItIsAskedForAndKnowsHowItChanges) {
  const auto object = pair_object_of("small")(300.0);
  EXPECT_LT(object->forces_N(PairVector::Zero()).norm(), 1e-3);
  EXPECT_NEAR(object->forces_N(1e-3 * PairVector::Unit(2))[2], -0.3, 0.02);
  // The solver's tolerance for sensitivities is 5 %.
  expect_stiffness_is_the_forces_gradient(*object, kAside_m, 2e-4, 0.05 * 300.0);
}

// In double precision, to 1e-6, and in one go from rest instead of along the loop's path.
TEST(ScenePair, HasTheForcesOfTheReferenceSolution) {
  const auto object = pair_object_of("small")(1.0);
  object->forces_N(0.5 * kAside_m);
  const PairVector found_N = object->forces_N(kAside_m);

  const auto scene = simulator::make_scene("small", evaluation::first_contact_point_W());
  simulator::SolverOptions exactly;
  exactly.relative_tolerance = 1e-6;
  exactly.max_iterations = 2000;
  simulator::SharedObject<double> reference(scene.mesh, exactly, 2);
  const PairVector points_W = evaluation::PairMotion::contact_points_W();
  reference.grab(0, points_W.head<3>(), scene.patch_radius_m);
  reference.grab(1, points_W.tail<3>(), scene.patch_radius_m);
  reference.solve();
  const double stiffness_N_per_m = -reference.equilibrium(0).stiffness_W(2, 2);
  reference.aim(0, kAside_m.head<3>());
  reference.aim(1, kAside_m.tail<3>());
  reference.solve();
  PairVector expected_N;
  expected_N << reference.equilibrium(0).force_W, reference.equilibrium(1).force_W;
  expected_N /= stiffness_N_per_m;
  EXPECT_LT((found_N - expected_N).norm(), 2e-3 * expected_N.norm());
}

TEST(ScenePair, RefusesScenesThatTwoToolsCannotHold) {
  EXPECT_THROW(pair_object_of("no_such_scene"), simulator::Error);
  EXPECT_THROW(pair_object_of("small_slide"), simulator::Error);

  const std::filesystem::path file =
      std::filesystem::path(::testing::TempDir()) / "narrow_scene.toml";
  std::ofstream(file) << "description = \"Cube of 20 mm\"\n[[object]]\nshape = \"block\"\n"
                         "vertex_count = [5, 5, 5]\nsize_m = [0.02, 0.02, 0.02]\n"
                         "stiffness_N_per_m = 20.0\nlaw = \"linear\"\n";
  EXPECT_THROW(pair_object_of(file.string())(100.0), evaluation::ChartError);
  std::filesystem::remove(file);
}

// One tool moves: the loop is that of a spring K. Both move: the normal mode in which they move
// against each other is stiffest, K (1 + 2c) / (1 + c).
TEST(PairLoop, HasTheLimitsOfTheEigenvaluesOfItsNormalModes) {
  PairLoopSetup setup = textbook();
  const double spring_N_per_m = eigenvalue_limit_N_per_m(
      sampled_spring(setup.device, setup.hand, 1.0 / setup.servo_rate_Hz, 0.0));
  setup.together = false;
  EXPECT_NEAR(limit_N_per_m(setup, kExact) / spring_N_per_m, 1.0, 2.0 * kScanStep);
  setup.together = true;
  EXPECT_NEAR(limit_N_per_m(setup, kExact) / spring_N_per_m,
              (1.0 + SpringPair::kBetween) / (1.0 + 2.0 * SpringPair::kBetween), 2.0 * kScanStep);
}

// hold renews its force at the simulator's ticks, a period late: the same theory with that period
// and age. The simulator's period is a whole number of cycles here.
TEST(PairLoop, HasTheLimitOfHoldAtTheSimulatorsRateAndDelay) {
  PairLoopSetup setup = textbook();
  setup.together = false;
  setup.simulator_rate_Hz = 25.0;
  setup.hold_s = 40.0;
  for (const double delay_s : {0.0, 0.1}) {
    setup.delay_s = {delay_s, 0.0};
    const double spring_N_per_m =
        eigenvalue_limit_N_per_m(sampled_spring(setup.device, setup.hand, 0.04, 0.04 + delay_s));
    EXPECT_NEAR(limit_N_per_m(setup, maker("hold")) / spring_N_per_m, 1.0, 0.06) << delay_s;
  }
}

TEST(PairLoop, RendersExactForcesWithoutErrorUnlessTheOthersPositionIsOld) {
  PairLoopSetup setup = textbook();
  setup.object = springs(SpringPair::kHardens_m);
  EXPECT_EQ(run_pair_loop(setup, 200.0, kExact).force_error_percent, 0.0);
  setup.other_age_s = {0.05, 0.05};
  EXPECT_GT(run_pair_loop(setup, 200.0, kExact).force_error_percent, 1.0);
}

// Around both sides of a linear loop only the sum of the ages counts, and a place that is moved on
// costs less.
TEST(PairLoop, APlaceThatIsACycleOldCostsLittleStiffnessWhereItIsMovedOn) {
  PairLoopSetup setup;
  setup.hand = hand_of("light");
  setup.timing = device_timing("ideal");
  const double fresh_N_per_m = limit_N_per_m(setup, kExact);
  const double cycle_s = 1.0 / setup.servo_rate_Hz;
  setup.other_age_s = {0.0, 2.0 * cycle_s};
  const double one_side_N_per_m = limit_N_per_m(setup, kExact);
  setup.other_age_s = {cycle_s, cycle_s};
  EXPECT_NEAR(limit_N_per_m(setup, kExact) / one_side_N_per_m, 1.0, 0.03);
  EXPECT_LT(one_side_N_per_m, 0.7 * fresh_N_per_m);
  setup.other_age_s = {0.0, cycle_s};
  const double kept_N_per_m = limit_N_per_m(setup, kExact);
  EXPECT_LT(kept_N_per_m, 0.85 * fresh_N_per_m);
  setup.moved_on = true;
  EXPECT_GE(limit_N_per_m(setup, kExact), 0.95 * fresh_N_per_m);
}

TEST(PairLoop, IsStableWithTheCoupledMethodWhereUncoupledOnesAreNot) {
  PairLoopSetup setup;
  setup.hand = hand_of("light");
  setup.timing = device_timing("ideal");
  setup.delay_s = {0.0, 0.1};
  const PairLoopResult coupled = run_pair_loop(setup, 1500.0, maker("kriging-6d"));
  EXPECT_EQ(coupled.behaviour, Behaviour::kStable);
  EXPECT_LT(coupled.force_error_percent, 1.0);
  EXPECT_NE(run_pair_loop(setup, 1500.0, maker("kriging")).behaviour, Behaviour::kStable);
}

TEST(PairLoop, GivesTheSameResultToTheLastBit) {
  PairLoopSetup setup;
  setup.hand = hand_of("firm");
  setup.timing = device_timing("w2_full_speed");
  const PairLoopResult once = run_pair_loop(setup, 500.0, maker("auto-6d"));
  const PairLoopResult again = run_pair_loop(setup, 500.0, maker("auto-6d"));
  EXPECT_EQ(once.force_error_percent, again.force_error_percent);
  EXPECT_EQ(once.hold_peak_to_peak_m, again.hold_peak_to_peak_m);
}

// A mesh that is solved in every cycle, and at the simulator's ticks for the methods.
TEST(PairLoop, RunsOnASolvedObject) {
  PairLoopSetup setup;
  setup.hand = hand_of("light");
  setup.timing = device_timing("ideal");
  setup.object = pair_object_of("small");
  const PairLoopResult exact = run_pair_loop(setup, 500.0, kExact);
  EXPECT_EQ(exact.behaviour, Behaviour::kStable);
  EXPECT_EQ(exact.force_error_percent, 0.0);
  const PairLoopResult coupled = run_pair_loop(setup, 500.0, maker("auto-6d"));
  EXPECT_EQ(coupled.behaviour, Behaviour::kStable);
  const PairLoopResult uncoupled = run_pair_loop(setup, 500.0, maker("kriging"));
  EXPECT_LT(coupled.force_error_percent, 0.5 * uncoupled.force_error_percent);
  setup.judged = false;
  EXPECT_NE(run_pair_loop(setup, 500.0, maker("hold")).behaviour, Behaviour::kStable);
}

TEST(PairLoop, GivesTheObjectsStiffnessWithItsSamples) {
  PairLoopSetup setup;
  setup.hand = hand_of("light");
  setup.timing = device_timing("ideal");
  const double without = run_pair_loop(setup, 500.0, maker("auto-6d")).force_error_percent;
  setup.stiffness = true;
  EXPECT_LT(run_pair_loop(setup, 500.0, maker("auto-6d")).force_error_percent, without);
}

// Exact rendering that is found once for all networks without ages is that of each of them.
TEST(PairLimits, ShareTheSearchOfExactRendering) {
  PairLimitOptions options;
  options.methods = {"hold"};
  options.quick = true;
  const auto rows = pair_limits(options);
  PairLoopSetup late;
  late.hand = hand_of("light");
  late.timing = device_timing("ideal");
  late.delay_s = {0.0, 0.1};
  for (const PairLimitRow& row : rows) {
    if (row.cell.method == kExactPair && row.cell.network == "late") {
      EXPECT_EQ(row.limit.largest_stable_N_per_m, limit_N_per_m(late, kExact));
    }
  }
}

TEST(PairLoop, RefusesImpossibleLoops) {
  const auto refused = [](void (*change)(PairLoopSetup&)) {
    PairLoopSetup setup = textbook();
    change(setup);
    EXPECT_THROW(run_pair_loop(setup, 100.0, kExact), std::invalid_argument);
  };
  refused([](PairLoopSetup& s) { s.servo_rate_Hz = 10.0; });
  refused([](PairLoopSetup& s) { s.simulator_rate_Hz = 0.0; });
  refused([](PairLoopSetup& s) { s.delay_s[1] = -0.1; });
  refused([](PairLoopSetup& s) { s.other_age_s[1] = 2.0; });
  refused([](PairLoopSetup& s) { s.hold_s = 1.0; });
  refused([](PairLoopSetup& s) {
    s.timing = device_timing("w2_full_speed");
    s.servo_rate_Hz = 4000.0;
  });
}

TEST(PairLimits, CompareEveryLoopWithExactRendering) {
  PairLimitOptions options;
  options.methods = {"kriging-6d samples=8"};
  options.quick = true;
  options.jobs = 1;
  const auto rows = pair_limits(options);
  ASSERT_EQ(rows.size(), 2U * (1U + pair_networks().size()));
  for (std::size_t i = 0; i < rows.size(); i += 2) {
    EXPECT_EQ(rows[i].cell.method, kExactPair);
    EXPECT_EQ(rows[i].relative_to_exact, 1.0);
    EXPECT_EQ(rows[i + 1].relative_to_exact,
              rows[i + 1].limit.largest_stable_N_per_m / rows[i].limit.largest_stable_N_per_m);
  }
  EXPECT_GT(least_relative_limit(rows, kSprings, "kriging-6d samples=8"), 0.9);
  EXPECT_TRUE(std::isnan(least_relative_limit(rows, kSprings, "hold")));

  const std::filesystem::path folder =
      std::filesystem::path(::testing::TempDir()) / "pair_limits_test";
  std::filesystem::create_directories(folder);
  const auto files = write_pair_limits(folder, rows);
  const auto content = [](const std::filesystem::path& file) {
    std::ifstream stream(file);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  EXPECT_THAT(content(files[0]), ::testing::HasSubstr("\nexact,500,0,"));
  EXPECT_THAT(content(files[1]),
              ::testing::HasSubstr("| springs | light | 500 Hz | one | local | "));
  std::filesystem::remove_all(folder);
}

TEST(PairLimits, RefuseAMethodThatCannotBeMade) {
  PairLimitOptions options;
  options.methods = {"tangent"};
  EXPECT_THROW(pair_limits(options), std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid::stability
