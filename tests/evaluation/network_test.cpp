// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/network.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kServo_Hz = 500.0;
constexpr double kPeriod_s = 1.0 / 30.0;

// An object whose force is -K d everywhere.
const Vector3d kStiffness_N_per_m{80.0, 90.0, 120.0};
const ForceTable& springs() {
  static const ForceTable table = [] {
    const TableLattice lattice;
    std::vector<Vector3d> forces_W;
    for (std::size_t i = 0; i < lattice.node_count(); ++i) {
      forces_W.push_back(-kStiffness_N_per_m.cwiseProduct(lattice.node_W_m(i)));
    }
    return ForceTable(lattice, forces_W);
  }();
  return table;
}

Vector3d true_force_W(const Vector3d& position_W) {
  return -kStiffness_N_per_m.cwiseProduct(position_W - first_contact_point_W());
}

Trace trace_of(const char* trajectory, const char* condition, std::uint64_t seed = 1) {
  return make_trace(Trajectory(trajectory, seed), springs(), network_condition(condition),
                    kServo_Hz, seed);
}

TEST(Network, IdealDeliversEachTickOnePeriodLater) {
  const Trace trace = trace_of("random", "ideal");
  ASSERT_EQ(trace.servo.size(), 10000U);
  ASSERT_EQ(trace.samples.size(), 599U);  // of 20 s; the last tick's answer would come too late
  for (std::size_t k = 0; k < trace.samples.size(); ++k) {
    const double tick_s = kPeriod_s * static_cast<double>(k);
    const DeliveredSample& each = trace.samples[k];
    EXPECT_NEAR(each.delivered_s, tick_s + kPeriod_s, 1e-9);
    EXPECT_GE(each.sample.time_s, tick_s - 1e-9);
    EXPECT_LT(each.sample.time_s, tick_s + 1.0 / kServo_Hz);
    EXPECT_LT((each.sample.force_W - true_force_W(each.sample.position_W)).norm(), 1e-9);
  }
  EXPECT_NEAR(trace.samples[1].sample.time_s, 0.034, 1e-9);
  for (const ServoInstant& instant : trace.servo) {
    EXPECT_LT((instant.force_W - true_force_W(instant.position_W)).norm(), 1e-9);
  }
  ASSERT_EQ(trace.events.size(), 1U);
  EXPECT_TRUE(trace.events[0].made);
  EXPECT_EQ(trace.events[0].point_W, first_contact_point_W());
}

TEST(Network, DelayComesOnTopOfThePeriod) {
  const Trace trace = trace_of("chirp", "delay100");
  EXPECT_EQ(trace.samples.size(), 596U);
  for (std::size_t k = 0; k < trace.samples.size(); ++k) {
    EXPECT_NEAR(trace.samples[k].delivered_s, kPeriod_s * static_cast<double>(k + 1) + 0.1, 1e-9);
  }
}

TEST(Network, LossyLosesAFifthAndJittersByTwentyMilliseconds) {
  constexpr std::uint64_t kSeed = 5;
  SCOPED_TRACE("seed 5");
  const Trace trace = trace_of("lissajous", "lossy", kSeed);
  // 598 answers, 20 % lost: 478 with a standard deviation of 9.8.
  EXPECT_NEAR(static_cast<double>(trace.samples.size()), 478.0, 40.0);
  double sum_s = 0.0;
  double least_s = 1.0;
  double most_s = 0.0;
  for (const DeliveredSample& each : trace.samples) {
    const double tick_s = std::floor(each.sample.time_s / kPeriod_s + 1e-6) * kPeriod_s;
    const double late_s = each.delivered_s - tick_s - kPeriod_s;
    sum_s += late_s;
    least_s = std::min(least_s, late_s);
    most_s = std::max(most_s, late_s);
  }
  EXPECT_GE(least_s, 0.02 - 1e-9);
  EXPECT_LT(least_s, 0.021);
  EXPECT_LE(most_s, 0.04 + 1e-9);
  EXPECT_GT(most_s, 0.039);
  EXPECT_NEAR(sum_s / static_cast<double>(trace.samples.size()), 0.03, 0.0015);
}

TEST(Network, NoiseIsWhiteAndTenMillinewtonsAnAxis) {
  const Trace trace = trace_of("random", "noise10", 3);
  Vector3d squares = Vector3d::Zero();
  double correlation = 0.0;
  Vector3d before = Vector3d::Zero();
  for (const DeliveredSample& each : trace.samples) {
    const Vector3d noise = each.sample.force_W - true_force_W(each.sample.position_W);
    squares += noise.cwiseProduct(noise);
    correlation += noise.dot(before);
    before = noise;
  }
  const double count = static_cast<double>(trace.samples.size());
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(std::sqrt(squares[axis] / count), 0.010, 0.0012);
  }
  EXPECT_LT(std::abs(correlation) / squares.sum(), 0.1);
  for (const ServoInstant& instant : trace.servo) {
    EXPECT_LT((instant.force_W - true_force_W(instant.position_W)).norm(), 1e-9);
  }
}

TEST(Network, SimulatorRateSetsTheNumberOfSamples) {
  EXPECT_EQ(trace_of("chirp", "rate10").samples.size(), 199U);
  EXPECT_EQ(trace_of("chirp", "rate60").samples.size(), 1199U);
}

TEST(Network, SameSeedSameNetwork) {
  const Trace one = trace_of("chirp", "lossy", 8);
  const Trace same = trace_of("chirp", "lossy", 8);
  ASSERT_EQ(one.samples.size(), same.samples.size());
  for (std::size_t k = 0; k < one.samples.size(); ++k) {
    EXPECT_EQ(one.samples[k].delivered_s, same.samples[k].delivered_s);
  }
  const Trace other = trace_of("chirp", "lossy", 9);
  EXPECT_NE(one.samples[0].delivered_s, other.samples[0].delivered_s);
}

