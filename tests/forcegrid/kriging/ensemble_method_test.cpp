// SPDX-License-Identifier: Apache-2.0
// An ensemble: which of its candidates is rendered, and its work in pieces.

#include "forcegrid/kriging/ensemble_method.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>

#include "forcegrid/kriging/kriging_method.h"
#include "tests/forcegrid/kriging/kriging_play.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using namespace testing;
using Kind = EnsembleMethod::Kind;

TEST(EnsembleMethods, StandNoiseOfTenMillinewtons) {
  const AnchoredSprings object(kSeed);
  Play play = hand_on(object);
  play.noise_N = 0.010;
  MethodOptions noiseless;
  noiseless.nugget = 1e-6;
  KrigingMethod single(KrigingMethod::Kind::kForceOnly, noiseless);
  EnsembleMethod ensemble(Kind::kKriging, {});
  play.run(single);
  const double single_error = play.error_after_1s;
  play.run(ensemble);
  EXPECT_LT(play.error_after_1s, 0.01);  // what the noise of each sample is by itself
  EXPECT_LT(play.error_after_1s, 0.8 * single_error) << "a field that believes every sample";
}

TEST(EnsembleMethods, LetTheEnsembleFindTheCandidateThatKnowsDamping) {
  const AnchoredSprings object(kSeed);
  Play play = hand_on(object);
  const HandMotion motion(kSeed);
  play.force_N = [=](double t_s, const Vector3d& d_m) {
    const Vector3d velocity =
        (motion.position_m(t_s + 1e-4) - motion.position_m(t_s - 1e-4)) / 2e-4;
    return Vector3d(object.force_N(d_m) - 3.0 * velocity);
  };
  play.duration_s = 12.0;
  KrigingMethod single(KrigingMethod::Kind::kForceOnly, {});
  EnsembleMethod ensemble(Kind::kKriging, {});
  play.run(single);
  const double single_error = play.error_after_1s;
  play.run(ensemble);
  EXPECT_GT(ensemble.candidate(ensemble.rendered()).field().settings().kernel.history_gain, 0.0);
  EXPECT_LT(play.error_after_1s, 0.4 * single_error);
  EXPECT_LT(play.error_after_1s, 0.025);
}

// On an object that damps, a candidate that knows the path is rendered, and uncertain about
// velocities, too. The first requests are made where one that knows the position alone is
// uncertain.
TEST(EnsembleMethods, AskFirstAboutPlacesThatAreUnknown) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  EnsembleMethod ensemble(Kind::kAuto, {});
  Play play;
  int requests_of_path = 0;
  play.displacement_m = [&](double t_s) {
    const Vector3d d_m = motion.position_m(t_s);
    Vector3d wanted_W;
    const bool knows_path = ensemble.candidate(ensemble.rendered()).knows_path();
    if (t_s > 0.2 && knows_path && ensemble.plan_request(t_s, kPoint_W + d_m, wanted_W)) {
      ++requests_of_path;
      double most_N = 0.0;
      for (std::size_t i = 0; i < 4; ++i) {  // smooth, exact, noisy, very noisy
        most_N = std::max(most_N, ensemble.candidate(i).field().deviation_N(
                                      wanted_W - kPoint_W, kriging::History::Zero()));
      }
      EXPECT_GT(most_N, kriging::FieldRequests::kAsk_N) << "at " << t_s << " s";
    }
    return d_m;
  };
  play.force_N = [&](double t_s, const Vector3d& d_m) -> Vector3d {
    const Vector3d moved_m = motion.position_m(t_s + 1e-4) - motion.position_m(t_s - 1e-4);
    return object.force_N(d_m) - 3.0 * moved_m / 2e-4;
  };
  play.duration_s = 0.9;  // fewer than 30 samples
  play.first_s = 0.5;
  play.run(ensemble);
  EXPECT_GT(requests_of_path, 0);
}

// Against a wall, an error of some millinewtons wakes all. "moved" then takes the last samples, of
// which one surprises it that had been predicted well. If it explained that one by a weaker object,
// and were rendered, the force would be wrong by a quarter of a newton.
TEST(EnsembleMethods, TakeNoOldSampleForACut) {
  const AnchoredSprings object(190);
  constexpr double kUp_m = 0.011;
  Play play;
  play.displacement_m = [](double t_s) -> Vector3d {
    const double w = 2.0 * std::numbers::pi * t_s;
    return std::min(1.0, t_s) * Vector3d(0.008 * std::sin(0.9 * w + 190.0),
                                         0.008 * std::sin(0.7 * w + 380.0),
                                         0.012 * std::sin(0.53 * w));
  };
  play.force_N = [&](double, const Vector3d& d_m) -> Vector3d {
    return object.force_N(d_m) - Vector3d(0.0, 0.0, 1000.0 * std::max(0.0, d_m.z() - kUp_m));
  };
  play.duration_s = 20.0;
  play.first_s = 3.0;
  EnsembleMethod ensemble(Kind::kAuto, {});
  play.run(ensemble);
  EXPECT_LT(play.worst_after_1s, 0.1);
}

