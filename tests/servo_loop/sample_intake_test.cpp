// SPDX-License-Identifier: Apache-2.0
// The servo's end of the link, without a loop: samples in, contact, queries out.

#include "servo_loop/sample_intake.h"

#include <gtest/gtest.h>

#include <chrono>
#include <limits>
#include <memory>
#include <vector>

#include "forcegrid/methods.h"
#include "rt/vectors.h"
#include "tests/servo_loop/square_patch.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;
using std::chrono::milliseconds;

constexpr rt::Duration kCycle = milliseconds(2);
constexpr double kMaxForce_N = 8.0;

/// Keeps all that it is given, and wants the force 1 mm further along x if it `wants` any.
class Listener final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "listener"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  MethodNeeds needs() const noexcept override {
    MethodNeeds needs;
    needs.requests_before_contact = queries_before_contact;
    return needs;
  }
  void take_sample(const Sample& sample) noexcept override { taken.push_back(sample); }
  void contact_made(std::uint32_t epoch, const Vector3d& point_W) noexcept override {
    epochs.push_back(epoch);
    points_W.push_back(point_W);
  }
  void contact_lost() noexcept override { ++losses; }
  int work(int) noexcept override { return 0; }
  bool plan_request(double, const Vector3d& position_W, Vector3d& wanted_W) noexcept override {
    ++asked;
    wanted_W = position_W + Vector3d(0.001, 0.0, 0.0);
    return wants;
  }
  ForceEstimate force(double, const Vector3d&) const noexcept override { return {}; }

  std::vector<Sample> taken;
  std::vector<std::uint32_t> epochs;
  std::vector<Vector3d> points_W;
  int losses = 0;
  int asked = 0;
  bool wants = true;
  bool queries_before_contact = false;
};

class Intake : public ::testing::Test {
 protected:
  SampleIntake make(double requests_per_s = 0.0) {
    return SampleIntake(
        ports_, {&rendered_, &evaluated_},
        {.max_force_N = kMaxForce_N, .simulator_rate_Hz = 30.0, .requests_per_s = requests_per_s});
  }

  ArrivedSample sample(bool in_contact, std::uint32_t epoch,
                       const Vector3d& force_W = Vector3d::Zero()) const {
    ArrivedSample arrived;
    arrived.in_contact = in_contact;
    arrived.arrived = now_;
    arrived.sample.time_s = servo_time_s(now_);
    arrived.sample.force_W = force_W;
    arrived.sample.contact_epoch = epoch;
    return arrived;
  }

  ArrivedSample answer(bool in_contact, std::uint32_t epoch) const {
    ArrivedSample arrived = sample(in_contact, epoch);
    arrived.sample.from_query = true;
    return arrived;
  }

  /// `arrived` is there at the next cycle.
  void take(SampleIntake& intake, const ArrivedSample& arrived) {
    ASSERT_TRUE(ports_.samples.push(arrived));
    cycle(intake);
  }

  void cycle(SampleIntake& intake) {
    now_ += kCycle;
    intake.take(now_, first_touch_);
  }

  CycleRecord record(const SampleIntake& intake) const {
    CycleRecord record;
    intake.describe(now_, record);
    return record;
  }

  /// Queries that `cycles` cycles send, a tool at (0.01, 0, 0).
  std::vector<link::Query> queries(SampleIntake& intake, int cycles) {
    std::vector<link::Query> all;
    for (int i = 0; i < cycles; ++i) {
      cycle(intake);
      intake.query_if_due(now_, Vector3d(0.01, 0.0, 0.0));
      for (link::Query query; ports_.queries.pop(query);) {
        all.push_back(query);
      }
    }
    return all;
  }

  ServoPorts ports_;
  Listener rendered_;
  Listener evaluated_;
  FirstTouch first_touch_{kMaxForce_N};
  rt::TimePoint now_ = rt::TimePoint(std::chrono::seconds(1000));
};

