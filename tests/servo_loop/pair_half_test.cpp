// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/pair_half.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "tests/servo_loop/two_halves.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

// Smooth, over some 8 mm and 1 to 2 Hz, another way for each tool.
Vector3d moves(double time_s, double phase) {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  return 0.008 * Vector3d(std::sin(kTurn * 1.3 * time_s + phase) - std::sin(phase),
                          std::sin(kTurn * 0.9 * time_s), -std::sin(kTurn * 1.7 * time_s));
}
Vector3d left_moves(double time_s) { return moves(time_s, 0.0); }
Vector3d right_moves(double time_s) { return moves(0.8 * time_s, 1.0); }
Vector3d keeps_still(double time_s) {
  return std::min(time_s, 0.5) * Vector3d(0.002, 0.004, -0.01);
}

// Beyond the pair method's own error: the other tool's place is half a cycle old, at 0.1 m/s 0.1
// mm, which is 13 mN of the spring between the tools, 0.5 % of the force. Moved on it has to be
// less.
constexpr double kOfKnowingLess_percent = 0.25;

// Says what the test says, and keeps the samples that it gets.
class SpokenPair final : public PairForceMethod {
 public:
  const char* name() const noexcept override { return "spoken-6d"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const PairSample& sample) noexcept override { samples.push_back(sample); }
  void contacts_made(std::uint32_t, const PairVector& points_W) noexcept override {
    holds = true;
    ++contacts;
    points = points_W;
  }
  void contacts_lost() noexcept override { holds = false; }
  int work(int) noexcept override { return 0; }
  PairEstimate forces(double, const PairVector& positions_W) const noexcept override {
    asked_W = positions_W;
    return {.forces_W = says_N, .status = status};
  }

  std::vector<PairSample> samples;
  bool holds = false;
  int contacts = 0;
  PairVector points = PairVector::Zero();
  PairVector says_N = PairVector::Constant(3.0);
  EstimateStatus status = EstimateStatus::kOk;
  mutable PairVector asked_W = PairVector::Zero();
};

class SpokenAlone final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "spoken"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample&) noexcept override { ++samples; }
  void contact_made(std::uint32_t, const Vector3d&) noexcept override {}
  void contact_lost() noexcept override {}
  int work(int) noexcept override { return 0; }
  ForceEstimate force(double, const Vector3d&) const noexcept override {
    return {
        .force_W = Vector3d::Constant(1.0), .status = EstimateStatus::kOk, .uncertainty_N = 0.25};
  }
  int samples = 0;
};

struct Spoken {
  explicit Spoken(std::array<TwoHalves::Path, 2> paths = {left_moves, right_moves})
      : two([this] { return made(pairs); }, [this] { return made(alone); }, std::move(paths)) {}

  template <typename Method>
  static std::unique_ptr<Method> made(std::vector<Method*>& all) {
    auto one = std::make_unique<Method>();
    all.push_back(one.get());
    return one;
  }

  std::vector<SpokenPair*> pairs;
  std::vector<SpokenAlone*> alone;
  TwoHalves two;
};

TEST(PairHalf, FollowsTheOtherHandBetweenTheSamples) {
  for (const bool first_rests : {true, false}) {
    const TwoHalves::Path first = first_rests ? keeps_still : left_moves;
    TwoHalves two("kriging-6d", "kriging", {first, right_moves});
    two.run_until(4.0);
    // The uncoupled method, on the same paths: no sample tells of its solution.
    TwoHalves uncoupled("kriging-6d", "kriging", {first, right_moves});
    uncoupled.tells_solution = false;
    uncoupled.run_until(4.0);
    for (std::size_t tool = 0; tool < 2; ++tool) {
      EXPECT_LT(two.error_percent(tool, 1.0),
                two.error_percent(tool, 1.0, true) + kOfKnowingLess_percent)
          << tool;
      if (tool == 0 || !first_rests) {  // while the other one moves
        EXPECT_LT(two.error_percent(tool, 1.0), 0.2 * uncoupled.error_percent(tool, 1.0)) << tool;
      }
      EXPECT_GT(two.counted(tool, "samples_paired"), 110U) << tool;
      EXPECT_LE(two.counted(tool, "samples_unpaired"), 1U) << tool;
      EXPECT_GT(two.counted(tool, "cycles_both_tools"), 1700U) << tool;
      EXPECT_EQ(two.cycles[tool].back().estimate.candidate, PairHalf::kBoth);
      EXPECT_EQ(two.cycles[tool].back().estimate.reason, ChoiceReason::kBothTools);
      EXPECT_EQ(uncoupled.counted(tool, "samples_paired"), 0U);
      EXPECT_GT(uncoupled.counted(tool, "samples_unpaired"), 100U);
      EXPECT_EQ(uncoupled.counted(tool, "cycles_both_tools"), 0U);
      EXPECT_GT(uncoupled.counted(tool, "cycles_learning"), 1700U);
    }
  }
}

