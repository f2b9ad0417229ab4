// SPDX-License-Identifier: Apache-2.0
// An object in closed form that slides away or gets weaker: what the field says of it, against what
// was done to it.

#include "forcegrid/kriging/moved_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "forcegrid/kriging/ensemble_method.h"
#include "tests/forcegrid/kriging/kriging_play.h"
#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;
using forcegrid::testing::AnchoredSprings;

using forcegrid::testing::kPeriod_s;

constexpr unsigned kSeed = 11;

FieldSettings settings(int stiffness_samples = 0) {
  FieldSettings settings;
  settings.nugget_N2 = 1e-6;
  settings.stiffness_samples = stiffness_samples;
  return settings;
}

// All that there is to do.
Innovation take(MovedField& field, const Observation& observation) {
  const Innovation innovation = field.take(observation);
  while (field.prepare()) {
  }
  return innovation.unfinished ? field.taken() : innovation;
}

// A tool that goes around in some millimetres, as a hand that explores does.
Vector3d hand_m(double time_s) {
  return {0.006 * std::sin(1.3 * time_s), 0.005 * std::sin(1.7 * time_s + 1.0),
          0.006 + 0.004 * std::sin(2.3 * time_s)};
}

// Thirty samples per second along that motion, of an object that is moved and weakened.
struct Scene {
  AnchoredSprings object{kSeed};
  double strength = 1.0;
  Vector3d moved_m = Vector3d::Zero();
  int number = 0;
  std::uint64_t contact = 1;
  bool with_stiffness = false;

  Vector3d force_N(const Vector3d& position_m) const {
    return strength * object.force_N(position_m - moved_m);
  }
  Observation at(double time_s, const Vector3d& position_m) const {
    Observation o;
    o.time_s = time_s;
    o.position_m = position_m;
    o.force_N = force_N(o.position_m);
    o.contact = contact;
    if (with_stiffness) {
      const Eigen::Matrix3d j = strength * object.stiffness_N_per_m(position_m - moved_m);
      o.has_stiffness = true;
      o.stiffness_N_per_m << j(0, 0), j(1, 1), j(2, 2), j(0, 1), j(0, 2), j(1, 2);
    }
    return o;
  }
  Observation next() {
    ++number;
    return at(kPeriod_s * number, hand_m(kPeriod_s * number));
  }
  // Eight seconds of the object as it is.
  void teach(MovedField& field) {
    for (int i = 0; i < 240; ++i) {
      take(field, next());
    }
  }
};

// The largest error [N] at the places of the last `count` samples.
double largest_error_N(const MovedField& field, const Scene& scene, int count) {
  double largest_N = 0.0;
  for (int i = 0; i < count; ++i) {
    const Vector3d at_m = hand_m(kPeriod_s * (scene.number - i));
    largest_N = std::max(largest_N,
                         (field.read(at_m, History::Zero()).force_N - scene.force_N(at_m)).norm());
  }
  return largest_N;
}

TEST(MovedField, IsAnOrdinaryFieldOfAnObjectThatStays) {
  Scene scene;
  MovedField field(settings());
  DictionaryField<float, 32, 4> plain(settings());
  for (int i = 0; i < 60; ++i) {
    const Observation o = scene.next();
    EXPECT_EQ(take(field, o).error_N, plain.take(o).error_N);
  }
  const Vector3d at_m(0.002, -0.001, 0.004);
  EXPECT_EQ(field.read(at_m, History::Zero()).force_N, plain.read(at_m, History::Zero()).force_N);
  EXPECT_EQ(field.shift_m(), Vector3d::Zero());
  EXPECT_EQ(field.strength(), 1.0);
}

TEST(MovedField, KnowsAllOfAWeakerObjectFromOneSample) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  const double before_N = largest_error_N(field, scene, 60);
  ASSERT_FALSE(field.open());
  const double strength = field.strength();
  scene.strength = 0.6;
  const Innovation innovation = take(field, scene.next());
  EXPECT_TRUE(innovation.surprised);
  EXPECT_TRUE(innovation.explained);
  EXPECT_NEAR(field.strength(), 0.6 * strength, 0.005);
  EXPECT_LT(largest_error_N(field, scene, 60), before_N + 0.01);
}