TEST_F(Intake, KnowsNothingBeforeTheFirstSample) {
  const SampleIntake intake = make();
  EXPECT_FALSE(intake.has_sample());
  EXPECT_FALSE(intake.in_contact());
  EXPECT_FALSE(intake.expected_contact_W());
  EXPECT_EQ(intake.sample_age_s(now_), std::numeric_limits<double>::infinity());
  EXPECT_DOUBLE_EQ(intake.sample_period_s(), 1.0 / 30.0) << "the expected one";
  EXPECT_EQ(record(intake).sample_age_ms, -1.0);
}

TEST_F(Intake, PublishesTheToolStateWithARisingSequence) {
  SampleIntake intake = make();
  for (std::uint32_t sequence = 1; sequence <= 3; ++sequence) {
    now_ += kCycle;
    intake.send_tool_state(now_, Vector3d(0.01, 0.02, 0.03), Vector3d(0.1, 0.2, 0.3));
    link::ToolState tool;
    ASSERT_TRUE(ports_.tool.fetch(tool));
    EXPECT_EQ(tool.sequence, sequence);
    EXPECT_EQ(tool.servo_time_ns, now_.time_since_epoch().count());
    EXPECT_EQ(rt::to_vector(tool.position_W_m), Vector3d(0.01, 0.02, 0.03));
    EXPECT_EQ(rt::to_vector(tool.velocity_W_m_per_s), Vector3d(0.1, 0.2, 0.3));
  }
}

TEST_F(Intake, GivesASampleInContactToEveryMethod) {
  SampleIntake intake = make();
  ArrivedSample arrived = sample(true, 7, Vector3d(0.0, 0.0, 0.5));
  arrived.sample.contact_point_W = Vector3d(0.01, 0.02, 0.03);
  take(intake, arrived);
  for (const Listener* method : {&rendered_, &evaluated_}) {
    ASSERT_EQ(method->taken.size(), 1U);
    EXPECT_EQ(method->taken[0].force_W, Vector3d(0.0, 0.0, 0.5));
    EXPECT_EQ(method->epochs, std::vector<std::uint32_t>{7});
    EXPECT_EQ(method->points_W[0], Vector3d(0.01, 0.02, 0.03));
    EXPECT_EQ(method->losses, 0);
  }
  EXPECT_TRUE(intake.in_contact());
  EXPECT_EQ(record(intake).contact_epoch, 7U);
  EXPECT_EQ(record(intake).samples_taken, 1U);
}

TEST_F(Intake, TellsOfContactOnceForEachEpochAndOfItsLossOnce) {
  SampleIntake intake = make();
  for (const std::uint32_t epoch : {2U, 2U, 3U, 3U}) {  // a cut or a slip: a new epoch in contact
    take(intake, sample(true, epoch));
  }
  EXPECT_EQ(rendered_.epochs, (std::vector<std::uint32_t>{2, 3}));
  take(intake, sample(false, 4));
  take(intake, sample(false, 4));
  EXPECT_EQ(rendered_.losses, 1);
  EXPECT_FALSE(intake.in_contact());
  EXPECT_EQ(rendered_.taken.size(), 4U) << "samples in the air carry no force of the object";
  take(intake, sample(true, 4));
  EXPECT_EQ(rendered_.epochs, (std::vector<std::uint32_t>{2, 3, 4}));
}

TEST_F(Intake, TellsTheMethodsWhenTheFirstSampleIsOutOfContact) {
  SampleIntake intake = make();
  take(intake, sample(false, 1));
  EXPECT_EQ(rendered_.losses, 1);
  EXPECT_TRUE(intake.has_sample());
}

// The link removes late and duplicated samples. One that gets through all the same must not make a
// contact anew, and a method must go on with the newest force.
TEST_F(Intake, ADuplicatedOrLateSampleOfTheSameContactChangesNothing) {
  const auto hold = make_force_method("hold", MethodOptions{});
  SampleIntake intake(ports_, {hold.get(), &rendered_}, {.max_force_N = kMaxForce_N});
  const ArrivedSample early = sample(true, 1, Vector3d(0.0, 0.0, 0.50));
  now_ += milliseconds(30);
  const ArrivedSample late = sample(true, 1, Vector3d(0.0, 0.0, 0.55));
  take(intake, early);
  take(intake, late);
  const double before_N = hold->force(servo_time_s(now_), Vector3d::Zero()).force_W.z();
  EXPECT_EQ(before_N, 0.55);
  take(intake, late);   // twice
  take(intake, early);  // after a newer one
  EXPECT_EQ(hold->force(servo_time_s(now_), Vector3d::Zero()).force_W.z(), before_N);
  EXPECT_EQ(rendered_.epochs.size(), 1U);
  EXPECT_TRUE(intake.in_contact());
  EXPECT_EQ(record(intake).contact_epoch, 1U);
}

