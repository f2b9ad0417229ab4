// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge/judge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "forcegrid/methods.h"
#include "tests/evaluation/ramp_trace.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;
using forcegrid::testing::Ramp;
using ::testing::ElementsAre;

constexpr double kRounding = 1e-9;  // relative to figures of order 1 to 100

Verdict judged(const std::string& name, const Trace& trace, const JudgeOptions& judging = {}) {
  MethodOptions options;
  options.grid.max_W.setConstant(0.1);
  options.grid.cells.setConstant(10);
  const auto method = make_force_method(name, options);
  return judge(*method, trace, judging);
}

// Records its calls in words, and gives the force that a test wants.
class Diary final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "diary"; }
  std::size_t memory_bytes() const noexcept override { return 123; }
  void take_sample(const Sample& sample) noexcept override {
    samples.push_back(sample);
    pending_work += work_per_sample;
    note((sample.from_query ? "answer " : "sample ") + text_of(sample.force_W.x()) + " epoch " +
         std::to_string(sample.contact_epoch));
  }
  void observe(double time_s, const Vector3d& /*position_W*/) noexcept override {
    observed_s = time_s;
  }
  void contact_made(std::uint32_t epoch, const Vector3d& point_W) noexcept override {
    note("contact " + std::to_string(epoch) + " at " + text_of(point_W.x()));
  }
  void contact_lost() noexcept override { note("lost"); }
  int work(int budget) noexcept override {
    largest_budget = std::max(largest_budget, budget);
    const int done = std::min(budget, pending_work);
    pending_work -= done;
    return done;
  }
  bool plan_request(double time_s, const Vector3d& /*position_W*/,
                    Vector3d& wanted_W) noexcept override {
    ++requests;
    wanted_W = Vector3d(time_s, 0.0, 0.0);
    return true;
  }
  void expect_contact(double /*time_s*/, const Vector3d& point_W) noexcept override {
    note("expects " + text_of(point_W.x()));
  }
  ForceEstimate force(double time_s, const Vector3d& /*position_W*/) const noexcept override {
    pending_at_force = std::max(pending_at_force, pending_work);
    ForceEstimate estimate;
    estimate.status = EstimateStatus::kOk;
    if (force_at) {
      estimate.force_W = force_at(time_s);
    }
    return estimate;
  }

  static std::string text_of(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%g", value);
    return text;
  }

  std::function<Vector3d(double)> force_at;
  std::vector<std::string> entries;  ///< "at what time it knew: what"
  std::vector<Sample> samples;
  double observed_s = -1.0;
  int work_per_sample = 0;
  int pending_work = 0;
  mutable int pending_at_force = 0;
  int largest_budget = 0;
  int requests = 0;

 private:
  // observe() has last reported the time of the previous cycle.
  void note(const std::string& what) { entries.push_back(text_of(observed_s) + ": " + what); }
};

// A servo at 10 Hz without motion or force.
Trace still(double seconds) {
  Trace trace;
  for (int i = 0; i < std::lround(10.0 * seconds); ++i) {
    trace.servo.push_back({0.1 * i, Vector3d::Zero(), Vector3d(1.0, 0.0, 0.0)});
  }
  return trace;
}

DeliveredSample sample_of(double time_s, double delivered_s, double force_N) {
  DeliveredSample row;
  row.sample.time_s = time_s;
  row.sample.position_W = Vector3d(0.5, 0.0, 0.0);
  row.sample.force_W = Vector3d(force_N, 0.0, 0.0);
  row.delivered_s = delivered_s;
  return row;
}