// A tool that rests at six places for half a second each, and 10 mN of noise.
TEST(MovedField, KnowsAWeakerObjectThroughTheNoiseThatItExpects) {
  std::mt19937 random(kSeed);
  std::normal_distribution<double> noise_N(0.0, 0.01);
  Scene scene;
  MovedField field(settings());
  MovedField deaf(settings());
  field.expect_noise(1e-4);
  const auto sample = [&](int number) {
    Observation o = scene.at(kPeriod_s * number, hand_m(0.8 * (number / 15)));
    o.force_N += Vector3d(noise_N(random), noise_N(random), noise_N(random));
    return o;
  };
  for (int i = 0; i < 90; ++i) {
    const Observation o = sample(i);
    EXPECT_FALSE(take(field, o).surprised) << "five deviations of three components, " << i;
    take(deaf, o);
  }
  scene.strength = 0.4;
  const Observation o = sample(89);
  EXPECT_TRUE(take(field, o).explained);
  take(deaf, o);
  EXPECT_NEAR(field.strength(), 0.4, 0.02);
  double largest_N = 0.0;
  double deaf_largest_N = 0.0;
  for (int i = 0; i < 90; i += 15) {
    const Vector3d at_m = hand_m(0.8 * (i / 15));
    const Vector3d truth_N = scene.force_N(at_m);
    largest_N = std::max(largest_N, (field.read(at_m, History::Zero()).force_N - truth_N).norm());
    deaf_largest_N =
        std::max(deaf_largest_N, (deaf.read(at_m, History::Zero()).force_N - truth_N).norm());
  }
  EXPECT_LT(largest_N, 0.05);
  EXPECT_GT(deaf_largest_N, 0.2) << "it expects 1 mN";
}

// Its factor is that of a field that expected this noise from the beginning.
TEST(MovedField, MakesItsFactorAnewForOtherNoise) {
  FieldSettings noisy = settings();
  noisy.nugget_N2 = 1e-4;
  Scene scene;
  MovedField field(settings());
  MovedField from_the_beginning(noisy);
  for (int i = 0; i < 20; ++i) {
    const Observation o = scene.next();
    take(field, o);
    take(from_the_beginning, o);
  }
  field.expect_noise(noisy.nugget_N2);
  const Observation o = scene.next();
  take(field, o);
  take(from_the_beginning, o);
  EXPECT_EQ(field.shift_m(), Vector3d::Zero());
  const Vector3d between_m = hand_m(kPeriod_s * 10.5);
  const Vector3d expected_N = from_the_beginning.read(between_m, History::Zero()).force_N;
  EXPECT_LT((field.read(between_m, History::Zero()).force_N - expected_N).norm(), 1e-5);
}

TEST(MovedField, FollowsAnObjectThatSlidesAndForeseesWhereItIs) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  const Vector3d from_m = field.shift_m();
  const Vector3d velocity_m_per_s(2e-3, -1.5e-3, 0.5e-3);
  Observation o;
  for (int i = 1; i <= 60; ++i) {
    scene.moved_m = kPeriod_s * i * velocity_m_per_s;
    o = scene.next();
    take(field, o);
  }
  EXPECT_TRUE(field.open());
  EXPECT_LT((field.shift_m() - from_m - scene.moved_m).norm(), 0.15 * scene.moved_m.norm());
  EXPECT_LT((field.velocity_m_per_s() - velocity_m_per_s).norm(), 0.4 * velocity_m_per_s.norm());
  // Two periods later, which is as late as a sample may be, at the newest place.
  scene.moved_m += 2.0 * kPeriod_s * velocity_m_per_s;
  const double stale_N =
      (field.read(o.position_m, History::Zero()).force_N - scene.force_N(o.position_m)).norm();
  field.set_time(o.time_s + 2.0 * kPeriod_s);
  const double foreseen_N =
      (field.read(o.position_m, History::Zero()).force_N - scene.force_N(o.position_m)).norm();
  EXPECT_LT(foreseen_N, 0.5 * stale_N);
}