TEST_F(Intake, TakesSeveralSamplesInTheOrderOfTheirArrival) {
  SampleIntake intake = make();
  ASSERT_TRUE(ports_.samples.push(sample(true, 1, Vector3d(0.1, 0.0, 0.0))));
  ASSERT_TRUE(ports_.samples.push(sample(false, 2)));
  ASSERT_TRUE(ports_.samples.push(sample(true, 3, Vector3d(0.2, 0.0, 0.0))));
  cycle(intake);
  EXPECT_EQ(rendered_.epochs, (std::vector<std::uint32_t>{1, 3}));
  EXPECT_EQ(rendered_.losses, 1);
  ASSERT_EQ(rendered_.taken.size(), 2U);
  EXPECT_EQ(rendered_.taken[1].force_W.x(), 0.2);
  EXPECT_EQ(record(intake).samples_taken, 3U);
}

TEST_F(Intake, TakesAFullRingInOneCycle) {
  SampleIntake intake = make();
  int pushed = 0;
  while (ports_.samples.push(sample(true, 1))) {
    ++pushed;
  }
  cycle(intake);
  EXPECT_EQ(record(intake).samples_taken, static_cast<std::uint64_t>(pushed));
}

TEST_F(Intake, AgesFromTheArrivalOfTheNewestBelievedSample) {
  SampleIntake intake = make();
  ArrivedSample arrived = sample(true, 1, Vector3d(0.0, 0.0, 0.5));
  arrived.sample.time_s -= 0.040;  // the tool was there 40 ms before the sample arrived
  take(intake, arrived);
  now_ += milliseconds(10);
  EXPECT_NEAR(intake.sample_age_s(now_), 0.012, 1e-9);
  EXPECT_NEAR(record(intake).sample_age_ms, 52.0, 1e-6);
}

TEST_F(Intake, AnImplausibleForceReachesNoMethodAndDoesNotMakeTheSamplesYounger) {
  SampleIntake intake = make();
  for (int i = 0; i < 5; ++i) {
    take(intake, sample(true, 1, Vector3d(0.0, 0.0, 0.5)));
  }
  now_ += milliseconds(30);
  const double age_s = intake.sample_age_s(now_ + kCycle);
  take(intake, sample(true, 1, Vector3d(0.0, 0.0, 7.0)));  // without the tool having moved
  EXPECT_EQ(intake.sample_age_s(now_), age_s);
  EXPECT_EQ(rendered_.taken.size(), 5U);
  take(intake, sample(true, 1, Vector3d(0.0, 0.0, 0.5)));
  EXPECT_EQ(rendered_.taken.size(), 6U);
  EXPECT_EQ(intake.samples_refused(), 1U);
}

TEST_F(Intake, ANewEpochMayJumpInForce) {
  SampleIntake intake = make();
  for (int i = 0; i < 5; ++i) {
    take(intake, sample(true, 1, Vector3d(0.0, 0.0, 0.5)));
  }
  take(intake, sample(true, 2, Vector3d(0.0, 0.0, 7.0)));
  ASSERT_EQ(rendered_.taken.size(), 6U);
  EXPECT_EQ(rendered_.taken.back().force_W.z(), 7.0);
}

TEST_F(Intake, MeasuresThePeriodOfSamples) {
  SampleIntake intake = make();
  for (int i = 0; i < 100; ++i) {
    now_ += milliseconds(18);
    take(intake, sample(false, 1));  // one cycle of 2 ms later
  }
  EXPECT_NEAR(intake.sample_period_s(), 0.020, 1e-5);
  now_ += std::chrono::hours(1);
  take(intake, sample(false, 1));
  EXPECT_LT(intake.sample_period_s(), 0.13) << "one pause counts as at most a second";
}