TEST(PairHalf, RendersEveryMethodOverBothTools) {
  for (const std::string& name : pair_method_names()) {
    TwoHalves two(name, "auto", {left_moves, right_moves});
    two.run_until(2.0);
    EXPECT_EQ(two.halves[0]->name(), name);
    EXPECT_STREQ(two.halves[0]->candidates()[PairHalf::kBoth], name.c_str());
    EXPECT_STREQ(two.halves[0]->candidates()[PairHalf::kAlone], "auto");
    EXPECT_GT(two.counted(0, "cycles_both_tools"), 700U) << name;
    EXPECT_NE(two.counted(1, "samples_passed_over"), ~0ULL) << "the method's own counter";
  }
}

TEST(PairHalf, PairsTheTwoAnswersOfASolutionAndNoOthers) {
  Spoken spoken;
  // A third of one tool's answers and a quarter of the other one's are lost.
  spoken.two.lost = [](std::size_t tool, std::uint64_t tick) { return tick % (3 + tool) == 1; };
  spoken.two.run_until(10.0);
  stability::SpringPair object(TwoHalves::kStiffness_N_per_m);
  PairVector points;
  points << TwoHalves::point_W(0), TwoHalves::point_W(1);
  for (std::size_t tool = 0; tool < 2; ++tool) {
    const auto& samples = spoken.pairs[tool]->samples;
    // Of 298 that had time to arrive, those that neither has lost: 2/3 x 3/4.
    EXPECT_NEAR(static_cast<double>(samples.size()), 149.0, 2.0);
    EXPECT_EQ(spoken.two.counted(tool, "samples_paired"), samples.size());
    for (const PairSample& sample : samples) {
      EXPECT_LT((sample.forces_W - object.forces_N(sample.positions_W - points)).norm(), 1e-12);
    }
    EXPECT_LT((spoken.pairs[tool]->points - points).norm(), 1e-12);
    EXPECT_EQ(spoken.pairs[tool]->contacts, 1);
    EXPECT_GT(spoken.alone[tool]->samples, 195) << "the method alone gets all of its own";
  }
  TwoHalves lossy("kriging-6d", "kriging", {left_moves, right_moves});
  lossy.lost = spoken.two.lost;
  lossy.run_until(4.0);
  EXPECT_LT(lossy.error_percent(0, 1.0),
            lossy.error_percent(0, 1.0, true) + kOfKnowingLess_percent);
}

TEST(PairHalf, PairsTheStiffnessOfOneSolutionOnly) {
  Spoken spoken;
  spoken.two.tells_stiffness = true;
  // Of five answers each: one tool's has none of its own, the other one's no influence, one was
  // solved for the other tool elsewhere; two are whole.
  spoken.two.change_answer = [](std::size_t tool, std::uint64_t tick, Sample& sample) {
    sample.has_stiffness = !(tick % 5 == 0 && tool == 0);
    sample.has_influence = !(tick % 5 == 1 && tool == 1);
    if (tick % 5 == 2 && tool == 0) {
      sample.other_position_W.x() += 1e-6;
    }
  };
  spoken.two.run_until(4.0);
  stability::SpringPair object(TwoHalves::kStiffness_N_per_m);
  PairVector points;
  points << TwoHalves::point_W(0), TwoHalves::point_W(1);
  for (std::size_t tool = 0; tool < 2; ++tool) {
    const auto& samples = spoken.pairs[tool]->samples;
    ASSERT_GT(samples.size(), 110U);
    std::size_t with = 0;
    for (const PairSample& sample : samples) {
      with += sample.has_stiffness ? 1 : 0;
      if (!sample.has_stiffness) {
        continue;
      }
      constexpr double kStep_m = 1e-4;
      for (Eigen::Index c = 0; c < 6; ++c) {
        const PairVector step = kStep_m * PairVector::Unit(c);
        const PairVector at_m = sample.positions_W - points;
        const PairVector slope =
            (object.forces_N(at_m + step) - object.forces_N(at_m - step)) / (2.0 * kStep_m);
        // Central differences of a cubic law over 0.1 mm.
        EXPECT_LT((sample.stiffness_W.col(c) - slope).norm(), 0.05) << tool << ' ' << c;
      }
    }
    EXPECT_EQ(spoken.two.counted(tool, "samples_with_stiffness"), with);
    EXPECT_NEAR(static_cast<double>(with), 0.4 * static_cast<double>(samples.size()), 2.0);
  }
}

