// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/dynamic_object.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "simulator/mesh/error.h"
#include "simulator/mesh/gravity.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/vertex_masses.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kStiffness_N_per_m = 40.0;
constexpr double kMass_kg = 0.1;  // of the vertex that is free
constexpr double kPull_m = 1e-3;
constexpr double kTangent = 1e-6;  // the springs' Hessian is in single precision
const double kOmega_rad_per_s = std::sqrt(kStiffness_N_per_m / kMass_kg);

// A mass that hangs 0.1 m below a fixed vertex.
SpringMesh one_mass(double retardation_time_s, double mass_damping_per_s = 0.0) {
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, 0}, {0, 0, -0.1}};
  mesh.fixed = {1, 0};
  mesh.springs = {{0, 1, kStiffness_N_per_m}};
  give_dynamics(mesh, {.mass_kg = 2.0 * kMass_kg,  // half of it at either end
                       .retardation_time_s = retardation_time_s,
                       .mass_damping_per_s = mass_damping_per_s});
  return mesh;
}

DynamicOptions steps_of(double step_s) {
  return {.step_s = step_s, .max_move_m = 1.0, .relative_tolerance = 1e-12};
}

double height_m(const DynamicObject& object, std::size_t vertex) {
  return object.positions_W()[vertex].z();
}

// Pulled down by kPull_m, held until it is still, and let go.
DynamicObject let_go_below(const SpringMesh& mesh, double step_s) {
  DynamicObject object(mesh, steps_of(step_s));
  EXPECT_EQ(object.grab(mesh.rest_position_W[1], 1e-6), 1);
  object.advance(step_s, {0, 0, -kPull_m});
  object.advance(step_s, {0, 0, -kPull_m});
  object.release();
  return object;
}

TEST(DynamicObject, OneMassOnASpringGoesAsTheMethodsOwnEigenvaluesSay) {
  const double step_s = 0.01;
  const double tau_s = 0.02;
  const double gamma_per_s = tau_s * kOmega_rad_per_s * kOmega_rad_per_s;
  DynamicObject object = let_go_below(one_mass(tau_s), step_s);
  // (1 + h gamma + h^2 omega^2) x+ - (2 + h gamma) x + x- = 0
  const double a = 1.0 + step_s * gamma_per_s + std::pow(step_s * kOmega_rad_per_s, 2);
  const double b = 2.0 + step_s * gamma_per_s;
  const std::complex<double> lambda =
      (b + std::sqrt(std::complex<double>(b * b - 4.0 * a))) / (2.0 * a);
  ASSERT_GT(lambda.imag(), 0.0) << "it has to swing";
  // x_0 = x_-1 = -kPull_m, x_n = Re(c lambda^n).
  const double x0_m = -kPull_m;
  const std::complex<double> back = 1.0 / lambda;
  const std::complex<double> c(x0_m, (x0_m * back.real() - x0_m) / back.imag());
  for (int n = 1; n <= 60; ++n) {
    object.advance(step_s, Vector3d::Zero());
    const double expected_m = (c * std::pow(lambda, n)).real();
    ASSERT_NEAR(height_m(object, 1) + 0.1, expected_m, kTangent * kPull_m) << "step " << n;
  }
}

// Height after a time, off the rest position, of the continuous equation.
double damped_swing_m(double time_s, double damping_per_s) {
  const double omega_d =
      std::sqrt(kOmega_rad_per_s * kOmega_rad_per_s - damping_per_s * damping_per_s);
  return -kPull_m * std::exp(-damping_per_s * time_s) *
         (std::cos(omega_d * time_s) + damping_per_s / omega_d * std::sin(omega_d * time_s));
}

TEST(DynamicObject, ShorterStepsTendToTheContinuousSwingAtFirstOrder) {
  const double time_s = 0.4;
  const double tau_s = 0.01;
  const double alpha_per_s = 2.0;
  const double decay_per_s = 0.5 * (tau_s * kOmega_rad_per_s * kOmega_rad_per_s + alpha_per_s);
  const double expected_m = damped_swing_m(time_s, decay_per_s);
  double before_m = 0.0;
  for (const double step_s : {1e-3, 0.5e-3, 0.25e-3}) {
    DynamicOptions options = steps_of(step_s);
    options.max_steps = 10'000;
    const SpringMesh mesh = one_mass(tau_s, alpha_per_s);
    DynamicObject object(mesh, options);
    ASSERT_EQ(object.grab(mesh.rest_position_W[1], 1e-6), 1);
    object.advance(1.0, {0, 0, -kPull_m});
    object.advance(1.0, {0, 0, -kPull_m});
    object.release();
    object.advance(time_s, Vector3d::Zero());
    const double error_m = height_m(object, 1) + 0.1 - expected_m;
    if (before_m != 0.0) {
      EXPECT_NEAR(before_m / error_m, 2.0, 0.1) << "step of " << step_s << " s";
    }
    before_m = error_m;
  }
  EXPECT_LT(std::abs(before_m), 0.02 * kPull_m);
}

