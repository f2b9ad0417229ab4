// SPDX-License-Identifier: Apache-2.0
#include "stability/scenes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "stability/closed_loop.h"
#include "tests/stability/linear_table.h"

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;

constexpr double kTolerance_N = 1e-9;  // of the splines' rounding
constexpr double kStiffness_N_per_m = 200.0;
const Vector3d kContact_W(0.08, 0.06, 0.06);

class Scenes : public ::testing::Test {
 protected:
  BaseField field() const { return {table_, kStiffness_N_per_m, kContact_W}; }
  // [N] along x, the tool being `x_m` from the contact point.
  static double force_N(const VirtualObject& object, double x_m) {
    return object.at(kContact_W + x_m * Vector3d::UnitX()).force_W.x();
  }
  static void move(VirtualObject& object, double time_s, double x_m) {
    object.advance(time_s, kContact_W + x_m * Vector3d::UnitX());
  }

 private:
  evaluation::ForceTable table_ = linear_table(50.0);
};

TEST_F(Scenes, TheHeldObjectIsAsStiffAsAskedFor) {
  const auto object = scene_of("held").make(field());
  EXPECT_NEAR(force_N(*object, 0.005), -1.0, kTolerance_N);
  EXPECT_EQ(object->stiffness_N_per_m(), kStiffness_N_per_m);
}

TEST_F(Scenes, ACutTakesStiffnessAwayAndIsAnEpochIfAnnounced) {
  for (const bool announced : {false, true}) {
    const auto object = make_cut(field(), announced);
    std::uint32_t epoch = object->contact().epoch;
    double expected_N = -1.0;
    for (const double time_s : {1.9, 2.0, 4.0}) {
      move(*object, time_s, 0.005);
      expected_N = time_s < 2.0 ? -1.0 : time_s < 4.0 ? -0.6 : -0.3;
      EXPECT_NEAR(force_N(*object, 0.005), expected_N, kTolerance_N);
      epoch += announced && time_s >= 2.0 ? 1U : 0U;
      EXPECT_EQ(object->contact().epoch, epoch);
    }
  }
}

TEST_F(Scenes, ASlideMovesTheFieldAndASlipItsContactPoint) {
  const auto slide = make_slide(field(), false);
  move(*slide, 3.5, 0.0);
  EXPECT_NEAR(force_N(*slide, 0.005), -kStiffness_N_per_m * 0.001, kTolerance_N);
  EXPECT_EQ(slide->contact().epoch, 1U);
  const auto slip = make_slide(field(), true);
  move(*slip, 3.0, 0.0);
  EXPECT_NEAR(force_N(*slip, 0.005), -kStiffness_N_per_m * 0.001, kTolerance_N);
  EXPECT_EQ(slip->contact().epoch, 2U);
  EXPECT_NEAR((slip->contact().point_W - kContact_W - Vector3d(0.004, -0.0025, 0.0)).norm(), 0.0,
              1e-12);
}

TEST_F(Scenes, TheWallPushesFromTwoMillimetresOn) {
  const auto object = make_second_contact(field());
  EXPECT_NEAR(force_N(*object, 0.002), -0.4, kTolerance_N);
  EXPECT_NEAR(force_N(*object, 0.006), -1.2 - 4.0, kTolerance_N);
}

TEST_F(Scenes, EachTouchOfTheTappedSurfaceIsANewContactAtItsPlace) {
  const auto object = make_tapping(field());
  EXPECT_FALSE(object->contact().in_contact);
  move(*object, 0.1, 0.003);
  EXPECT_TRUE(object->contact().in_contact);
  EXPECT_EQ(object->contact().epoch, 1U);
  EXPECT_NEAR(object->contact().point_W.x() - kContact_W.x(), 0.002, 1e-12);
  EXPECT_NEAR(force_N(*object, 0.003), -0.2, kTolerance_N);
  move(*object, 0.2, 0.001);
  EXPECT_FALSE(object->contact().in_contact);
  EXPECT_EQ(force_N(*object, 0.001), 0.0);
  move(*object, 0.3, 0.004);
  EXPECT_EQ(object->contact().epoch, 2U);
}

TEST_F(Scenes, TheViscousObjectDragsWithThreeNewtonSecondsPerMetre) {
  const auto object = make_viscous(field());
  const double speed_m_per_s = 0.01;
  double time_s = 0.0;
  for (; time_s < 0.2; time_s += 0.0001) {
    move(*object, time_s, speed_m_per_s * time_s);
  }
  const double x_m = speed_m_per_s * (time_s - 0.0001);
  // The follower lags by the speed times its time constant, and half a step.
  EXPECT_NEAR(force_N(*object, x_m), -kStiffness_N_per_m * x_m - 3.0 * speed_m_per_s, 4e-4);
}

TEST_F(Scenes, TheKelvinVoigtObjectAddsItsDampingTimeTimesTheRateOfItsForce) {
  const auto object = make_kelvin_voigt(field(), 0.02);
  const double speed_m_per_s = 0.01;
  double time_s = 0.0;
  for (; time_s < 0.2; time_s += 0.0001) {
    move(*object, time_s, speed_m_per_s * time_s);
  }
  const double x_m = speed_m_per_s * (time_s - 0.0001);
  // Half a step of the follower's lag is a hundredth of it.
  EXPECT_NEAR(force_N(*object, x_m), -kStiffness_N_per_m * (x_m + 0.02 * speed_m_per_s),
              0.01 * kStiffness_N_per_m * 0.02 * speed_m_per_s);
  EXPECT_NEAR(object->at(kContact_W).stiffness_W(0, 0), -5.0 * kStiffness_N_per_m, 1e-6);
}