// Pokes into objects whose samples have 30 mN of noise. By their errors of the last samples alone,
// candidates that expect less noise are rendered now and then.
TEST(EnsembleMethods, RenderWhoExpectsAsMuchNoiseAsThereIs) {
  constexpr int kObjects = 24;
  kriging::EnsembleThresholds by_errors_alone;
  by_errors_alone.more_likely_nats = 1e9;
  double error = 0.0;
  double error_by_errors_alone = 0.0;
  for (unsigned seed = 20; seed < 20 + kObjects; ++seed) {
    Play play = poke_on(AnchoredSprings(seed));
    play.noise_N = 0.03;
    play.duration_s = 10.0;
    EnsembleMethod ensemble(Kind::kAuto, {});
    play.run(ensemble);
    error += play.error_after_1s / kObjects;
    EnsembleMethod other(Kind::kAuto, {}, by_errors_alone);
    play.run(other);
    error_by_errors_alone += play.error_after_1s / kObjects;
  }
  EXPECT_LT(error, 0.9 * error_by_errors_alone);
}

// The largest error of `auto` from `first_s` on, of the RMS force, in pokes with 10 mN of noise.
double worst_of_pokes(const AnchoredSprings& object, double first_s, double duration_s,
                      const std::function<Vector3d(double, const Vector3d&)>& force_N) {
  Play play = poke_on(object);
  play.noise_N = 0.01;
  play.first_s = first_s;
  play.duration_s = duration_s;
  play.force_N = force_N;
  EnsembleMethod ensemble(Kind::kAuto, {});
  play.run(ensemble);
  return play.worst_after_1s;
}

// An object has moved by 8 mm and then lost half of its strength. With 10 mN of noise "walls",
// which expects 3 mN, finds walls in samples that whoever is rendered has predicted as well as any.
TEST(EnsembleMethods, RenderNoWallWhereNobodyIsWrong) {
  for (const unsigned seed : {40u, 57u, 89u, 100u, 124u}) {
    const AnchoredSprings object(seed);
    const auto moved_N = [&](double t_s, const Vector3d& d_m) -> Vector3d {
      const Vector3d slide_m = std::clamp((t_s - 4.0) / 3.0, 0.0, 1.0) * Vector3d(8e-3, 2.4e-3, 0);
      return (t_s > 9.0 ? 0.5 : 1.0) * object.force_N(d_m - slide_m);
    };
    EXPECT_LT(worst_of_pokes(object, 9.5, 18.0, moved_N), 0.3) << seed;
  }
}

// The objects lose 60 % of their strength while the tool rests inside. "moved" knows that they are
// weaker everywhere if it expects the noise that there is; the next pokes elsewhere are wrong by
// half of the force and more if it expects 1 mN.
TEST(EnsembleMethods, KnowAWeakerObjectThroughNoise) {
  for (const unsigned seed : {30u, 34u, 61u, 88u}) {
    const AnchoredSprings object(seed);
    const auto cut_N = [&](double t_s, const Vector3d& d_m) -> Vector3d {
      return (t_s > 5.0 ? 0.4 : 1.0) * object.force_N(d_m);
    };
    EXPECT_LT(worst_of_pokes(object, 6.0, 8.0, cut_N), 0.05) << seed;
  }
}

// Who woke is scored by the last samples: if the candidate that is best by the first of them is
// rendered until the others have been scored, it may be wrong by a third of the force.
TEST(EnsembleMethods, ChooseOnceAllLastSamplesAreScored) {
  const AnchoredSprings object(118);
  const HandMotion motion(218);
  Vector3d slow_N = Vector3d::Zero();
  double last_s = 0.0;
  Play play;
  play.displacement_m = [&](double t_s) { return motion.position_m(t_s); };
  play.force_N = [&](double t_s, const Vector3d& d_m) -> Vector3d {  // relaxes to 60 %
    const double kept = std::exp(-(t_s - last_s) / 0.5);
    last_s = t_s;
    slow_N = kept * slow_N + (1.0 - kept) * object.force_N(d_m);
    return object.force_N(d_m) - 0.4 * slow_N;
  };
  EnsembleMethod ensemble(Kind::kAuto, {});
  play.run(ensemble);
  EXPECT_LT(play.worst_after_1s, 0.15);
}