TEST(DynamicObject, AWeightlessKelvinVoigtSpringCreepsBackWithItsRetardationTime) {
  SpringMesh mesh = one_mass(0.05);
  mesh.mass_kg = {1e-9, 1e-9};
  const double step_s = 1e-3;
  DynamicObject object = let_go_below(mesh, step_s);
  for (int n = 1; n <= 100; ++n) {
    object.advance(step_s, Vector3d::Zero());
    ASSERT_NEAR((height_m(object, 1) + 0.1) / -kPull_m, std::pow(1.0 + step_s / 0.05, -n), 1e-5);
  }
  // Twice the retardation time; the discrete factor differs from it by h / tau.
  EXPECT_NEAR((height_m(object, 1) + 0.1) / -kPull_m, std::exp(-2.0), 2.0 * step_s / 0.05);
}

TEST(DynamicObject, AToolFeelsSpringAndDamperWhileItMovesAndTheSpringAloneWhenItStands) {
  const double tau_s = 0.05;
  const SpringMesh mesh = one_mass(tau_s);
  DynamicObject object(mesh, steps_of(1e-3));
  ASSERT_EQ(object.grab(mesh.rest_position_W[1], 1e-6), 1);
  const double speed_m_per_s = 0.02;
  for (int n = 1; n <= 20; ++n) {
    const double down_m = speed_m_per_s * 5e-3 * n;
    const Vector3d force_W = object.advance(5e-3, {0, 0, -down_m}).force_W;
    EXPECT_NEAR(force_W.z(), kStiffness_N_per_m * (down_m + tau_s * speed_m_per_s), 1e-6);
  }
  const Equilibrium still = object.advance(5e-3, {0, 0, -2e-3});
  EXPECT_NEAR(still.force_W.z(), kStiffness_N_per_m * 2e-3, 1e-6);
  EXPECT_TRUE(still.converged);
}

TEST(DynamicObject, AWeightSwingsAboutWhereItSags) {
  SpringMesh mesh = one_mass(0.0);
  settle_under_gravity(mesh, 2.0 * kMass_kg, 9.81);
  const double sag_m = kMass_kg * 9.81 / kStiffness_N_per_m;
  DynamicObject object(mesh, steps_of(1e-4));
  object.advance(0.1, Vector3d::Zero());
  EXPECT_NEAR(height_m(object, 1), -0.1 - sag_m, 1e-7) << "at rest it stays";
  object = let_go_below(mesh, 1e-4);
  double sum_m = 0.0;
  const int steps =
      5 * static_cast<int>(std::lround(2.0 * std::numbers::pi / kOmega_rad_per_s / 1e-4));
  for (int n = 0; n < steps; ++n) {
    object.advance(1e-4, Vector3d::Zero());
    sum_m += height_m(object, 1) + 0.1 + sag_m;
  }
  EXPECT_LT(std::abs(sum_m / steps), 0.01 * kPull_m);
}

SpringMesh block(double retardation_time_s) {
  LatticeBlockOptions options;
  options.vertex_count = {6, 6, 5};
  options.size_m = {0.05, 0.05, 0.04};
  options.stiffness_N_per_m = 20.0;
  options.random_spread = 0.3;
  options.law.cubic_coefficient = 5.0;
  SpringMesh mesh = make_lattice_block(options);
  give_dynamics(mesh, {.mass_kg = 0.08, .retardation_time_s = retardation_time_s});
  return mesh;
}

