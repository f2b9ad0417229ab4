// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/candidate_choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "forcegrid/kriging/ensemble_candidates.h"

namespace forcegrid::kriging {
namespace {

// A spring that meets a wall at 4 mm.
void teach_a_wall(Candidate& candidate) {
  for (int i = 0; i < 60; ++i) {
    Observation o;
    o.time_s = i / 30.0;
    o.contact = 1;
    o.position_m = Eigen::Vector3d(1e-3 * (i % 6), 1e-3 * (i / 6 % 3), 0.0);
    const double beyond_m = std::max(0.0, o.position_m.x() - 0.0035);
    o.force_N = -200.0 * o.position_m - Eigen::Vector3d(2000.0 * beyond_m, 0.0, 0.0);
    candidate.field().take(o);
    while (candidate.field().prepare()) {
    }
  }
  ASSERT_TRUE(candidate.field().knows_walls());
}

class CandidateChoiceTest : public ::testing::Test {
 protected:
  CandidateChoiceTest()
      : path_(kPathTimeConstants_s),
        candidates_(make_candidates(EnsembleKind::kAuto, {}, thresholds_, path_)),
        choice_(candidates_, thresholds_) {}

  std::size_t index(const std::string& name) const {
    for (std::size_t i = 0; i < candidates_.all.size(); ++i) {
      if (name == candidates_.all[i]->name()) {
        return i;
      }
    }
    ADD_FAILURE() << name;
    return 0;
  }
  /// A sample at which all candidates have the same squared error but one.
  EvaluatedSample sample(double error_N2, std::size_t other, double other_N2) const {
    EvaluatedSample sample;
    sample.error_N2.fill(error_N2);
    sample.error_N2[other] = other_N2;
    return sample;
  }