// Hold lags a ramp by the age of its sample: 20, 22, ... 38 ms over and over. Its error is that age
// times speed and stiffness, and F_o is proportional to the time.
TEST(Judge, AgreesWithTheClosedFormOfHoldOnARamp) {
  const Ramp ramp;
  const Verdict verdict = judged("hold", ramp.trace());
  double ages_squared = 0.0;
  for (int i = 0; i < 10; ++i) {
    ages_squared += std::pow(0.020 + 0.002 * i, 2) / 10.0;
  }
  const double cycles = ramp.cycles();
  const double last = cycles - 1.0;  // sum of i^2 for i = 0..last, times dt^2
  const double times_squared = 4e-6 * last * (last + 1.0) * (2.0 * last + 1.0) / 6.0 / cycles;
  const double rate_N_per_s = ramp.stiffness_N_per_m * Ramp::kSpeed_m_per_s;
  const double percent_per_s = 100.0 / std::sqrt(times_squared);
  EXPECT_NEAR(verdict.reference_rms_N, rate_N_per_s * std::sqrt(times_squared), kRounding);
  EXPECT_NEAR(verdict.rms_error_percent_after_1s, percent_per_s * std::sqrt(ages_squared),
              kRounding);
  EXPECT_NEAR(verdict.max_error_percent_after_1s, percent_per_s * 0.038, kRounding);
  EXPECT_NEAR(verdict.p95_error_percent_after_1s, percent_per_s * 0.038, kRounding);
  EXPECT_NEAR(verdict.largest_step_N, rate_N_per_s * 0.018, kRounding);
  // The first second has the same ages but for the first 10 cycles, before any sample: there the
  // force is zero, so the error is F_o itself, whose "age" is 0, 2, ... 18 ms.
  double first_squared = 490.0 * ages_squared;
  for (int i = 0; i < 10; ++i) {
    first_squared += std::pow(0.002 * i, 2);
  }
  EXPECT_NEAR(verdict.rms_error_percent_first_1s, percent_per_s * std::sqrt(first_squared / 500.0),
              kRounding);
  EXPECT_NEAR(verdict.max_error_percent_first_1s, percent_per_s * 0.038, kRounding);
  EXPECT_EQ(verdict.samples_taken, 99u);  // the hundredth arrives after the last cycle
  EXPECT_EQ(verdict.cycles_by_status[static_cast<std::size_t>(EstimateStatus::kUnknown)], 10u);
  EXPECT_EQ(verdict.cycles_by_status[static_cast<std::size_t>(EstimateStatus::kOk)], 990u);
}

TEST(Judge, FindsNoErrorInMethodsThatAreExactOnARamp) {
  for (const char* name : {"linear", "secant", "broyden", "tangent"}) {
    const Verdict verdict = judged(name, Ramp{}.trace());
    EXPECT_LT(verdict.rms_error_percent_after_1s, 1e-6) << name;
    EXPECT_GT(verdict.rms_error_percent_first_1s, 0.01) << name;  // before the first sample
    EXPECT_EQ(verdict.adaptation_s, 0.5) << name;
  }
}

TEST(Judge, MeasuresTimesAndMemory) {
  const Verdict verdict = judged("forcegrid", Ramp{}.trace());
  EXPECT_GT(verdict.query_ns_median, 0.0);
  EXPECT_GE(verdict.query_ns_p99, verdict.query_ns_median);
  EXPECT_GT(verdict.sample_us_median, 0.0);
  EXPECT_GE(verdict.sample_us_p99, verdict.sample_us_median);
  // A sample costs far more than a query, and one cycle in ten takes one in.
  EXPECT_GT(verdict.cycle_ns, verdict.query_ns_median);
  EXPECT_GT(verdict.cycle_ns_p99, verdict.cycle_ns_median);
  EXPECT_GE(verdict.timer_floor_ns, 1.0);
  EXPECT_LT(verdict.timer_floor_ns, 1000.0);
  EXPECT_GT(verdict.memory_bytes, 11u * 11u * 11u * 16u);
}

TEST(Judge, TakesTheLeastOfEachCyclesTimesIfAsked) {
  const Trace trace = Ramp{}.trace();
  const auto judge_with = [&](std::vector<double>& least_ns) {
    JudgeOptions options;
    options.least_cycle_ns = &least_ns;
    return judged("hold", trace, options);
  };
  std::vector<double> least_ns;
  const Verdict first = judge_with(least_ns);
  ASSERT_EQ(least_ns.size(), trace.servo.size());
  EXPECT_GE(first.cycle_ns_p999, first.cycle_ns_median);

  std::fill(least_ns.begin(), least_ns.end(), 1e12);  // longer than any cycle takes
  EXPECT_LT(judge_with(least_ns).cycle_ns_p999, 1e12);
  std::fill(least_ns.begin(), least_ns.end(), 0.0);
  const Verdict none = judge_with(least_ns);
  EXPECT_EQ(none.cycle_ns_p999, none.timer_floor_ns);
  EXPECT_EQ(*std::max_element(least_ns.begin(), least_ns.end()), 0.0);

  least_ns.pop_back();
  EXPECT_THROW(judge_with(least_ns), std::invalid_argument);
}