TEST(PairHalf, TakesTheOthersNewestPlaceAndMovesItOn) {
  Spoken spoken({[](double) { return Vector3d::Zero(); },
                 [](double time_s) { return Vector3d(0.0, 0.1 * time_s, 0.0); }});
  spoken.two.run_until(1.0);
  const double now_s = spoken.two.cycles[0].back().time_s - TwoHalves::kStart_s;
  const Vector3d other_W = spoken.pairs[0]->asked_W.tail<3>();
  // Half a cycle old, at 0.1 m/s: 0.1 mm behind without its velocity.
  EXPECT_LT((other_W - spoken.two.position_W(1, now_s)).norm(), 1e-6);
}

// Of a steady acceleration a velocity that does not lag leaves 1/2 a h^2 after half a cycle h; the
// mean velocity of the last cycle would leave three times as much.
TEST(PairHalf, MovesItOnByAVelocityThatDoesNotLag) {
  constexpr double kAcceleration_m_per_s2 = 2.0;
  Spoken spoken({[](double) { return Vector3d::Zero(); },
                 [](double time_s) {
                   return Vector3d(0.0, 0.5 * kAcceleration_m_per_s2 * time_s * time_s, 0.0);
                 }});
  spoken.two.run_until(0.5);
  const double now_s = spoken.two.cycles[0].back().time_s - TwoHalves::kStart_s;
  const Vector3d behind_W = spoken.two.position_W(1, now_s) - spoken.pairs[0]->asked_W.tail<3>();
  const double half_cycle_s = 0.5 * TwoHalves::kPeriod_s;
  EXPECT_NEAR(behind_W.y(), 0.5 * kAcceleration_m_per_s2 * half_cycle_s * half_cycle_s, 1e-9);
}

TEST(PairHalf, VelocityAtTheEndOfUnequalCyclesIsExactForASteadyAcceleration) {
  const auto place_W = [](double t) { return Vector3d(0.3 * t - 2.0 * t * t, 0.1, 5.0 * t * t); };
  const Vector3d before = (place_W(0.003) - place_W(0.001)) / 0.002;
  const Vector3d last = (place_W(0.0035) - place_W(0.003)) / 0.0005;
  const Vector3d exact(0.3 - 4.0 * 0.0035, 0.0, 10.0 * 0.0035);
  EXPECT_LT((end_velocity(last, 0.0005, before, 0.002) - exact).norm(), 1e-12);
}

TEST(PairHalf, IsTheMethodAloneWhileTheOtherToolIsOffTheObject) {
  TwoHalves two("kriging-6d", "kriging", {left_moves, right_moves});
  two.holds = {true, false};
  TwoHalves same("kriging-6d", "kriging", {left_moves, right_moves});
  same.holds = {true, false};
  same.runs = {true, false};  // nobody tells it of the other tool
  two.run_until(1.5);
  same.run_until(1.5);
  ASSERT_EQ(two.cycles[0].size(), same.cycles[0].size());
  for (std::size_t i = 0; i < two.cycles[0].size(); ++i) {
    EXPECT_EQ(two.cycles[0][i].estimate.force_W, same.cycles[0][i].estimate.force_W) << i;
    EXPECT_EQ(two.cycles[0][i].estimate.candidate, PairHalf::kAlone);
    EXPECT_EQ(two.cycles[0][i].estimate.reason, ChoiceReason::kOneTool);
  }
  EXPECT_LT(two.error_percent(0, 1.0), 2.0) << "it does render its own tool";
  EXPECT_GT(two.counted(0, "cycles_other_off"), 700U);
  EXPECT_EQ(two.counted(0, "cycles_both_tools"), 0U);
  EXPECT_EQ(two.cycles[1].back().estimate.force_W, Vector3d::Zero());
}

// A loop that has ended or failed: its place grows old, and its tool holds on for the simulator.
TEST(PairHalf, LetsGoOfAnotherLoopThatIsLateWithoutAStep) {
  Spoken spoken;
  spoken.two.run_until(1.0);
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.force_W, Vector3d::Constant(3.0));
  EXPECT_TRUE(std::isnan(spoken.two.cycles[0].back().estimate.uncertainty_N));
  spoken.two.runs[1] = false;
  spoken.two.run_until(1.0 + PairHalf::kOld_s - TwoHalves::kPeriod_s);
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.force_W, Vector3d::Constant(3.0));
  spoken.two.run_until(1.0 + PairHalf::kOld_s + PairHalf::kFade_s + 2.0 * TwoHalves::kPeriod_s);
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.force_W, Vector3d::Constant(1.0));
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.uncertainty_N, 0.25);
  // The old place is moved on for kMostAhead_s at most.
  const double last_s = spoken.two.cycles[1].back().time_s - TwoHalves::kStart_s;
  EXPECT_LT((spoken.pairs[0]->asked_W.tail<3>() - spoken.two.position_W(1, last_s)).norm(),
            0.2 * PairHalf::kMostAhead_s);
  EXPECT_LE(spoken.two.largest_step_N(0, 0.5),
            1.001 * 2.0 * std::sqrt(3.0) * TwoHalves::kPeriod_s / PairHalf::kFade_s);
  EXPECT_EQ(spoken.two.counted(0, "returns_to_one_tool"), 1U);
  spoken.two.run_until(2.0);
  EXPECT_GT(spoken.two.counted(0, "cycles_other_late"), 400U);
  spoken.two.runs[1] = true;
  spoken.two.run_until(2.5);
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.force_W, Vector3d::Constant(3.0));
}

