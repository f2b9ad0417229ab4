// SPDX-License-Identifier: Apache-2.0
// A simulator for several tools, over the link.
#include "simulator/shared_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rt/vectors.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/shared_object.h"
#include "tests/simulator/running_simulator.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;
using namespace std::chrono_literals;

SimulatorOptions two_tools() {
  SimulatorOptions options;
  options.tools = 2;
  options.rate_Hz = 100.0;
  return options;
}

// A servo in the test's hands that keeps its tool at one place.
class Servo {
 public:
  Servo(RunningSimulator& simulator, link::ToolId tool, link::Content newest = link::Content::kPose)
      : endpoint(simulator.address(), link::ServoEndpoint::random_session_id(), {}, tool, newest) {}

  void say(const Vector3d& position_W) {
    at_W = position_W;
    link::ToolState state;
    state.sequence = ++sequence;
    state.servo_time_ns = 1000 + sequence;
    state.position_W_m = rt::to_array(position_W);
    endpoint.send(state);
  }
  // The newest sample that has come.
  void listen() {
    while (const auto sample = endpoint.receive()) {
      (sample->query_id != 0 ? reply : newest) = sample;
    }
    if (const auto told = endpoint.next_others()) {
      others = told;
    }
  }

  link::ServoEndpoint endpoint;
  std::uint32_t sequence = 0;
  Vector3d at_W = Vector3d::Zero();
  std::optional<link::ForceSample> newest;
  std::optional<link::ForceSample> reply;  ///< to a query
  std::optional<link::OtherTools> others;
};

// Keeps all servos talking until `done`. @returns whether it came in time.
template <typename Done>
bool until(std::initializer_list<Servo*> servos, Done done) {
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (std::chrono::steady_clock::now() < give_up) {
    for (Servo* const servo : servos) {
      servo->say(servo->at_W);
    }
    std::this_thread::sleep_for(2ms);
    for (Servo* const servo : servos) {
      servo->listen();
    }
    if (done()) {
      return true;
    }
  }
  return false;
}

bool is_at(const Servo& servo) {
  return servo.newest && servo.newest->position_W_m == rt::to_array(servo.at_W);
}

constexpr double kApart_m = 0.02;
const Vector3d kLeft_W{-kApart_m, 0, 0};
const Vector3d kRight_W{kApart_m, 0, 0};
const Vector3d kUp_W{0, 0, 0.01};

class TwoServos : public testing::Test {
 protected:
  explicit TwoServos(const SimulatorOptions& options = two_tools(),
                     link::Content newest = link::Content::kPose)
      : simulator_(options), left_(simulator_, 1, newest), right_(simulator_, 2, newest) {}

  void bring_both_down() {
    for (const double z_m : {0.01, -0.0001}) {
      left_.at_W = kLeft_W + Vector3d(0, 0, z_m);
      right_.at_W = kRight_W + Vector3d(0, 0, z_m);
      ASSERT_TRUE(until({&left_, &right_}, [&] { return is_at(left_) && is_at(right_); }));
    }
    ASSERT_TRUE(left_.newest->in_contact && right_.newest->in_contact);
  }

  RunningSimulator simulator_;
  Servo left_;
  Servo right_;
};

class TwoServosThatAskForSensitivities : public TwoServos {
 protected:
  TwoServosThatAskForSensitivities() : TwoServos(two_tools(), link::Content::kSensitivities) {}
};

