// SPDX-License-Identifier: Apache-2.0
// Who of an ensemble is awake: the evidence that wakes candidates, what a woken one begins with,
// and that nothing is lost against an ensemble in which nobody ever sleeps.

#include "forcegrid/kriging/wake_rule.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <random>
#include <string>
#include <vector>

#include "forcegrid/kriging/ensemble_method.h"
#include "forcegrid/kriging/history.h"
#include "forcegrid/kriging/kriging_field.h"
#include "tests/forcegrid/kriging/kriging_play.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using namespace testing;
using Kind = EnsembleMethod::Kind;

// Normalised squares of errors that are `larger` times as large as predicted.
class Innovations {
 public:
  explicit Innovations(double larger) : normal_(0.0, larger) {}
  double next() {
    double square = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double e = normal_(random_);
      square += e * e;
    }
    return square / 3.0;
  }

 private:
  std::mt19937 random_{kSeed};
  std::normal_distribution<double> normal_;
};

TEST(Misfit, IsFoundWithoutCauseAtMostOnceInTheExponentialOfItsThreshold) {
  constexpr double kNats = 6.0;
  constexpr int kSamples = 200'000;
  kriging::Misfit misfit(kNats);
  Innovations innovations(1.0);
  int found = 0;
  for (int i = 0; i < kSamples; ++i) {
    misfit.add(innovations.next());
    if (misfit.found()) {
      ++found;
      misfit.restart();
    }
  }
  EXPECT_LE(found, kSamples / std::exp(kNats)) << "seed " << kSeed;
}

TEST(Misfit, IsFoundWithinAFewSamplesOfErrorsThreeTimesAsLarge) {
  constexpr int kRuns = 1000;
  Innovations innovations(3.0);
  int samples = 0;
  for (int run = 0; run < kRuns; ++run) {
    kriging::Misfit misfit(8.0);
    while (!misfit.found()) {
      misfit.add(innovations.next());
      ++samples;
    }
  }
  EXPECT_LT(samples, 3 * kRuns) << "seed " << kSeed;
}

TEST(DictionaryField, BeginsWithManySamplesAsIfItHadTakenThem) {
  const AnchoredSprings object(kSeed);
  std::vector<kriging::Observation> observations;
  for (int i = 0; i < 20; ++i) {
    kriging::Observation o;
    o.position_m = Vector3d(0.004 * (i % 3), 0.004 * (i / 3 % 3), 0.004 * (i / 9));
    o.force_N = object.force_N(o.position_m);
    o.contact = 1;
    observations.push_back(o);
  }
  kriging::DictionaryField<double, 32, 0> one_by_one({});
  kriging::DictionaryField<double, 32, 0> at_once({});
  for (const kriging::Observation& o : observations) {
    one_by_one.take(o);
  }
  // What it knew before does not count.
  kriging::Observation other;
  other.force_N = Vector3d(9.0, 9.0, 9.0);
  at_once.take(other);
  ASSERT_TRUE(at_once.begin_with(observations));
  EXPECT_EQ(at_once.sample_count(), one_by_one.sample_count());
  for (const Vector3d& p_m : {Vector3d(0.003, 0.002, 0.001), Vector3d(-0.01, 0.02, 0.005)}) {
    const Vector3d expected_N = one_by_one.read(p_m, kriging::History::Zero()).force_N;
    EXPECT_LT((at_once.read(p_m, kriging::History::Zero()).force_N - expected_N).norm(),
              1e-6 * expected_N.norm());
  }
}

kriging::EnsembleThresholds nobody_sleeps() {
  kriging::EnsembleThresholds thresholds;
  thresholds.everybody_awake = true;
  return thresholds;
}

int awake(const EnsembleMethod& ensemble) {
  int count = 0;
  for (std::size_t i = 0; i < ensemble.candidates().size(); ++i) {
    count += ensemble.candidate(i).awake() ? 1 : 0;
  }
  return count;
}

TEST(WakeRule, LetsOneCandidateWorkOnAPlainElasticObject) {
  const AnchoredSprings object(kSeed);
  Play play = hand_on(object);
  play.duration_s = 12.0;
  EnsembleMethod all(Kind::kAuto, {}, nobody_sleeps());
  play.run(all);
  EXPECT_EQ(awake(all), 13);
  const double all_error = play.error_after_1s;
  EnsembleMethod few(Kind::kAuto, {});
  play.run(few);
  EXPECT_LE(awake(few), 3) << "the rendered one, newest, and one in an audition";
  EXPECT_LT(play.error_after_1s, 1.1 * all_error);
}