TEST(Judge, TellsWhenAMethodHasAdapted) {
  Trace trace = still(4.0);
  Diary diary;
  // 10 % until 1.2 s, so 7.7 % in the half second that begins at 1 s, and 1 % from then on.
  diary.force_at = [](double time_s) { return Vector3d(time_s < 1.2 ? 1.1 : 1.01, 0.0, 0.0); };
  EXPECT_NEAR(judge(diary, trace).adaptation_s, 2.0, kRounding);
  diary.force_at = [](double time_s) { return Vector3d(time_s < 3.6 ? 1.0 : 1.2, 0.0, 0.0); };
  EXPECT_TRUE(std::isnan(judge(diary, trace).adaptation_s));
}

TEST(Judge, HasNoFigureWhereNothingCanBeMeasured) {
  Diary diary;
  Verdict verdict = judge(diary, still(0.9));
  EXPECT_TRUE(std::isnan(verdict.rms_error_percent_after_1s));
  EXPECT_TRUE(std::isnan(verdict.max_error_percent_after_1s));
  EXPECT_TRUE(std::isnan(verdict.largest_step_N));
  EXPECT_NEAR(verdict.rms_error_percent_first_1s, 100.0, kRounding);  // it gives zero
  EXPECT_TRUE(std::isnan(verdict.sample_us_median));
  EXPECT_EQ(verdict.samples_taken, 0u);
  EXPECT_EQ(diary.entries.size(), 0u);
  Trace nothing_felt = still(2.0);
  for (ServoInstant& instant : nothing_felt.servo) {
    instant.force_W.setZero();
  }
  verdict = judge(diary, nothing_felt);
  EXPECT_EQ(verdict.reference_rms_N, 0.0);
  EXPECT_TRUE(std::isnan(verdict.rms_error_percent_after_1s));
  EXPECT_TRUE(std::isnan(verdict.adaptation_s));
}

TEST(Judge, DeliversAtTheFirstCycleThatIsNotEarlierAndMakesContactWithTheFirstSample) {
  Trace trace = still(1.0);
  trace.samples = {sample_of(0.0, 0.2, 1.0), sample_of(0.1, 0.25, 1.2)};
  Diary diary;
  judge(diary, trace);
  // Cycle 0.2 delivers (it has seen 0.1 last), and 0.25 comes with cycle 0.3.
  EXPECT_THAT(diary.entries, ElementsAre("0.1: contact 1 at 0.5", "0.1: sample 1 epoch 1",
                                         "0.2: sample 1.2 epoch 1"));
}

TEST(Judge, GivesAMethodNoForceThatTheServoWouldNotBelieve) {
  Trace trace = still(1.5);
  trace.samples = {sample_of(0.0, 0.1, 1.0), sample_of(0.3, 0.4, 1.0), sample_of(0.6, 0.7, 9.0),
                   sample_of(0.9, 1.0, 1.0)};
  Diary diary;
  const Verdict verdict = judge(diary, trace);
  EXPECT_EQ(verdict.samples_taken, 3u);
  EXPECT_EQ(verdict.samples_refused, 1u);
  for (const Sample& sample : diary.samples) {
    EXPECT_EQ(sample.force_W.x(), 1.0);
  }
}