TEST_F(Intake, AContactPointAwayFromAToolInTheAirIsAnExpectedContact) {
  SampleIntake intake = make();
  ArrivedSample air = sample(false, 4);
  air.sample.position_W = air.sample.contact_point_W = Vector3d(0.0, 0.0, 0.1);
  take(intake, air);
  EXPECT_FALSE(intake.expected_contact_W()) << "no contact in sight";
  air.sample.contact_point_W = Vector3d(0.01, 0.02, -0.03);
  take(intake, air);
  ASSERT_TRUE(intake.expected_contact_W());
  EXPECT_EQ(*intake.expected_contact_W(), Vector3d(0.01, 0.02, -0.03));
  ArrivedSample contact = sample(true, 5);
  contact.sample.contact_point_W = Vector3d(0.01, 0.02, -0.03);
  take(intake, contact);
  EXPECT_FALSE(intake.expected_contact_W()) << "it has happened";
}

TEST_F(Intake, AnAnswerGoesToTheRenderedMethodAloneAndOnlyWithinItsContact) {
  SampleIntake intake = make(100.0);
  take(intake, answer(true, 1));
  EXPECT_TRUE(rendered_.taken.empty()) << "no contact is known";
  EXPECT_FALSE(intake.in_contact()) << "an answer is no sign of contact";
  EXPECT_FALSE(intake.has_sample());
  take(intake, sample(true, 1));
  take(intake, answer(true, 1));
  take(intake, answer(true, 2));   // of another contact
  take(intake, answer(false, 1));  // of a position out of contact
  EXPECT_EQ(rendered_.taken.size(), 2U);
  EXPECT_TRUE(rendered_.taken.back().from_query);
  EXPECT_EQ(evaluated_.taken.size(), 1U);
  EXPECT_EQ(intake.answers_taken(), 1U);
  take(intake, sample(false, 3));
  take(intake, answer(true, 1));  // the contact is over
  EXPECT_EQ(intake.answers_taken(), 1U);
}

TEST_F(Intake, AnswersDoNotRejuvenateTheSamplesNorCountAsSuch) {
  SampleIntake intake = make(100.0);
  take(intake, sample(true, 1));
  now_ += milliseconds(50);
  const double age_s = intake.sample_age_s(now_ + kCycle);
  take(intake, answer(true, 1));
  EXPECT_EQ(intake.sample_age_s(now_), age_s);
  EXPECT_EQ(record(intake).samples_taken, 1U);
}

TEST_F(Intake, AnswersFromBeforeTheContactGoToAMethodThatCanUseThem) {
  for (const bool can : {false, true}) {
    rendered_ = Listener{};
    rendered_.queries_before_contact = can;
    SampleIntake intake = make(100.0);
    take(intake, sample(false, 4));
    take(intake, answer(true, 3));  // of a contact that is over
    EXPECT_EQ(intake.answers_taken(), 0U);
    take(intake, answer(true, 4));  // of the contact to come
    EXPECT_EQ(intake.answers_taken(), can ? 1U : 0U);
    take(intake, sample(true, 5));
    take(intake, answer(true, 4));  // it comes only after the touch
    EXPECT_EQ(intake.answers_taken(), can ? 2U : 0U);
    EXPECT_EQ(rendered_.taken.back().before_contact, can);
    take(intake, answer(true, 5));
    EXPECT_EQ(intake.answers_taken(), can ? 3U : 1U);
    EXPECT_FALSE(rendered_.taken.back().before_contact);
  }
}

TEST_F(Intake, SendsQueriesInContactAtTheirRate) {
  SampleIntake intake = make(120.0);
  EXPECT_TRUE(queries(intake, 50).empty()) << "before any contact";
  take(intake, sample(true, 1));
  const std::vector<link::Query> sent = queries(intake, 500);  // 1 s
  EXPECT_NEAR(static_cast<double>(sent.size()), 120.0, 1.0);
  for (std::size_t i = 0; i < sent.size(); ++i) {
    EXPECT_EQ(sent[i].query_id, i + 1);
    EXPECT_EQ(rt::to_vector(sent[i].position_W_m), Vector3d(0.011, 0.0, 0.0));
  }
  EXPECT_EQ(sent.back().servo_time_ns % 2'000'000, 0) << "the start of a cycle";
  EXPECT_EQ(intake.queries_sent(), sent.size());
  EXPECT_EQ(evaluated_.asked, 0);
}