TEST(Network, ContactsAreEventsAndTheAirHasNoForce) {
  const Trajectory regrab("regrab_varied", 6);
  const Trace trace = make_trace(regrab, springs(), network_condition("ideal"), kServo_Hz, 6);
  ASSERT_EQ(trace.events.size(), 28U);
  for (std::size_t i = 0; i < trace.events.size(); ++i) {
    const ContactSpan& span = regrab.contacts()[i / 2];
    EXPECT_EQ(trace.events[i].made, i % 2 == 0);
    const double expected_s = i % 2 == 0 ? span.begin_s : span.end_s;
    EXPECT_GE(trace.events[i].time_s, expected_s - 1e-9);
    EXPECT_LT(trace.events[i].time_s, expected_s + 1.0 / kServo_Hz);
  }
  for (const ServoInstant& instant : trace.servo) {
    const int contact = regrab.contact_at(instant.time_s);
    if (contact < 0) {
      EXPECT_EQ(instant.force_W, Vector3d::Zero());
    } else {
      const ContactSpan& span = regrab.contacts()[static_cast<std::size_t>(contact)];
      const Vector3d expected_W =
          -span.force_factor * kStiffness_N_per_m.cwiseProduct(instant.position_W - span.point_W);
      EXPECT_LT((instant.force_W - expected_W).norm(), 1e-9);
    }
  }
}

TEST(Network, StiffnessReachesTheMethodOnlyWhereTheLinkHasIt) {
  const Trajectory chirp("chirp");
  EXPECT_FALSE(
      judge_options(chirp, springs(), network_condition("ideal"), 500.0, 1).stiffness_to_method);
  EXPECT_TRUE(judge_options(chirp, springs(), network_condition("lossy+stiffness"), 500.0, 1)
                  .stiffness_to_method);
  const Trace trace = trace_of("chirp", "stiffness");
  const Eigen::Matrix3d expected = (-kStiffness_N_per_m).asDiagonal();
  EXPECT_LT((trace.samples[100].sample.stiffness_W - expected).norm(), 1e-6);
}

TEST(Network, RequestsAreAnsweredFromTheTableOnePeriodLater) {
  const Trajectory chirp("chirp");
  const JudgeOptions options =
      judge_options(chirp, springs(), network_condition("requests120"), 500.0, 1);
  EXPECT_EQ(options.requests_per_s, 120.0);
  EXPECT_NEAR(options.request_delay_s, 1.0 / 120.0, 1e-12);
  const Vector3d wanted_W = first_contact_point_W() + Vector3d(0.004, -0.003, 0.011);
  const Sample answer = options.answer(1.0, wanted_W);
  EXPECT_TRUE(answer.from_query);
  EXPECT_EQ(answer.position_W, wanted_W);
  EXPECT_LT((answer.force_W - true_force_W(wanted_W)).norm(), 1e-9);
  const Sample beyond = options.answer(1.0, first_contact_point_W() + Vector3d(0.5, 0.0, 0.0));
  EXPECT_LT((beyond.position_W - first_contact_point_W() - Vector3d(0.021, 0.0, 0.0)).norm(), 1e-9);
  EXPECT_LT((beyond.force_W - true_force_W(beyond.position_W)).norm(), 1e-9);
}

// A method may ask for any position, also above or below what the large object's table covers.
TEST(Network, RequestsBeyondTheLargeObjectAreAnsweredAtItsNearestPosition) {
  const Trajectory exploration("exploration");
  for (const NamedObjectEffect& effect : named_object_effects()) {
    const SceneExtras extras{{}, effect.effect};
    const JudgeOptions options =
        judge_options(exploration, springs(), network_condition("requests120"), 500.0, 1, extras);
    for (const Vector3d& far_m : {Vector3d(0.01, -0.02, 0.3), Vector3d(0.4, -0.3, -0.2)}) {
      const Sample answer = options.answer(20.0, first_contact_point_W() + far_m);
      const double z_m = answer.position_W.z() - first_contact_point_W().z();
      EXPECT_NEAR(z_m, far_m.z() > 0.0 ? 0.027 : -0.006, 1e-9) << effect.name;
      EXPECT_NEAR(answer.position_W.x() - first_contact_point_W().x(), far_m.x(), 1e-9);
      EXPECT_TRUE(answer.force_W.allFinite());
    }
  }
}

// The object slides by up to 4 mm, and its table with it.
TEST(Network, RequestsBeyondASlidObjectAreAnsweredAtItsNearestPosition) {
  const Trajectory random("random");
  for (const NamedObjectEffect& effect : named_object_effects()) {
    const JudgeOptions options = judge_options(random, springs(), network_condition("requests120"),
                                               500.0, 1, {{}, effect.effect});
    for (const double time_s : {1.0, 10.0}) {
      const Sample answer =
          options.answer(time_s, first_contact_point_W() + Vector3d(0.5, -0.5, 0.5));
      const Vector3d edge_m = Vector3d(0.021, -0.021, 0.027) + effect.effect.slid_W_m(time_s);
      EXPECT_LT((answer.position_W - first_contact_point_W() - edge_m).norm(), 1e-9) << effect.name;
    }
  }
}

TEST(Network, UnknownConditionListsTheKnownOnes) {
  try {
    network_condition("carrier-pigeon");
    FAIL() << "no error";
  } catch (const ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("'carrier-pigeon'"));
    EXPECT_THAT(error.what(), HasSubstr("ideal, stiffness, delay100"));
  }
}

}  // namespace
}  // namespace forcegrid::evaluation
