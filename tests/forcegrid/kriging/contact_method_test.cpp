// SPDX-License-Identifier: Apache-2.0
// kriging-contact: what is known at the first moment of a contact, and requests before it.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "forcegrid/kriging/kriging_method.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "tests/forcegrid/kriging/kriging_contacts.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using namespace testing;
using Kind = KrigingMethod::Kind;

TEST(KrigingContact, IsRightAtAKnownPlaceFromTheFirstCycleOfAContact) {
  double error[2];
  for (const bool contact_aware : {false, true}) {
    KrigingMethod method(contact_aware ? Kind::kContact : Kind::kForceOnly, {});
    EXPECT_EQ(method.force(0.0, kPlace_W).status, EstimateStatus::kUnknown);
    hold(method, 1, kPlace_W, 0.0);
    hold(method, 2, kPlace_W + Vector3d(0.010, 0.0, 0.0), 2.0);
    hold(method, 3, kPlace_W + Vector3d(-0.008, 0.006, 0.0), 4.0);
    EXPECT_EQ(method.force(5.5, kPlace_W).force_W, Vector3d::Zero());
    const Vector3d again_W = kPlace_W + Vector3d(0.009, 0.001, 0.0);
    method.contact_made(4, again_W);
    work(method);
    EXPECT_EQ(method.force(6.0, again_W).status, EstimateStatus::kPartlyKnown);
    error[contact_aware ? 1 : 0] = error_before_the_first_sample(method, again_W);
  }
  EXPECT_GT(error[0], 0.2) << "the place is stiffer than the last one by more than half";
  EXPECT_LT(error[1], 0.03);
}

class RequestsBeforeContact : public ::testing::Test {
 protected:
  // One servo cycle of an approach; @returns whether a request was made.
  bool approach(ForceMethod& method, const Vector3d& expected_W) {
    time_s_ += 0.008;
    method.observe(time_s_, expected_W + Vector3d(0.0, 0.0, 0.01));
    method.expect_contact(time_s_, expected_W);
    work(method);
    return method.plan_request(time_s_, expected_W + Vector3d(0.0, 0.0, 0.01), wanted_W_);
  }

  double time_s_ = 10.0;
  Vector3d wanted_W_ = Vector3d::Zero();
};

TEST_F(RequestsBeforeContact, MakeThePlaceKnownBeforeItIsTouched) {
  KrigingMethod method(Kind::kContact, {});
  std::vector<Vector3d> asked;
  for (int i = 0; i < 36; ++i) {  // 0.3 s at 120 a second
    if (approach(method, kPlace_W)) {
      for (const Vector3d& before : asked) {
        EXPECT_GT((before - wanted_W_).norm(), 0.0029) << "asked twice";
      }
      EXPECT_LT((wanted_W_ - kPlace_W).norm(), 0.019);
      asked.push_back(wanted_W_);
      method.take_sample(answer_at(time_s_, kPlace_W, wanted_W_));
      EXPECT_EQ(method.force(time_s_, kPlace_W).force_W, Vector3d::Zero()) << "still in the air";
    }
  }
  EXPECT_GE(asked.size(), 3u);
  EXPECT_LE(asked.size(), 13u);
  EXPECT_FALSE(approach(method, kPlace_W)) << "all is known or asked";
  const Vector3d touched_W = kPlace_W + Vector3d(0.001, -0.001, 0.0);
  method.contact_made(1, touched_W);
  work(method);
  // Without requests nothing is known. The object is 5 % stiffer here, and the motion goes further
  // than was asked for.
  EXPECT_LT(error_before_the_first_sample(method, touched_W), 0.15);
}

TEST_F(RequestsBeforeContact, AreNotMadeWhereThePlaceIsKnown) {
  KrigingMethod method(Kind::kContact, {});
  hold(method, 1, kPlace_W, 0.0);
  hold(method, 2, kPlace_W + Vector3d(0.003, 0.0, 0.0), 2.0);
  int asked = 0;
  for (int i = 0; i < 36; ++i) {
    asked += approach(method, kPlace_W + Vector3d(0.001, 0.0, 0.0)) ? 1 : 0;
  }
  EXPECT_LE(asked, 4);
  asked = 0;
  for (int i = 0; i < 36; ++i) {
    asked += approach(method, kPlace_W + Vector3d(0.08, 0.0, 0.0)) ? 1 : 0;
  }
  EXPECT_EQ(asked, 13) << "without answers, all of a place that was never touched";
}