TEST_F(Intake, SendsNoQueryWithoutARateOrWithoutAWish) {
  SampleIntake silent = make(0.0);
  take(silent, sample(true, 1));
  EXPECT_TRUE(queries(silent, 50).empty());
  EXPECT_EQ(rendered_.asked, 0);
  rendered_.wants = false;
  SampleIntake content = make(100.0);
  take(content, sample(true, 1));
  EXPECT_TRUE(queries(content, 50).empty());
  EXPECT_GT(rendered_.asked, 0);
}

TEST_F(Intake, DoesNotMakeUpForQueriesThatAPauseHasPrevented) {
  SampleIntake intake = make(100.0);
  take(intake, sample(true, 1));
  queries(intake, 10);
  now_ += std::chrono::seconds(1);
  EXPECT_LE(queries(intake, 5).size(), 2U);  // 10 ms
}

TEST_F(Intake, CountsOnlyQueriesThatTheRingTook) {
  SampleIntake intake = make(500.0);
  take(intake, sample(true, 1));
  for (int i = 0; i < 200; ++i) {  // nobody takes them out
    now_ += kCycle;
    intake.query_if_due(now_, Vector3d::Zero());
  }
  std::uint64_t waiting = 0;
  for (link::Query query; ports_.queries.pop(query);) {
    ++waiting;
  }
  EXPECT_LT(waiting, 200U);
  EXPECT_EQ(intake.queries_sent(), waiting);
}

TEST_F(Intake, QueriesBeforeAnExpectedContactOnlyForAMethodThatCanUseThem) {
  for (const bool can : {false, true}) {
    rendered_ = Listener{};
    rendered_.queries_before_contact = can;
    SampleIntake intake = make(100.0);
    ArrivedSample air = sample(false, 4);
    take(intake, air);
    EXPECT_TRUE(queries(intake, 50).empty()) << "no contact in sight";
    air.sample.contact_point_W = Vector3d(0.0, 0.0, -0.01);
    take(intake, air);
    const auto sent = static_cast<double>(queries(intake, 50).size());  // in 0.1 s
    EXPECT_NEAR(sent, can ? 10.0 : 0.0, can ? 1.0 : 0.0);
  }
}

TEST_F(Intake, GivesTheNewestSurfaceAndTheSamplesToTheFirstTouch) {
  SampleIntake intake = make();
  const auto surface = near_surface(square_patch(now_.time_since_epoch().count(), 0.001, 500.0));
  ASSERT_TRUE(surface);
  ports_.surface.publish(*surface);
  take(intake, sample(false, 0));
  EXPECT_EQ(first_touch_.counts().patches, 1U);
  take(intake, sample(true, 1));
  EXPECT_EQ(first_touch_.counts().unseen, 1U) << "a contact of the simulator's alone";
}

TEST_F(Intake, ARestartWaitsForANewSampleAndKeepsTheCounts) {
  SampleIntake intake = make(100.0);
  take(intake, sample(true, 1, Vector3d(0.0, 0.0, 0.5)));
  take(intake, answer(true, 1));
  intake.restart();
  EXPECT_FALSE(intake.has_sample());
  EXPECT_EQ(intake.sample_age_s(now_), std::numeric_limits<double>::infinity());
  EXPECT_EQ(intake.answers_taken(), 1U);
  EXPECT_EQ(record(intake).samples_taken, 1U);
  // The hand has moved on: the first force cannot be compared with those before.
  take(intake, sample(true, 1, Vector3d(0.0, 0.0, 7.0)));
  EXPECT_TRUE(intake.has_sample());
  EXPECT_EQ(rendered_.taken.back().force_W.z(), 7.0);
}

}  // namespace
}  // namespace forcegrid::servo
