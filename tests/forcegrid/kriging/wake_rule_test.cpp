// SPDX-License-Identifier: Apache-2.0
// Who of an ensemble is awake: the evidence that wakes candidates, what a woken one begins with,
// how long who sleeps, and that nothing is lost against an ensemble in which nobody ever sleeps.

#include "forcegrid/kriging/wake_rule.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "forcegrid/kriging/candidate_choice.h"
#include "forcegrid/kriging/ensemble_candidates.h"
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

// Who sleeps for how long, by the numbers of docs/kriging.md, "Who is awake".
namespace forcegrid::kriging {
namespace {

using ::testing::ElementsAre;
using Errors_N2 = std::map<std::string, double>;  // squared; all others err by `others`

constexpr double kLongInContact_s = 10.0;
constexpr double kUnsure_N = 0.011;

// The rule of `auto`, and the samples that it hears of.
class Sleepers {
 public:
  // One sample of the path, evaluated and scored.
  void sample(const std::string& rendered, const Errors_N2& errors_N2, double others_N2 = 1.0,
              double since_contact_s = kLongInContact_s) {
    queued(rendered, since_contact_s, {});
    EvaluatedSample evaluated;
    evaluated.error_N2.fill(others_N2);
    for (const auto& [name, error_N2] : errors_N2) {
      evaluated.error_N2[index(name)] = error_N2;
    }
    rule.evaluated(evaluated);
    rule.scored(choice_);
  }
  void samples(int count, const std::string& rendered, const Errors_N2& errors_N2,
               double others_N2 = 1.0) {
    for (int i = 0; i < count; ++i) {
      sample(rendered, errors_N2, others_N2);
    }
  }
  // One that is queued and not yet evaluated.
  void queued(const std::string& rendered, double since_contact_s, const QueuedSample& sample) {
    rule.sample_queued(number_++, sample, since_contact_s, index(rendered));
  }
  // All err alike for 30 samples: the rendered one would have sufficed.
  void all_fall_asleep() {
    samples(30, "exact", {});
    ASSERT_FALSE(rule.all_awake());
  }

  std::size_t index(const std::string& name) const {
    for (std::size_t i = 0; i < candidates.all.size(); ++i) {
      if (candidates.all[i]->name() == name) {
        return i;
      }
    }
    ADD_FAILURE() << "no candidate " << name;
    return 0;
  }
  bool awake(const std::string& name) const { return rule.awake(index(name)); }

  const EnsembleThresholds thresholds{};
  const ToolHistory path{kPathTimeConstants_s};
  Candidates candidates = make_candidates(EnsembleKind::kAuto, {}, thresholds, path);
  WakeRule rule{candidates, thresholds, true};

