// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/reduced_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/organ_surface.h"
#include "simulator/solver/reduced_springs.h"
#include "simulator/solver/reduced_training.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr std::uint64_t kSeed = 7;

// Energy, force and stiffness of the same springs, plainly and in double.
double energy_J(const std::vector<ReducedSprings::Chosen>& springs, const Eigen::VectorXd& z) {
  double sum_J = 0.0;
  for (const ReducedSprings::Chosen& spring : springs) {
    const double length_m = (spring.edge_m + spring.basis * z).norm();
    const double e = length_m * spring.law.inverse_length_per_m - 1.0;
    const double a = spring.law.exponent;
    const double g = a > 0.0 ? (std::cosh(a * e) - 1.0) / (a * a) : e * e / 2.0;
    sum_J += spring.weight * spring.law.scale_N / spring.law.inverse_length_per_m *
             (g + spring.law.cubic * std::pow(e, 4) / 4.0);
  }
  return sum_J;
}

std::vector<ReducedSprings::Chosen> random_springs(int coordinates, std::size_t count) {
  std::mt19937_64 numbers(kSeed);
  std::normal_distribution<double> normal;
  std::vector<ReducedSprings::Chosen> springs(count);
  for (std::size_t s = 0; s < count; ++s) {
    ReducedSprings::Chosen& spring = springs[s];
    spring.edge_m = 0.005 * Vector3d(normal(numbers), normal(numbers), normal(numbers));
    spring.basis = Eigen::Matrix3Xd::NullaryExpr(3, coordinates, [&] { return normal(numbers); });
    const double length_m = 0.9 * spring.edge_m.norm();
    spring.law = {1.0 / length_m, 10.0 * length_m, s % 2 == 0 ? 5.0 : 0.0, s % 3 == 0 ? 4.0 : 0.0};
    spring.weight = 0.5 + static_cast<double>(s % 4);
  }
  return springs;
}

TEST(ReducedSprings, ForceAndStiffnessAreTheEnergysDerivatives) {
  SCOPED_TRACE(kSeed);
  constexpr int kCoordinates = 7;
  for (const std::size_t count : {0U, 1U, 16U, 37U}) {
    const auto chosen = random_springs(kCoordinates, count);
    ReducedSprings springs(kCoordinates, chosen);
    const Eigen::VectorXd z = Eigen::VectorXd::LinSpaced(kCoordinates, -3e-4, 4e-4);
    const auto at = [&](const Eigen::VectorXd& where, Eigen::MatrixXd& stiffness) {
      Eigen::VectorXd force(kCoordinates);
      stiffness.resize(kCoordinates, kCoordinates);
      springs.evaluate(where.data(), force.data(), stiffness.data());
      return force;
    };
    Eigen::MatrixXd stiffness;
    Eigen::MatrixXd unused;
    const Eigen::VectorXd force = at(z, stiffness);
    constexpr double kStep_m = 1e-6;
    for (int i = 0; i < kCoordinates; ++i) {
      const Eigen::VectorXd step = kStep_m * Eigen::VectorXd::Unit(kCoordinates, i);
      const double slope = (energy_J(chosen, z + step) - energy_J(chosen, z - step)) / 2e-6;
      EXPECT_NEAR(force[i], -slope, 1e-5 * force.norm() + 1e-12);
      // The forces are single precision: a longer step.
      const Eigen::VectorXd bent =
          (at(z - 50.0 * step, unused) - at(z + 50.0 * step, unused)) / 1e-4;
      EXPECT_LT((stiffness.col(i) - bent).norm(), 2e-2 * stiffness.norm() + 1e-12);
    }
    EXPECT_LT((stiffness - stiffness.transpose()).norm(), 1e-12);
  }
}

SpringMesh block(const SpringLaw& law) {
  LatticeBlockOptions options;
  options.vertex_count = {9, 9, 8};
  options.law = law;
  return make_lattice_block(options);
}

SpringMesh surface() {
  OrganOptions options;
  options.vertex_count = 500;
  options.edge_count = 1400;
  options.stiffness_N_per_m = 6.0;
  options.pre_strain = 0.5;
  options.home_stiffness_N_per_m = 5.0;
  return make_organ_surface(options);
}

constexpr double kPatch_m = 0.013;

// A closed curve through a box of 16 x 16 x 14 mm above the surface, and another one.
Vector3d training_place_W(double t) {
  return 1e-3 * Vector3d(8.0 * std::sin(1.1 * t), 8.0 * std::sin(1.7 * t + 0.4),
                         7.0 - 7.0 * std::cos(0.9 * t));
}
Vector3d test_place_W(double t) {
  return 1e-3 * Vector3d(6.5 * std::sin(2.3 * t + 0.8), 6.5 * std::cos(1.3 * t),
                         7.0 + 5.5 * std::sin(0.7 * t));
}

