// SPDX-License-Identifier: Apache-2.0
// The rendered method asks the simulator for forces at positions of its own choice.

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "servo_loop/servo_loop.h"
#include "tests/servo_loop/scripted_device.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr rt::Duration kPeriod = std::chrono::milliseconds(2);

// Wants to know the force 1 mm further along x, always.
class CuriousMethod final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "curious"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample& sample) noexcept override {
    (sample.from_query ? answers : samples) += 1;
    newest = sample;
  }
  void contact_made(std::uint32_t, const Vector3d&) noexcept override { ++contacts; }
  void contact_lost() noexcept override { ++losses; }
  MethodNeeds needs() const noexcept override {
    MethodNeeds needs;
    needs.requests_before_contact = asks_before_contact;
    return needs;
  }
  void expect_contact(double, const Vector3d& point_W) noexcept override {
    ++expectations;
    expected_W = point_W;
  }
  int work(int) noexcept override { return 0; }
  bool plan_request(double, const Vector3d& position_W, Vector3d& wanted_W) noexcept override {
    ++asked;
    wanted_W = position_W + Vector3d(0.001, 0.0, 0.0);
    return true;
  }
  ForceEstimate force(double, const Vector3d&) const noexcept override { return {}; }

  int samples = 0;
  int answers = 0;
  int contacts = 0;
  int losses = 0;
  int asked = 0;
  int expectations = 0;
  bool asks_before_contact = false;
  Vector3d expected_W = Vector3d::Zero();
  Sample newest;
};

class Requests : public ::testing::Test {
 protected:
  static ServoOptions options(double requests_per_s) {
    ServoOptions options;
    options.requests_per_s = requests_per_s;
    options.check_motors = false;  // a scripted device does not move by what it is told
    options.watch_encoders = false;
    return options;
  }

  void arrive(bool in_contact, std::uint32_t epoch, bool from_query) {
    ArrivedSample arrived;
    arrived.sample.contact_epoch = epoch;
    arrived.sample.time_s = rt::seconds(now_.time_since_epoch());
    arrived.sample.from_query = from_query;
    arrived.in_contact = in_contact;
    arrived.arrived = now_;
    ASSERT_TRUE(ports_.samples.push(arrived));
  }

  // Runs cycles and returns the queries that they sent.
  std::vector<link::Query> run_cycles(ServoLoop& loop, int count) {
    std::vector<link::Query> queries;
    for (int i = 0; i < count; ++i) {
      now_ += kPeriod;
      device_.show(position_D_, now_ - std::chrono::milliseconds(1));
      EXPECT_EQ(loop.run_cycle(now_, now_ + kPeriod), Fault::kNone);
      for (link::Query query; ports_.queries.pop(query);) {
        EXPECT_EQ(query.servo_time_ns, now_.time_since_epoch().count());
        queries.push_back(query);
      }
      for (CycleRecord record; ports_.records.pop(record);) {
      }
    }
    return queries;
  }

  profiles::DeviceProfile profile_ = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device_{profile_};
  CuriousMethod rendered_;
  CuriousMethod evaluated_;
  ServoPorts ports_;
  const Vector3d position_D_ = Vector3d(0.01, -0.02, 0.03);
  rt::TimePoint now_ = rt::TimePoint(std::chrono::seconds(1000));
};

TEST_F(Requests, AreMadeAtTheirRateByTheRenderedMethodInContact) {
  ServoLoop loop(device_, profile_, {&rendered_, &evaluated_}, ports_, options(120.0));
  EXPECT_TRUE(run_cycles(loop, 100).empty()) << "before any contact";
  arrive(true, 1, false);
  const std::vector<link::Query> queries = run_cycles(loop, 500);
  EXPECT_NEAR(static_cast<double>(queries.size()), 120.0, 2.0);  // in 1 s
  EXPECT_EQ(evaluated_.asked, 0);
  for (std::size_t i = 0; i < queries.size(); ++i) {
    EXPECT_EQ(queries[i].query_id, i + 1);
    EXPECT_NEAR(queries[i].position_W_m[0], position_D_.x() + 0.001, 2e-4);  // encoder counts
    EXPECT_NEAR(queries[i].position_W_m[1], position_D_.y(), 2e-4);
  }
  arrive(false, 2, false);
  EXPECT_TRUE(run_cycles(loop, 100).empty()) << "after the contact";
}

TEST_F(Requests, AreNotMadeUnlessAskedFor) {
  ServoLoop loop(device_, profile_, {&rendered_}, ports_, options(0.0));
  arrive(true, 1, false);
  EXPECT_TRUE(run_cycles(loop, 200).empty());
  EXPECT_EQ(rendered_.asked, 0);
}

