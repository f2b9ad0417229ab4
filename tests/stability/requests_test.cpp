// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "evaluation/motions/variation.h"
#include "forcegrid/methods.h"
#include "stability/chart_cases.h"
#include "stability/closed_loop.h"
#include "stability/scenes.h"
#include "stability/slow_simulator.h"
#include "tests/stability/linear_table.h"

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;

constexpr double kTolerance_N = 1e-9;  // of the splines' rounding
constexpr double kStiffness_N_per_m = 200.0;
constexpr double kSurface_m = 0.002;  // along z
constexpr std::int64_t kCycle_ns = 2'000'000;

// Asks 4 mm beyond the surface whenever it may, renders nothing, and writes down what it is told.
class Asker final : public ForceMethod {
 public:
  explicit Asker(bool before_contact) { needs_.requests_before_contact = before_contact; }

  const char* name() const noexcept override { return "asker"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  MethodNeeds needs() const noexcept override { return needs_; }
  void take_sample(const Sample& sample) noexcept override {
    if (sample.from_query) {
      answers.push_back({sample, now_s_});
    }
  }
  void contact_made(std::uint32_t /*epoch*/, const Vector3d& point_W) noexcept override {
    touched_W.push_back(point_W);
    expected_last_W.push_back(expected_W_);
    in_contact_ = true;
  }
  void contact_lost() noexcept override { in_contact_ = false; }
  int work(int /*budget*/) noexcept override { return 0; }
  ForceEstimate force(double /*time_s*/, const Vector3d& /*position_W*/) const noexcept override {
    return {};
  }
  void observe(double time_s, const Vector3d& /*position_W*/) noexcept override { now_s_ = time_s; }
  void expect_contact(double /*time_s*/, const Vector3d& point_W) noexcept override {
    expected_W_ = point_W;
  }
  bool plan_request(double /*time_s*/, const Vector3d& position_W,
                    Vector3d& wanted_W) noexcept override {
    in_the_air += in_contact_ ? 0 : 1;
    ++asked;
    wanted_W = (in_contact_ ? position_W : expected_W_) + 0.004 * Vector3d::UnitZ();
    return true;
  }

  struct Answered {
    Sample sample;
    double cycle_s;  // before the one that it arrived in
  };
  std::vector<Answered> answers;
  std::vector<Vector3d> touched_W;
  std::vector<Vector3d> expected_last_W;  // when each contact was made
  int asked = 0;
  int in_the_air = 0;

 private:
  MethodNeeds needs_;
  bool in_contact_ = false;
  double now_s_ = 0.0;
  Vector3d expected_W_ = Vector3d::Zero();
};

LoopSetup setup_with(double requests_per_s, double delay_s = 0.0) {
  LoopSetup setup;
  setup.timing = device_timing("w2_full_speed");
  setup.hand = hand_of("light");
  setup.network.requests_per_s = requests_per_s;
  setup.network.delay_s = delay_s;
  return setup;
}

class Requests : public ::testing::Test {
 protected:
  std::unique_ptr<VirtualObject> touching(const LoopSetup& setup) const {
    return make_touching({table_, kStiffness_N_per_m, setup.contact_point_W});
  }
  LoopResult run(const LoopSetup& setup, const std::string& method) const {
    MethodOptions options;
    options.grid.max_W = {0.16, 0.12, 0.12};
    options.grid.cells.setConstant(49);
    const auto made = make_force_method(method, options);
    const auto object = touching(setup);
    return run_closed_loop(setup, *object, made.get());
  }
  // [N/m] of a touch there; the table is isotropic, so turning it changes nothing.
  double stiffness_at(const Vector3d& point_W) const {
    return kStiffness_N_per_m * evaluation::VariedObject(table_, 1).stiffness_factor(point_W);
  }
  evaluation::ForceTable table_ = linear_table(50.0);
};

TEST_F(Requests, TheSimulatorAnswersForATouchThatIsStillToCome) {
  const LoopSetup setup = setup_with(120.0, 0.1);
  const auto object = touching(setup);
  SlowSimulator simulator(setup.network, SimulatorFault::kNone, 1);
  const Vector3d above_W = setup.contact_point_W;
  const Vector3d wanted_W = above_W + Vector3d(0.001, 0.0, kSurface_m + 0.004);
  object->advance(0.0, above_W);
  EXPECT_FALSE(simulator.ask(0, wanted_W, *object)) << "it has not seen the tool yet";
  // 2 mm at 10 mm/s along z, and 5 mm/s along x.
  simulator.publish(0, above_W, Vector3d(0.005, 0.0, 0.010), *object);
  ASSERT_TRUE(simulator.ask(kCycle_ns, wanted_W, *object));
  const std::int64_t due_ns = kCycle_ns + std::llround(1e9 / 120.0) + 100'000'000;
  EXPECT_FALSE(simulator.receive(due_ns - 1));
  const auto answer = simulator.receive(due_ns);
  ASSERT_TRUE(answer);
  EXPECT_TRUE(answer->sample.from_query);
  EXPECT_TRUE(answer->sample.before_contact);
  const Vector3d touch_W = above_W + Vector3d(0.001, 0.0, kSurface_m);
  EXPECT_NEAR((answer->sample.contact_point_W - touch_W).norm(), 0.0, 1e-12);
  const Vector3d expected_N = -stiffness_at(touch_W) * (wanted_W - touch_W);
  EXPECT_NEAR((answer->sample.force_W - expected_N).norm(), 0.0, kTolerance_N);
}

TEST_F(Requests, NobodyIsAnsweredWhoGoesAwayIsFarOrMayNotAsk) {
  for (const auto& [requests_per_s, speed_m_per_s] :
       {std::pair(120.0, -0.010), std::pair(120.0, 0.006), std::pair(0.0, 0.010)}) {
    const LoopSetup setup = setup_with(requests_per_s);
    const auto object = touching(setup);
    object->advance(0.0, setup.contact_point_W);
    SlowSimulator simulator(setup.network, SimulatorFault::kNone, 1);
    simulator.publish(0, setup.contact_point_W, speed_m_per_s * Vector3d::UnitZ(), *object);
    EXPECT_FALSE(simulator.ask(kCycle_ns, setup.contact_point_W, *object))
        << requests_per_s << ' ' << speed_m_per_s;
  }
}

TEST_F(Requests, InContactThereIsOneInEachPeriodAndNoneIsAnsweredEarlier) {
  const double rate_per_s = 60.0;
  LoopSetup setup = setup_with(rate_per_s);
  LinearObject object(kStiffness_N_per_m, setup.contact_point_W);
  Asker asker(false);
  const LoopResult result = run_closed_loop(setup, object, &asker);
  // Of 10 s and the instants k / 60 s in them, the first two are before the first sample (33 ms).
  EXPECT_EQ(result.requests_made, 598U);
  // The last is asked in the cycle at 9.984 s; its answer comes after the last cycle, at 9.998 s.
  EXPECT_EQ(result.answers_taken, 597U);
  EXPECT_EQ(result.answers_before, 0U);
  EXPECT_EQ(result.samples_taken, 299U) << "as many as without requests";
  ASSERT_EQ(asker.answers.size(), 597U);
  for (const Asker::Answered& each : asker.answers) {
    const double took_s = each.cycle_s + 0.002 - each.sample.time_s;
    EXPECT_GE(took_s, 1.0 / rate_per_s - 1e-9);
    EXPECT_LE(took_s, 1.0 / rate_per_s + 0.002 + 1e-9);
    const Vector3d expected_N =
        -kStiffness_N_per_m * (each.sample.position_W - setup.contact_point_W);
    EXPECT_NEAR((each.sample.force_W - expected_N).norm(), 0.0, kTolerance_N);
  }
}

TEST_F(Requests, BeforeContactGoToAMethodThatAsksForThem) {
  for (const bool before_contact : {false, true}) {
    const LoopSetup setup = setup_with(120.0);
    Asker asker(before_contact);
    const auto object = touching(setup);
    const LoopResult result = run_closed_loop(setup, *object, &asker);
    // Nothing pushes, so the hand has its way: z = 2 mm is crossed upwards in each of the periods
    // of 0.97 Hz within the 6 s.
    EXPECT_EQ(result.touches, 6U);
    ASSERT_EQ(asker.touched_W.size(), 6U);
    EXPECT_EQ(asker.in_the_air > 0, before_contact);
    EXPECT_EQ(result.answers_before > 0, before_contact);
    if (!before_contact) {
      continue;
    }
    // At most as many as fit into the 0.3 s before each touch, and into the way back.
    EXPECT_LE(result.answers_before, 6U * 36U);
    EXPECT_GE(result.answers_before, 6U * 8U) << "at least 67 ms before each touch";
    for (std::size_t i = 0; i < asker.touched_W.size(); ++i) {
      // The prediction may stay behind by 2 mm, and by what a hand turns within 0.1 s.
      EXPECT_LT((asker.touched_W[i] - asker.expected_last_W[i]).norm(), 0.004) << i;
    }
    for (const Asker::Answered& each : asker.answers) {
      if (each.sample.before_contact) {
        const Vector3d displacement_m = each.sample.position_W - each.sample.contact_point_W;
        const Vector3d expected_N = -stiffness_at(each.sample.contact_point_W) * displacement_m;
        EXPECT_NEAR((each.sample.force_W - expected_N).norm(), 0.0, kTolerance_N);
      }
    }
  }
}

TEST_F(Requests, TakeAwayTheErrorOfATouchThatTheServoSees) {
  for (const char* const hand : {"light", "firm"}) {
    LoopSetup setup = setup_with(0.0);
    setup.hand = hand_of(hand);
    setup.sees_contacts = true;
    const LoopResult without = run(setup, kDefaultMethod);
    for (const double rate_per_s : {60.0, 120.0}) {
      setup.network.requests_per_s = rate_per_s;
      const LoopResult with = run(setup, kDefaultMethod);
      EXPECT_LT(with.first_67ms_error_percent, 0.2 * without.first_67ms_error_percent)
          << hand << ' ' << rate_per_s;
      EXPECT_LT(with.force_error_percent, 1.0) << hand << ' ' << rate_per_s;
    }
  }
}

TEST_F(Requests, LeaveTheSamplesAlongThePathAsTheyAre) {
  LoopSetup setup = setup_with(0.0);
  setup.network.loss = 0.2;
  setup.network.jitter_s = 0.02;
  const LoopResult without = run(setup, "hold");
  setup.network.requests_per_s = 120.0;
  const LoopResult with = run(setup, "hold");  // it makes none
  EXPECT_EQ(with.requests_made, 0U);
  EXPECT_EQ(with.force_error_percent, without.force_error_percent);
  EXPECT_EQ(with.samples_lost, without.samples_lost);
}

}  // namespace
}  // namespace forcegrid::stability