// A tool that rests between pokes tells candidates apart by luck alone. The choice then flickers,
// but one alone would have done as well, and all others sleep.
TEST(WakeRule, LetsOneCandidateWorkWhereTheChoiceFlickers) {
  const AnchoredSprings object(kSeed);
  Play play = poke_on(object);
  play.duration_s = 12.0;
  EnsembleMethod all(Kind::kAuto, {}, nobody_sleeps());
  play.run(all);
  const double all_error = play.error_after_1s;
  EnsembleMethod few(Kind::kAuto, {});
  play.run(few);
  EXPECT_LT(awake(few), 8);
  EXPECT_LT(play.error_after_1s, 1.1 * all_error);
}

// The object slides away under a tool that is held nearly still, and nobody says so: every older
// sample misleads a field that does not know of it.
TEST(AutoMethod, FollowsAnObjectThatSlidesAway) {
  const AnchoredSprings object(kSeed);
  Play play = hand_on(object);
  play.displacement_m = [](double t_s) {
    return Vector3d(0.004 + 2e-4 * std::sin(50.0 * t_s), 0.003 * std::sin(t_s), 0.010);
  };
  play.force_N = [object](double t_s, const Vector3d& d_m) {
    const double slid_m = t_s < 4.0 ? 0.0 : 0.003 * (t_s - 4.0);
    return object.force_N(d_m - Vector3d(slid_m, -0.6 * slid_m, 0.0));
  };
  play.duration_s = 10.0;
  play.first_s = 5.0;
  EnsembleMethod method(Kind::kAuto, {});
  play.run(method);
  const double auto_error = play.error_after_1s;
  kriging::EnsembleThresholds no_specialists;
  no_specialists.specialist_weight = 1e9;
  no_specialists.path_better_for_long = 0.0;  // nor is any proven
  EnsembleMethod without(Kind::kAuto, {}, no_specialists);
  play.run(without);
  EXPECT_LT(auto_error, 0.8 * play.error_after_1s);
}

// The object changes after six seconds, when all but one sleep: from `settled_s` on, the ensemble
// is as good as one in which nobody sleeps.
void expect_as_good_as_all_awake(Play play, double settled_s, const std::string& what) {
  play.duration_s = 14.0;
  play.first_s = settled_s;
  EnsembleMethod all(Kind::kAuto, {}, nobody_sleeps());
  play.run(all);
  const double all_error = play.error_after_1s;
  EnsembleMethod few(Kind::kAuto, {});
  play.run(few);
  EXPECT_LT(play.error_after_1s, 1.3 * all_error) << what << ", all awake: " << all_error;
}

TEST(WakeRule, WakesEverybodyWithinTwoSecondsWhenTheObjectBeginsToDamp) {
  const AnchoredSprings object(kSeed);
  Play play = hand_on(object);
  const HandMotion motion(kSeed);
  play.force_N = [=](double t_s, const Vector3d& d_m) {
    const Vector3d velocity =
        (motion.position_m(t_s + 1e-4) - motion.position_m(t_s - 1e-4)) / 2e-4;
    const double damping_Ns_per_m = t_s < 6.0 ? 0.0 : 3.0;
    return Vector3d(object.force_N(d_m) - damping_Ns_per_m * velocity);
  };
  expect_as_good_as_all_awake(play, 8.0, "damping");
}

TEST(WakeRule, WakesEverybodyWhenTheRenderedCandidateCanDoNothingWithASample) {
  const kriging::EnsembleThresholds thresholds;
  const ToolHistory path(kriging::kPathTimeConstants_s);
  kriging::Candidates candidates = kriging::make_candidates(Kind::kAuto, {}, thresholds, path);
  const kriging::CandidateChoice choice(candidates, thresholds);
  kriging::WakeRule rule(candidates, thresholds, true);
  kriging::EvaluatedSample alike;
  alike.error_N2.fill(1.0);
  for (int i = 0; i < thresholds.awake_samples; ++i) {
    rule.evaluated(alike);
    rule.scored(choice);
  }
  ASSERT_FALSE(rule.all_awake());
  rule.rendered_had_no_use();
  EXPECT_TRUE(rule.all_awake());
}

TEST(WakeRule, WakesWallsAtOnceWhenTheToolMeetsOne) {
  const AnchoredSprings object(kSeed);
  Play play = hand_on(object);
  play.displacement_m = [](double t_s) {
    const double ahead_m = t_s < 6.0 ? 0.0 : 0.005 * (1.0 - std::cos(2.0 * (t_s - 6.0)));
    return Vector3d(ahead_m, 0.008 * std::sin(2.0 * t_s), 0.008 * std::cos(1.3 * t_s));
  };
  play.force_N = [object](double, const Vector3d& d_m) {
    const double inside_m = std::max(0.0, d_m.x() - 0.004);
    return Vector3d(object.force_N(d_m) - Vector3d(1500.0 * inside_m, 0.0, 0.0));
  };
  expect_as_good_as_all_awake(play, 1.0, "wall");
}

}  // namespace
}  // namespace forcegrid