// An object that slides on while the tool is away for half a second, and in the next contact.
TEST(MovedField, FollowsAnObjectThatSlidesOnBetweenContacts) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  const Vector3d velocity_m_per_s(2e-3, -1.5e-3, 0.5e-3);
  const int slides_from = scene.number;
  const auto slid_m = [&] { return kPeriod_s * (scene.number - slides_from) * velocity_m_per_s; };
  const auto next = [&](std::uint64_t contact) {
    ++scene.number;
    scene.moved_m = slid_m();
    --scene.number;
    Observation o = scene.next();
    o.contact = contact;
    return o;
  };
  for (int i = 0; i < 30; ++i) {
    take(field, next(1));
  }
  const double in_contact_N = largest_error_N(field, scene, 1);
  scene.number += 15;
  const Observation first = next(2);
  field.enter_contact(2, Vector3d::Zero());
  const auto error_N = [&] {
    return (field.read(first.position_m, History::Zero()).force_N - first.force_N).norm();
  };
  const double as_it_was_N = error_N();
  field.set_time(first.time_s);
  EXPECT_LT(error_N(), 0.4 * as_it_was_N);
  take(field, first);
  EXPECT_TRUE(field.open());
  for (int i = 0; i < 30; ++i) {
    take(field, next(2));
  }
  EXPECT_LT(largest_error_N(field, scene, 1), in_contact_N + 0.02);
  // Unseen for longer it is taken to be at rest.
  scene.number += 90;
  take(field, next(3));
  EXPECT_EQ(field.velocity_m_per_s(), Vector3d::Zero());
}

// The longer an object slides steadily, the less a force that is a little off says of its velocity.
TEST(MovedField, LearnsThatASlideIsSteady) {
  const auto turned_m_per_s = [](int samples, double off_N) {
    Scene scene;
    MovedField field(settings());
    scene.teach(field);
    Observation o;
    for (int i = 1; i <= samples; ++i) {
      scene.moved_m = kPeriod_s * i * Vector3d(2e-3, -1.5e-3, 0.5e-3);
      o = scene.next();
      if (i == samples) {
        o.force_N.x() += off_N;
      }
      take(field, o);
    }
    EXPECT_TRUE(field.open());
    return field.velocity_m_per_s();
  };
  const auto turn_m_per_s = [&](int samples) {
    return (turned_m_per_s(samples, 0.01) - turned_m_per_s(samples, 0.0)).norm();
  };
  EXPECT_LT(turn_m_per_s(30), 0.55 * turn_m_per_s(6));
}

// A tool that pokes at 10 Hz while the object slides into what it knows nothing of: each error of
// the shift would be learned as a force. Later it is known to tens of micrometres where it is.
TEST(MovedField, KnowsHowFarASlideHasGoneIntoTheUnknown) {
  Scene scene;
  MovedField field(settings());
  constexpr double kSlow_s = 0.1;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> deep_m(0.002, 0.010);
  Vector3d at_m = Vector3d::Zero();
  double time_s = 0.0;
  const auto poke = [&](int samples) {
    for (int i = 0; i < samples; ++i) {
      time_s += kSlow_s;
      scene.moved_m = std::clamp(time_s - 6.0, 0.0, 3.0) * Vector3d(2.7e-3, -1.7e-3, 0.0);
      if (i % 4 == 0) {
        at_m = {0.2 * deep_m(random), -0.2 * deep_m(random), deep_m(random)};
      }
      take(field, scene.at(time_s, at_m));
    }
  };
  poke(100);
  EXPECT_LT((field.shift_m() - scene.moved_m).norm(), 0.1e-3) << "of 9.6 mm, seed " << kSeed;
  double squares_N2 = 0.0;
  for (int i = 0; i < 100; ++i) {
    const Vector3d place_m(0.2 * deep_m(random), -0.2 * deep_m(random), deep_m(random));
    const Vector3d error_N = field.read(place_m, History::Zero()).force_N - scene.force_N(place_m);
    squares_N2 += error_N.squaredNorm() / 100.0;
  }
  EXPECT_LT(std::sqrt(squares_N2), 0.05) << "seed " << kSeed;
}