TEST_F(TwoServos, HoldOneObjectAndFeelEachOther) {
  EXPECT_THAT(simulator_.line(), HasSubstr(" tools 2\n"));
  bring_both_down();
  left_.at_W = kLeft_W + Vector3d(-0.001, 0.0, 0.002);
  right_.at_W = kRight_W + Vector3d(0.001, 0.001, 0.006);
  const auto settled = [&] {
    return is_at(left_) && is_at(right_) && left_.newest->converged && right_.newest->converged;
  };
  ASSERT_TRUE(until({&left_, &right_}, settled));
  // Both are there, so from the next tick on no sample is of an older place of the other one.
  const std::uint32_t sequence = left_.sequence;
  ASSERT_TRUE(until({&left_, &right_}, [&] {
    return settled() && left_.newest->echo_sequence > sequence &&
           right_.newest->echo_sequence > sequence;
  }));

  SharedObject<double> reference(make_scene("small").mesh, {}, 2);
  reference.grab(0, kLeft_W, 0.012);
  reference.grab(1, kRight_W, 0.012);
  reference.aim(0, left_.at_W - kLeft_W);
  reference.aim(1, right_.at_W - kRight_W);
  reference.solve();
  const std::array<const Servo*, 2> servos = {&left_, &right_};
  for (std::size_t k = 0; k < 2; ++k) {
    const Vector3d expected_W = reference.equilibrium(k).force_W;
    const Vector3d found_W = rt::to_vector(servos[k]->newest->force_W_N);
    ASSERT_GT(expected_W.norm(), 0.1);
    EXPECT_LT((found_W - expected_W).norm(), 3e-3 * expected_W.norm());
    EXPECT_TRUE(servos[k]->newest->has_stiffness);
  }
  const SimulatorSummary summary = simulator_.stop();
  EXPECT_EQ(summary.sessions, 2U);
  EXPECT_EQ(summary.contacts, 2U);
  EXPECT_EQ(summary.not_finite, 0U);
  ASSERT_EQ(summary.tools.size(), 2U);
  EXPECT_EQ(summary.tools[0].tool, 1U);
  EXPECT_EQ(summary.tools[1].tool, 2U);
  EXPECT_EQ(summary.tools[0].answers + summary.tools[1].answers, summary.answers);
  EXPECT_EQ(to_json(summary)["tools"][1]["contacts"], 1);
}

// dF_i/dP_j by central differences of the reference solution.
TEST_F(TwoServosThatAskForSensitivities, LearnHowTheOtherToolChangesTheirForce) {
  bring_both_down();
  left_.at_W = kLeft_W + Vector3d(-0.001, 0.0, 0.002);
  right_.at_W = kRight_W + Vector3d(0.001, 0.001, 0.006);
  const std::array<const Servo*, 2> servos = {&left_, &right_};
  const auto knows_where_the_other_is = [&](std::size_t k) {
    const auto& sample = servos[k]->newest;
    return is_at(*servos[k]) && sample->converged && sample->influence_count == 1 &&
           sample->influences[0].position_W_m == rt::to_array(servos[1 - k]->at_W);
  };
  ASSERT_TRUE(until({&left_, &right_},
                    [&] { return knows_where_the_other_is(0) && knows_where_the_other_is(1); }));
  SolverOptions tight;
  tight.relative_tolerance = 1e-8;
  tight.max_iterations = 4000;
  SharedObject<double> reference(make_scene("small").mesh, tight, 2);
  reference.grab(0, kLeft_W, 0.012);
  reference.grab(1, kRight_W, 0.012);
  const std::array<Vector3d, 2> at_W = {left_.at_W - kLeft_W, right_.at_W - kRight_W};
  constexpr double kStep_m = 2e-5;
  for (std::size_t k = 0; k < 2; ++k) {
    SCOPED_TRACE(testing::Message() << "tool " << k + 1);
    const link::ToolInfluence& other = servos[k]->newest->influences[0];
    EXPECT_EQ(other.tool, 2U - k);
    EXPECT_LE(other.echo_sequence, servos[1 - k]->sequence);
    EXPECT_GT(other.echo_sequence, 0U);
    Eigen::Matrix3d expected;
    for (int axis = 0; axis < 3; ++axis) {
      const auto force_W = [&](double step_m) {
        reference.aim(k, at_W[k]);
        reference.aim(1 - k, at_W[1 - k] + step_m * Vector3d::Unit(axis));
        reference.solve();
        return reference.equilibrium(k).force_W;
      };
      expected.col(axis) = (force_W(kStep_m) - force_W(-kStep_m)) / (2.0 * kStep_m);
    }
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> found(
        other.stiffness_W_N_per_m.data());
    EXPECT_GT(expected.norm(), 1.0);
    EXPECT_LT((found - expected).norm(), 0.01 * expected.norm()) << found << "\nby differences\n"
                                                                 << expected;
    const double relative = (found - expected).norm() / expected.norm();
    RecordProperty("relative_error_" + std::to_string(k + 1), std::to_string(relative));
  }
}