void expect_work_piece_by_piece(Kind kind) {
  const AnchoredSprings object(kSeed);
  Play at_once = hand_on(object);
  Play in_pieces = hand_on(object);
  in_pieces.work_budget = 1;
  EnsembleMethod first(kind, {});
  EnsembleMethod second(kind, {});
  at_once.run(first);
  in_pieces.run(second);
  EXPECT_EQ(second.samples_passed_over(), 0u);
  EXPECT_LT(in_pieces.error_after_1s, 1.5 * at_once.error_after_1s + 1e-4);

  // One call does one piece: the rendered candidate answers after the first, the others follow. One
  // piece is not a sample's: the uncertainty of what is rendered.
  EnsembleMethod ensemble(kind, {});
  ensemble.contact_made(1, Vector3d::Zero());
  ensemble.observe(0.0, Vector3d::Zero());
  Sample sample;
  sample.force_W = Vector3d(1, 2, 3);
  ensemble.take_sample(sample);
  EXPECT_EQ(ensemble.force(0.0, Vector3d::Zero()).status, EstimateStatus::kUnknown);
  int calls = 0;
  int others = 0;
  int fitted_before = 0;
  while (ensemble.work(1) > 0) {
    ++calls;
    EXPECT_NEAR(ensemble.force(0.0, Vector3d::Zero()).force_W.z(), 3.0, 0.01);
    int fitted = 0;
    for (std::size_t i = 0; i < ensemble.candidates().size(); ++i) {
      fitted += ensemble.candidate(i).field().sample_count();
    }
    others += fitted == fitted_before ? 1 : 0;
    EXPECT_EQ(fitted + others, calls);
    fitted_before = fitted;
  }
  EXPECT_EQ(others, 1);
  EXPECT_EQ(static_cast<std::size_t>(fitted_before), ensemble.candidates().size());
}

TEST(EnsembleMethods, LetTheEnsembleDoItsWorkPieceByPiece) {
  expect_work_piece_by_piece(Kind::kKriging);
}

TEST(EnsembleMethods, CountSamplesThatAnEnsembleWithoutTimePassesOver) {
  EnsembleMethod ensemble(Kind::kKriging, {});
  ensemble.contact_made(1, Vector3d::Zero());
  for (int i = 0; i < 100; ++i) {
    Sample sample;
    sample.time_s = 0.01 * i;
    sample.position_W = Vector3d(0.0001 * i, 0, 0);
    sample.force_W = -200.0 * sample.position_W;
    ensemble.take_sample(sample);
    ensemble.work(1);
  }
  EXPECT_GT(ensemble.samples_passed_over(), 0u);
  ASSERT_EQ(ensemble.counters().size(), 1u);
  EXPECT_STREQ(ensemble.counters()[0].name, "samples_passed_over");
  EXPECT_EQ(ensemble.counters()[0].value, ensemble.samples_passed_over());
  // The rendered candidate has seen them all.
  EXPECT_NEAR(ensemble.force(1.0, Vector3d(0.0099, 0, 0)).force_W.x(), -1.98, 0.01);
}

TEST(EnsembleMethods, HandOverWithoutAStep) {
  const AnchoredSprings object(kSeed);
  EnsembleMethod ensemble(Kind::kKriging, {});
  ensemble.contact_made(1, kPoint_W);
  const HandMotion motion(kSeed);
  std::mt19937 random(kSeed);
  std::normal_distribution<double> noise(0.0, 0.03);
  int hand_overs = 0;
  for (int i = 0; i < 150; ++i) {
    const double t_s = i * kPeriod_s;
    Sample sample;
    sample.time_s = t_s;
    sample.position_W = kPoint_W + motion.position_m(t_s);
    sample.force_W = object.force_N(motion.position_m(t_s)) +
                     Vector3d(noise(random), noise(random), noise(random));
    ensemble.observe(t_s, sample.position_W);
    ensemble.take_sample(sample);
    const std::size_t rendered = ensemble.rendered();
    for (bool more = true; more;) {
      const std::string before = std::to_string(ensemble.rendered());
      const Vector3d force_before_N = ensemble.force(t_s, sample.position_W).force_W;
      const int samples_before = ensemble.candidate(rendered).field().sample_count();
      more = ensemble.work(1) > 0;
      if (ensemble.rendered() != rendered && std::to_string(ensemble.rendered()) != before) {
        ++hand_overs;
        EXPECT_EQ(ensemble.candidate(rendered).field().sample_count(), samples_before);
        EXPECT_LT((ensemble.force(t_s, sample.position_W).force_W - force_before_N).norm(), 1e-3);
      }
    }
  }
  EXPECT_GE(hand_overs, 1);
}

}  // namespace
}  // namespace forcegrid