TEST(DynamicObject, ComesToTheEquilibriumThatTheQuasiStaticSolverFinds) {
  const SpringMesh mesh = block(0.02);
  DynamicObject object(mesh, {.relative_tolerance = 1e-7});
  ElasticObject<double> still(mesh, {.relative_tolerance = 1e-7});
  const int held = object.grab(mesh.top_W, 0.012);
  ASSERT_GT(held, 0);
  ASSERT_EQ(still.grab(mesh.top_W, 0.012), held);
  for (const Vector3d& there_W : {Vector3d(0.004, -0.002, 0.005), Vector3d(-0.003, 0.0, -0.004)}) {
    object.advance(0.05, there_W);
    for (int n = 0; n < 60; ++n) {
      object.advance(0.05, there_W);
    }
    const Vector3d expected_W = still.move_to(there_W).force_W;
    const Equilibrium reached = object.advance(0.05, there_W);
    EXPECT_TRUE(reached.converged);
    EXPECT_LT((reached.force_W - expected_W).norm(), 1e-4 * expected_W.norm());
  }
}

Vector3d momentum_W(const SpringMesh& mesh, const DynamicObject& object, std::size_t first) {
  Vector3d sum = Vector3d::Zero();
  const std::vector<Vector3d> velocity_W = object.velocities_W();
  for (std::size_t i = first; i < velocity_W.size(); ++i) {
    sum += mesh.mass_kg[i] * velocity_W[i];
  }
  return sum;
}

TEST(DynamicObject, ABodyThatNothingHoldsKeepsItsMomentum) {
  // A square of four masses with diagonals; what is fixed is another body, beside it.
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, 0.5}, {0, 0, 0}, {0.02, 0, 0}, {0.02, 0.02, 0}, {0, 0.02, 0.01}};
  mesh.fixed = {1, 0, 0, 0, 0};
  mesh.springs = {{1, 2, 20.0}, {2, 3, 30.0}, {3, 4, 20.0},
                  {4, 1, 10.0}, {1, 3, 25.0}, {2, 4, 15.0}};
  give_dynamics(mesh, {.mass_kg = 0.05, .retardation_time_s = 0.01});
  DynamicObject object(mesh, {.step_s = 1e-3, .relative_tolerance = 1e-10});
  ASSERT_EQ(object.grab(mesh.rest_position_W[1], 1e-6), 1);
  object.advance(0.02, {0.002, -0.001, 0.001});
  object.release();
  const Vector3d thrown = momentum_W(mesh, object, 1);
  ASSERT_GT(thrown.norm(), 1e-4);
  for (int n = 0; n < 10; ++n) {
    object.advance(0.05, Vector3d::Zero());
    ASSERT_LT((momentum_W(mesh, object, 1) - thrown).norm(), 1e-6 * thrown.norm());
  }
}

// k l0^2 (e^2 / 2 + c e^4 / 4) of every spring, and the vertices' motion.
double energy_J(const SpringMesh& mesh, const DynamicObject& object) {
  const std::vector<Vector3d> position_W = object.positions_W();
  const std::vector<Vector3d> velocity_W = object.velocities_W();
  double sum_J = 0.0;
  for (const Spring& spring : mesh.springs) {
    const double l0_m = natural_length_m(mesh, spring);
    const double e = (position_W[static_cast<std::size_t>(spring.a)] -
                      position_W[static_cast<std::size_t>(spring.b)])
                             .norm() /
                         l0_m -
                     1.0;
    const double c = mesh.laws[static_cast<std::size_t>(spring.law)].cubic_coefficient;
    sum_J += spring.stiffness_N_per_m * l0_m * l0_m * (e * e / 2.0 + c * e * e * e * e / 4.0);
  }
  for (std::size_t i = 0; i < velocity_W.size(); ++i) {
    sum_J += 0.5 * mesh.mass_kg[i] * velocity_W[i].squaredNorm();
  }
  return sum_J;
}

TEST(DynamicObject, EnergyNeverGrowsWhileNobodyWorksOnIt) {
  for (const double tau_s : {0.0, 0.02}) {
    const SpringMesh mesh = block(tau_s);
    DynamicObject object(mesh);
    ASSERT_GT(object.grab(mesh.top_W, 0.012), 0);
    object.advance(0.1, {0.003, 0.002, 0.006});
    object.release();
    double before_J = energy_J(mesh, object);
    ASSERT_GT(before_J, 1e-4);
    const double begun_J = before_J;
    for (int n = 0; n < 200; ++n) {
      object.advance(2e-3, Vector3d::Zero());
      const double now_J = energy_J(mesh, object);
      ASSERT_LE(now_J, before_J + 1e-6 * begun_J) << "step " << n << ", tau " << tau_s << " s";
      before_J = now_J;
    }
    EXPECT_LT(before_J, 0.5 * begun_J);
  }
}

