// SPDX-License-Identifier: Apache-2.0
// Objects that resist, relax, are cut or slide, and simulators that do not converge, against closed
// forms.

#include "evaluation/objects/object_effect.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "evaluation/scenarios/network.h"
#include "evaluation/scenarios/scenarios.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

constexpr double kServo_Hz = 500.0;
const Vector3d kStiffness_N_per_m{80.0, 110.0, 130.0};

Vector3d linear_N(const Vector3d& d) { return -kStiffness_N_per_m.cwiseProduct(d); }

const ForceTable& springs() {
  static const ForceTable table = [] {
    const TableLattice lattice;
    std::vector<Vector3d> forces_W;
    for (std::size_t i = 0; i < lattice.node_count(); ++i) {
      forces_W.push_back(linear_N(lattice.node_W_m(i)));
    }
    return ForceTable(lattice, forces_W);
  }();
  return table;
}

const ObjectEffect& named(const std::string& name) {
  for (const NamedObjectEffect& each : named_object_effects()) {
    if (each.name == name) {
      return each.effect;
    }
  }
  throw ChartError("no alteration " + name);
}

Trace trace_of(const Trajectory& trajectory, const ObjectEffect& effect) {
  return make_trace(trajectory, springs(), network_condition("ideal"), kServo_Hz, 1, {{}, effect});
}

// d_z = A (1 - cos phi), phi = 2 pi (0.2 t + 0.07 t^2): the velocity is A phi' sin phi.
TEST(ObjectEffects, ResistTheVelocityAndAnswerQueriesAtRest) {
  const Trajectory chirp("chirp");
  const Trace trace = trace_of(chirp, named("viscous"));
  for (std::size_t i = 0; i < trace.servo.size(); i += 37) {
    const double t_s = trace.servo[i].time_s;
    const double phase = 2.0 * std::numbers::pi * (0.2 * t_s + 0.07 * t_s * t_s);
    const double rate = 2.0 * std::numbers::pi * (0.2 + 0.14 * t_s);
    const double z_m = 0.010 * (1.0 - std::cos(phase));
    const double v_m_per_s = 0.010 * rate * std::sin(phase);
    EXPECT_NEAR(trace.servo[i].force_W.z(), -130.0 * z_m - 3.0 * v_m_per_s, 2e-4) << t_s;
  }
  const JudgeOptions options = judge_options(chirp, springs(), network_condition("requests120"),
                                             kServo_Hz, 1, {{}, named("viscous")});
  const Vector3d d(0.003, -0.002, 0.005);
  EXPECT_LT((options.answer(7.0, first_contact_point_W() + d).force_W - linear_N(d)).norm(), 1e-9);
}

// The superposition integral over the past's steps, with the reduced relaxation function.
TEST(ObjectEffects, RelaxAsTheSuperpositionOfPastSteps) {
  const Trajectory random("random", 3);
  const Trace trace = trace_of(random, named("relaxing"));
  for (const std::size_t now : {400U, 1111U, 2500U}) {
    Vector3d force_N = Vector3d::Zero();
    Vector3d before_N = Vector3d::Zero();
    for (std::size_t i = 0; i <= now; ++i) {
      const Vector3d elastic_N = linear_N(trace.servo[i].position_W - first_contact_point_W());
      const double since_s = (static_cast<double>(now - i) + (i < now ? 0.5 : 0.0)) / kServo_Hz;
      const double left = 0.6 + 0.25 * std::exp(-since_s / 0.080) + 0.15 * std::exp(-since_s / 0.8);
      force_N += left * (elastic_N - before_N);
      before_N = elastic_N;
    }
    EXPECT_LT((trace.servo[now].force_W - force_N).norm(), 0.003 * (1.0 + force_N.norm())) << now;
  }
}

TEST(ObjectEffects, CutTheForceAndItsSlope) {
  const Trace trace = trace_of(Trajectory("random", 3), named("cut"));
  for (const DeliveredSample& delivered : trace.samples) {
    const Sample& sample = delivered.sample;
    const double left = sample.time_s < 7.0 ? 1.0 : sample.time_s < 13.0 ? 0.6 : 0.3;
    EXPECT_LT(
        (sample.force_W - left * linear_N(sample.position_W - first_contact_point_W())).norm(),
        1e-9);
    EXPECT_NEAR(sample.stiffness_W(2, 2), -130.0 * left, 1e-6);
  }
}

TEST(ObjectEffects, SlideTheObjectUnderTheTool) {
  const Trace trace = trace_of(Trajectory("random", 3), named("sliding"));
  const Vector3d slide_m(0.008, -0.005, 0.0);
  for (const ServoInstant& instant : trace.servo) {
    const double done = std::clamp((instant.time_s - 6.0) / 3.0, 0.0, 1.0);
    // The force at the start is taken off, so only what has slid since counts.
    const Vector3d d = instant.position_W - first_contact_point_W() - done * slide_m;
    EXPECT_LT((instant.force_W - linear_N(d)).norm(), 1e-9) << instant.time_s;
  }
}

TEST(ObjectEffects, LeaveAShareOfTheForceUndoneAndSayHowMuch) {
  const Trace trace = trace_of(Trajectory("random", 3), named("unconverged"));
  Vector3d answer_N = Vector3d::Zero();
  for (const DeliveredSample& delivered : trace.samples) {
    const Sample& sample = delivered.sample;
    const Vector3d reference_N = linear_N(sample.position_W - first_contact_point_W());
    answer_N = 0.4 * answer_N + 0.6 * reference_N;
    EXPECT_LT((sample.force_W - answer_N).norm(), 1e-9);
    EXPECT_FALSE(sample.converged);
    EXPECT_NEAR(sample.relative_residual * std::max(answer_N.norm(), 0.05),
                (reference_N - answer_N).norm(), 1e-9);
  }
  for (const ServoInstant& instant : trace.servo) {
    EXPECT_LT((instant.force_W - linear_N(instant.position_W - first_contact_point_W())).norm(),
              1e-9);
  }
}

TEST(ObjectEffects, MakeScenesOfTheSameObject) {
  const ChartScene& scene = chart_scene("block+relaxing");
  EXPECT_EQ(scene.object, "block");
  EXPECT_EQ(scene.extras.effect.relaxations.size(), 2U);
  EXPECT_TRUE(chart_scene("block").extras.effect.relaxations.empty());
}

}  // namespace
}  // namespace forcegrid::evaluation