TEST_F(Scenes, TheRelaxingObjectFollowsItsRelaxationFunction) {
  const auto object = make_relaxation(field());
  move(*object, 0.0, 0.0);
  EXPECT_NEAR(force_N(*object, 0.005), -1.0, kTolerance_N) << "at once";
  for (int i = 1; i <= 800; ++i) {
    move(*object, 0.001 * i, 0.005);
    if (i == 80 || i == 800) {
      const double t_s = 0.001 * i;
      EXPECT_NEAR(force_N(*object, 0.005),
                  -(0.6 + 0.25 * std::exp(-t_s / 0.08) + 0.15 * std::exp(-t_s / 0.8)), 1e-9)
          << t_s;
    }
  }
}

TEST_F(Scenes, TheHystereticObjectKeepsTheWorkOfItsSlider) {
  // Once round between +-5 mm: the slider takes 4 (5 mm - 1 mm) K / 2 1 mm.
  const auto object = make_hysteresis(field());
  double work_J = 0.0;
  double last_N = 0.0;
  double last_m = 0.0;
  const auto go = [&](double to_m, bool counted) {
    const double from_m = last_m;
    for (int i = 1; i <= 1000; ++i) {
      const double x_m = from_m + (to_m - from_m) * i / 1000.0;
      const double now_N = force_N(*object, x_m);
      work_J += counted ? 0.5 * (now_N + last_N) * (x_m - last_m) : 0.0;
      move(*object, 0.0, x_m);
      last_N = now_N;
      last_m = x_m;
    }
  };
  go(0.005, false);
  go(-0.005, true);
  go(0.005, true);
  EXPECT_NEAR(work_J, -4.0 * 0.004 * 0.5 * kStiffness_N_per_m * 0.001, 1e-6);
}

TEST_F(Scenes, TheShellSnapsAtTwoMillimetresAndBackAtOne) {
  const auto object = make_snap_through(field());
  move(*object, 0.0, 0.0019);
  EXPECT_NEAR(force_N(*object, 0.0015), -0.3, kTolerance_N);
  move(*object, 0.1, 0.0021);
  EXPECT_NEAR(force_N(*object, 0.0015), -0.1, kTolerance_N);
  move(*object, 0.2, 0.0011);
  EXPECT_NEAR(force_N(*object, 0.0015), -0.1, kTolerance_N);
  move(*object, 0.3, 0.0009);
  EXPECT_NEAR(force_N(*object, 0.0015), -0.3, kTolerance_N);
}

TEST_F(Scenes, AllHaveNamesOfTheirOwnAndAnObject) {
  std::set<std::string> names;
  for (const Scene& scene : scenes()) {
    EXPECT_TRUE(names.insert(scene.name).second) << scene.name;
    EXPECT_NE(scene.make(field()), nullptr) << scene.name;
  }
  EXPECT_EQ(scenes().front().name, "held");
  EXPECT_THROW(scene_of("nowhere"), std::invalid_argument);
}

// Answers of a simulator at 10 Hz that is asked at 500 Hz for a tool at rest 5 mm out.
std::vector<SlowSimulator::Answer> answers(SimulatorFault fault, double until_s) {
  const evaluation::ForceTable table = linear_table(50.0);
  TableObject object(table, kStiffness_N_per_m, kContact_W);
  evaluation::NetworkCondition network;
  network.simulator_rate_Hz = 10.0;
  SlowSimulator simulator(network, fault, 3);
  std::vector<SlowSimulator::Answer> all;
  for (std::int64_t now_ns = 0; now_ns <= std::llround(1e9 * until_s); now_ns += 2'000'000) {
    simulator.publish(now_ns, kContact_W + 0.005 * Vector3d::UnitX(), Vector3d::Zero(), object);
    while (const auto answer = simulator.receive(now_ns)) {
      EXPECT_LE(answer->arrives_ns, now_ns);
      all.push_back(*answer);
    }
  }
  return all;
}

TEST(SlowSimulator, AnswersOnePeriodLater) {
  const auto all = answers(SimulatorFault::kNone, 1.0);
  ASSERT_EQ(all.size(), 10U);
  EXPECT_EQ(all[3].arrives_ns, 400'000'000);
  EXPECT_NEAR(all[3].sample.time_s, 0.3, 1e-9);
  EXPECT_NEAR(all[3].sample.force_W.x(), -1.0, kTolerance_N);
}

TEST(SlowSimulator, FaultsAreWhatTheirNamesSay) {
  EXPECT_NEAR(answers(SimulatorFault::kUnconverged, 0.3)[1].sample.force_W.x(), -0.84,
              kTolerance_N);
  EXPECT_NEAR(answers(SimulatorFault::kBias, 0.3)[1].sample.force_W.x(), -0.9, kTolerance_N);
  EXPECT_NEAR(answers(SimulatorFault::kClockSkew, 0.3)[1].sample.time_s, 0.101, 1e-9);
  EXPECT_EQ(answers(SimulatorFault::kPauses, 3.0).size(), 30U - 2U * 2U);
  EXPECT_EQ(answers(SimulatorFault::kRestarts, 3.0).back().sample.contact_epoch, 3U);
  int not_finite = 0;
  int outliers = 0;
  for (const auto& answer : answers(SimulatorFault::kNotFinite, 40.0)) {
    not_finite += answer.sample.force_W.allFinite() ? 0 : 1;
  }
  for (const auto& answer : answers(SimulatorFault::kOutliers, 40.0)) {
    outliers += std::abs(answer.sample.force_W.x() + 1.0) > kTolerance_N ? 1 : 0;
  }
  // Of 400, one in twenty: four standard deviations of the binomial are 17.
  EXPECT_NEAR(not_finite, 20, 17);
  EXPECT_NEAR(outliers, 20, 17);
}

}  // namespace
}  // namespace forcegrid::stability