ReducedTrainingSet states_of(const SpringMesh& mesh) {
  ElasticObject<float> full(mesh, {.relative_tolerance = 3e-4});
  EXPECT_GT(full.grab(mesh.top_W, kPatch_m), 0);
  ReducedTrainingSet set = begin_training_set(mesh, full);
  for (int k = 1; k <= 300; ++k) {
    add_state(mesh, full, full.move_to(training_place_W(0.1 * k)), {.apart_m = 2e-3}, set);
  }
  return set;
}

struct Difference {
  double force = 0.0;      // RMS over RMS
  double stiffness = 0.0;  // the same of dF/dP
};

// Against the object itself, converged, along another motion.
Difference difference(const SpringMesh& mesh, ReducedModel model) {
  ElasticObject<double> converged(mesh, {.relative_tolerance = 1e-7, .max_iterations = 2000});
  converged.grab(mesh.top_W, kPatch_m);
  double error2 = 0.0;
  double all2 = 0.0;
  double stiffness_error2 = 0.0;
  double stiffness2 = 0.0;
  for (int k = 0; k < 60; ++k) {
    const Equilibrium expected = converged.move_to(test_place_W(0.15 * k));
    const Equilibrium answer = model.move_to(test_place_W(0.15 * k));
    EXPECT_TRUE(answer.converged) << k;
    error2 += (answer.force_W - expected.force_W).squaredNorm();
    all2 += expected.force_W.squaredNorm();
    stiffness_error2 += (answer.stiffness_W - expected.stiffness_W).squaredNorm();
    stiffness2 += expected.stiffness_W.squaredNorm();
  }
  return {std::sqrt(error2 / all2), std::sqrt(stiffness_error2 / stiffness2)};
}

TEST(ReducedModel, GivesTheConvergedForceAlongAMotionThatItWasNotTrainedOn) {
  for (const SpringLaw& law : {SpringLaw{}, SpringLaw{.cubic_coefficient = 5.0},
                               SpringLaw{.cubic_coefficient = 0.0, .exponent = 4.0}}) {
    const SpringMesh mesh = block(law);
    const ReducedTraining training = train_reduced_model(mesh, states_of(mesh));
    ASSERT_TRUE(training.model.has_value());
    EXPECT_LT(training.model->springs(), mesh.springs.size() / 10);
    EXPECT_LE(training.cubature_error, ReducedTrainingOptions{}.cubature_tolerance);
    EXPECT_LT(training.training_error, 2e-3);
    const Difference off = difference(mesh, *training.model);
    EXPECT_LT(off.force, 2e-3) << law.exponent;
    EXPECT_LT(off.stiffness, 2e-2) << law.exponent;
  }
}

TEST(ReducedModel, KnowsHomeSpringsAndDeadLoads) {
  const SpringMesh mesh = surface();
  const ReducedTraining training = train_reduced_model(mesh, states_of(mesh));
  ReducedModel model = *training.model;
  ElasticObject<double> whole(mesh, {.relative_tolerance = 1e-7, .max_iterations = 2000});
  whole.grab(mesh.top_W, kPatch_m);
  const Equilibrium rest = whole.move_to(Vector3d::Zero());
  const Equilibrium reduced_rest = model.move_to(Vector3d::Zero());
  EXPECT_LT((reduced_rest.force_W - rest.force_W).norm(), 1e-4);
  EXPECT_LT((reduced_rest.stiffness_W - rest.stiffness_W).norm(), 2e-2 * rest.stiffness_W.norm());
  EXPECT_LT(difference(mesh, model).force, 1e-2);
}

TEST(ReducedModel, MoreModesAndSpringsBringItNearerToTheObject) {
  const SpringMesh mesh = block({.cubic_coefficient = 5.0});
  const ReducedTrainingSet set = states_of(mesh);
  double before = 1.0;
  for (const int modes : {1, 4, 12}) {
    const ReducedTraining training = train_reduced_model(
        mesh, set, {.mode_tolerance = 1e-9, .most_modes = modes, .cubature_tolerance = 1e-4});
    EXPECT_EQ(training.model->modes(), modes);
    const double off = difference(mesh, *training.model).force;
    EXPECT_LT(off, 0.6 * before) << modes;
    before = off;
  }
  const double coarse =
      difference(mesh, *train_reduced_model(mesh, set, {.most_springs = 12}).model).force;
  EXPECT_GT(coarse, 2.0 * before);
}