TEST(Judge, GivesAMethodTheSamplesOfThePresentContactOnly) {
  Trace trace = still(1.5);
  trace.events = {{0.1, true, Vector3d(7.0, 0.0, 0.0), std::nullopt},
                  {0.5, false, Vector3d::Zero(), std::nullopt},
                  {0.8, true, Vector3d(8.0, 0.0, 0.0), std::nullopt}};
  trace.samples = {sample_of(0.0, 0.15, 1.0),  // before any contact
                   sample_of(0.1, 0.3, 2.0),   // of the first
                   sample_of(0.45, 0.6, 3.0),  // of the first, but it is over
                   sample_of(0.7, 0.75, 4.0),  // of none
                   sample_of(0.49, 0.9, 5.0),  // of the first, in the second
                   sample_of(0.8, 1.0, 6.0)};  // of the second
  Diary diary;
  const Verdict verdict = judge(diary, trace);
  EXPECT_THAT(diary.entries,
              ElementsAre("-1: lost", "0: contact 1 at 7", "0.2: sample 2 epoch 1", "0.4: lost",
                          "0.7: contact 2 at 8", "0.9: sample 6 epoch 2"));
  EXPECT_EQ(verdict.samples_taken, 2u);
  EXPECT_EQ(verdict.samples_not_taken, 4u);
  EXPECT_EQ(diary.samples.back().contact_point_W.x(), 8.0);
}

TEST(Judge, LetsTheServoKnowOfAContactLaterOrWithItsFirstSample) {
  Trace trace = still(1.5);
  trace.events = {{0.1, true, Vector3d(7.0, 0.0, 0.0), 0.4},
                  {0.5, false, Vector3d::Zero(), 0.9},
                  {1.0, true, Vector3d(8.0, 0.0, 0.0), 1.3}};
  trace.samples = {sample_of(0.1, 0.4, 1.0), sample_of(0.4, 0.8, 1.2), sample_of(1.0, 1.2, 3.0)};
  Diary diary;
  judge(diary, trace);
  EXPECT_THAT(diary.entries, ElementsAre("-1: lost", "0.3: contact 1 at 7", "0.3: sample 1 epoch 1",
                                         "0.7: sample 1.2 epoch 1", "0.8: lost",
                                         "1.1: contact 2 at 8", "1.1: sample 3 epoch 2"));
}

TEST(Judge, TakesATraceThatBeginsWithAReleaseAsInContactBefore) {
  Trace trace = still(1.0);
  trace.events = {{0.5, false, Vector3d::Zero(), std::nullopt}};
  trace.samples = {sample_of(0.0, 0.2, 1.0)};
  Diary diary;
  judge(diary, trace);
  EXPECT_THAT(diary.entries,
              ElementsAre("0.1: contact 1 at 0.5", "0.1: sample 1 epoch 1", "0.4: lost"));
}

TEST(Judge, WithholdsTheStiffnessWhenAsked) {
  Diary diary;
  JudgeOptions options;
  judge(diary, Ramp{}.trace(), options);
  EXPECT_TRUE(diary.samples.front().has_stiffness);
  Diary without;
  options.stiffness_to_method = false;
  judge(without, Ramp{}.trace(), options);
  EXPECT_FALSE(without.samples.front().has_stiffness);
  EXPECT_EQ(without.samples.front().stiffness_W, Eigen::Matrix3d::Zero());
}

TEST(Judge, SpendsTheWorkBudgetACycleOrAllAtOnce) {
  Trace trace = still(1.0);
  trace.samples = {sample_of(0.0, 0.2, 1.0)};
  Diary at_once;
  at_once.work_per_sample = 100;
  judge(at_once, trace);
  EXPECT_EQ(at_once.pending_at_force, 0);
  Diary slowly;
  slowly.work_per_sample = 100;
  JudgeOptions options;
  options.work_budget = 10;
  judge(slowly, trace, options);
  EXPECT_EQ(slowly.largest_budget, 10);
  EXPECT_EQ(slowly.pending_at_force, 100);
  EXPECT_EQ(slowly.pending_work, 100 - 8 * 10);  // cycles at 0.2, 0.3, ... 0.9
}

