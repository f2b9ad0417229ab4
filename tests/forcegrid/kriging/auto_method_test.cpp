// SPDX-License-Identifier: Apache-2.0
// auto: which of its candidates is rendered, and why.

#include <gtest/gtest.h>

#include <iostream>
#include <string>

#include "forcegrid/kriging/ensemble_method.h"
#include "forcegrid/methods.h"
#include "tests/forcegrid/kriging/kriging_contacts.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using namespace testing;

std::unique_ptr<ForceMethod> make_auto() { return make_force_method("auto", {}); }

std::string rendered(const ForceMethod& method, const Vector3d& at_W) {
  return method.candidates()[method.force(100.0, at_W).candidate];
}

// A hand on springs for five seconds; `answer` makes the sample.
template <typename Answer>
void play(ForceMethod& method, const Answer& answer, double begin_s = 0.0) {
  const HandMotion hand(kSeed);
  method.contact_made(1, kPlace_W);
  for (int i = 0; i < 2500; ++i) {
    const double time_s = begin_s + 0.002 * i;
    const Vector3d d_m = hand.position_m(0.002 * i);
    method.observe(time_s, kPlace_W + d_m);
    const Sample sample = answer(sample_at(time_s, kPlace_W, d_m));
    if (i % 17 == 0) {
      method.take_sample(sample);
    }
    work(method);
  }
}

TEST(AutoMethod, IsTheDefaultAndNamesItsCandidates) {
  EXPECT_STREQ(kDefaultMethod, "auto");
  const auto method = make_force_method(kDefaultMethod, {});
  EXPECT_STREQ(method->name(), "auto");
  EXPECT_EQ(method->candidates().size(), 13u);
  EXPECT_TRUE(method->needs().requests_before_contact);
  EXPECT_FALSE(method->needs().requests);
  EXPECT_FALSE(method->needs().stiffness);
  EXPECT_LT(method->memory_bytes(), 4'000'000u);
}

TEST(AutoMethod, BeginsWithThePlaceThatItKnows) {
  const auto method = make_auto();
  hold(*method, 1, kPlace_W, 0.0);
  hold(*method, 2, kPlace_W + Vector3d(0.010, 0.0, 0.0), 2.0);
  hold(*method, 3, kPlace_W + Vector3d(-0.008, 0.006, 0.0), 4.0);
  hold(*method, 4, kPlace_W + Vector3d(0.010, 0.001, 0.0), 6.0);
  const Vector3d again_W = kPlace_W + Vector3d(0.009, 0.001, 0.0);
  method->contact_made(5, again_W);
  work(*method);
  EXPECT_EQ(rendered(*method, again_W), "places");
  EXPECT_EQ(method->force(8.0, again_W).reason, ChoiceReason::kKnownPlace);
  EXPECT_LT(error_before_the_first_sample(*method, again_W), 0.03);
}

// The first sample of a contact is of no force, but its stiffness tells how stiff the place is now.
TEST(AutoMethod, LeavesAPlaceThatHasAnotherStiffness) {
  for (const double stiffer : {1.0, 0.6}) {
    const auto method = make_auto();
    for (std::uint32_t contact = 1; contact <= 4; ++contact) {
      hold(*method, contact, kPlace_W + Vector3d(0.002 * contact, 0.0, 0.0), 2.0 * contact);
    }
    const Vector3d again_W = kPlace_W + Vector3d(0.006, 0.0, 0.0);
    method->observe(10.0, again_W);
    method->contact_made(5, again_W);
    work(*method);
    ASSERT_EQ(rendered(*method, again_W), "places");
    Sample first = sample_at(10.0, again_W, Vector3d::Zero());
    first.has_stiffness = true;
    constexpr double kStep_m = 1e-6;
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d step_m = kStep_m * Vector3d::Unit(axis);
      first.stiffness_W.col(axis) =
          stiffer * (force_N(again_W, step_m) - force_N(again_W, -step_m)) / (2.0 * kStep_m);
    }
    method->take_sample(first);
    work(*method);
    EXPECT_EQ(rendered(*method, again_W) == "places", stiffer == 1.0);
    const Vector3d d_m(0.002, -0.001, 0.004);
    const Vector3d exact_N = stiffer * force_N(again_W, d_m);
    EXPECT_LT((method->force(10.0, again_W + d_m).force_W - exact_N).norm(), 0.1 * exact_N.norm());
  }
}

