// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_method.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "tests/forcegrid/kriging/kriging_play.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using namespace testing;
using Kind = KrigingMethod::Kind;

TEST(KrigingMethods, FollowAnElasticObject) {
  const AnchoredSprings object(kSeed);
  for (const char* name : {"kriging", "kriging-bank"}) {
    Play play = hand_on(object);
    const auto method = make_force_method(name, {});
    play.run(*method);
    // Streaming is off by a fifth here; the springs harden faster than the sheet's block, on which
    // it is 0.15 and 0.08 %.
    EXPECT_LT(play.error_after_1s, std::string(name) == "kriging-bank" ? 0.003 : 0.006)
        << method->name();
    EXPECT_LT(play.worst_after_1s, 0.04) << method->name();
  }
}

TEST(KrigingMethods, LearnSoonerAndNoWorseWithStiffness) {
  const AnchoredSprings object(kSeed);
  for (const char* name : {"kriging-tangent", "kriging-bank"}) {
    Play without = poke_on(object);
    Play with = poke_on(object);
    with.stiffness_N_per_m = [&](const Vector3d& d) { return object.stiffness_N_per_m(d); };
    const auto plain = make_force_method(name, {});
    const auto tangent = make_force_method(name, {});
    without.run(*plain);
    with.run(*tangent);
    EXPECT_LT(with.error_first_1s, 0.07) << tangent->name();
    EXPECT_LT(with.error_first_1s, 0.5 * without.error_first_1s) << tangent->name();
    EXPECT_LE(with.error_after_1s, 1.02 * without.error_after_1s) << tangent->name();
  }
}

TEST(KrigingMethods, AskWhereTheyKnowLittleAndStopAskingOnceTheyKnow) {
  const AnchoredSprings object(kSeed);
  for (const char* name : {"kriging", "kriging-bank"}) {
    Play without = poke_on(object);
    Play with = poke_on(object);
    with.requests_per_s = 120.0;
    const auto silent = make_force_method(name, {});
    const auto asking = make_force_method(name, {});
    without.run(*silent);
    with.run(*asking);
    EXPECT_LT(with.error_first_1s, 0.5 * without.error_first_1s) << asking->name();
    EXPECT_LT(with.error_first_1s, std::string(name) == "kriging-bank" ? 0.03 : 0.1)
        << asking->name();
    EXPECT_LE(with.error_after_1s, 1.1 * without.error_after_1s + 2e-4) << asking->name();
    EXPECT_GT(with.requests, 3) << asking->name();
    EXPECT_LT(with.requests_after_2s, 60) << asking->name() << " of 720 possible";
  }
}

TEST(KrigingMethods, DoNotAskOutOfContactNorTwiceForTheSame) {
  KrigingMethod method(Kind::kForceOnly, {});
  Vector3d wanted_W;
  EXPECT_FALSE(method.plan_request(0.0, kPoint_W, wanted_W));
  method.contact_made(1, kPoint_W);
  method.observe(0.0, kPoint_W);
  std::vector<Vector3d> asked;
  for (int i = 0; i < 20; ++i) {
    if (method.plan_request(0.001 * i, kPoint_W, wanted_W)) {
      for (const Vector3d& before : asked) {
        EXPECT_GT((before - wanted_W).norm(), 0.0029);
      }
      asked.push_back(wanted_W);
    }
  }
  EXPECT_GE(asked.size(), 3u);
  method.contact_lost();
  EXPECT_FALSE(method.plan_request(10.0, kPoint_W, wanted_W));
}

// A contact elsewhere on an object that is as stiff there: known at once, relative to the new
// point.
TEST(KrigingMethods, KeepWhatTheyLearntRelativeToTheContactPoint) {
  const AnchoredSprings object(kSeed);
  for (const char* name : {"kriging", "kriging-bank"}) {
    const auto method = make_force_method(name, {});
    Play play = hand_on(object);
    play.run(*method);
    method->contact_lost();
    EXPECT_EQ(method->force(9.0, kPoint_W).status, EstimateStatus::kOk);
    EXPECT_EQ(method->force(9.0, kPoint_W).force_W, Vector3d::Zero());
    const Vector3d elsewhere_W(0.12, 0.02, 0.05);
    method->contact_made(2, elsewhere_W);
    double squares_N2 = 0.0;
    double reference_N2 = 0.0;
    for (int i = 0; i < 1000; ++i) {
      const Vector3d d_m = HandMotion(kSeed).position_m(3.0 + i * kServo_s);
      const ForceEstimate estimate = method->force(10.0 + i * kServo_s, elsewhere_W + d_m);
      EXPECT_EQ(estimate.status, EstimateStatus::kPartlyKnown) << "nothing of this contact yet";
      squares_N2 += (estimate.force_W - object.force_N(d_m)).squaredNorm();
      reference_N2 += object.force_N(d_m).squaredNorm();
    }
    EXPECT_LT(std::sqrt(squares_N2 / reference_N2), 0.005) << method->name();
  }
}

TEST(KrigingMethods, StandAHundredMillisecondsOfDelay) {
  const AnchoredSprings object(kSeed);
  for (const char* name : {"kriging", "kriging-bank"}) {
    Play play = hand_on(object);
    play.delay_s = 0.1;
    const auto method = make_force_method(name, {});
    play.run(*method);
    EXPECT_LT(play.error_after_1s, 0.025) << method->name();
  }
}