 private:
  const CandidateChoice choice_{candidates, thresholds};
  std::uint64_t number_ = 0;
};

// In these tests "smooth" is a little better than the rendered one, so that not all sleep; or the
// rendered one knows the path.

TEST(TheOneThatBegan, SleepsWithAllOthersUnlessItWasChosen) {
  Sleepers s;
  s.samples(5, "smooth", {});
  s.rule.handed_over(s.index("exact"));
  s.all_fall_asleep();
  EXPECT_FALSE(s.awake("smooth"));
  Sleepers chosen;
  chosen.samples(5, "smooth", {});
  chosen.rule.handed_over(chosen.index("exact"));
  chosen.sample("exact", {});
  chosen.rule.handed_over(chosen.index("smooth"));
  chosen.sample("smooth", {});
  chosen.rule.handed_over(chosen.index("exact"));
  chosen.all_fall_asleep();
  EXPECT_TRUE(chosen.awake("smooth"));
}

TEST(TheOneThatBegan, StaysBesideAnotherThatWasRenderedLately) {
  Sleepers s;
  s.samples(5, "smooth", {});
  s.rule.handed_over(s.index("viscous"));
  s.sample("viscous", {});
  s.rule.handed_over(s.index("exact"));
  s.samples(70, "exact", {});  // until the path is no longer needed
  ASSERT_FALSE(s.rule.all_awake());
  EXPECT_TRUE(s.awake("viscous"));
  EXPECT_TRUE(s.awake("smooth"));
}

// "smooth" was chosen, then "exact"; all fall asleep but these.
void keep_smooth(Sleepers& s) {
  s.samples(5, "exact", {});
  s.rule.handed_over(s.index("smooth"));
  s.sample("smooth", {});
  s.rule.handed_over(s.index("exact"));
  s.all_fall_asleep();
  ASSERT_TRUE(s.awake("smooth"));
}

TEST(RenderedLately, SleepsAfter30SamplesThatItPredictsNoBetter) {
  Sleepers s;
  keep_smooth(s);
  s.samples(29, "exact", {{"smooth", 1.0}});
  EXPECT_TRUE(s.awake("smooth"));
  s.sample("exact", {{"smooth", 1.0}});
  EXPECT_FALSE(s.awake("smooth"));
}

TEST(RenderedLately, StaysFor200SamplesIfItPredictsBetter) {
  Sleepers s;
  keep_smooth(s);
  s.samples(100, "exact", {{"smooth", 0.9}});
  EXPECT_TRUE(s.awake("smooth"));
  s.samples(71, "exact", {{"smooth", 0.9}});  // 30 went by before
  EXPECT_FALSE(s.awake("smooth"));
}

TEST(RenderedLately, StaysIfChoosingItHasGainedSomething) {
  Sleepers s;
  keep_smooth(s);
  for (int turn = 0; turn < 4; ++turn) {  // each is right in its turn, and rendered then
    s.rule.handed_over(s.index("smooth"));
    s.sample("smooth", {{"smooth", 1.0}}, 9.0);
    s.rule.handed_over(s.index("exact"));
    s.samples(39, "exact", {{"exact", 1.0}}, 9.0);
  }
  EXPECT_TRUE(s.awake("smooth"));
}

TEST(RenderedLately, StaysFor200SamplesAfterEverybodyWasWoken) {
  Sleepers s;
  keep_smooth(s);
  s.rule.rendered_had_no_use();
  ASSERT_TRUE(s.rule.all_awake());
  s.rule.handed_over(s.index("smooth"));
  s.sample("smooth", {});
  s.rule.handed_over(s.index("exact"));
  s.all_fall_asleep();
  s.samples(100, "exact", {});
  EXPECT_TRUE(s.awake("smooth"));
}

TEST(RenderedLately, StaysAgainWhenItIsRenderedAgain) {
  Sleepers s;
  keep_smooth(s);
  s.samples(30, "exact", {});
  ASSERT_FALSE(s.awake("smooth"));
  s.rule.handed_over(s.index("smooth"));
  s.sample("smooth", {});
  s.rule.handed_over(s.index("exact"));
  s.sample("exact", {});
  EXPECT_TRUE(s.awake("smooth"));
}

TEST(HopelessCandidates, SleepAfter40SamplesOfSixteenTimesTheSquaredError) {
  Sleepers s;
  const Errors_N2 errors_N2{{"smooth", 0.5}, {"viscous", 15.5}, {"noisy viscous", 16.5}};
  s.samples(39, "exact", errors_N2);
  EXPECT_TRUE(s.awake("noisy viscous"));
  s.sample("exact", errors_N2);
  EXPECT_FALSE(s.awake("noisy viscous"));
  s.samples(200, "exact", errors_N2);
  EXPECT_TRUE(s.rule.all_awake()) << "but for those that are hopeless";
  EXPECT_TRUE(s.awake("viscous"));
  EXPECT_FALSE(s.awake("noisy viscous"));
}

// Samples a thousand times as bad count as 1, those that are alike as 0: of three, one makes an
// average of 1/3, two one of 2/3. The limit is 1/2.
TEST(HopelessCandidates, AreNotHopelessForAFewBadSamples) {
  Sleepers s;
  for (int i = 0; i < 120; ++i) {
    s.sample("exact", {{"smooth", 0.5},
                       {"viscous", i % 3 == 0 ? 1000.0 : 1.0},
                       {"noisy viscous", i % 3 != 0 ? 1000.0 : 1.0}});
  }
  EXPECT_TRUE(s.awake("viscous"));
  EXPECT_FALSE(s.awake("noisy viscous"));
}

// ln 1.9 / ln 4 = 0.46 and ln 2.2 / ln 4 = 0.57; one bad sample in 40 makes both sums far more than
// 16 times as large, and adds at most 0.03 to the averages.
TEST(HopelessCandidates, AreAsBadInMostSamplesByALittleAtLeast) {
  Sleepers s;
  for (int i = 0; i < 40; ++i) {
    s.sample("exact", {{"smooth", 0.5},
                       {"viscous", i == 10 ? 1e4 : 1.9},
                       {"noisy viscous", i == 10 ? 1e4 : 2.2}});
  }
  EXPECT_TRUE(s.awake("viscous"));
  EXPECT_FALSE(s.awake("noisy viscous"));
}

TEST(HopelessCandidates, AreNeverTheBestThatKnowsThePositionAloneNorTheNewestSample) {
  Sleepers s;
  const Errors_N2 errors_N2{{"viscous", 1.0}, {"smooth", 60.0}, {"exact", 50.0}, {"noisy", 70.0}};
  s.samples(40, "viscous", errors_N2, 100.0);
  EXPECT_TRUE(s.awake("viscous"));
  EXPECT_TRUE(s.awake("exact"));
  EXPECT_TRUE(s.awake("newest"));
  for (const char* const other : {"smooth", "noisy", "very noisy", "noisy viscous", "walls",
                                  "memory", "unfinished", "relaxing"}) {
    EXPECT_FALSE(s.awake(other)) << other;
  }
}

TEST(HopelessCandidates, StayAwakeFor200SamplesAfterTheyWereRendered) {
  Sleepers s;
  const Errors_N2 errors_N2{{"viscous", 1.0}, {"smooth", 50.0}};
  s.sample("exact", errors_N2, 100.0);
  s.samples(199, "viscous", errors_N2, 100.0);
  EXPECT_TRUE(s.awake("exact"));
  EXPECT_FALSE(s.awake("noisy"));
  s.samples(10, "viscous", errors_N2, 100.0);
  EXPECT_FALSE(s.awake("exact"));
}

TEST(HopelessCandidates, AreNotLookedForWhileWallsWasRenderedInTheLast60Samples) {
  Sleepers s;
  const Errors_N2 errors_N2{{"walls", 1.0}, {"viscous", 1.0}, {"smooth", 50.0}};
  s.samples(30, "walls", errors_N2, 100.0);
  s.samples(58, "viscous", errors_N2, 100.0);
  EXPECT_TRUE(s.awake("noisy"));
  s.samples(5, "viscous", errors_N2, 100.0);
  EXPECT_FALSE(s.awake("noisy"));
}

// With n = 5, S grows by 20/3 - 3 ln 3 = 3.37 at each sample: above 8 with the third.
TEST(HopelessCandidates, WakeWithAllOthersAndMaySleepAgainAfterAnother40Samples) {
  Sleepers s;
  const Errors_N2 errors_N2{{"smooth", 0.5}, {"noisy viscous", 17.0}};
  s.samples(40, "exact", errors_N2);
  ASSERT_FALSE(s.awake("noisy viscous"));
  Innovation innovation;
  innovation.predicted = true;
  innovation.error_N = 0.9e-3;  // below 1 mN: none
  innovation.normalised = 5.0;
  for (int i = 0; i < 10; ++i) {
    s.rule.rendered_took(innovation);
  }
  innovation.error_N = 0.1;
  s.rule.rendered_took(innovation);
  s.rule.rendered_took(innovation);
  EXPECT_FALSE(s.awake("noisy viscous"));
  s.rule.rendered_took(innovation);
  EXPECT_TRUE(s.awake("noisy viscous"));
  s.samples(39, "exact", errors_N2);
  EXPECT_TRUE(s.awake("noisy viscous"));
  s.sample("exact", errors_N2);
  EXPECT_FALSE(s.awake("noisy viscous"));
}

// The contacts, from 1 on, in whose first sample `name` is awake.
std::vector<int> contacts_with(Sleepers& s, const std::string& name, int contacts, int first = 1) {
  std::vector<int> with;
  for (int contact = first; contact < first + contacts; ++contact) {
    s.rule.contact_made();
    s.queued("exact", 0.1, {});
    if (s.awake(name)) {
      with.push_back(contact);
    }
  }
  return with;
}

TEST(ContactPauses, OfPlacesAreTwoAndThenFourContactsWhileItWinsNothing) {
  Sleepers s;
  s.all_fall_asleep();
  EXPECT_THAT(contacts_with(s, "places", 15), ElementsAre(1, 3, 7, 11, 15));
  // A win: from the next contact on as at first.
  s.rule.handed_over(s.index("places"));
  s.rule.handed_over(s.index("exact"));
  EXPECT_THAT(contacts_with(s, "places", 9, 16), ElementsAre(16, 17, 19, 23));
}

TEST(ContactPauses, OfMemoryAreTheSameAndItPredictsFourSamples) {
  Sleepers s;
  s.all_fall_asleep();
  for (int contact = 1; contact <= 8; ++contact) {
    s.rule.contact_made();
    const bool asked = contact == 1 || contact == 3 || contact == 7;
    for (int sample = 1; sample <= 6; ++sample) {
      s.queued("exact", 0.03 * sample, {});
      EXPECT_EQ(s.awake("memory"), asked && sample <= 4) << contact << ", sample " << sample;
    }
  }
}

TEST(ContactPauses, EndForPlacesWithAnAnswerFromBeforeTheContact) {
  Sleepers s;
  s.all_fall_asleep();
  contacts_with(s, "places", 1);
  s.rule.contact_made();  // the second: not asked
  EXPECT_FALSE(s.awake("places"));
  QueuedSample before;
  before.before_contact = true;
  s.queued("exact", 0.0, before);
  EXPECT_TRUE(s.awake("places"));
}

TEST(Places, IsAwakeForTheFirst400MillisecondsAndKeepsTheSamplesOf800) {
  Sleepers s;
  s.all_fall_asleep();
  s.rule.contact_made();
  for (const double since_s : {0.0, 0.39, 0.41, 0.79, 0.81}) {
    s.queued("exact", since_s, {});
    EXPECT_EQ(s.awake("places"), since_s < 0.4) << since_s;
    EXPECT_EQ(s.rule.places_misses(), since_s > 0.4 && since_s < 0.8) << since_s;
  }
  s.rule.contact_made();  // not asked at the second
  for (const double since_s : {0.0, 0.39, 0.41, 0.79, 0.81}) {
    s.queued("exact", since_s, {});
    EXPECT_FALSE(s.awake("places")) << since_s;
    EXPECT_EQ(s.rule.places_misses(), since_s < 0.8) << since_s;
  }
}

TEST(Auditions, OfTheRunnerUpTakeTwelveSamplesWithPausesThatDoubleUpTo192) {
  Sleepers s;
  for (const auto& candidate : s.candidates.all) {
    candidate->score_N2 = 2.0;
  }
  s.candidates.all[s.index("noisy")]->score_N2 = 1.0;
  s.all_fall_asleep();
  std::vector<int> begun;
  std::vector<int> lengths;
  bool before = false;
  for (int sample = 1; sample <= 800; ++sample) {
    s.queued("exact", kLongInContact_s, {});
    const bool now = s.awake("noisy");
    if (now && !before) {
      begun.push_back(sample);
      lengths.push_back(0);
    }
    if (now) {
      ++lengths.back();
    }
    before = now;
  }
  EXPECT_THAT(lengths, ::testing::Each(12));
  // The 24th, then each 12 samples and a pause of 24, 48, 96, 192, 192 later.
  EXPECT_THAT(begun, ElementsAre(24, 60, 120, 228, 432, 636));
}

TEST(Auditions, AreNotForAFieldOfAnObjectThatHasNeverMoved) {
  Sleepers s;
  for (const auto& candidate : s.candidates.all) {
    candidate->score_N2 = 2.0;
  }
  s.candidates.all[s.index("moved")]->score_N2 = 1.0;
  s.all_fall_asleep();
  for (int sample = 0; sample < 800; ++sample) {
    s.queued("exact", kLongInContact_s, {});
    ASSERT_FALSE(s.awake("moved")) << sample;
  }
}

TEST(Auditions, OfMemoryBeginWhereTheRenderedOneIsUnsureAndAtMostEvery36Samples) {
  Sleepers s;
  s.all_fall_asleep();
  s.queued("exact", kLongInContact_s, {});
  ASSERT_FALSE(s.awake("memory"));
  s.rule.rendered_deviates(kUnsure_N);
  int awake = 0;
  for (int sample = 0; sample < 20; ++sample) {  // no other audition began
    awake += s.awake("memory") ? 1 : 0;
    s.queued("exact", kLongInContact_s, {});
    s.rule.rendered_deviates(kUnsure_N);
  }
  EXPECT_EQ(awake, 12);
  for (int sample = 0; sample < 16; ++sample) {
    s.queued("exact", kLongInContact_s, {});
  }
  s.rule.rendered_deviates(kUnsure_N);
  EXPECT_TRUE(s.awake("memory"));
}

TEST(Auditions, OfMemoryAreNotForAFieldThatErrsByAsMuchAnyway) {
  Sleepers s;
  s.all_fall_asleep();
  s.queued("exact", kLongInContact_s, {});
  EXPECT_FALSE(s.rule.rendered_deviates(0.009));
  s.candidates.all[s.index("exact")]->long_score_N2 = 0.03 * 0.03;  // noise
  EXPECT_FALSE(s.rule.rendered_deviates(0.029));
  EXPECT_FALSE(s.awake("memory"));
  EXPECT_TRUE(s.rule.rendered_deviates(0.031));
  EXPECT_TRUE(s.awake("memory"));
}

TEST(Auditions, OfMemoryAreNotForAnObjectThatHasSurprised) {
  Sleepers s;
  s.all_fall_asleep();
  s.rule.rendered_had_no_use();
  ASSERT_TRUE(s.rule.woken());
  s.samples(30, "exact", {});
  ASSERT_FALSE(s.rule.all_awake());
  s.rule.rendered_deviates(kUnsure_N);
  EXPECT_FALSE(s.awake("memory"));
}

// Somebody must sleep for everybody to wake.
void all_wake(Sleepers& s) {
  s.rule.rendered_had_no_use();
  ASSERT_TRUE(s.rule.woken());
}

// It is best where nobody who is awake knows the object.
TEST(WakeRule, IsUndecidedForThe30SamplesAfterAllWoke) {
  Sleepers s;
  const Errors_N2 errors_N2{{"viscous", 0.1}, {"smooth", 0.5}, {"exact", 0.2}, {"memory", 0.1}};
  s.samples(29, "viscous", errors_N2);
  EXPECT_TRUE(s.rule.undecided());
  EXPECT_EQ(s.rule.best_general(), s.index("exact")) << "\"memory\" keeps what others forget";
  s.sample("viscous", errors_N2);
  EXPECT_TRUE(s.rule.all_awake());
  EXPECT_FALSE(s.rule.undecided());
  Sleepers asleep;
  asleep.all_fall_asleep();
  EXPECT_FALSE(asleep.rule.undecided());
  asleep.rule.rendered_had_no_use();
  EXPECT_TRUE(asleep.rule.undecided());
}

TEST(WakeRule, WakesEverybodyWhenTheNewestSampleIsTheBestThatIsKnown) {
  Sleepers s;
  s.all_fall_asleep();
  s.rule.handed_over(s.index("memory"));
  ASSERT_FALSE(s.rule.all_awake());
  s.rule.handed_over(s.index("newest"));
  EXPECT_TRUE(s.rule.all_awake());
}

TEST(Moved, SleepsForTheFirst30Samples) {
  Sleepers s;
  s.samples(29, "exact", {{"smooth", 0.5}});
  EXPECT_FALSE(s.awake("moved"));
  s.sample("exact", {{"smooth", 0.5}});
  EXPECT_TRUE(s.awake("moved"));
}

TEST(Moved, WakesWithAllOthersUnlessTheForceDependedOnThePath) {
  Sleepers s;
  s.all_fall_asleep();
  all_wake(s);
  EXPECT_TRUE(s.awake("moved"));
  Sleepers damped;
  damped.samples(5, "viscous", {});
  damped.rule.handed_over(damped.index("exact"));
  damped.samples(70, "exact", {});  // until the path is no longer needed
  ASSERT_FALSE(damped.rule.all_awake());
  damped.rule.handed_over(damped.index("viscous"));
  damped.sample("viscous", {});
  all_wake(damped);
  EXPECT_FALSE(damped.awake("moved"));
  EXPECT_TRUE(damped.awake("smooth"));
}

}  // namespace
}  // namespace forcegrid::kriging