// An object that turns back: the velocity is not what it was, and what was learned before stays.
TEST(MovedField, FollowsAnObjectThatTurnsBack) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  const Vector3d velocity_m_per_s(3e-3, -2e-3, 0.0);
  for (int i = 1; i <= 90; ++i) {
    scene.moved_m += kPeriod_s * (i <= 45 ? 1.0 : -1.0) * velocity_m_per_s;
    take(field, scene.next());
  }
  EXPECT_LT((field.velocity_m_per_s() + velocity_m_per_s).norm(), 0.1 * velocity_m_per_s.norm());
  EXPECT_LT((field.shift_m() - scene.moved_m).norm(), 0.1e-3);
  EXPECT_LT(largest_error_N(field, scene, 1), 0.02);
}

// Cut while it slides: the motion goes on.
TEST(MovedField, KnowsAWeakerObjectThatSlides) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  const Vector3d velocity_m_per_s(2e-3, -1.5e-3, 0.0);
  for (int i = 1; i <= 60; ++i) {
    scene.moved_m += kPeriod_s * velocity_m_per_s;
    scene.strength = i > 40 ? 0.5 : 1.0;
    take(field, scene.next());
  }
  EXPECT_NEAR(field.strength(), 0.5, 0.02);
  EXPECT_LT(largest_error_N(field, scene, 1), 0.02);
}

TEST(MovedField, ComesToRestWithTheObject) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  for (int i = 1; i <= 30; ++i) {
    scene.moved_m = kPeriod_s * i * Vector3d(3e-3, 0.0, 0.0);
    take(field, scene.next());
  }
  for (int i = 0; i < 60; ++i) {
    take(field, scene.next());
  }
  EXPECT_FALSE(field.open());
  EXPECT_LT(largest_error_N(field, scene, 30), 0.02);
}

// A tool that pushes along one line at 10 Hz knows nothing of the object beside it. The simulator's
// stiffness tells what comes there under the tool, however uncertain the shift.
TEST(MovedField, LearnsByStiffnessWhatSlidesUnderTheTool) {
  Scene scene;
  scene.with_stiffness = true;
  MovedField field(settings(2));
  constexpr double kSlow_s = 0.1;
  const auto push_m = [](double time_s) {
    return Vector3d(0.0, 0.0, 0.006 + 0.004 * std::sin(5.0 * time_s));
  };
  double slid_N2 = 0.0;
  double rested_N2 = 0.0;
  for (int i = 0; i < 120; ++i) {
    const double time_s = kSlow_s * i;
    scene.moved_m = std::clamp(time_s - 6.0, 0.0, 3.0) * Vector3d(2.7e-3, -1.7e-3, 0.0);
    const double error_N = take(field, scene.at(time_s, push_m(time_s))).error_N;
    slid_N2 += i >= 63 && i < 90 ? error_N * error_N / 27.0 : 0.0;
    rested_N2 += i >= 100 ? error_N * error_N / 20.0 : 0.0;
  }
  EXPECT_LT(std::sqrt(slid_N2), 0.02) << "of 2 N; it would be 33 mN without that";
  EXPECT_LT(std::sqrt(rested_N2), 0.035) << "52 mN";
}

TEST(MovedField, TakesAStrongerForceForNoWeakerObject) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  scene.strength = 1.5;
  EXPECT_FALSE(take(field, scene.next()).explained);
  EXPECT_EQ(field.strength(), 1.0);
}