// A Kelvin-Voigt object: 3 Ns/m in parallel to the springs.
TEST(KrigingMethods, SayHowFarTheyKnow) {
  const AnchoredSprings object(kSeed);
  KrigingMethod method(Kind::kForceOnly, {});
  Play play = hand_on(object);
  play.run(method);
  const Vector3d here_W = kPoint_W + HandMotion(kSeed).position_m(8.0 - kServo_s);
  const ForceEstimate here = method.force(8.0, here_W);
  EXPECT_EQ(here.status, EstimateStatus::kOk);
  EXPECT_LT(here.uncertainty_N, 0.1);
  // Away from everything: fading without a jump, then unknown.
  double last_N = method.force(8.0, here_W).force_W.norm();
  bool partly = false;
  bool unknown = false;
  for (double x_m = 0.0; x_m < 0.2; x_m += 1e-4) {
    const ForceEstimate far = method.force(8.0, here_W + Vector3d(x_m, 0, 0));
    partly |= far.status == EstimateStatus::kPartlyKnown;
    EXPECT_FALSE(unknown && far.status != EstimateStatus::kUnknown);
    unknown |= far.status == EstimateStatus::kUnknown;
    EXPECT_LT(std::abs(far.force_W.norm() - last_N), 0.5) << "at " << x_m;
    last_N = far.force_W.norm();
    EXPECT_GT(far.uncertainty_N, 0.0);
  }
  EXPECT_TRUE(partly);
  EXPECT_TRUE(unknown);
  EXPECT_EQ(last_N, 0.0);
}

TEST(KrigingMethods, TellUncertaintiesOfTheSizeOfTheirErrors) {
  const AnchoredSprings object(kSeed);
  const HandMotion motion(kSeed);
  KrigingMethod method(Kind::kForceOnly, {});
  method.contact_made(1, kPoint_W);
  double normalised = 0.0;
  int count = 0;
  for (int i = 0; i < 4000; ++i) {
    const double t_s = i * kServo_s;
    const Vector3d d_m = motion.position_m(t_s);
    method.observe(t_s, kPoint_W + d_m);
    if (i % 16 == 0) {
      Sample sample;
      sample.time_s = t_s;
      sample.position_W = kPoint_W + d_m;
      sample.force_W = object.force_N(d_m);
      method.take_sample(sample);
      method.work(kAllWork);
    }
    if (i > 500) {
      const ForceEstimate estimate = method.force(t_s, kPoint_W + d_m);
      normalised += (estimate.force_W - object.force_N(d_m)).squaredNorm() / 3.0 /
                    (estimate.uncertainty_N * estimate.uncertainty_N);
      ++count;
    }
  }
  // This object is smoother than the prior's, so the claim is on the safe side, but not by much.
  EXPECT_LT(std::sqrt(normalised / count), 1.5);
  EXPECT_GT(std::sqrt(normalised / count), 0.05);
}

TEST(KrigingMethods, IgnoreLateSamplesButNotLateAnswers) {
  KrigingMethod method(Kind::kForceOnly, {});
  method.contact_made(1, Vector3d::Zero());
  Sample sample;
  sample.time_s = 1.0;
  sample.force_W = Vector3d(2, 0, 0);
  method.take_sample(sample);
  sample.time_s = 0.9;
  sample.position_W = Vector3d(0.02, 0, 0);
  method.take_sample(sample);
  method.work(kAllWork);
  EXPECT_EQ(method.field().sample_count(), 1);
  sample.from_query = true;
  method.take_sample(sample);
  method.work(kAllWork);
  EXPECT_EQ(method.field().sample_count(), 2);
}

TEST(KrigingMethods, LeaveOutAStiffnessThatIsNotFinite) {
  KrigingMethod method(Kind::kTangent, {});
  method.contact_made(1, Vector3d::Zero());
  Sample sample;
  sample.force_W = Vector3d(1, 0, 0);
  sample.has_stiffness = true;
  sample.stiffness_W.setConstant(std::numeric_limits<double>::quiet_NaN());
  method.take_sample(sample);
  method.work(kAllWork);
  EXPECT_EQ(method.field().row_count(), 3);
  EXPECT_NEAR(method.force(0.0, Vector3d::Zero()).force_W.x(), 1.0, 1e-3);
}

TEST(KrigingMethods, RefuseOptionsThatCannotBeUsedAndTakeThoseThatCan) {
  for (const char* variant : {"kriging nug=0", "kriging samples=1", "kriging samples=33",
                              "kriging spacing=1", "kriging spacing_N=-1"}) {
    EXPECT_THROW(parse_method_variant(variant, {}), std::invalid_argument) << variant;
  }
  MethodOptions options;
  options.nugget = -1.0;
  try {
    make_force_method("kriging", options);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("nugget"), std::string::npos) << error.what();
  }
  const MethodVariant variant =
      parse_method_variant("kriging nug=1e-6 samples=16 spacing=2mm spacing_N=0.2", {});
  const KrigingMethod method(Kind::kForceOnly, variant.options);
  EXPECT_EQ(method.field().settings().nugget_N2, 1e-6);
  EXPECT_EQ(method.field().settings().samples, 16);
  EXPECT_EQ(method.field().settings().spacing.metres, 2e-3);
  EXPECT_EQ(method.field().settings().spacing.newtons, 0.2);
}

}  // namespace
}  // namespace forcegrid