TEST(Judge, SendsRequestsAtTheirRateAndDeliversTheAnswersLater) {
  Trace trace = still(1.0);
  trace.samples = {sample_of(0.0, 0.2, 1.0)};
  Diary diary;
  JudgeOptions options;
  options.requests_per_s = 5.0;  // at 0.2, 0.4, 0.6 and 0.8 s; there is no method to ask before
  options.request_delay_s = 0.15;
  options.answer = [](double time_s, const Vector3d& position_W) {
    EXPECT_EQ(position_W.x(), time_s);
    return sample_of(time_s, time_s, 10.0 * time_s).sample;
  };
  const Verdict verdict = judge(diary, trace, options);
  EXPECT_THAT(diary.entries,
              ElementsAre("0.1: contact 1 at 0.5", "0.1: sample 1 epoch 1", "0.3: answer 2 epoch 1",
                          "0.5: answer 4 epoch 1", "0.7: answer 6 epoch 1"));
  EXPECT_EQ(diary.requests, 4);
  EXPECT_EQ(verdict.requests_answered, 3u);  // the fourth answer arrives after the end
  EXPECT_EQ(verdict.samples_taken, 1u);
}

TEST(Judge, DropsTheAnswersOfAContactThatIsOver) {
  Trace trace = still(1.0);
  trace.events = {{0.0, true, Vector3d(7.0, 0.0, 0.0), std::nullopt},
                  {0.5, false, Vector3d::Zero(), std::nullopt}};
  Diary diary;
  JudgeOptions options;
  options.requests_per_s = 2.5;  // at 0, 0.4 and 0.8 s
  options.request_delay_s = 0.25;
  options.answer = [](double time_s, const Vector3d& /*position_W*/) {
    return sample_of(time_s, time_s, 10.0 * time_s).sample;
  };
  const Verdict verdict = judge(diary, trace, options);
  EXPECT_EQ(diary.requests, 3);
  EXPECT_EQ(verdict.requests_answered, 1u);
  EXPECT_THAT(diary.entries,
              ElementsAre("-1: lost", "-1: contact 1 at 7", "0.2: answer 0 epoch 1", "0.4: lost"));
}

TEST(Judge, TellsOfAnExpectedContactAndDeliversWhatWasAskedBeforeIt) {
  Trace trace = still(0.6);
  for (std::size_t i = 0; i < trace.servo.size(); ++i) {
    trace.servo[i].position_W.x() = 0.1 * static_cast<double>(i);  // 1 m/s
  }
  trace.events = {{0.4, true, Vector3d(7.0, 0.0, 0.0), std::nullopt}};
  Diary diary;
  JudgeOptions options;
  options.requests_per_s = 5.0;  // at 0, 0.2 and 0.4 s
  options.request_delay_s = 0.25;
  options.answer = [](double time_s, const Vector3d& /*position_W*/) {
    return sample_of(time_s, time_s, 1.0).sample;
  };
  options.expect = [](const Vector3d& position_W,
                      const Vector3d& velocity_W) -> std::optional<Vector3d> {
    EXPECT_NEAR(velocity_W.x(), 1.0, 1e-9);
    if (position_W.x() < 0.15) {
      return std::nullopt;
    }
    return Vector3d(3.0, 0.0, 0.0);
  };
  options.answer_before_contact = [](double time_s, const Vector3d& /*position_W*/,
                                     const Vector3d& point_W) {
    return sample_of(time_s, time_s, 10.0 * point_W.x()).sample;
  };
  judge(diary, trace, options);
  EXPECT_THAT(diary.entries,
              ElementsAre("-1: lost", "0.2: expects 3", "0.2: answer 1 epoch 0", "0.3: expects 3",
                          "0.3: contact 1 at 7", "0.4: answer 30 epoch 0"));
  ASSERT_EQ(diary.samples.size(), 2u);
  EXPECT_FALSE(diary.samples[0].before_contact) << "asked when no contact was expected";
  EXPECT_TRUE(diary.samples[1].before_contact);
  EXPECT_EQ(diary.samples[1].contact_point_W.x(), 3.0);
}

TEST(Judge, KeepsTheForcesWhenAsked) {
  Diary diary;
  diary.force_at = [](double time_s) { return Vector3d(time_s, 0.0, 0.0); };
  JudgeOptions options;
  EXPECT_TRUE(judge(diary, still(1.0), options).forces_W.empty());
  options.keep_forces = true;
  const Verdict verdict = judge(diary, still(1.0), options);
  ASSERT_EQ(verdict.forces_W.size(), 10u);
  EXPECT_EQ(verdict.forces_W[7].x(), 0.1 * 7);
}

}  // namespace
}  // namespace forcegrid::evaluation