TEST(ReducedModel, ItsStatesAreNearTheObjects) {
  const SpringMesh mesh = block({.cubic_coefficient = 5.0});
  ReducedTraining training = train_reduced_model(mesh, states_of(mesh));
  ElasticObject<float> full(mesh, {.relative_tolerance = 3e-4});
  full.grab(mesh.top_W, kPatch_m);
  const Equilibrium answer = full.move_to(test_place_W(2.0));
  const ReducedSnapshot state = take_snapshot(mesh, full, answer);
  training.model->move_to(state.displacement_W);
  const Eigen::VectorXf moved_m = training.basis * training.model->coordinates().cast<float>();
  EXPECT_LT((moved_m - state.moved_m).norm(), 0.02F * state.moved_m.norm());
}

TEST(ReducedModel, LongMovesAndWrongPlacesLeaveItUsable) {
  const SpringMesh mesh = block({.cubic_coefficient = 5.0});
  ReducedModel model = *train_reduced_model(mesh, states_of(mesh)).model;
  const Vector3d place_W = test_place_W(1.0);
  const Equilibrium first = model.move_to(place_W);
  model.move_to(training_place_W(3.0));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Equilibrium lost = model.move_to({nan, 0.0, 0.0});
  EXPECT_FALSE(lost.converged);
  EXPECT_FALSE(lost.reached);
  const Equilibrium far = model.move_to({0.5, 0.5, 0.5});
  EXPECT_TRUE(!far.converged || far.force_W.allFinite());
  const Equilibrium again = model.move_to(place_W);
  EXPECT_TRUE(again.converged);
  EXPECT_LT((again.force_W - first.force_W).norm(), 1e-3 * first.force_W.norm());
  EXPECT_NEAR(model.distance_m({0.3, 0.0, 0.0}), 0.3, 0.02);
}

template <typename Function>
std::string message_of(Function function) {
  try {
    function();
  } catch (const Error& error) {
    return error.what();
  }
  return "nothing was thrown";
}

TEST(ReducedTraining, RefusesWhatItCannotTrainOn) {
  const SpringMesh mesh = block({.cubic_coefficient = 5.0});
  ElasticObject<float> full(mesh);
  full.grab(mesh.top_W, kPatch_m);
  ReducedTrainingSet set = begin_training_set(mesh, full);
  EXPECT_THAT(message_of([&] { train_reduced_model(mesh, set); }), HasSubstr("no states"));
  add_state(mesh, full, full.move_to({0.0, 0.0, 0.003}), {}, set);
  EXPECT_THAT(message_of([&] { train_reduced_model(surface(), set); }), HasSubstr("another mesh"));
  EXPECT_THAT(message_of([&] { train_reduced_model(mesh, set, {.most_modes = 46}); }),
              HasSubstr("most_modes is 46"));
  EXPECT_THAT(message_of([&] { train_reduced_model(mesh, set, {.mode_tolerance = 0.0}); }),
              HasSubstr("mode_tolerance"));
  const std::atomic<bool> cancel{true};
  EXPECT_FALSE(train_reduced_model(mesh, set, {.cancel = &cancel}).model.has_value());
}

TEST(ReducedTraining, KeepsStatesThatAreNewAndConverged) {
  const SpringMesh mesh = block({.cubic_coefficient = 5.0});
  ElasticObject<float> full(mesh);
  full.grab(mesh.top_W, kPatch_m);
  ReducedTrainingSet set = begin_training_set(mesh, full);
  const StateSpacing spacing{.apart_m = 2e-3, .most_states = 2};
  EXPECT_FALSE(add_state(mesh, full, full.move_to({0.0, 0.0, 0.0019}), spacing, set));
  EXPECT_TRUE(add_state(mesh, full, full.move_to({0.0, 0.0, 0.003}), spacing, set));
  EXPECT_FALSE(add_state(mesh, full, full.move_to({0.001, 0.0, 0.003}), spacing, set));
  Equilibrium bad = full.move_to({0.004, 0.0, 0.003});
  bad.converged = false;
  EXPECT_FALSE(add_state(mesh, full, bad, spacing, set));
  EXPECT_TRUE(add_state(mesh, full, full.move_to({0.004, 0.0, 0.003}), spacing, set));
  EXPECT_FALSE(add_state(mesh, full, full.move_to({-0.004, 0.0, 0.003}), spacing, set));
}

}  // namespace
}  // namespace forcegrid::simulator
