// SPDX-License-Identifier: Apache-2.0
// Who sleeps for how long, by the numbers of docs/kriging.md, "Who is awake".

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "forcegrid/kriging/candidate_choice.h"
#include "forcegrid/kriging/ensemble_candidates.h"
#include "forcegrid/kriging/history.h"
#include "forcegrid/kriging/wake_rule.h"

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
              bool first_touch = false) {
    queued(rendered, kLongInContact_s, {});
    EvaluatedSample evaluated;
    evaluated.first_touch = first_touch;
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

  // By 1 N, and for so long that it is no longer luck if one that knows the path errs less.
  void all_have_erred() {
    EvaluatedSample evaluated;
    evaluated.error_N2.fill(1.0);
    for (std::uint64_t i = 0; i < thresholds.long_enough; ++i) {
      choice_.score(evaluated, 0);
    }
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
  CandidateChoice choice_{candidates, thresholds};
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
  s.all_have_erred();
  s.rule.handed_over(s.index("viscous"));
  s.sample("viscous", {});
  s.rule.handed_over(s.index("exact"));
  s.samples(59, "exact", {});
  EXPECT_TRUE(s.rule.all_awake()) << "the path was needed";
  s.samples(11, "exact", {});
  ASSERT_FALSE(s.rule.all_awake());
  EXPECT_TRUE(s.awake("viscous"));
  EXPECT_TRUE(s.awake("smooth"));
}

// A field that knows the path may fit the first few samples better, as any field may.
TEST(WhoKnowsThePath, IsNotNeededForWhatItWasRenderedByLuck) {
  Sleepers s;
  s.samples(5, "smooth", {});
  s.rule.handed_over(s.index("viscous"));
  s.sample("viscous", {});
  s.rule.handed_over(s.index("exact"));
  s.all_fall_asleep();
  EXPECT_FALSE(s.awake("viscous"));
  EXPECT_FALSE(s.awake("smooth"));
}

// All that touches ever show, where each is short.
TEST(FirstTouches, CountWhereTheRenderedOneErrsByAtMostAMillinewton) {
  Sleepers known;
  Sleepers unknown;
  for (int i = 0; i < 29; ++i) {
    known.sample("exact", {{"exact", 0.99e-6}}, 1.0, true);
    unknown.sample("exact", {{"exact", 1.01e-6}}, 1.0, true);
  }
  EXPECT_TRUE(known.rule.all_awake());
  known.sample("exact", {{"exact", 0.99e-6}}, 1.0, true);
  EXPECT_FALSE(known.rule.all_awake());
  for (int i = 0; i < 100; ++i) {
    unknown.sample("exact", {{"exact", 1.01e-6}}, 1.0, true);
  }
  EXPECT_TRUE(unknown.rule.all_awake());
}

TEST(Specialists, StayAfter60SamplesAndLetAllSleepAfter30WhereAnotherWillStay) {
  Sleepers needed;
  needed.samples(59, "moved", {{"moved", 0.01}});
  EXPECT_TRUE(needed.rule.all_awake());
  needed.sample("moved", {{"moved", 0.01}});
  EXPECT_FALSE(needed.rule.all_awake());
  EXPECT_EQ(needed.rule.stays(), needed.index("moved"));
  Sleepers lucky;
  lucky.samples(29, "moved", {});
  EXPECT_TRUE(lucky.rule.all_awake());
  lucky.sample("moved", {});
  EXPECT_FALSE(lucky.rule.all_awake());
  EXPECT_EQ(lucky.rule.stays(), lucky.index("exact"));
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
  s.all_have_erred();
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
  s.all_have_erred();
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

// "smooth" expects (3.2 mN)^2 of noise. Errors below show that less noise may do.
TEST(Auditions, AreForTheLeastNoiseWhereTheRenderedOneErrsByLessThanItExpects) {
  const auto audition_of = [](double error_N) {
    Sleepers s;
    s.candidates.all[s.index("exact")]->score_N2 = 1.0;  // so the runner-up is another
    s.samples(30, "smooth", {{"smooth", 0.5}});          // nobody else is nearly as good
    EXPECT_FALSE(s.rule.all_awake());
    s.candidates.all[s.index("smooth")]->long_score_N2 = error_N * error_N;
    for (int sample = 1; sample <= 24; ++sample) {
      EXPECT_FALSE(s.awake("exact"));
      s.queued("smooth", kLongInContact_s, {});
    }
    return s.awake("exact");
  };
  EXPECT_TRUE(audition_of(3.1e-3));
  EXPECT_FALSE(audition_of(3.2e-3));
}

TEST(Auditions, AreForTheOneThatWasRenderedIfAnotherStays) {
  Sleepers s;
  for (const auto& candidate : s.candidates.all) {
    candidate->score_N2 = 2.0;
  }
  s.candidates.all[s.index("exact")]->score_N2 = 1.0;
  s.candidates.all[s.index("noisy")]->score_N2 = 0.9;
  s.samples(30, "noisy", {});
  ASSERT_EQ(s.rule.stays(), s.index("exact"));
  s.rule.handed_over(s.index("exact"));
  for (int sample = 1; sample <= 24; ++sample) {
    s.queued("exact", kLongInContact_s, {});
  }
  EXPECT_FALSE(s.awake("memory"));
  EXPECT_TRUE(s.awake("noisy"));
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

// In the first 0.4 s of one about which "places" is asked, it is for that.
TEST(Auditions, OfMemoryMayBeginWithAContactAboutWhichPlacesIsNotAsked) {
  Sleepers s;
  s.all_fall_asleep();
  for (const int contact : {1, 2}) {
    s.rule.contact_made();
    for (int sample = 0; sample < 5; ++sample) {  // those of the contact's own audition
      s.queued("exact", 0.1, {});
    }
    ASSERT_EQ(s.awake("places"), contact == 1);
    EXPECT_EQ(s.rule.rendered_deviates(kUnsure_N), contact == 2);
  }
}

TEST(Auditions, OfMemoryAreNotForAnObjectThatHasSurprisedInTheLast200Samples) {
  Sleepers s;
  s.all_fall_asleep();
  s.rule.rendered_had_no_use();
  ASSERT_TRUE(s.rule.woken());
  s.samples(30, "exact", {});
  ASSERT_FALSE(s.rule.all_awake());
  s.rule.rendered_deviates(kUnsure_N);
  EXPECT_FALSE(s.awake("memory"));
  s.samples(170, "exact", {});
  EXPECT_FALSE(s.rule.rendered_deviates(kUnsure_N));
  s.sample("exact", {});
  EXPECT_TRUE(s.rule.rendered_deviates(kUnsure_N));
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

// "exact" is the first of those that know the position alone.
TEST(WakeRule, LetsTheOneThatAssumesTheLeastNoiseStayIfItIsNearlyAsGood) {
  Sleepers s;
  const auto squared = [](double error_N) { return error_N * error_N; };
  const double smooth_N2 = squared(0.003);
  s.samples(30, "smooth", {{"smooth", smooth_N2}, {"exact", smooth_N2 + squared(0.0006)}});
  ASSERT_FALSE(s.rule.all_awake());
  EXPECT_EQ(s.rule.stays(), s.index("exact"));
  Sleepers worse;
  worse.samples(30, "smooth", {{"smooth", smooth_N2}, {"exact", smooth_N2 + squared(0.0008)}});
  ASSERT_FALSE(worse.rule.all_awake());
  EXPECT_EQ(worse.rule.stays(), worse.index("smooth"));
  worse.sample("smooth", {});
  EXPECT_EQ(worse.rule.stays(), worse.index("smooth"));
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
  // "viscous" was rendered; those that know the position alone err by 20 mN, or hardly.
  for (const double others_N : {0.02, 0.005}) {
    Sleepers damped;
    damped.samples(5, "viscous", {});
    damped.rule.handed_over(damped.index("exact"));
    damped.all_fall_asleep();
    damped.all_have_erred();
    for (const auto& candidate : damped.candidates.all) {
      candidate->long_score_N2 = others_N * others_N;
    }
    damped.rule.handed_over(damped.index("viscous"));
    damped.sample("viscous", {});
    all_wake(damped);
    EXPECT_EQ(damped.awake("moved"), others_N < 0.01) << "else it was rendered by luck";
    EXPECT_TRUE(damped.awake("smooth"));
  }
}

TEST(WakeRule, IsNeverUndecidedWhereNobodySleeps) {
  const EnsembleThresholds thresholds;
  const ToolHistory path{kPathTimeConstants_s};
  const Candidates candidates = make_candidates(EnsembleKind::kKriging, {}, thresholds, path);
  const WakeRule rule(candidates, thresholds, false);
  EXPECT_FALSE(rule.undecided());
}

}  // namespace
}  // namespace forcegrid::kriging