TEST(DynamicObject, AfterAPauseTheTimeIsMadeUpInLongerStepsAndItSaysSo) {
  const SpringMesh mesh = block(0.02);
  DynamicObject object(mesh);
  ASSERT_GT(object.grab(mesh.top_W, 0.012), 0);
  const Equilibrium usual = object.advance(0.033, {0, 0, 0.001});
  EXPECT_EQ(usual.steps, 17);
  EXPECT_FALSE(object.long_step());
  const Equilibrium late = object.advance(30.0, {0, 0, 0.004});
  EXPECT_EQ(late.steps, object.options().max_steps);
  EXPECT_TRUE(object.long_step());
  EXPECT_TRUE(late.converged);
  ElasticObject<double> still(mesh, {.relative_tolerance = 1e-6});
  still.grab(mesh.top_W, 0.012);
  const Vector3d expected_W = still.move_to({0, 0, 0.004}).force_W;
  EXPECT_LT((late.force_W - expected_W).norm(), 0.02 * expected_W.norm()) << "all but still";
}

TEST(DynamicObject, WhatCanNotBeChangesNothing) {
  const SpringMesh mesh = block(0.02);
  DynamicObject object(mesh);
  ASSERT_GT(object.grab(mesh.top_W, 0.012), 0);
  const Vector3d there_W(0, 0, 0.001);
  const Equilibrium before = object.advance(0.03, there_W);
  const std::vector<Vector3d> positions_W = object.positions_W();
  const double nan = std::nan("");
  for (const Equilibrium& refused :
       {object.advance(-1.0, there_W), object.advance(nan, there_W),
        object.advance(0.01, {0, nan, 0}), object.advance(0.0, {0, 0, 0.002})}) {
    EXPECT_FALSE(refused.reached);
    EXPECT_FALSE(refused.converged);
    EXPECT_EQ(refused.force_W, before.force_W);
    EXPECT_EQ(refused.displacement_W, there_W);
  }
  EXPECT_EQ(object.positions_W(), positions_W);
  EXPECT_TRUE(object.advance(0.0, there_W).reached);
}

TEST(DynamicObject, SwingsOnWhenItIsLetGoAndIsStillAfterRest) {
  const SpringMesh mesh = block(0.001);
  DynamicObject object(mesh);
  EXPECT_EQ(object.grab({1, 1, 1}, 0.01), 0);
  ASSERT_GT(object.grab(mesh.top_W, 0.012), 0);
  EXPECT_THROW(object.grab(mesh.top_W, 0.012), Error);
  object.advance(0.1, {0, 0, 0.005});
  object.release();
  EXPECT_FALSE(object.grabbed());
  EXPECT_EQ(object.advance(0.01, Vector3d::Zero()).force_W, Vector3d::Zero());
  EXPECT_GT(momentum_W(mesh, object, 0).norm(), 1e-5);
  object.rest();
  EXPECT_EQ(object.positions_W(), mesh.rest_position_W);
  EXPECT_EQ(momentum_W(mesh, object, 0), Vector3d::Zero());
}

TEST(DynamicObject, RefusesWhatHasNoMassesAndOptionsOutOfRange) {
  const auto complaint = [](const SpringMesh& mesh, const DynamicOptions& options) {
    try {
      DynamicObject object(mesh, options);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  SpringMesh mesh = block(0.0);
  EXPECT_THAT(complaint(mesh, {.step_s = 0.0}), HasSubstr("step_s"));
  EXPECT_THAT(complaint(mesh, {.max_steps = 0}), HasSubstr("max_steps"));
  mesh.mass_kg.back() = 0.0;
  EXPECT_THAT(complaint(mesh, {}), HasSubstr("mass of 0"));
  mesh.mass_kg.clear();
  EXPECT_THAT(complaint(mesh, {}), HasSubstr("mass_kg"));
  EXPECT_THROW(give_dynamics(mesh, {.mass_kg = 0.0}), Error);
  EXPECT_THROW(give_dynamics(mesh, {.mass_kg = 1.0, .retardation_time_s = -1.0}), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
