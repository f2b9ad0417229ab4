// SPDX-License-Identifier: Apache-2.0
#include "paper/recorded_motion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "evaluation/motions/trajectories.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/scenarios/scenarios.h"
#include "paper/figures.h"
#include "simulator/solver/elastic_object.h"
#include "tests/paper/tiny_scenes.h"

namespace forcegrid::paper {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kStiffness_N_per_m = 100.0;
constexpr double kSpeed_m_per_s = 0.01;
const Vector3d kContact_W(0.08, 0.06, 0.05);

// A tool that is pulled off a linear spring at constant speed, for two seconds.
evaluation::Trace steady_pull() {
  std::vector<Vector3d> positions_W;
  std::vector<Vector3d> forces_W;
  for (int i = 0; i < 1000; ++i) {
    const double way_m = kSpeed_m_per_s * i / kServoRate_Hz;
    positions_W.push_back(kContact_W + Vector3d(0.0, 0.0, way_m));
    forces_W.push_back(Vector3d(0.0, 0.0, -kStiffness_N_per_m * way_m));
  }
  return trace_of_path(positions_W, forces_W, kContact_W);
}

TEST(TraceOfPath, HasAnAnswerThirtyTimesASecondOnePeriodLate) {
  const evaluation::Trace trace = steady_pull();
  ASSERT_EQ(trace.servo.size(), 1000U);
  ASSERT_EQ(trace.samples.size(), 59U);  // ticks at 0 to 58/30 s; the next comes after the end
  for (std::size_t k = 0; k < trace.samples.size(); ++k) {
    const double tick_s = static_cast<double>(k) / kSimulatorRate_Hz;
    EXPECT_NEAR(trace.samples[k].delivered_s, tick_s + 1.0 / kSimulatorRate_Hz, 1e-12);
    const double lag_s = trace.samples[k].sample.time_s - tick_s;
    EXPECT_GE(lag_s, -1e-9);
    EXPECT_LT(lag_s, 1.0 / kServoRate_Hz);
    EXPECT_NEAR(trace.samples[k].sample.force_W.z(),
                -kStiffness_N_per_m * (trace.samples[k].sample.position_W - kContact_W).z(), 1e-12);
  }
}

// A streamed force is between one and two periods T old, each age as often: the RMS of k v age is
// k v T sqrt(7/3).
TEST(TraceOfPath, MakesStreamingLagByOneToTwoPeriods) {
  const evaluation::Trace trace = steady_pull();
  const Played streaming = play("hold", trace);
  const double error_N = 0.01 * rms_error_percent(trace, streaming.verdict.forces_W, 0.5, 1.5, 1.0);
  const double expected_N =
      kStiffness_N_per_m * kSpeed_m_per_s / kSimulatorRate_Hz * std::sqrt(7.0 / 3.0);
  EXPECT_NEAR(error_N, expected_N, 0.03 * expected_N);  // ages come in steps of 2 ms
}

TEST(Fifths, HaveTheErrorAndTheSpeedOfTheirOwnTime) {
  const evaluation::Trace trace = steady_pull();
  Played wrong{"wrong later on", {}};
  wrong.verdict.reference_rms_N = 2.0;
  for (const evaluation::ServoInstant& instant : trace.servo) {
    const double error_N = instant.time_s < 1.6 - 1e-9 ? 0.0 : 0.5;
    wrong.verdict.forces_W.push_back(instant.force_W + Vector3d(error_N, 0.0, 0.0));
  }
  const std::vector<Fifth> fifths = fifths_of(trace, {wrong});
  ASSERT_EQ(fifths.size(), 5U);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_NEAR(fifths[i].rms_error_percent.at(0), i == 4 ? 25.0 : 0.0, 1e-9) << i;
    EXPECT_NEAR(fifths[i].top_speed_m_per_s, kSpeed_m_per_s, 1e-9) << i;
  }
}

TEST(RecordedMotion, HasTheForcesOfTheObjectItselfAndKeepsThem) {
  PaperOptions options;
  options.jobs = 1;
  options.cache = ::testing::TempDir() + "paper_cache_" + std::to_string(getpid());
  std::filesystem::remove_all(options.cache);
  const std::string scene = tiny_scene("tiny", 20.0, 0.3);
  const RecordedMotion solved = record_motion(scene, "chirp", options);
  EXPECT_FALSE(solved.from_cache);
  EXPECT_EQ(solved.unconverged, 0U);
  ASSERT_EQ(solved.trace.servo.size(), 10000U);

  // Solved once more, each time from rest.
  const evaluation::ChartScene& chosen = evaluation::chart_scene(scene);
  simulator::SolverOptions solver;
  solver.relative_tolerance = 1e-7;
  solver.max_step_m = 1e-3;
  solver.max_steps = 100;
  solver.max_iterations = 2000;
  for (const std::size_t i : {500U, 3000U, 9001U}) {
    simulator::ElasticObject<double> object(evaluation::make_mesh(chosen), solver);
    ASSERT_GT(object.grab(evaluation::first_contact_point_W(), chosen.patch_radius_m), 0);
    const evaluation::ServoInstant& instant = solved.trace.servo[i];
    const Vector3d force_W =
        object.move_to(instant.position_W - evaluation::first_contact_point_W()).force_W;
    EXPECT_LT((force_W - instant.force_W).norm(), 1e-6) << "cycle " << i;
  }

  // Its amplitude is 20 mm; at 3 Hz, the fastest, 2 pi 3 Hz 10 mm = 188 mm/s for 1/30 s.
  EXPECT_NEAR(solved.longest_travel_m, 0.188 / kSimulatorRate_Hz, 0.0002);

  const RecordedMotion again = record_motion(scene, "chirp", options);
  EXPECT_TRUE(again.from_cache);
  ASSERT_EQ(again.trace.servo.size(), solved.trace.servo.size());
  ASSERT_EQ(again.trace.samples.size(), solved.trace.samples.size());
  for (std::size_t i = 0; i < again.trace.servo.size(); ++i) {
    ASSERT_EQ(again.trace.servo[i].force_W, solved.trace.servo[i].force_W) << i;
  }
  EXPECT_FALSE(record_motion(tiny_scene("tiny", 21.0, 0.3), "chirp", options).from_cache);
  std::filesystem::remove_all(options.cache);
}

TEST(RecordedMotion, RefusesAMotionThatLetsGo) {
  try {
    record_motion(tiny_scene("tiny", 20.0, 0.3), "tapping", {});
    FAIL() << "it took a motion of many contacts";
  } catch (const evaluation::ChartError& error) {
    EXPECT_THAT(error.what(), HasSubstr("'tapping' has more than one contact"));
  }
}

TEST(RecordedMotion, StopsWhenItIsToldTo) {
  const std::atomic<bool> cancel{true};
  PaperOptions options;
  options.cancel = &cancel;
  EXPECT_THROW(record_motion(tiny_scene("tiny", 20.0, 0.3), "chirp", options), evaluation::Stopped);
}

}  // namespace
}  // namespace forcegrid::paper