// At 20 um the force falls by 2 mN, which surprises nobody; the stiffness falls by 40 %.
TEST(MovedField, KnowsAWeakerObjectByTheStiffnessWhereItsForceIsSmall) {
  Scene scene;
  scene.with_stiffness = true;
  MovedField field(settings(2));
  scene.teach(field);
  const Vector3d lightly_m(0.0, 0.0, 0.00002);
  const auto lightly = [&] { return scene.at(kPeriod_s * ++scene.number, lightly_m); };
  for (int i = 0; i < 10; ++i) {
    ASSERT_FALSE(take(field, lightly()).explained);
  }
  ASSERT_EQ(field.strength(), 1.0);
  ASSERT_FALSE(field.open());
  scene.strength = 0.6;
  const Innovation innovation = take(field, lightly());
  EXPECT_TRUE(innovation.explained);
  EXPECT_NEAR(field.strength(), 0.6, 0.01);
  scene.strength = 0.9;  // stronger than it was: another object
  EXPECT_FALSE(take(field, lightly()).explained);
}

TEST(MovedField, DoesNotTakeAShiftForAWeakerObjectByItsStiffness) {
  Scene scene;
  scene.with_stiffness = true;
  MovedField field(settings(2));
  scene.teach(field);
  const Vector3d velocity_m_per_s(2e-3, -1.5e-3, 0.5e-3);
  for (int i = 0; i < 30; ++i) {
    scene.moved_m += kPeriod_s * velocity_m_per_s;
    EXPECT_FALSE(take(field, scene.next()).explained) << i;
  }
  EXPECT_EQ(field.strength(), 1.0);
}

// Asleep it takes no samples; who is rendered has found out that this contact is 0.6 of the others.
TEST(MovedField, KeepsWhatItRemembersOfOtherContactsAtTheScaleOfThisOne) {
  for (const double deviation : {0.001, 0.1}) {
    Scene scene;
    MovedField field(settings());
    for (int i = 0; i < 300; ++i) {
      field.remember(scene.next());
    }
    Observation late = scene.next();
    scene.contact = 2;
    scene.strength = 0.6;
    field.scale_earlier_contacts(2, {.factor = 0.8, .deviation = 0.001});
    field.scale_earlier_contacts(2, {.factor = 0.6, .deviation = deviation});
    late.position_m = Vector3d(0.02, 0.0, 0.0);  // far from all others, so it is kept
    late.force_N = scene.object.force_N(late.position_m);
    field.remember(late);
    EXPECT_TRUE(field.begin_with({}));
    const bool sure = deviation < 0.01;
    EXPECT_EQ(largest_error_N(field, scene, 300) < 0.02, sure) << deviation;
    const Vector3d far_N = field.read(late.position_m, History::Zero()).force_N;
    EXPECT_EQ((far_N - scene.force_N(late.position_m)).norm() < 0.02, sure);
  }
}

TEST(MovedField, BeginsWithWhatItRemembers) {
  Scene scene;
  MovedField field(settings());
  for (int i = 0; i < 300; ++i) {
    field.remember(scene.next());
  }
  EXPECT_LT(field.sample_count(), settings().samples);
  EXPECT_TRUE(field.begin_with({}));
  EXPECT_EQ(field.row_count(), 3 * field.sample_count());
  EXPECT_LT(largest_error_N(field, scene, 300), 0.02);
}

// What the candidate is for: after a cut the force is right at once, also where the tool has not
// been since.
TEST(AutoMethod, RendersAWeakerObjectWhereItHasNotBeenSince) {
  const AnchoredSprings object(kSeed);
  constexpr double kCut_s = 8.0;
  forcegrid::testing::Play play;
  play.displacement_m = hand_m;
  play.force_N = [&object](double time_s, const Vector3d& d_m) -> Vector3d {
    return (time_s < kCut_s ? 1.0 : 0.5) * object.force_N(d_m);
  };
  play.duration_s = 10.0;
  play.first_s =
      kCut_s + 0.11;  // three periods: one until a sample shows it, one until it is there
  EnsembleMethod method(EnsembleMethod::Kind::kAuto, {});
  play.run(method);
  EXPECT_STREQ(method.candidates()[method.rendered()], "moved");
  EXPECT_LT(play.error_after_1s, 2e-3);
}

