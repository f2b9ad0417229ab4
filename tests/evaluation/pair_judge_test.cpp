// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge/pair_judge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "forcegrid/pair_methods.h"
#include "tests/evaluation/pair_ramp.h"

namespace forcegrid::evaluation {
namespace {

using ::testing::ElementsAre;
using testing::PairRamp;

constexpr double kRounding = 1e-9;  // relative to figures of order 1 to 100

std::unique_ptr<PairForceMethod> made(const std::string& name) {
  MethodOptions options;
  options.grid.max_W.setConstant(0.1);
  options.grid.cells.setConstant(10);
  return make_pair_force_method(name, options);
}

// The newest sample is 10 to 19 cycles old, and hold is behind by what the force has changed in
// that time: |K V| per second.
TEST(PairJudge, AgreesWithTheClosedFormOfHoldOnARamp) {
  const PairRamp ramp;
  const auto method = made("hold");
  const PairVerdict verdict = judge_pair(*method, ramp.trace());
  const PairVector rate_N_per_s = ramp.stiffness_N_per_m * ramp.velocity_W;
  double squares = 0.0;
  for (int age = 10; age < 20; ++age) {
    squares += std::pow(age * PairRamp::kServoPeriod_s, 2);
  }
  const double rms_age_s = std::sqrt(squares / 10.0);
  double time_squares = 0.0;
  for (int cycle = 0; cycle < ramp.cycles(); ++cycle) {
    time_squares += std::pow(ramp.time_s(cycle), 2);
  }
  const double rms_time_s = std::sqrt(time_squares / ramp.cycles());
  EXPECT_NEAR(verdict.together.after_1s.rms_percent, 100.0 * rms_age_s / rms_time_s,
              100.0 * kRounding);
  EXPECT_NEAR(verdict.together.reference_rms_N, rate_N_per_s.norm() * rms_time_s, kRounding);
  EXPECT_NEAR(verdict.tools[0].reference_rms_N, rate_N_per_s.head<3>().norm() * rms_time_s,
              kRounding);
  EXPECT_NEAR(verdict.tools[1].reference_rms_N, rate_N_per_s.tail<3>().norm() * rms_time_s,
              kRounding);
  // Every force of the ramp is late by the same share of itself.
  EXPECT_NEAR(verdict.tools[0].after_1s.rms_percent, verdict.together.after_1s.rms_percent, 1e-7);
  EXPECT_NEAR(verdict.tools[1].after_1s.max_percent,
              100.0 * 19 * PairRamp::kServoPeriod_s / rms_time_s, 1e-7);
  // The error falls by ten cycles' worth when a sample arrives.
  EXPECT_NEAR(verdict.together.largest_step_N, 9.0 * PairRamp::kServoPeriod_s * rate_N_per_s.norm(),
              kRounding);
  EXPECT_EQ(verdict.samples_taken, 99U);  // the last one arrives after the trace's end
  EXPECT_GT(verdict.query_ns_median, 0.0);
  EXPECT_GT(verdict.cycle_ns, 0.0);
  EXPECT_EQ(verdict.memory_bytes, method->memory_bytes());
}

TEST(PairJudge, SeparatesTheErrorOfOneToolFromThatOfTheOther) {
  PairRamp ramp;
  ramp.velocity_W.tail<3>().setZero();
  ramp.stiffness_N_per_m = PairRamp::coupled(100.0, 0.0);
  PairTrace trace = ramp.trace();
  for (PairInstant& instant : trace.servo) {  // the second tool feels a constant force
    instant.forces_W[5] = 1.0;
  }
  for (DeliveredPairSample& row : trace.samples) {
    row.sample.forces_W[5] = 1.0;
  }
  const auto method = made("hold");
  const PairVerdict verdict = judge_pair(*method, trace);
  EXPECT_GT(verdict.tools[0].after_1s.rms_percent, 1.0);
  EXPECT_NEAR(verdict.tools[1].after_1s.rms_percent, 0.0, kRounding);
  // In the first half second 10 cycles of 250 have no force yet, 20 % RMS; the next is exact.
  EXPECT_NEAR(verdict.tools[1].adaptation_s, 1.0, 1e-12);
}

// Records its calls.
class Diary final : public PairForceMethod {
 public:
  const char* name() const noexcept override { return "diary"; }
  std::size_t memory_bytes() const noexcept override { return 123; }
  void take_sample(const PairSample& sample) noexcept override {
    lines.push_back("sample " + std::to_string(std::lround(1e3 * sample.time_s)) + " epoch " +
                    std::to_string(sample.contact_epoch) + " point " +
                    std::to_string(std::lround(sample.contact_points_W[0])));
    pending = 3;
  }
  void contacts_made(std::uint32_t epoch, const PairVector& points_W) noexcept override {
    lines.push_back("contact " + std::to_string(epoch) + " point " +
                    std::to_string(std::lround(points_W[0])));
  }
  void contacts_lost() noexcept override { lines.push_back("lost"); }
  int work(int budget) noexcept override {
    budgets.push_back(budget);
    const int done = std::min(pending, 1);
    pending -= done;
    return done;
  }
  PairEstimate forces(double /*time_s*/, const PairVector& /*at*/) const noexcept override {
    return {};
  }

  std::vector<std::string> lines;
  std::vector<int> budgets;
  int pending = 0;
};

PairTrace two_contacts() {
  PairTrace trace;
  for (int i = 0; i < 5; ++i) {
    trace.servo.push_back({0.01 * i, PairVector::Zero(), PairVector::Zero()});
  }
  trace.contacts = {{0.0, PairVector::Constant(1.0), {}}, {0.015, PairVector::Constant(2.0), 0.03}};
  const auto add = [&trace](double time_s, double delivered_s) {
    DeliveredPairSample row;
    row.sample.time_s = time_s;
    row.delivered_s = delivered_s;
    trace.samples.push_back(row);
  };
  add(0.0, 0.005);
  add(0.02, 0.025);  // of the second contact, before the servo hears of it
  add(0.01, 0.028);  // of the first, too late
  add(0.03, 0.035);
  return trace;
}

TEST(PairJudge, GivesAMethodTheSamplesOfThePresentContactOnly) {
  Diary diary;
  const PairVerdict verdict = judge_pair(diary, two_contacts());
  EXPECT_THAT(diary.lines,
              ElementsAre("contact 1 point 1", "sample 0 epoch 1 point 1", "contact 2 point 2",
                          "sample 20 epoch 2 point 2", "sample 30 epoch 2 point 2"));
  EXPECT_EQ(verdict.samples_taken, 3U);
  EXPECT_EQ(verdict.samples_not_taken, 1U);
  EXPECT_EQ(verdict.cycles_by_status[static_cast<std::size_t>(EstimateStatus::kUnknown)], 5U);
}

TEST(PairJudge, WithoutContactsTheFirstSampleMakesOne) {
  PairTrace trace = two_contacts();
  trace.contacts.clear();
  Diary diary;
  judge_pair(diary, trace);
  EXPECT_THAT(diary.lines, ElementsAre("contact 1 point 0", "sample 0 epoch 1 point 0",
                                       "sample 20 epoch 1 point 0", "sample 10 epoch 1 point 0",
                                       "sample 30 epoch 1 point 0"));
}

TEST(PairJudge, SpendsTheWorkBudgetOnceACycle) {
  Diary diary;
  PairJudgeOptions options;
  options.work_budget = 7;
  judge_pair(diary, two_contacts(), options);
  EXPECT_THAT(diary.budgets, ElementsAre(7, 7, 7, 7, 7));
}

}  // namespace
}  // namespace forcegrid::evaluation