// A new contact at the point where the tool is announces that the object has changed, by a cut,
// say.
TEST(AutoMethod, DoesNotKnowAPlaceWhereTheObjectHasChanged) {
  const auto method = make_auto();
  for (std::uint32_t contact = 1; contact <= 4; ++contact) {
    hold(*method, contact, kPlace_W + Vector3d(0.002 * contact, 0.0, 0.0), 2.0 * contact);
  }
  const Vector3d again_W = kPlace_W + Vector3d(0.004, 0.0, 0.0);
  method->contact_made(5, again_W);
  work(*method);
  ASSERT_EQ(method->force(10.0, again_W).reason, ChoiceReason::kKnownPlace);
  method->take_sample(sample_at(10.0, again_W, Vector3d(0.0, 0.0, -0.001)));
  work(*method);
  method->contact_made(6, again_W);
  work(*method);
  EXPECT_NE(method->force(10.0, again_W).reason, ChoiceReason::kKnownPlace);
  const Vector3d elsewhere_W = again_W + Vector3d(0.004, 0.0, 0.0);
  method->contact_made(7, elsewhere_W);
  work(*method);
  EXPECT_EQ(method->force(10.0, elsewhere_W).reason, ChoiceReason::kKnownPlace) << "a slip";
}

// Contacts that tell nothing about their neighbours, so that `places` errs. It mostly sleeps. A
// candidate that wakes begins on a par with the rendered one, but a record of first touches stands.
TEST(AutoMethod, RemembersThatPlacesWasWrongThoughItSlept) {
  EnsembleMethod method(EnsembleMethod::Kind::kAuto, {});
  const auto names = method.candidates();
  std::size_t index = 0;
  while (names[index] != std::string("places")) {
    ++index;
  }
  const kriging::Candidate& places = method.candidate(index);
  int worse = 0;
  for (std::uint32_t contact = 1; contact <= 14; ++contact) {
    const double begin_s = 6.0 * contact;
    const double stiffer = 1.0 + 0.3 * ((7 * contact) % 5);
    const Vector3d point_W = kPlace_W + Vector3d(0.002 * (contact % 3), 0.0, 0.0);
    const HandMotion hand(kSeed + contact);
    const bool slept = !places.awake();
    method.observe(begin_s, point_W);
    method.contact_made(contact, point_W);
    if (slept && places.awake() && method.rendered() != index) {
      EXPECT_GE(places.score_N2, places.first_touch_score_N2) << contact;
      const double rendered_N2 = method.candidate(method.rendered()).score_N2;
      worse += places.first_touch_score_N2 > 4.0 * rendered_N2 ? 1 : 0;
    }
    for (int i = 1; i <= 500; ++i) {
      const double time_s = begin_s + 0.01 * i;
      Sample sample = sample_at(time_s, point_W, hand.position_m(0.01 * i));
      sample.force_W *= stiffer;
      method.observe(time_s, sample.position_W);
      if (i % 3 == 0) {
        method.take_sample(sample);
      }
      work(method);
    }
    method.contact_lost();
  }
  EXPECT_GT(worse, 0) << "it would have begun with twice the rendered one's score";
}

// What `places` knows of the place where the tool is now is not there when the contact begins.
TEST(AutoMethod, KnowsAPlaceAgainThatItLeftForAnother) {
  const auto method = make_auto();
  std::uint32_t contact = 0;
  const auto hold_at = [&](const Vector3d& point_W) {
    ++contact;
    hold(*method, contact, point_W, 2.0 * contact);
  };
  const Vector3d there_W = kPlace_W + Vector3d(0.020, 0.0, 0.0);
  for (const double aside_m : {0.0, 0.004, -0.003, 0.002}) {
    hold_at(there_W + Vector3d(0.0, aside_m, 0.0));
  }
  for (int i = 0; i < 9; ++i) {  // more than its neighbours, so that none of these are left
    hold_at(kPlace_W + Vector3d(0.0, 0.001 * (i - 4), 0.0));
  }
  play(
      *method, [](const Sample& sample) { return sample; }, 2.0 * ++contact);
  ASSERT_NE(rendered(*method, kPlace_W), "places") << "it is not served first";
  const Vector3d again_W = there_W + Vector3d(0.0, 0.001, 0.0);
  method->contact_made(++contact, again_W);
  work(*method);
  EXPECT_EQ(rendered(*method, again_W), "places");
  EXPECT_EQ(method->force(40.0, again_W).reason, ChoiceReason::kKnownPlace);
  EXPECT_LT(error_before_the_first_sample(*method, again_W), 0.03);
}

// The tool comes near an unknown place. @returns how many requests were made and answered.
int approach(ForceMethod& method, const Vector3d& point_W, double& time_s) {
  int asked = 0;
  for (int i = 0; i < 30; ++i) {
    time_s += 0.008;
    const Vector3d above_W = point_W + Vector3d(0.0, 0.0, 0.01);
    method.observe(time_s, above_W);
    method.expect_contact(time_s, point_W);
    work(method);
    Vector3d wanted_W;
    if (method.plan_request(time_s, above_W, wanted_W)) {
      method.take_sample(answer_at(time_s, point_W, wanted_W));
      ++asked;
    }
  }
  return asked;
}