TEST_F(RequestsBeforeContact, NeedAnExpectationThatIsNotOld) {
  KrigingMethod method(Kind::kContact, {});
  EXPECT_FALSE(method.plan_request(time_s_, kPlace_W, wanted_W_));
  EXPECT_TRUE(approach(method, kPlace_W));
  EXPECT_TRUE(method.plan_request(time_s_ + 0.05, kPlace_W, wanted_W_));
  EXPECT_FALSE(method.plan_request(time_s_ + 0.2, kPlace_W, wanted_W_));
  method.expect_contact(time_s_ + 0.3, Vector3d::Constant(std::nan("")));
  EXPECT_FALSE(method.plan_request(time_s_ + 0.3, kPlace_W, wanted_W_));
  EXPECT_TRUE(approach(method, kPlace_W));
  method.contact_lost();
  EXPECT_FALSE(method.plan_request(time_s_, kPlace_W, wanted_W_));
}

TEST_F(RequestsBeforeContact, AreNothingToMethodsThatDoNotTellPlacesApart) {
  for (const Kind kind : {Kind::kForceOnly, Kind::kTangent}) {
    KrigingMethod method(kind, {});
    EXPECT_FALSE(approach(method, kPlace_W));
    method.take_sample(answer_at(time_s_, kPlace_W, kPlace_W + Vector3d(0.0, 0.0, 0.004)));
    method.contact_made(1, kPlace_W);
    method.take_sample(answer_at(time_s_, kPlace_W, kPlace_W + Vector3d(0.0, 0.0, 0.004)));
    work(method);
    EXPECT_EQ(method.field().sample_count(), 0) << method.name();
  }
}

TEST_F(RequestsBeforeContact, AreStillOfUseWhenTheAnswerComesAfterTheTouch) {
  KrigingMethod method(Kind::kContact, {});
  ASSERT_TRUE(approach(method, kPlace_W));
  method.contact_made(1, kPlace_W + Vector3d(0.001, 0.0, 0.0));
  method.take_sample(answer_at(time_s_, kPlace_W, wanted_W_));
  work(method);
  EXPECT_EQ(method.field().sample_count(), 1);
  Sample broken = answer_at(time_s_, kPlace_W, wanted_W_ + Vector3d(0.0, 0.005, 0.0));
  broken.contact_point_W.x() = std::numeric_limits<double>::quiet_NaN();
  method.take_sample(broken);
  work(method);
  EXPECT_EQ(method.field().sample_count(), 1) << "of no place";
}

TEST(KrigingContact, TakesTheFirstSampleForTheContactPointWhereThatIsNotKnown) {
  KrigingMethod method(Kind::kContact, {});
  method.contact_made(1, Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  method.take_sample(sample_at(0.0, kPlace_W, Vector3d::Zero()));
  const Vector3d d_m(0.004, 0.002, -0.003);
  method.take_sample(sample_at(0.1, kPlace_W, d_m));
  work(method);
  EXPECT_LT((method.force(0.2, kPlace_W + d_m).force_W - force_N(kPlace_W, d_m)).norm(), 1e-3);
}

TEST(KrigingContact, IsMadeByNameWithCheckedOptions) {
  const MethodVariant variant = parse_method_variant("kriging-contact nug=1e-6 samples=20", {});
  const auto method = make_force_method(variant.name, variant.options);
  EXPECT_STREQ(method->name(), "kriging-contact");
  EXPECT_FALSE(method->needs().stiffness);
  EXPECT_LT(method->memory_bytes(), 1'000'000u);
  const KrigingMethod made(Kind::kContact, variant.options);
  EXPECT_EQ(made.field().settings().nugget_N2, 1e-6);
  EXPECT_EQ(made.field().settings().samples, 20);
  for (const char* refused : {"kriging-contact nug=0", "kriging-contact samples=1"}) {
    EXPECT_THROW(
        {
          const MethodVariant bad = parse_method_variant(refused, {});
          make_force_method(bad.name, bad.options);
        },
        std::invalid_argument)
        << refused;
  }
}

}  // namespace
}  // namespace forcegrid