TEST_F(Requests, AreNotMadeUpForAfterAPause) {
  ServoLoop loop(device_, profile_, {&rendered_}, ports_, options(100.0));
  arrive(true, 1, false);
  run_cycles(loop, 10);
  now_ += std::chrono::milliseconds(40);
  EXPECT_LE(run_cycles(loop, 5).size(), 2u);  // 10 ms
}

TEST_F(Requests, AreAnsweredToTheRenderedMethodAloneAndSayNothingOfContact) {
  ServoLoop loop(device_, profile_, {&rendered_, &evaluated_}, ports_, options(100.0));
  arrive(true, 1, true);  // before any contact is known
  run_cycles(loop, 1);
  EXPECT_EQ(rendered_.answers, 0);
  EXPECT_EQ(rendered_.contacts, 0);
  arrive(true, 1, false);
  arrive(true, 1, true);
  arrive(true, 2, true);   // of another contact
  arrive(false, 1, true);  // of none
  run_cycles(loop, 1);
  EXPECT_EQ(rendered_.contacts, 1);
  EXPECT_EQ(rendered_.losses, 0);
  EXPECT_EQ(rendered_.samples, 1);
  EXPECT_EQ(rendered_.answers, 1);
  EXPECT_EQ(evaluated_.samples, 1);
  EXPECT_EQ(evaluated_.answers, 0);
}

// The simulator says where the tool will touch by the contact point of samples in the air.
TEST_F(Requests, AreMadeBeforeContactByAMethodThatCanUseTheAnswers) {
  const Vector3d expected_W(0.01, 0.02, -0.03);
  for (const bool asks : {false, true}) {
    rendered_ = CuriousMethod{};
    rendered_.asks_before_contact = asks;
    ServoLoop loop(device_, profile_, {&rendered_, &evaluated_}, ports_, options(100.0));
    ArrivedSample air;
    air.sample.contact_epoch = 4;
    air.sample.position_W = air.sample.contact_point_W = Vector3d(0.0, 0.0, 0.1);
    air.arrived = now_;
    ASSERT_TRUE(ports_.samples.push(air));
    EXPECT_TRUE(run_cycles(loop, 50).empty()) << "no contact in sight";
    EXPECT_EQ(rendered_.expectations, 0);
    air.sample.contact_point_W = expected_W;
    ASSERT_TRUE(ports_.samples.push(air));
    const std::size_t queries = run_cycles(loop, 50).size();  // 0.1 s
    EXPECT_EQ(rendered_.expectations, 50);
    EXPECT_EQ(rendered_.expected_W, expected_W);
    EXPECT_EQ(queries, asks ? 10u : 0u);

    arrive(true, 3, true);  // of a contact that is over
    arrive(true, 4, true);  // of the one that is expected
    run_cycles(loop, 1);
    EXPECT_EQ(rendered_.answers, asks ? 1 : 0);
    EXPECT_EQ(rendered_.newest.before_contact, asks);
    arrive(true, 5, false);
    arrive(true, 4, true);  // too late, but of use
    run_cycles(loop, 1);
    EXPECT_EQ(rendered_.contacts, 1);
    EXPECT_EQ(rendered_.answers, asks ? 2 : 0);
    EXPECT_EQ(rendered_.newest.before_contact, asks);
    arrive(true, 5, true);
    run_cycles(loop, 1);
    EXPECT_EQ(rendered_.answers, asks ? 3 : 1);
    EXPECT_FALSE(rendered_.newest.before_contact);
    EXPECT_EQ(rendered_.expectations, 51) << "nothing is expected in contact";
  }
}

// What the link carries reaches the method: when, where, how good.
TEST_F(Requests, AndSamplesCarryTimeContactPointResidualAndConvergence) {
  ServoLoop loop(device_, profile_, {&rendered_}, ports_, options(0.0));
  ArrivedSample arrived;
  arrived.in_contact = true;
  arrived.arrived = now_;
  arrived.sample.time_s = 999.5;
  arrived.sample.contact_epoch = 1;
  arrived.sample.contact_point_W = Vector3d(0.01, 0.02, 0.03);
  arrived.sample.relative_residual = 0.25;
  arrived.sample.converged = false;
  ASSERT_TRUE(ports_.samples.push(arrived));
  run_cycles(loop, 1);
  EXPECT_EQ(rendered_.newest.time_s, 999.5);
  EXPECT_EQ(rendered_.newest.contact_point_W, Vector3d(0.01, 0.02, 0.03));
  EXPECT_EQ(rendered_.newest.relative_residual, 0.25);
  EXPECT_FALSE(rendered_.newest.converged);
}

TEST_F(Requests, AreAtMostOneACycle) {
  for (const double per_s : {-1.0, 501.0, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW(ServoLoop(device_, profile_, {&rendered_}, ports_, options(per_s)),
                 std::invalid_argument);
  }
}

}  // namespace
}  // namespace forcegrid::servo