void expect_begins_with_answers(ForceMethod& method, std::uint32_t contact, const Vector3d& point_W,
                                double time_s, double at_most) {
  method.contact_made(contact, point_W);
  work(method);
  EXPECT_EQ(rendered(method, point_W), "places");
  EXPECT_EQ(method.force(time_s, point_W).reason, ChoiceReason::kAskedBefore);
  EXPECT_LT(error_before_the_first_sample(method, point_W), at_most);
}

TEST(AutoMethod, BeginsWithWhatItHasAskedAbout) {
  const auto method = make_auto();
  double time_s = 10.0;
  EXPECT_GE(approach(*method, kPlace_W, time_s), 4);
  expect_begins_with_answers(*method, 1, kPlace_W, time_s, 0.1);
}

TEST(AutoMethod, AsksBeforeAContactThoughPlacesSlept) {
  const auto method = make_auto();
  play(*method, [](const Sample& sample) { return sample; });  // five seconds: all fall asleep
  method->contact_lost();
  for (std::uint32_t contact = 2; contact < 8; ++contact) {
    hold(*method, contact, kPlace_W, 4.0 + 2.0 * contact);
  }
  double time_s = 30.0;
  const Vector3d elsewhere_W = kPlace_W + Vector3d(0.020, 0.0, 0.0);
  EXPECT_GE(approach(*method, elsewhere_W, time_s), 4);
  // Fewer requests than about the first place, which is half as stiff: without any, 0.5.
  expect_begins_with_answers(*method, 8, elsewhere_W, time_s, 0.2);
}

TEST(AutoMethod, CorrectsASimulatorThatHasNotConverged) {
  const auto method = make_auto();
  Vector3d answered_N = Vector3d::Zero();
  Vector3d reference_N = Vector3d::Zero();
  int ticks = 0;
  play(*method, [&](Sample sample) {
    reference_N = sample.force_W;
    if (ticks++ % 17 == 0) {
      answered_N += 0.6 * (sample.force_W - answered_N);
    }
    sample.force_W = answered_N;
    sample.converged = false;
    return sample;
  });
  const Vector3d end_W = kPlace_W + HandMotion(kSeed).position_m(0.002 * 2499);
  EXPECT_EQ(rendered(*method, end_W), "unfinished");
  EXPECT_LT((method->force(0.002 * 2499, end_W).force_W - reference_N).norm(),
            0.01 * reference_N.norm());
}

TEST(AutoMethod, LeavesAConvergedSimulatorToTheOthers) {
  const auto method = make_auto();
  play(*method, [](const Sample& sample) { return sample; });
  const std::string who = rendered(*method, kPlace_W);
  EXPECT_NE(who, "unfinished");
  EXPECT_NE(who, "relaxing");
}

TEST(AutoMethod, FollowsAnObjectThatRelaxes) {
  const auto method = make_auto();
  Vector3d lag_N = Vector3d::Zero();
  Vector3d reference_N = Vector3d::Zero();
  play(*method, [&](Sample sample) {
    lag_N += 0.002 / 0.15 * (sample.force_W - lag_N);
    sample.force_W -= 0.4 * lag_N;
    reference_N = sample.force_W;
    return sample;
  });
  const Vector3d end_W = kPlace_W + HandMotion(kSeed).position_m(0.002 * 2499);
  EXPECT_EQ(rendered(*method, end_W), "relaxing");
  EXPECT_LT((method->force(0.002 * 2499, end_W).force_W - reference_N).norm(),
            0.03 * reference_N.norm());
}

// The share of the time after 2 s in which the rendered candidate knows more than the position.
double share_of_the_path(double mass_kg) {
  const auto method = make_auto();
  const HandMotion hand(kSeed);
  int cycles = 0;
  int path = 0;
  play(*method, [&](Sample sample) {
    constexpr double kStep_s = 2e-3;
    const Vector3d acceleration_W =
        (hand.position_m(sample.time_s + kStep_s) - 2.0 * hand.position_m(sample.time_s) +
         hand.position_m(sample.time_s - kStep_s)) /
        (kStep_s * kStep_s);
    if (sample.time_s > 2.0) {
      const std::string who = rendered(*method, sample.position_W);
      path += who == "viscous" || who == "noisy viscous" || who == "relaxing" ? 1 : 0;
      ++cycles;
    }
    sample.force_W -= mass_kg * acceleration_W;
    return sample;
  });
  const double share = static_cast<double>(path) / cycles;
  std::cout << mass_kg << " kg: " << share << '\n';
  return share;
}

TEST(AutoMethod, LeavesAnObjectWithInertiaToCandidatesThatKnowThePath) {
  EXPECT_GT(share_of_the_path(0.1), 0.8) << "0.2 if a few good samples were all that counted";
  EXPECT_EQ(share_of_the_path(0.0), 0.0) << "no lucky run";
}

}  // namespace
}  // namespace forcegrid