// An object that slides by 3 mm in the second from `slides_s` on and that is cut at `cut_s`. The
// tool rests in the cut, so that the first sample that shows it is of a small force. 60 ms later it
// presses, and the force is half of what it was: what `auto` renders until the next sample is
// judged.
void expect_known_by_a_small_force(double slides_s, double cut_s) {
  const AnchoredSprings object(kSeed);
  const double presses_s = cut_s + 2.2 * kPeriod_s;
  forcegrid::testing::Play play;
  play.displacement_m = [&](double time_s) -> Vector3d {
    const bool rests = time_s > cut_s - 0.5 && time_s < presses_s;
    return rests ? Vector3d(0.0, 0.0, 0.0003) : hand_m(time_s);
  };
  play.force_N = [&](double time_s, const Vector3d& d_m) -> Vector3d {
    const double slid_m = 3e-3 * std::clamp(time_s - slides_s, 0.0, 1.0);
    return (time_s < cut_s ? 1.0 : 0.5) * object.force_N(d_m - Vector3d(slid_m, 0.0, 0.0));
  };
  play.duration_s = presses_s + kPeriod_s;
  play.first_s = presses_s;
  EnsembleMethod method(EnsembleMethod::Kind::kAuto, {});
  play.run(method);
  EXPECT_STREQ(method.candidates()[method.rendered()], "moved");
  EXPECT_LT(play.error_after_1s, 0.02);
}

// "moved" sleeps, and the rendered candidate hardly errs.
TEST(AutoMethod, KnowsAWeakerObjectByASmallForceBeforeALargeOne) {
  constexpr double kNever_s = 1e3;
  expect_known_by_a_small_force(kNever_s, 8.0);
}

// "moved" is rendered because the object slid before. Candidates that wake at the cut predict the
// samples from before it better.
TEST(AutoMethod, KeepsToTheObjectThatMovedWhenThatGetsWeaker) {
  expect_known_by_a_small_force(8.0, 10.5);
}

// A servo's cycle has time for one piece. Until all are done, the field answers as before.
TEST(MovedField, ExplainsASurpriseInPieces) {
  Scene scene;
  MovedField field(settings());
  scene.teach(field);
  scene.moved_m = Vector3d(0.004, 0.0, 0.0);
  const Observation observation = scene.next();
  const Vector3d at_m = observation.position_m;
  const Vector3d before_N = field.read(at_m, History::Zero()).force_N;
  const Innovation first = field.take(observation);
  ASSERT_TRUE(first.unfinished);
  EXPECT_FALSE(field.ready());
  int pieces = 0;
  while (!field.ready()) {
    EXPECT_LT((field.read(at_m, History::Zero()).force_N - before_N).norm(), 1e-9) << pieces;
    field.set_time(observation.time_s);
    ASSERT_TRUE(field.prepare());
    ++pieces;
  }
  EXPECT_LE(pieces, 8);
  EXPECT_TRUE(field.taken().surprised);
  EXPECT_TRUE(field.open());
  EXPECT_LT((field.read(at_m, History::Zero()).force_N - observation.force_N).norm(),
            0.2 * (before_N - observation.force_N).norm());
}

// What comes in between needs the whole sample.
TEST(MovedField, FinishesASampleBeforeTheNextOneOrAnotherContact) {
  for (const bool contact : {false, true}) {
    Scene scene;
    MovedField field(settings());
    MovedField whole(settings());
    for (int i = 0; i < 200; ++i) {
      const Observation observation = scene.next();
      take(field, observation);
      take(whole, observation);
    }
    scene.moved_m = Vector3d(0.004, 0.0, 0.0);
    const Observation surprise = scene.next();
    ASSERT_TRUE(field.take(surprise).unfinished);
    take(whole, surprise);
    if (contact) {
      field.enter_contact(1, Vector3d::Zero());
      whole.enter_contact(1, Vector3d::Zero());
    }
    const Observation next = scene.next();
    take(field, next);
    take(whole, next);
    EXPECT_EQ(field.shift_m(), whole.shift_m());
    EXPECT_EQ(field.read(next.position_m, History::Zero()).force_N,
              whole.read(next.position_m, History::Zero()).force_N);
  }
}

}  // namespace
}  // namespace forcegrid::kriging