  EnsembleThresholds thresholds_;
  ToolHistory path_;
  Candidates candidates_;
  CandidateChoice choice_;
};

TEST_F(CandidateChoiceTest, KeepsTheRenderedOneUnlessAnotherIsClearlyBetter) {
  const std::size_t smooth = index("smooth");
  for (int i = 0; i < 100; ++i) {
    choice_.score(sample(1.0, smooth, 0.95), 0);
  }
  EXPECT_EQ(choice_.best(0), 0u);
  for (int i = 0; i < 100; ++i) {
    choice_.score(sample(1.0, smooth, 0.85), 0);
  }
  EXPECT_EQ(choice_.best(0), smooth);
}

TEST_F(CandidateChoiceTest, KeepsTheRenderedOneWhoseErrorsNobodyFeels) {
  const std::size_t smooth = index("smooth");
  const auto best = [&](double error_N) {
    for (int i = 0; i < 100; ++i) {
      choice_.score(sample(error_N * error_N, smooth, 0.0), 0);
    }
    return choice_.best(0);
  };
  EXPECT_EQ(best(0.99e-3), 0u);
  EXPECT_EQ(choice_.best(index("newest")), smooth) << "it does not push back";
  EXPECT_EQ(best(1.01e-3), smooth);
}

// "exact" is the first of those that know the position alone, and assumes the least noise.
TEST_F(CandidateChoiceTest, TakesLessNoiseWhereErrorsAreNotFelt) {
  const std::size_t smooth = index("smooth");
  const auto best = [&](double exact_N) {
    for (int i = 0; i < 200; ++i) {
      choice_.score(sample(exact_N * exact_N, smooth, 0.25e-6), smooth);
    }
    return choice_.likely_best(smooth);
  };
  EXPECT_EQ(best(0.87e-3), smooth) << "more than 0.7 mN worse";
  EXPECT_EQ(best(0.85e-3), 0u);
  candidates_.all[0]->sleep();
  EXPECT_EQ(choice_.likely_best(smooth), smooth);
  EXPECT_EQ(choice_.likely_best(index("walls")), index("walls"))
      << "it knows more than the position";
  candidates_.all[0]->wake(0);
  EXPECT_EQ(choice_.best(smooth), smooth) << "of kriging-bank, whose candidates all stay awake";
}

// "viscous" has three times its score, but that is for its being rendered, not against it.
TEST_F(CandidateChoiceTest, LeavesASpecialistToNobodyWhoErredMore) {
  const std::size_t viscous = index("viscous");
  const auto best = [&](double others_N2) {
    for (int i = 0; i < 100; ++i) {
      choice_.score(sample(others_N2, viscous, 1.0), viscous);
    }
    return choice_.best(viscous);
  };
  EXPECT_EQ(best(1.2), viscous);
  EXPECT_NE(best(0.9), viscous);
}

// "walls" has proven a surface, so its error counts a hundredth; but not of an object that moved.
TEST_F(CandidateChoiceTest, LeavesAMovedObjectToNoWallThatErredMore) {
  const std::size_t walls = index("walls");
  teach_a_wall(*candidates_.all[walls]);
  const auto best = [&](std::size_t rendered) {
    for (int i = 0; i < 100; ++i) {  // the first ones prove the surface
      choice_.score(sample(1.0, walls, i < 10 ? 1e-4 : 1.2), rendered);
    }
    return choice_.best(rendered);
  };
  EXPECT_EQ(best(0), walls);
  EXPECT_NE(best(index("moved")), walls);
}

TEST_F(CandidateChoiceTest, AveragesErrorsOverSomeSamples) {
  choice_.score(sample(1.0, 1, 0.0), 0);
  EXPECT_NEAR(candidates_.all[0]->score_N2, 1.0 - thresholds_.score_kept, 1e-12);
  EXPECT_NEAR(candidates_.all[0]->long_score_N2, 1.0 - thresholds_.long_score_kept, 1e-12);
  EXPECT_EQ(candidates_.all[0]->first_touch_score_N2, 0.0);
  EXPECT_EQ(candidates_.all[1]->score_N2, 0.0);
}

TEST_F(CandidateChoiceTest, TakesAFewBetterSamplesOfOneThatWasWorseForLuck) {
  const std::size_t smooth = index("smooth");
  const auto better = [&](double error_N2) {
    for (int i = 0; i < 7; ++i) {
      choice_.score(sample(1.0, smooth, error_N2), 0);
    }
    return choice_.best(0);
  };
  for (int i = 0; i < 100; ++i) {
    choice_.score(sample(1.0, smooth, 4.0), 0);
  }
  EXPECT_EQ(better(0.05), 0u) << "1.05 of the score, 2.7 of the long one";
  EXPECT_EQ(better(0.05), 0u) << "0.37, 1.5: luck";
  EXPECT_EQ(better(0.05), smooth) << "0.15, 0.87: no longer";
  const std::size_t walls = index("walls");
  for (int i = 0; i < 100; ++i) {
    choice_.score(sample(1.0, walls, 4.0), 0);
  }
  for (int i = 0; i < 15; ++i) {
    choice_.score(sample(1.0, walls, 0.0), 0);
  }
  EXPECT_GT(candidates_.all[walls]->long_score_N2, 1.0);
  EXPECT_EQ(choice_.best(0), 0u) << "three times 0.35";
  for (int i = 0; i < 1; ++i) {
    choice_.score(sample(1.0, walls, 0.0), 0);
  }
  EXPECT_GT(candidates_.all[walls]->long_score_N2, 1.0);
  EXPECT_EQ(choice_.best(0), walls) << "three times 0.297, not twelve";
}

// A tool at rest makes the newest sample seem to be all there is to know.
TEST_F(CandidateChoiceTest, LeavesARestingToolToWhoeverKnowsTheObject) {
  const std::size_t newest = index("newest");
  const auto chosen = [&](double others_N, int rests) {
    for (int i = 0; i < 100; ++i) {
      choice_.score(sample(others_N * others_N, newest, 0.04), 0);  // in motion
    }
    for (int i = 0; i < rests; ++i) {
      choice_.score(sample(others_N * others_N, newest, 0.0), 0);
    }
    EXPECT_GT(candidates_.all[newest]->long_score_N2, others_N * others_N);
    return choice_.best(0);
  };
  EXPECT_EQ(chosen(0.0013, 72), 0u);
  EXPECT_EQ(chosen(0.0099, 60), 0u) << "it would render a force that does not push back";
  for (int i = 0; i < 72; ++i) {
    choice_.score(sample(0.0099 * 0.0099, newest, 0.0), 0);
  }
  EXPECT_LT(candidates_.all[newest]->long_score_N2, 0.0099 * 0.0099);
  EXPECT_EQ(choice_.best(0), 0u) << "however long it rests";
  EXPECT_EQ(chosen(0.030, 32), newest) << "right at once, where nobody else is";
}

// Candidates that expect more or less noise err alike. Which is right shows in how large an error
// each one expected, long before the errors themselves tell.
TEST_F(CandidateChoiceTest, PrefersTheMoreLikelyOfThoseThatErrAlike) {
  const std::size_t noisy = index("noisy");
  const auto likely = [&](double noisys_error_N2, double more_nats, int samples) {
    EvaluatedSample evaluated = sample(1.0, noisy, noisys_error_N2);
    evaluated.likelihood_nats.fill(-2.0);
    evaluated.likelihood_nats[noisy] = -2.0 + more_nats;
    for (int i = 0; i < samples; ++i) {
      choice_.score(evaluated, 0);
    }
    return choice_.likely_best(0);
  };
  EXPECT_EQ(likely(1.0, 1.0, 6), 0u) << "(1 - 0.95^6) / 0.05 = 5.3 nats";
  EXPECT_EQ(likely(1.0, 1.0, 2), noisy) << "6.7 nats";
  EXPECT_EQ(choice_.best(0), 0u) << "by the errors alone";
  EXPECT_EQ(likely(1.0, 0.0, 100), 0u) << "forgotten";
  EXPECT_EQ(likely(1.0, 100.0, 1), 0u) << "one sample counts for 1 nat";
  EXPECT_EQ(likely(1.3, 1.0, 40), 0u) << "it errs by more than is luck";
}

TEST_F(CandidateChoiceTest, NamesWhoseNoiseIsClearlyMoreLikely) {
  const std::size_t noisy = index("noisy");
  EvaluatedSample evaluated = sample(1.0, noisy, 1.0);
  evaluated.likelihood_nats[noisy] = 1.0;
  for (int i = 0; i < 6; ++i) {
    choice_.score(evaluated, 0);
  }
  EXPECT_EQ(choice_.likeliest_general(0), 0u) << "5.3 nats";
  choice_.score(evaluated, 0);
  choice_.score(evaluated, 0);
  EXPECT_EQ(choice_.likeliest_general(0), noisy) << "6.7 nats";
  EXPECT_EQ(choice_.likeliest_general(noisy), noisy);
  candidates_.all[noisy]->sleep();
  EXPECT_EQ(choice_.likeliest_general(0), 0u) << "it sleeps";
  EXPECT_EQ(choice_.likeliest_general(noisy), 0u) << "of those that are awake";
}

TEST_F(CandidateChoiceTest, LeavesASpecialistWhateverElseIsLikely) {
  const std::size_t viscous = index("viscous");
  EvaluatedSample evaluated = sample(1.0, viscous, 0.3);
  evaluated.likelihood_nats[index("noisy")] = 2.0;
  for (int i = 0; i < 100; ++i) {
    choice_.score(evaluated, viscous);
  }
  EXPECT_EQ(choice_.likely_best(viscous), viscous);
}

TEST_F(CandidateChoiceTest, CountsTheErrorsOfSpecialistsMore) {
  const std::size_t viscous = index("viscous");
  for (int i = 0; i < 5; ++i) {  // too few to prove that the path counts
    choice_.score(sample(1.0, viscous, 0.5), 0);
  }
  EXPECT_EQ(choice_.best(0), 0u) << "half the error, times three";
  for (int i = 0; i < 30; ++i) {
    choice_.score(sample(1.0, viscous, 0.5), 0);
  }
  EXPECT_EQ(choice_.best(0), viscous) << "better for long";
}

TEST_F(CandidateChoiceTest, TakesACandidateWithoutUseForASampleToErrLikeTheRenderedOne) {
  const std::size_t unfinished = index("unfinished");
  choice_.score(sample(2.0, unfinished, EvaluatedSample::kNotTaken_N2), 0);
  EXPECT_EQ(candidates_.all[unfinished]->score_N2, candidates_.all[0]->score_N2);
  choice_.score(sample(2.0, unfinished, EvaluatedSample::kNotTaken_N2), unfinished);
  EXPECT_EQ(candidates_.all[unfinished]->score_N2, candidates_.all[0]->score_N2);
}

TEST_F(CandidateChoiceTest, BeginsAContactWithThePlaceThatItWasAskedAbout) {
  choice_.score(sample(1.0, 2, 0.1), 0);
  const auto asked = choice_.for_contact(thresholds_.enough_answers, true, 0);
  EXPECT_EQ(asked.candidate, index("places"));
  EXPECT_EQ(asked.reason, ChoiceReason::kAskedBefore);
  const auto not_asked = choice_.for_contact(0, true, 0);
  EXPECT_EQ(not_asked.reason, ChoiceReason::kFirstTouches) << "places has no sample";
}

// Samples of a spring, which a field takes with all that follows from them.
void press(Field& field, double stiffness_N_per_m, int samples) {
  field.enter_contact(1, Eigen::Vector3d::Zero());
  for (int i = 0; i < samples; ++i) {
    Observation o;
    o.time_s = i / 30.0;
    o.contact = 1;
    o.position_m = {0.003 * std::sin(0.3 * i), 0.003 * std::cos(0.4 * i), 0.004 + 0.0001 * i};
    o.force_N = -stiffness_N_per_m * o.position_m;
    field.take(o);
    for (int piece = 0; piece < 1000 && !field.ready(); ++piece) {
      field.prepare();
    }
  }
}

TEST_F(CandidateChoiceTest, KnowsNoPlaceOfAnObjectThatGotWeakerSince) {
  const std::size_t moved = index("moved");
  press(candidates_.all[index("places")]->field(), 100.0, 20);
  press(candidates_.all[moved]->field(), 100.0, 20);
  EXPECT_EQ(choice_.for_contact(0, true, 0).reason, ChoiceReason::kKnownPlace);
  EXPECT_EQ(choice_.for_contact(0, true, moved).reason, ChoiceReason::kKnownPlace);
  press(candidates_.all[moved]->field(), 50.0, 1);
  ASSERT_TRUE(candidates_.all[moved]->differs());
  EXPECT_EQ(choice_.for_contact(0, true, 0).reason, ChoiceReason::kKnownPlace);
  EXPECT_NE(choice_.for_contact(0, true, moved).reason, ChoiceReason::kKnownPlace);
}

TEST_F(CandidateChoiceTest, KnowsNoPlaceAfterItErredMoreAtKnownOnes) {
  const std::size_t places = index("places");
  press(candidates_.all[places]->field(), 100.0, 20);
  const auto touch = [&](double exact_N2, double places_N2, int samples) {
    EvaluatedSample first = sample(exact_N2, places, places_N2);
    first.first_touch = true;
    for (int i = 0; i < samples; ++i) {
      choice_.score(first, 0);
    }
  };
  touch(1.0, 1.0, 100);  // so far all erred alike, by so much that a few more samples count little
  EXPECT_EQ(choice_.for_contact(0, true, 0).reason, ChoiceReason::kKnownPlace);
  touch(1e-4, 1e-4, 3);
  EXPECT_EQ(choice_.for_contact(0, true, 0).reason, ChoiceReason::kKnownPlace);
  touch(1e-4, 1e-2, 3);
  EXPECT_NE(choice_.for_contact(0, true, 0).reason, ChoiceReason::kKnownPlace);
  touch(1e-2, 1e-4, 3);  // it is asked all the same
  EXPECT_EQ(choice_.for_contact(0, true, 0).reason, ChoiceReason::kKnownPlace);
}

// 3 mN are less than anybody feels, though "exact" errs by a third of it. Not where it is not sure.
TEST_F(CandidateChoiceTest, KnowsAPlaceThatItIsSureOfAfterItErredByMillinewtons) {
  const std::size_t places = index("places");
  Field& field = candidates_.all[places]->field();
  const auto touches = [&](double exact_N, double places_N, int samples) {
    EvaluatedSample first = sample(exact_N * exact_N, places, places_N * places_N);
    first.first_touch = true;
    for (int i = 0; i < samples; ++i) {
      choice_.score(first, 0);
    }
  };
  const auto is_known = [&] {
    return choice_.for_contact(0, true, 0).reason == ChoiceReason::kKnownPlace;
  };
  touches(1.0, 1.0, 100);  // at other places: no more samples make it worse than others there
  press(field, 100.0, 5);
  const double unsure_N = field.deviation_N(thresholds_.probe_m, History::Zero());
  ASSERT_GT(unsure_N, 0.01);
  ASSERT_LT(unsure_N, thresholds_.known_place_N);
  EXPECT_TRUE(is_known());
  touches(0.001, 0.003, 20);
  EXPECT_FALSE(is_known());
  press(field, 100.0, 20);
  ASSERT_LT(field.deviation_N(thresholds_.probe_m, History::Zero()), 0.01);
  EXPECT_TRUE(is_known());
  touches(0.001, 0.015, 20);
  EXPECT_FALSE(is_known());
}

TEST_F(CandidateChoiceTest, TrustsASurfaceHoweverLittleMovedErred) {
  const std::size_t moved = index("moved");
  Candidate& walls = *candidates_.all[index("walls")];
  walls.score_N2 = 4e-3 * 4e-3;
  candidates_.all[0]->score_N2 = candidates_.all[moved]->score_N2 = 1e-3 * 1e-3;
  EXPECT_TRUE(choice_.trusts(walls, moved, 80e-3 * 80e-3));
  EXPECT_FALSE(choice_.trusts(walls, moved, 30e-3 * 30e-3)) << "not much more than it errs itself";
  EXPECT_FALSE(choice_.trusts(walls, moved, EvaluatedSample::kNotTaken_N2));
  EXPECT_FALSE(choice_.trusts(walls, 0, 80e-3 * 80e-3));
  candidates_.all[0]->score_N2 = 2e-3 * 2e-3;
  EXPECT_TRUE(choice_.trusts(walls, 0, 80e-3 * 80e-3));
}

// 4 mm from the contact point 26 N/m make 0.104 N.
TEST_F(CandidateChoiceTest, KnowsNoPlaceWhoseStiffnessIsAnother) {
  Candidate& places = *candidates_.all[index("places")];
  places.field().expect_reads(true);
  press(places.field(), 200.0, 20);
  const auto seen = [](double stiffness_N_per_m) {
    Observation o;
    o.has_stiffness = true;
    o.stiffness_N_per_m.head<3>().setConstant(-stiffness_N_per_m);
    return o;
  };
  EXPECT_FALSE(choice_.place_is_contradicted(seen(200.0)));
  EXPECT_FALSE(choice_.place_is_contradicted(seen(180.0)));
  EXPECT_FALSE(choice_.place_is_contradicted(seen(220.0)));
  EXPECT_EQ(places.score_N2, 0.0);
  EXPECT_TRUE(choice_.place_is_contradicted(seen(140.0)));
  EXPECT_TRUE(choice_.place_is_contradicted(seen(260.0)));
  EXPECT_NEAR(std::sqrt(places.score_N2), 0.24, 0.04);
  Observation o = seen(140.0);
  o.from_query = true;
  EXPECT_FALSE(choice_.place_is_contradicted(o)) << "asked elsewhere";
  o = seen(140.0);
  o.has_stiffness = false;
  EXPECT_FALSE(choice_.place_is_contradicted(o));
}

TEST_F(CandidateChoiceTest, BeginsAContactWithTheBestOfFirstTouches) {
  EvaluatedSample first = sample(1.0, 2, 0.1);
  first.first_touch = true;
  choice_.score(first, 0);
  for (int i = 0; i < 100; ++i) {
    choice_.score(sample(1.0, 3, 0.01), 0);  // best later on
  }
  EXPECT_EQ(choice_.best(0), 3u);
  EXPECT_EQ(choice_.for_contact(0, true, 3).candidate, 2u);
}

// Its surfaces stay in the workspace, and one that was wrong can push with tens of newtons.
TEST_F(CandidateChoiceTest, BeginsNoContactWithWallsThatWereWrongLately) {
  const std::size_t walls = index("walls");
  teach_a_wall(*candidates_.all[walls]);
  EvaluatedSample first = sample(1.0, walls, 0.01);
  first.first_touch = true;
  for (int i = 0; i < 10; ++i) {
    choice_.score(first, 0);
  }
  EXPECT_EQ(choice_.for_contact(0, true, 0).candidate, walls);
  for (int i = 0; i < 3; ++i) {
    choice_.score(sample(0.01, walls, 20.0), 0);
  }
  EXPECT_NE(choice_.for_contact(0, true, 0).candidate, walls);
  EXPECT_NE(choice_.for_contact(0, true, walls).candidate, walls);
}

TEST_F(CandidateChoiceTest, BeginsNoContactWithOneThatTookNoFirstTouchItself) {
  // The rendered one changes; each time it is the best, and the one without use errs like it.
  const std::size_t no_use = index("unfinished");
  EvaluatedSample first = sample(1.0, no_use, EvaluatedSample::kNotTaken_N2);
  first.first_touch = true;
  for (int i = 0; i < 30; ++i) {
    const std::size_t best = i % 2 == 0 ? 0 : 1;
    first.error_N2[best] = 0.01;
    first.error_N2[1 - best] = 1.0;
    choice_.score(first, best);
  }
  EXPECT_NE(choice_.for_contact(0, true, 0).candidate, no_use);
}

TEST_F(CandidateChoiceTest, BeginsNoContactWithOneThatSleptAtAllFirstTouches) {
  const std::size_t slept = index("unfinished");
  candidates_.all[slept]->sleep();
  EvaluatedSample first = sample(1.0, 2, 0.1);
  first.first_touch = true;
  choice_.score(first, 0);
  candidates_.all[slept]->wake(0);
  EXPECT_EQ(choice_.for_contact(0, true, 0).candidate, 2u);
}

TEST_F(CandidateChoiceTest, BeginsNoContactWithOneThatWasAwakeAtFewFirstTouches) {
  const std::size_t slept = 3;
  candidates_.all[slept]->sleep();
  EvaluatedSample first = sample(1.0, 2, 0.5);
  first.first_touch = true;
  for (int i = 0; i < 30; ++i) {
    choice_.score(first, 0);
  }
  candidates_.all[slept]->wake(0);
  choice_.score(first, 0);  // it errs as much as others do
  EXPECT_EQ(choice_.for_contact(0, true, 0).candidate, 2u);
  EXPECT_NEAR(candidates_.all[slept]->score_N2, candidates_.all[0]->score_N2, 1e-12);
}

// Its score is made of the errors of those that were rendered. When the best of them fails, it
// seems to be the best, but knows nothing.
TEST_F(CandidateChoiceTest, DoesNotChooseOneThatTookNoSample) {
  const std::size_t best = 0;
  const std::size_t noisy = index("noisy");
  const std::size_t unfinished = index("unfinished");
  const auto score = [&](double best_N2, double unfinished_N2, std::size_t rendered) {
    EvaluatedSample sample = this->sample(7.0, best, best_N2);
    sample.error_N2[noisy] = 6.0;
    sample.error_N2[unfinished] = unfinished_N2;
    choice_.score(sample, rendered);
  };
  for (int i = 0; i < 30; ++i) {
    score(1.0, EvaluatedSample::kNotTaken_N2, best);
  }
  score(100.0, EvaluatedSample::kNotTaken_N2, noisy);
  ASSERT_LT(thresholds_.specialist_weight * candidates_.all[unfinished]->score_N2,
            thresholds_.hysteresis * candidates_.all[noisy]->score_N2);
  EXPECT_EQ(choice_.best(noisy), noisy);
  score(100.0, 0.1, noisy);
  EXPECT_EQ(choice_.best(noisy), unfinished) << "it has taken one";
}

TEST_F(CandidateChoiceTest, LearnsNothingFromASampleThatNobodyCouldTake) {
  choice_.score(sample(2.0, 1, 0.5), 0);
  const double before_N2 = candidates_.all[0]->score_N2;
  choice_.score(sample(EvaluatedSample::kNotTaken_N2, 1, 0.5), 0);
  EXPECT_EQ(candidates_.all[0]->score_N2, before_N2);
}

TEST_F(CandidateChoiceTest, LosesTheProofOfAWallByASecondSampleThatItPredictsWorse) {
  const std::size_t walls = index("walls");
  Candidate& candidate = *candidates_.all[walls];
  teach_a_wall(candidate);
  const auto counts = [&] { return candidate.rate({}) / candidate.score_N2; };
  for (int i = 0; i < 10; ++i) {
    choice_.score(sample(1.0, walls, 0.01), 0);
  }
  EXPECT_EQ(counts(), thresholds_.wall_proven_weight);
  const EvaluatedSample worse = sample(0.001, walls, 0.02);
  choice_.score(worse, 0);
  EXPECT_EQ(counts(), thresholds_.wall_proven_weight) << "what two samples have proven";
  choice_.score(worse, 0);
  EXPECT_GT(counts(), thresholds_.wall_proven_weight);
}

// Some wall explains a surprise of any cause.
TEST_F(CandidateChoiceTest, BelievesAWallForEightSamplesThatNoneHasProven) {
  const std::size_t walls = index("walls");
  Candidate& candidate = *candidates_.all[walls];
  teach_a_wall(candidate);
  candidate.score_N2 = 1.0;
  const auto counts = [&] { return candidate.rate({}); };
  Innovation found;
  found.explained = found.surprised = true;
  candidate.on_taken(found, false);
  EXPECT_EQ(counts(), thresholds_.wall_calm_weight);
  for (int sample = 1; sample < thresholds_.walls_awake; ++sample) {
    candidate.on_taken({}, false);
    candidate.on_taken({}, true);  // an answer to a query is no sample of the path
  }
  EXPECT_EQ(counts(), thresholds_.wall_calm_weight);
  candidate.on_taken({}, false);
  EXPECT_EQ(counts(), thresholds_.specialist_weight);
  // One sample that only the wall explains; later ones that refute it do not make it unknown.
  choice_.score(sample(1.0, walls, 0.01), 0);
  candidate.score_N2 = 1.0;
  EXPECT_EQ(counts(), thresholds_.wall_calm_weight);
  choice_.score(sample(0.001, walls, 0.02), 0);
  candidate.score_N2 = 1.0;
  EXPECT_EQ(counts(), thresholds_.wall_calm_weight);
}

TEST_F(CandidateChoiceTest, TrustsAnExplanationUnlessItsScoreIsBadByFar) {
  Candidate& walls = *candidates_.all[index("walls")];
  candidates_.all[0]->score_N2 = 1.0;
  walls.score_N2 = 11.0;
  EXPECT_TRUE(choice_.trusts(walls, 0, 100.0));
  walls.score_N2 = 11.2;
  EXPECT_FALSE(choice_.trusts(walls, 0, 100.0));
}

TEST_F(CandidateChoiceTest, NamesItsCandidatesInAFixedOrder) {
  const char* const names[] = {"exact",         "smooth", "noisy",  "very noisy", "viscous",
                               "noisy viscous", "walls",  "memory", "unfinished", "relaxing",
                               "places",        "newest", "moved"};
  ASSERT_EQ(candidates_.all.size(), std::size(names));
  for (std::size_t i = 0; i < std::size(names); ++i) {
    EXPECT_STREQ(candidates_.all[i]->name(), names[i]);
  }
}

}  // namespace
}  // namespace forcegrid::kriging