TEST_F(TwoServos, AreNotToldHowTheOtherToolChangesTheirForceUnlessTheyAsk) {
  bring_both_down();
  EXPECT_EQ(left_.newest->influence_count, 0U);
}

TEST_F(TwoServos, GetTheForceWhereTheyAskForItWithTheOtherToolWhereItIs) {
  bring_both_down();
  right_.at_W = kRight_W + Vector3d(0.001, 0.001, 0.006);
  ASSERT_TRUE(until({&left_, &right_}, [&] { return is_at(left_) && is_at(right_); }));
  const std::uint32_t sequence = right_.sequence;
  ASSERT_TRUE(until({&left_, &right_}, [&] { return right_.newest->echo_sequence > sequence; }));
  const Vector3d asked_W = kLeft_W + Vector3d(0.002, 0.0, 0.004);
  left_.endpoint.send(link::Query{
      .query_id = 7, .servo_time_ns = 5'000'000, .position_W_m = rt::to_array(asked_W)});
  ASSERT_TRUE(until({&left_, &right_}, [&] { return left_.reply.has_value(); }));
  EXPECT_FALSE(right_.reply) << "the query is the left one's";
  const link::ForceSample reply = *left_.reply;
  EXPECT_EQ(reply.query_id, 7U);
  EXPECT_TRUE(reply.in_contact);
  EXPECT_EQ(reply.contact_epoch, left_.newest->contact_epoch);
  EXPECT_LT((rt::to_vector(reply.position_W_m) - asked_W).norm(), 1e-6);
  SharedObject<double> reference(make_scene("small").mesh, {}, 2);
  reference.grab(0, kLeft_W - Vector3d(0, 0, 0.0001), 0.012);
  reference.grab(1, kRight_W - Vector3d(0, 0, 0.0001), 0.012);
  reference.aim(0, asked_W - rt::to_vector(left_.newest->contact_point_W_m));
  reference.aim(1, right_.at_W - rt::to_vector(right_.newest->contact_point_W_m));
  reference.solve();
  const Vector3d expected_W = reference.equilibrium(0).force_W;
  ASSERT_GT(expected_W.norm(), 0.1);
  EXPECT_LT((rt::to_vector(reply.force_W_N) - expected_W).norm(), 3e-3 * expected_W.norm());
  // The next sample is of where the tool is, as before.
  const std::uint32_t later = left_.sequence;
  ASSERT_TRUE(until({&left_, &right_}, [&] { return left_.newest->echo_sequence > later; }));
  EXPECT_TRUE(is_at(left_));
  const SimulatorSummary summary = simulator_.stop();
  EXPECT_EQ(summary.replies, 1U);
  EXPECT_EQ(summary.queries_refused, 0U);
}

TEST_F(TwoServos, InTheAirTheyGetZeroWhereTheyAsk) {
  left_.at_W = kLeft_W + kUp_W;
  right_.at_W = kRight_W + kUp_W;
  ASSERT_TRUE(until({&left_, &right_}, [&] { return is_at(left_) && is_at(right_); }));
  left_.endpoint.send(link::Query{
      .query_id = 9, .servo_time_ns = 5'000'000, .position_W_m = rt::to_array(kLeft_W)});
  ASSERT_TRUE(until({&left_, &right_}, [&] { return left_.reply.has_value(); }));
  EXPECT_FALSE(left_.reply->in_contact);
  EXPECT_EQ(left_.reply->force_W_N, (link::Vector3{0.0, 0.0, 0.0}));
}

