// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_kriging_method.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>

#include "forcegrid/method_variant.h"
#include "forcegrid/pair_methods.h"
#include "tests/forcegrid/pair/series_springs.h"

namespace forcegrid {
namespace {

using testing::HardeningPair;

constexpr unsigned kSeed = 5;
constexpr int kAllWork = 1 << 30;

// Where both tools are at a time: each on a Lissajous figure of some 10 mm.
PairVector path_m(double time_s) {
  const double t = 2.0 * 3.14159265358979 * time_s;
  PairVector p;
  p << 0.008 * std::sin(0.53 * t), 0.008 * std::sin(0.71 * t), 0.006 * std::sin(0.97 * t),
      0.007 * std::sin(0.61 * t + 1.0), 0.008 * std::sin(0.83 * t), 0.007 * std::sin(0.47 * t);
  return p;
}

const PairVector kTouched_W = (PairVector() << 0.05, 0.03, 0.1, 0.05, 0.09, 0.1).finished();

PairSample sample_at(double time_s, const PairVector& noise_N = PairVector::Zero()) {
  PairSample sample;
  sample.time_s = time_s;
  sample.positions_W = kTouched_W + path_m(time_s);
  sample.forces_W = HardeningPair{}.forces_N(path_m(time_s)) + noise_N;
  return sample;
}

// With the stiffness there times `factor`.
PairSample stiff_sample_at(double time_s, double factor = 1.0,
                           const PairVector& noise_N = PairVector::Zero()) {
  PairSample sample = sample_at(time_s, noise_N);
  sample.has_stiffness = true;
  sample.stiffness_W = factor * HardeningPair{}.stiffness_N_per_m(path_m(time_s));
  return sample;
}

std::unique_ptr<PairForceMethod> made(const std::string& text) {
  MethodOptions options;
  options.grid.max_W.setConstant(0.2);
  options.grid.cells.setConstant(10);
  const MethodVariant variant = parse_pair_variant(text, options);
  return make_pair_force_method(variant.name, variant.options);
}

struct Errors {
  double first_1s_percent;
  double after_1s_percent;
};

// RMS errors in % of RMS force at 500 Hz, with samples at 30 Hz that arrive a period late.
// @param stiffness_factor  0: samples without stiffness
// @param from_s  when the first second begins to count; the first sample arrives at 0.033 s
Errors errors_of(PairForceMethod& method, double seconds, double noise_N = 0.0,
                 double stiffness_factor = 0.0, double from_s = 0.04) {
  std::mt19937 numbers(kSeed);
  std::normal_distribution<double> noise(0.0, noise_N > 0.0 ? noise_N : 1.0);
  method.contacts_made(1, kTouched_W);
  double squares[2] = {};
  double reference[2] = {};
  int next = 0;
  for (int i = 0; i < static_cast<int>(500 * seconds); ++i) {
    const double now_s = i / 500.0;
    for (; (next + 1) / 30.0 <= now_s; ++next) {
      PairVector error_N = PairVector::Zero();
      for (double& component : error_N) {
        component = noise_N > 0.0 ? noise(numbers) : 0.0;
      }
      method.take_sample(stiffness_factor == 0.0
                             ? sample_at(next / 30.0, error_N)
                             : stiff_sample_at(next / 30.0, stiffness_factor, error_N));
      while (method.work(kAllWork) > 0) {
      }
    }
    const PairVector at_W = kTouched_W + path_m(now_s);
    method.observe(now_s, at_W);
    const PairVector exact_N = HardeningPair{}.forces_N(path_m(now_s));
    if (now_s < from_s) {
      continue;
    }
    const int later = now_s >= 1.0 ? 1 : 0;
    squares[later] += (method.forces(now_s, at_W).forces_W - exact_N).squaredNorm();
    reference[later] += exact_N.squaredNorm();
  }
  return {100.0 * std::sqrt(squares[0] / reference[0]),
          100.0 * std::sqrt(squares[1] / reference[1])};
}

double error_percent(PairForceMethod& method, double seconds, double noise_N = 0.0) {
  return errors_of(method, seconds, noise_N).after_1s_percent;
}

TEST(PairKriging, FollowsBothToolsWhereUncoupledMethodsCannot) {
  const auto coupled = made("kriging-6d");
  const auto uncoupled = made("kriging");
  const double coupled_percent = error_percent(*coupled, 6.0);
  EXPECT_LT(coupled_percent, 1.0);
  EXPECT_GT(error_percent(*uncoupled, 6.0), 10.0 * coupled_percent);
}

TEST(PairKriging, WithoutContactHasNoForceAndBeforeAnySampleKnowsNone) {
  const auto method = made("kriging-6d");
  EXPECT_EQ(method->forces(0.0, kTouched_W).status, EstimateStatus::kUnknown);
  method->take_sample(sample_at(0.5));  // no contact yet
  method->contacts_made(1, kTouched_W);
  EXPECT_EQ(method->work(kAllWork), 0);
  EXPECT_EQ(method->forces(0.0, kTouched_W).status, EstimateStatus::kUnknown);
  method->take_sample(sample_at(0.6));
  EXPECT_GT(method->work(kAllWork), 0);
  const PairEstimate known = method->forces(0.6, kTouched_W + path_m(0.6));
  EXPECT_EQ(known.status, EstimateStatus::kOk);
  EXPECT_LT((known.forces_W - sample_at(0.6).forces_W).norm(), 0.01);
  method->contacts_lost();
  EXPECT_EQ(method->forces(0.6, kTouched_W).status, EstimateStatus::kOk);
  EXPECT_EQ(method->forces(0.6, kTouched_W).forces_W, PairVector::Zero());
  method->contacts_made(2, kTouched_W);  // what was held is another patch
  EXPECT_EQ(method->forces(0.6, kTouched_W).status, EstimateStatus::kUnknown);
}

TEST(PairKriging, FadesFarFromEverySample) {
  const auto method = made("kriging-6d");
  method->contacts_made(1, kTouched_W);
  method->take_sample(sample_at(0.6));
  method->work(kAllWork);
  const PairVector at_W = kTouched_W + path_m(0.6);
  const auto away = [&](double metres) {
    return method->forces(0.7, at_W + metres * PairVector::Unit(4));
  };
  EXPECT_EQ(away(0.05).status, EstimateStatus::kOk);
  EXPECT_EQ(away(0.07).status, EstimateStatus::kPartlyKnown);
  EXPECT_GT(away(0.07).forces_W.norm(), 0.0);
  EXPECT_LT(away(0.0899).forces_W.norm(), 1e-3 * away(0.06).forces_W.norm());
  EXPECT_EQ(away(0.1).status, EstimateStatus::kUnknown);
  EXPECT_EQ(away(0.1).forces_W, PairVector::Zero());
}

TEST(PairKriging, IgnoresWhatIsNotFiniteOrOlder) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto method = made("kriging-6d");
  method->contacts_made(1, kTouched_W);
  PairSample bad = sample_at(0.6);
  bad.forces_W[3] = nan;
  method->take_sample(bad);
  bad = sample_at(nan);
  bad.positions_W.setZero();
  method->take_sample(bad);
  EXPECT_EQ(method->work(kAllWork), 0);
  method->take_sample(sample_at(0.6));
  while (method->work(kAllWork) > 0) {
  }
  method->take_sample(sample_at(0.5));
  EXPECT_EQ(method->work(kAllWork), 0);
  PairVector at_W = kTouched_W;
  at_W[5] = nan;
  EXPECT_EQ(method->forces(0.6, at_W).status, EstimateStatus::kNotFinite);
  EXPECT_EQ(method->forces(nan, kTouched_W).status, EstimateStatus::kNotFinite);
  EXPECT_EQ(method->forces(0.6, at_W).forces_W, PairVector::Zero());
}

TEST(PairKriging, PassesOverTheOldestSamplesThatItHasNoTimeFor) {
  const auto method = made("kriging-6d");
  method->contacts_made(1, kTouched_W);
  for (int i = 0; i < 11; ++i) {
    method->take_sample(sample_at(0.1 * i));
  }
  EXPECT_STREQ(method->counters()[0].name, "samples_passed_over");
  EXPECT_EQ(method->counters()[0].value, 3U);
  while (method->work(kAllWork) > 0) {
  }
  EXPECT_EQ(dynamic_cast<PairKrigingMethod&>(*method).rendered().sample_count(), 8);
}

TEST(PairKriging, ExceedsABudgetByAtMostOnePiece) {
  const auto method = made("auto-6d");
  method->contacts_made(1, kTouched_W);
  constexpr int kRows = 6 * 32;
  constexpr int kPiece = 1 + kRows * kRows / 8;
  for (int i = 0; i < 60; ++i) {
    method->take_sample(sample_at(i / 30.0));
    for (int done = 1; done > 0;) {
      done = method->work(500);
      EXPECT_LE(done, 500 + kPiece);
    }
  }
  // With two samples' stiffness; of fields without it two pieces are done at once.
  constexpr int kRowsWithStiffness = kRows + 2 * pair::kStiffnessNumbers;
  constexpr int kLargest = std::max(1 + kRowsWithStiffness * kRowsWithStiffness / 8, 2 * kPiece);
  for (int i = 60; i < 120; ++i) {
    method->take_sample(stiff_sample_at(i / 30.0));
    for (int done = 1; done > 0;) {
      done = method->work(500);
      EXPECT_LE(done, 500 + kLargest);
    }
  }
}

// A loop of 500 Hz spends 1000 units a cycle: 16 cycles for each sample.
TEST(PairAuto, KeepsUpWithThirtySamplesASecondAtFiveHundredHertz) {
  for (const bool stiffness : {false, true}) {
    const auto method = made("auto-6d");
    method->contacts_made(1, kTouched_W);
    int next = 0;
    int busy_cycles = 0;
    for (int cycle = 0; cycle < 5000; ++cycle) {
      for (; next / 30.0 <= cycle / 500.0; ++next) {
        method->take_sample(stiffness ? stiff_sample_at(next / 30.0) : sample_at(next / 30.0));
      }
      busy_cycles += method->work(1000) > 0 ? 1 : 0;
    }
    EXPECT_EQ(method->counters()[0].value, 0U) << stiffness;  // passed over
    EXPECT_LT(busy_cycles, 4500) << stiffness;                // it catches up between samples
  }
}

// The same samples, without stiffness from the tenth on: the fields with it go on as well.
TEST(PairAuto, GoesOnWhereTheStiffnessEndsOrBegins) {
  for (const bool begins : {false, true}) {
    const auto method = made("auto-6d");
    method->contacts_made(1, kTouched_W);
    double error_N2 = 0.0;
    double exact_N2 = 0.0;
    for (int i = 0; i < 90; ++i) {
      if (i >= 45) {
        const PairVector exact_N = sample_at(i / 30.0).forces_W;
        const PairEstimate found = method->forces(i / 30.0, kTouched_W + path_m(i / 30.0));
        EXPECT_EQ(found.status, EstimateStatus::kOk);
        error_N2 += (found.forces_W - exact_N).squaredNorm();
        exact_N2 += exact_N.squaredNorm();
      }
      method->take_sample((i < 10) != begins ? stiff_sample_at(i / 30.0) : sample_at(i / 30.0));
      while (method->work(kAllWork) > 0) {
      }
    }
    EXPECT_LT(error_N2, 0.01 * 0.01 * exact_N2) << begins;
  }
}

double noise_chosen_N2(double noise_N) {
  const auto method = made("auto-6d");
  error_percent(*method, 6.0, noise_N);
  return dynamic_cast<PairKrigingMethod&>(*method).rendered().settings().nugget_N2;
}

TEST(PairAuto, ExpectsMoreNoiseOfSamplesThatHaveMore) {
  RecordProperty("seed", static_cast<int>(kSeed));
  EXPECT_LE(noise_chosen_N2(0.0), 1e-6);
  EXPECT_GE(noise_chosen_N2(0.030), 1e-4);
}

TEST(PairAuto, IsBetterThanTheOneFieldOnNoisySamples) {
  const auto choosing = made("auto-6d");
  const auto fixed = made("kriging-6d");
  EXPECT_LT(error_percent(*choosing, 8.0, 0.020), 0.8 * error_percent(*fixed, 8.0, 0.020));
}

// From one cycle to the next the force changes by what the tools' motion explains, also where
// another candidate takes over.
TEST(PairAuto, ChangesItsCandidateWithoutAJump) {
  const auto method = made("auto-6d");
  method->contacts_made(1, kTouched_W);
  std::mt19937 numbers(kSeed);
  std::normal_distribution<double> noise(0.0, 0.02);
  int next = 0;
  int changes_seen = 0;
  for (int i = 0; i < 4000; ++i) {
    const double now_s = i / 500.0;
    const PairVector at_W = kTouched_W + path_m(now_s);
    method->observe(now_s, at_W);
    const PairVector before_N = method->forces(now_s, at_W).forces_W;
    const auto changes = method->counters()[1].value;
    const auto* const field = &dynamic_cast<PairKrigingMethod&>(*method).rendered();
    for (; (next + 1) / 30.0 <= now_s; ++next) {
      PairVector error_N;
      for (double& component : error_N) {
        component = noise(numbers);
      }
      method->take_sample(sample_at(next / 30.0, error_N));
      while (method->work(kAllWork) > 0) {
      }
    }
    if (method->counters()[1].value != changes) {
      ++changes_seen;
      // The candidate before, which has taken the sample as well, at the same place and time.
      const PairVector old_N = field->read(path_m(now_s)).forces_N;
      const PairVector now_N = method->forces(now_s, at_W).forces_W;
      EXPECT_LT((now_N - old_N).norm(), 1e-4 + 0.2 * (before_N - old_N).norm());
    }
  }
  EXPECT_GT(changes_seen, 0);
}

TEST(PairKriging, IsBetterWithTheStiffnessOfTheSamples) {
  for (const char* name : {"kriging-6d", "auto-6d"}) {
    const Errors without = errors_of(*made(name), 6.0);
    const Errors with = errors_of(*made(name), 6.0, 0.0, 1.0);
    EXPECT_LT(with.first_1s_percent, 0.5 * without.first_1s_percent) << name;
    EXPECT_LT(with.after_1s_percent, 0.9 * without.after_1s_percent) << name;
  }
}

TEST(PairAuto, IsHardlyWorseWithAWrongStiffnessThanWithout) {
  for (const double factor : {0.5, 0.8, 1.5, -1.0}) {
    constexpr double kCompared_s = 0.1;  // two samples have shown that it is wrong
    const Errors without = errors_of(*made("auto-6d"), 6.0, 0.0, 0.0, kCompared_s);
    const Errors wrong = errors_of(*made("auto-6d"), 6.0, 0.0, factor, kCompared_s);
    EXPECT_LT(wrong.after_1s_percent, 1.05 * without.after_1s_percent) << factor;
    EXPECT_LT(wrong.first_1s_percent, 1.05 * without.first_1s_percent) << factor;
  }
}

TEST(PairMethods, RefuseWhatTheyCannotUse) {
  const auto refusal = [](const std::string& text) {
    try {
      made(text);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("it was made");
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(refusal("kriging-7d"),
              HasSubstr("'kriging-7d' is not known; known methods: auto-6d"));
  EXPECT_THAT(refusal("kriging-6d samples=49"), HasSubstr("2 to 48"));
  EXPECT_THAT(refusal("auto-6d nug=1e-4"), HasSubstr("leave nug out"));
  EXPECT_THAT(refusal("tangent"), HasSubstr("stiffness, which not all samples of two tools have"));
  EXPECT_THAT(refusal("forcegrid+request"), HasSubstr("answers to requests"));
}

TEST(PairMethods, StateTheirMemory) {
  EXPECT_GT(made("kriging-6d")->memory_bytes(), sizeof(pair::PairField));
  EXPECT_GT(made("auto-6d")->memory_bytes(), 4 * sizeof(pair::PairField));
  EXPECT_LT(made("auto-6d")->memory_bytes(), 20'000'000U);
}

}  // namespace
}  // namespace forcegrid