// Whatever happens, the force moves between the two methods' without a step, unless this tool
// comes off the object.
TEST(PairHalf, NeverStepsWhateverTheOtherToolDoes) {
  const unsigned seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  Spoken spoken;
  spoken.two.run_until(0.5);
  for (int event = 0; event < 100; ++event) {
    switch (random() % 4) {
      case 0:
        spoken.two.holds[1] = !spoken.two.holds[1];
        break;
      case 1:
        spoken.two.runs[1] = !spoken.two.runs[1];
        break;
      case 2:
        spoken.pairs[0]->status =
            random() % 2 == 0 ? EstimateStatus::kUnknown : EstimateStatus::kNotFinite;
        break;
      default:
        spoken.pairs[0]->status = EstimateStatus::kOk;
        break;
    }
    spoken.two.run_until(0.5 + 0.01 * static_cast<double>(event * 10 + random() % 10));
  }
  spoken.two.runs[1] = spoken.two.holds[1] = true;
  spoken.pairs[0]->status = EstimateStatus::kOk;
  spoken.two.run_until(12.0);
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.force_W, Vector3d::Constant(3.0));
  EXPECT_LE(spoken.two.largest_step_N(0, 0.2),
            1.001 * 2.0 * std::sqrt(3.0) * TwoHalves::kPeriod_s / PairHalf::kFade_s);
  const std::uint64_t all =
      spoken.two.counted(0, "cycles_both_tools") + spoken.two.counted(0, "cycles_other_off") +
      spoken.two.counted(0, "cycles_other_late") + spoken.two.counted(0, "cycles_learning");
  EXPECT_NEAR(static_cast<double>(all), 12.0 / TwoHalves::kPeriod_s, 40.0) << "each cycle once";
}

TEST(PairHalf, LearnsAnewWhenTheOtherToolTouchesAgain) {
  Spoken spoken;
  spoken.two.run_until(1.0);
  EXPECT_EQ(spoken.pairs[0]->contacts, 1);
  spoken.two.holds[1] = false;
  spoken.two.run_until(1.2);
  EXPECT_FALSE(spoken.pairs[0]->holds);
  EXPECT_FALSE(spoken.pairs[1]->holds);
  const std::size_t before = spoken.pairs[0]->samples.size();
  spoken.two.run_until(1.5);
  EXPECT_EQ(spoken.pairs[0]->samples.size(), before);
  spoken.two.holds[1] = true;
  spoken.two.run_until(2.0);
  EXPECT_TRUE(spoken.pairs[0]->holds);
  EXPECT_GE(spoken.pairs[0]->contacts, 2);
  EXPECT_GT(spoken.pairs[0]->samples.size(), before + 8);
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.force_W, Vector3d::Constant(3.0));
  // This tool comes off: zero of the object, from one of the methods' answers at once.
  spoken.two.holds[0] = false;
  spoken.two.run_until(2.2);
  EXPECT_EQ(spoken.two.cycles[0].back().estimate.force_W, Vector3d::Constant(1.0))
      << "what the method alone says";
  EXPECT_FALSE(spoken.pairs[0]->holds);
}

TEST(PairHalf, TellsNoPositionThatIsNone) {
  Spoken spoken;
  spoken.two.run_until(0.5);
  PairPlace place;
  while (spoken.two.exchange.fetch(1, place)) {
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  spoken.two.halves[0]->observe(200.0, {0.0, nan, 0.0});
  EXPECT_FALSE(spoken.two.exchange.fetch(1, place));
  EXPECT_EQ(spoken.two.halves[0]->force(200.0, {0.0, 0.0, 0.0}).status, EstimateStatus::kOk);
}

TEST(PairHalf, CountsSamplesThatTheOtherLoopDoesNotFetch) {
  Spoken spoken;
  spoken.two.halves[0]->contact_made(1, Vector3d::Zero());
  for (int i = 0; i < PairExchange::kSamples + 5; ++i) {
    Sample sample;
    sample.time_s = i;
    sample.contact_epoch = 1;
    spoken.two.halves[0]->take_sample(sample);
  }
  EXPECT_EQ(spoken.two.counted(0, "samples_untold"), 5U);
}

}  // namespace
}  // namespace forcegrid::servo