TEST_F(TwoServos, AreToldWhereTheOtherIs) {
  left_.at_W = kLeft_W + kUp_W;
  right_.at_W = kRight_W + kUp_W;
  ASSERT_TRUE(until({&left_, &right_}, [&] { return left_.others && right_.others; }));
  right_.at_W = kRight_W + 2.0 * kUp_W;
  ASSERT_TRUE(until({&left_, &right_}, [&] {
    return left_.others->tools[0].position_W_m == rt::to_array(right_.at_W);
  }));
  ASSERT_EQ(left_.others->count, 1U);
  EXPECT_EQ(left_.others->tools[0].tool, 2U);
  EXPECT_FALSE(left_.others->tools[0].in_contact);
  EXPECT_GE(left_.others->tools[0].age_ns, 0);
  EXPECT_EQ(right_.others->tools[0].tool, 1U);
}

class TwoServosFaultOfOne : public TwoServos {
 protected:
  TwoServosFaultOfOne() : TwoServos(fault_stops_one()) {}
  static SimulatorOptions fault_stops_one() {
    SimulatorOptions options = two_tools();
    options.fault_stops_all = false;
    return options;
  }
};

// The right servo says nothing more: its position's age grows, and then its tool is gone.
TEST_F(TwoServosFaultOfOne, AnAgeGrowsUntilASilentServosToolLetsGo) {
  bring_both_down();
  right_.at_W = kRight_W + Vector3d(0, 0, 0.005);
  ASSERT_TRUE(until({&left_, &right_}, [&] { return is_at(right_) && left_.others; }));
  const std::uint32_t epoch = left_.newest->contact_epoch;
  ASSERT_TRUE(until({&left_}, [&] { return left_.others->tools[0].age_ns > 1'000'000'000; }));
  EXPECT_TRUE(left_.others->tools[0].in_contact);
  ASSERT_TRUE(until({&left_}, [&] { return left_.newest->contact_epoch > epoch; }));
  EXPECT_TRUE(left_.newest->in_contact) << "it goes on alone";
  const SimulatorSummary summary = simulator_.stop();
  EXPECT_EQ(summary.faults, 1U);
  EXPECT_EQ(summary.not_finite, 0U);
}

TEST_F(TwoServos, OneEndsInMidForceAndTheOtherFeelsTheObjectAlone) {
  bring_both_down();
  left_.at_W = kLeft_W + Vector3d(-0.001, 0.0, 0.004);
  right_.at_W = kRight_W + Vector3d(0.001, 0.001, 0.006);
  ASSERT_TRUE(until({&left_, &right_}, [&] { return is_at(left_) && is_at(right_); }));
  const std::uint32_t epoch = left_.newest->contact_epoch;
  right_.endpoint.say_goodbye();
  ASSERT_TRUE(until({&left_}, [&] {
    return left_.newest->contact_epoch > epoch && left_.newest->converged && is_at(left_);
  }));
  ElasticObject<double> alone(make_scene("small").mesh);
  alone.grab(kLeft_W, 0.012);
  const Vector3d expected_W = alone.move_to(left_.at_W - kLeft_W).force_W;
  EXPECT_LT((rt::to_vector(left_.newest->force_W_N) - expected_W).norm(), 5e-3 * expected_W.norm());
  EXPECT_TRUE(left_.newest->in_contact);
}

TEST_F(TwoServosFaultOfOne, TheOtherGoesOnAlone) {
  bring_both_down();
  const std::uint32_t epoch = left_.newest->contact_epoch;
  right_.endpoint.say_goodbye(true);
  ASSERT_TRUE(until({&left_}, [&] { return left_.newest->contact_epoch > epoch; }));
  EXPECT_FALSE(left_.endpoint.refusal());
}

// By default, and also for silence; and the simulator serves again once all have gone.
TEST_F(TwoServos, AFaultOfOneStopsBothUntilAllHaveGone) {
  bring_both_down();
  right_.endpoint.say_goodbye(true);
  ASSERT_TRUE(until({&left_}, [&] { return left_.endpoint.refusal().has_value(); }));
  EXPECT_EQ(left_.endpoint.refusal()->reason, link::Refusal::Reason::kOtherFault);
  Servo third(simulator_, 3);
  third.at_W = kRight_W + kUp_W;
  ASSERT_TRUE(until({&left_, &third}, [&] { return third.endpoint.refusal().has_value(); }));
  EXPECT_FALSE(third.newest);
  left_.endpoint.say_goodbye();
  third.endpoint.say_goodbye();
  Servo next(simulator_, 1);
  next.at_W = kLeft_W + kUp_W;
  ASSERT_TRUE(until({&next}, [&] { return is_at(next); }));
  EXPECT_EQ(simulator_.stop().faults, 1U);
}

TEST_F(TwoServos, SoDoesASilenceOfOne) {
  bring_both_down();
  ASSERT_TRUE(until({&left_}, [&] { return left_.endpoint.refusal().has_value(); }));
  EXPECT_EQ(left_.endpoint.refusal()->reason, link::Refusal::Reason::kOtherFault);
}

TEST_F(TwoServos, AThirdIsRefusedAndAServoOfVersion1IsServedInAFreePlace) {
  left_.at_W = kLeft_W + kUp_W;
  ASSERT_TRUE(until({&left_}, [&] { return is_at(left_); }));
  Servo old(simulator_, 0);
  old.at_W = kRight_W + kUp_W;
  ASSERT_TRUE(until({&left_, &old}, [&] { return is_at(old) && left_.others; }));
  EXPECT_EQ(left_.others->tools[0].tool, 0U);
  EXPECT_EQ(old.endpoint.others_accepted(), 0U);
  ASSERT_TRUE(
      until({&left_, &old, &right_}, [&] { return right_.endpoint.refusal().has_value(); }));
  EXPECT_EQ(right_.endpoint.refusal()->most_tools, 2U);
  EXPECT_FALSE(right_.newest);
}

TEST_F(TwoServos, EachLinkIsDelayedAsAsked) {
  SimulatorOptions options = two_tools();
  options.link_conditions.delay_s = 0.02;
  RunningSimulator delayed(options);
  Servo first(delayed, 1);
  Servo second(delayed, 2);
  first.at_W = kLeft_W + kUp_W;
  second.at_W = kRight_W + kUp_W;
  ASSERT_TRUE(until({&first, &second}, [&] { return is_at(first) && is_at(second); }));
  const SimulatorSummary summary = delayed.stop();
  EXPECT_GT(summary.delayed, 0U);
}

TEST(SharedLoop, SaysWhichOptionKnowsOneToolOnly) {
  const auto refused = [](auto change) {
    SimulatorOptions options = two_tools();
    options.listen = "127.0.0.1:0";
    options.scene = "small";
    change(options);
    std::ostringstream out;
    const std::atomic<bool> stop{true};
    try {
      run_simulator(options, out, stop);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(refused([](auto& o) { o.solver_kind = SolverKind::kLocal; }),
              HasSubstr("solver local knows one tool; give --solver quasi_static"));
  EXPECT_THAT(refused([](auto& o) { o.workers = "127.0.0.1:0"; }), HasSubstr("--workers out"));
  EXPECT_THAT(refused([](auto& o) { o.control = "/nowhere"; }), HasSubstr("--control out"));
  EXPECT_THAT(refused([](auto& o) { o.material_tolerance_percent = 1.0; }),
              HasSubstr("--material-tolerance-percent out"));
  EXPECT_THAT(refused([](auto& o) { o.tools = 5; }), HasSubstr("at most 4"));
  EXPECT_THAT(refused([](auto& o) { o.tools = 0; }), HasSubstr("1 to 4"));
}

TEST(SharedLoop, RefusesAToolThatSlides) {
  SimulatorOptions options = two_tools();
  options.listen = "127.0.0.1:0";
  options.scene = "small";
  options.tool = ToolOptions{};
  options.tool->shape = "sphere";
  options.tool->contact = "slide";
  std::ostringstream out;
  const std::atomic<bool> stop{false};
  EXPECT_THAT([&] { run_simulator(options, out, stop); },
              testing::ThrowsMessage<Error>(HasSubstr("use --contact sticky")));
}

}  // namespace
}  // namespace forcegrid::simulator
