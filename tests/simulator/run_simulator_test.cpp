// SPDX-License-Identifier: Apache-2.0
#include "simulator/run_simulator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "link/servo_endpoint.h"
#include "rt/local_datagrams.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/touch/dynamic_contact.h"
#include "tests/simulator/running_simulator.h"

namespace forcegrid::simulator {
namespace {

using ::testing::HasSubstr;
using namespace std::chrono_literals;

TEST(RunSimulator, SaysWhereItListensAndWhatTheObjectIs) {
  RunningSimulator simulator;
  EXPECT_THAT(simulator.line(),
              ::testing::MatchesRegex("listening 127\\.0\\.0\\.1:[0-9]+ scene small vertices 1089 "
                                      "springs 8268\n"));
  const SimulatorSummary summary = simulator.stop();
  EXPECT_EQ(summary.vertices, 1089U);
  EXPECT_EQ(summary.answers, 0U);
}

TEST(RunSimulator, AnswersAToolThatTouchesAndPulls) {
  RunningSimulator simulator;
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  const auto above = answer_at(servo, sequence, {0.001, 0.002, 0.02});
  ASSERT_TRUE(above);
  EXPECT_FALSE(above->in_contact);
  EXPECT_EQ(above->contact_epoch, 0U);
  EXPECT_EQ(above->force_W_N, (link::Vector3{}));
  EXPECT_EQ(above->contact_point_W_m, above->position_W_m);
  EXPECT_TRUE(above->converged);

  const auto touch = answer_at(servo, sequence, {0.001, 0.002, -0.0001});
  ASSERT_TRUE(touch);
  EXPECT_TRUE(touch->in_contact);
  EXPECT_EQ(touch->contact_epoch, 1U);
  const link::Vector3 where_it_came_in{0.001, 0.002, 0.0};
  EXPECT_EQ(touch->contact_point_W_m, where_it_came_in);

  const auto pull = answer_at(servo, sequence, {0.001, 0.002, 0.0099});
  ASSERT_TRUE(pull);
  EXPECT_EQ(pull->contact_point_W_m, where_it_came_in);
  EXPECT_EQ(pull->contact_epoch, 1U);
  EXPECT_TRUE(pull->converged);
  EXPECT_LE(pull->relative_residual, 1e-3);
  EXPECT_GT(pull->solve_time_s, 0.0);
  EXPECT_TRUE(pull->has_stiffness);
  EXPECT_LE(pull->echo_sequence, sequence);
  EXPECT_EQ(pull->echo_servo_time_ns, 1000 + static_cast<std::int64_t>(pull->echo_sequence));

  ElasticObject<double> reference(make_scene("small").mesh);
  reference.grab({0.001, 0.002, 0.0}, 0.012);
  reference.set_relative_tolerance(1e-8);
  const Equilibrium expected = reference.move_to({0, 0, 0.0099});
  ASSERT_TRUE(expected.converged);
  ASSERT_LT(expected.force_W.z(), -0.5);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    EXPECT_NEAR(pull->force_W_N[i], expected.force_W[row], 2e-3 * expected.force_W.norm());
    EXPECT_NEAR(pull->stiffness_W_N_per_m[3 * i + i], expected.stiffness_W(row, row),
                0.02 * expected.stiffness_W.norm());
  }

  const SimulatorSummary summary = simulator.stop();
  EXPECT_GE(summary.ticks, 3U);
  EXPECT_GE(summary.answers, 3U);
  EXPECT_LE(summary.answers, summary.ticks);
  EXPECT_EQ(summary.sessions, 1U);
  EXPECT_EQ(summary.contacts, 1U);
  EXPECT_EQ(summary.unconverged, 0U);
  EXPECT_GT(summary.worst_relative_residual, 0.0);
  EXPECT_LE(summary.worst_relative_residual, 1e-3);
  const nlohmann::json json = to_json(summary);
  EXPECT_EQ(json.at("scene"), "small");
  EXPECT_GE(json.at("solve_ms").at("max").get<double>(),
            json.at("solve_ms").at("p50").get<double>());
}

// Asks a simulator at two rates `answers` times at one place.
SimulatorSummary pull_at_two_rates(int answers, const Eigen::Vector3d& expected_W) {
  SimulatorOptions options;
  options.solver_kind = SolverKind::kTwoRates;
  options.rate_Hz = 500.0;
  RunningSimulator simulator(options);
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  EXPECT_TRUE(answer_at(servo, sequence, {0.001, 0.002, 0.02}));
  EXPECT_TRUE(answer_at(servo, sequence, {0.001, 0.002, -0.0001}));
  double error = 1.0;
  for (int k = 0; k < answers; ++k) {
    const auto pull = answer_at(servo, sequence, {0.001, 0.002, 0.0049});
    if (!pull) {
      ADD_FAILURE() << "no answer " << k;
      break;
    }
    error = (Eigen::Vector3d(pull->force_W_N.data()) - expected_W).norm() / expected_W.norm();
  }
  EXPECT_LE(error, 2e-3);
  return simulator.stop();
}

TEST(RunSimulator, AtTwoRatesTheAnswerBecomesThatOfTheWholeObject) {
  ElasticObject<double> reference(make_scene("small").mesh, {.relative_tolerance = 1e-8});
  reference.grab({0.001, 0.002, 0.0}, 0.012);
  const Eigen::Vector3d expected_W = reference.move_to({0.0, 0.0, 0.0049}).force_W;
  // The region holds all of this small object and is right at once. When the whole object's
  // solution comes is the scheduler's affair: its thread has the lowest priority, and on a busy
  // machine a run of 0.2 s may end before its turn.
  SimulatorSummary summary;
  for (int answers = 100; answers <= 6400 && summary.whole_solutions == 0; answers *= 2) {
    summary = pull_at_two_rates(answers, expected_W);
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_EQ(summary.solver, "two_rates");
  EXPECT_GT(to_json(summary).at("whole_solutions").get<int>(), 0);
}

TEST(RunSimulator, ReducedLearnsWhileItAnswersAndCountsWhoDid) {
  SimulatorOptions options;
  options.solver_kind = SolverKind::kReduced;
  options.rate_Hz = 500.0;
  RunningSimulator simulator(options);
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  ASSERT_TRUE(answer_at(servo, sequence, {0.001, 0.002, 0.02}));
  ElasticObject<double> reference(make_scene("small").mesh);
  reference.grab({0.001, 0.002, 0.0}, 0.012);
  for (int k = 0; k < 40; ++k) {
    const double up_m = 0.0005 * k;
    const double aside_m = 0.004 * std::sin(0.4 * k);
    const auto sample = answer_at(servo, sequence, {0.001 + aside_m, 0.002, up_m - 0.0001});
    ASSERT_TRUE(sample);
    EXPECT_TRUE(sample->in_contact && sample->converged);
    const Eigen::Vector3d expected_W = reference.move_to({aside_m, 0.0, up_m - 0.0001}).force_W;
    const Eigen::Vector3d force_W(sample->force_W_N.data());
    EXPECT_LT((force_W - expected_W).norm(), 0.02 * std::max(1.0, expected_W.norm()));
  }
  const SimulatorSummary summary = simulator.stop();
  EXPECT_EQ(summary.solver, "reduced");
  EXPECT_GT(summary.reduced.full_answers, 8U) << "nothing could be learnt from";
  const nlohmann::json json = to_json(summary)["reduced"];
  EXPECT_EQ(json["answers"], summary.reduced.answers);
  EXPECT_EQ(json["full_answers"], summary.reduced.full_answers);
}

TEST(RunSimulator, ANewSessionFindsTheObjectAtRest) {
  RunningSimulator simulator;
  {
    link::ServoEndpoint servo(simulator.address());
    std::uint32_t sequence = 0;
    ASSERT_TRUE(answer_at(servo, sequence, {0, 0, 0.01}));
    ASSERT_TRUE(answer_at(servo, sequence, {0, 0, -0.0001}));
    const auto pull = answer_at(servo, sequence, {0, 0, 0.01});
    ASSERT_TRUE(pull);
    EXPECT_LT(pull->force_W_N[2], -0.1);
  }
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  const auto above = answer_at(servo, sequence, {0, 0, 0.01});
  ASSERT_TRUE(above);
  EXPECT_FALSE(above->in_contact);
  EXPECT_EQ(above->contact_epoch, 0U);
  EXPECT_EQ(above->force_W_N[2], 0.0);
  const auto touch = answer_at(servo, sequence, {0, 0, -0.0002});
  ASSERT_TRUE(touch);
  EXPECT_EQ(touch->contact_epoch, 1U);
  EXPECT_EQ(simulator.stop().sessions, 2U);
}

TEST(RunSimulator, AnswersQueriesBesideTheSamples) {
  RunningSimulator simulator;
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  ASSERT_TRUE(answer_at(servo, sequence, {0, 0, 0.01}));
  ASSERT_TRUE(answer_at(servo, sequence, {0, 0, -0.0001}));
  ASSERT_TRUE(answer_at(servo, sequence, {0, 0, 0.005}));
  link::Query query;
  query.query_id = 1;
  query.servo_time_ns = 77;
  query.position_W_m = {0, 0, 0.0099};
  servo.send(query);
  std::optional<link::ForceSample> reply;
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (!reply && std::chrono::steady_clock::now() < give_up) {
    servo.wait(5ms);
    while (const auto sample = servo.receive()) {
      if (sample->query_id == 1) {
        reply = sample;
      }
    }
  }
  ASSERT_TRUE(reply);
  EXPECT_TRUE(reply->in_contact);
  EXPECT_TRUE(reply->converged);
  EXPECT_EQ(reply->echo_servo_time_ns, 77);
  const auto there = answer_at(servo, sequence, {0, 0, 0.0099});
  ASSERT_TRUE(there);
  EXPECT_NEAR(reply->force_W_N[2], there->force_W_N[2], 2e-3 * std::abs(there->force_W_N[2]));
  EXPECT_EQ(simulator.stop().replies, 1U);
}

TEST(RunSimulator, SaysWhereAnApproachingToolWillTouchAndAnswersQueriesForThatContact) {
  RunningSimulator simulator;
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  const auto resting = answer_at(servo, sequence, {0, 0, 0.01});
  ASSERT_TRUE(resting);
  EXPECT_EQ(resting->contact_point_W_m, resting->position_W_m) << "a tool that does not move";

  // 50 mm/s down and 20 mm/s to the side, from 5 mm above the surface: touches in 0.1 s.
  const link::Vector3 expected_W{0.002, 0.001, 0.0};
  link::Query query;
  query.query_id = 1;
  query.servo_time_ns = 77;
  query.position_W_m = {0.002, 0.001, 0.006};
  std::optional<link::ForceSample> sample;
  std::optional<link::ForceSample> reply;
  std::optional<link::SurfacePatch> patch;  // with the stiffness there
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (!(reply && patch) && std::chrono::steady_clock::now() < give_up) {
    link::ToolState state;
    state.sequence = ++sequence;
    state.servo_time_ns = 1000 + sequence;
    state.position_W_m = {0.0, 0.001, 0.005};
    state.velocity_W_m_per_s = {0.020, 0.0, -0.050};
    servo.send(state);
    servo.wait(2ms);
    while (const auto each = servo.receive()) {
      if (each->query_id == 1) {
        reply = each;
      } else if (!sample && each->contact_point_W_m != each->position_W_m) {
        sample = each;
        servo.send(query);
      }
    }
    if (const auto newest = servo.next_patch(); newest && newest->has_stiffness) {
      patch = newest;
    }
  }
  ASSERT_TRUE(patch);
  EXPECT_GT(patch->triangle_count, 0);
  EXPECT_EQ(patch->contact_epoch, 0U);
  EXPECT_EQ(patch->tool_radius_m, 0.0F) << "a point";
  ASSERT_TRUE(sample);
  EXPECT_FALSE(sample->in_contact);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(sample->contact_point_W_m[axis], expected_W[axis], 1e-12);
  }
  ASSERT_TRUE(reply);
  EXPECT_TRUE(reply->in_contact);
  EXPECT_TRUE(reply->converged);
  EXPECT_EQ(reply->contact_epoch, sample->contact_epoch) << "nothing has touched";
  EXPECT_EQ(reply->contact_point_W_m, sample->contact_point_W_m);

  // The force is what a tool that really touches there feels.
  ASSERT_TRUE(answer_at(servo, sequence, {0.002, 0.001, 0.0001}));
  const auto touched = answer_at(servo, sequence, {0.002, 0.001, 0.0});
  ASSERT_TRUE(touched);
  ASSERT_TRUE(touched->in_contact);
  const std::array<std::size_t, 6> entries{0, 4, 8, 1, 2, 5};  // xx, yy, zz, xy, xz, yz
  for (std::size_t i = 0; i < entries.size(); ++i) {
    EXPECT_NEAR(static_cast<double>(patch->stiffness_W_N_per_m[i]),
                touched->stiffness_W_N_per_m[entries[i]],
                0.03 * std::abs(touched->stiffness_W_N_per_m[8]));
  }
  const double below_m = touched->contact_point_W_m[2];  // of a step above the surface
  const auto there = answer_at(servo, sequence, {0.002, 0.001, 0.006 + below_m});
  ASSERT_TRUE(there);
  EXPECT_LT(there->force_W_N[2], -0.1);
  EXPECT_NEAR(reply->force_W_N[2], there->force_W_N[2], 5e-3 * std::abs(there->force_W_N[2]));
}

TEST(RunSimulator, ASphereThatSlidesPressesLeavesAndAnswersNoQueries) {
  SimulatorOptions options;
  options.tool = ToolOptions{.shape = "sphere", .contact = "slide"};
  RunningSimulator simulator(options);
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  link::ToolState state;
  state.position_W_m = {0, 0, 0.005};
  state.velocity_W_m_per_s = {0, 0, -0.05};
  std::optional<link::SurfacePatch> patch;
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (!(patch && patch->has_press_forces) && std::chrono::steady_clock::now() < give_up) {
    state.servo_time_ns = state.sequence = ++sequence;
    servo.send(state);
    servo.wait(2ms);
    while (servo.receive()) {
    }
    const auto newest = servo.next_patch();
    patch = newest ? newest : patch;
  }
  const auto pressed = answer_at(servo, sequence, {0, 0, -0.002});
  ASSERT_TRUE(pressed);
  ASSERT_TRUE(patch && patch->has_press_forces);
  EXPECT_NEAR(static_cast<double>(patch->press_forces_W_N[1][2]), pressed->force_W_N[2],
              0.03 * pressed->force_W_N[2]);
  EXPECT_TRUE(pressed->in_contact);
  EXPECT_EQ(pressed->contact_epoch, 1U);
  EXPECT_NEAR(pressed->contact_point_W_m[2], 0.0, 1e-5) << "where it touched";
  EXPECT_GT(pressed->force_W_N[2], 0.01) << "pushed, not pulled";
  link::Query query;
  query.query_id = 1;
  query.servo_time_ns = 77;
  query.position_W_m = {0, 0, -0.003};
  servo.send(query);
  const auto away = answer_at(servo, sequence, {0, 0, 0.004});
  ASSERT_TRUE(away);
  EXPECT_FALSE(away->in_contact);
  EXPECT_EQ(away->contact_epoch, 2U);
  EXPECT_EQ(away->force_W_N, (link::Vector3{}));
  const SimulatorSummary summary = simulator.stop();
  EXPECT_EQ(summary.queries_refused, 1U);
  EXPECT_EQ(summary.replies, 0U);
  EXPECT_EQ(summary.contacts, 1U);
  const nlohmann::json json = to_json(summary);
  EXPECT_EQ(json.at("tool"), "sphere");
  EXPECT_EQ(json.at("contact"), "slide");
}

// A sinking tool that touches and then moves the jelly up and down; servo time is the test's own,
// so that nothing depends on how busy the machine is.
TEST(RunSimulator, AnObjectThatMovesByItselfFeelsEveryPositionOfTheServo) {
  constexpr int kStates = 17;  // between two answers
  const auto place_W = [](int state) {
    const double t_s = 2e-3 * state - 0.2;
    const double z_m = t_s < 0.0 ? -0.03 * t_s : 0.010 * std::sin(12.0 * t_s);
    return Eigen::Vector3d(0, 0, z_m);
  };
  const Scene scene = make_scene("jelly", Eigen::Vector3d::Zero());
  const auto all = make_dynamic_contact(scene, {}, {});
  const auto sparse = make_dynamic_contact(scene, {}, {});
  SimulatorOptions options;
  options.scene = "jelly";
  RunningSimulator simulator(options);
  link::ServoEndpoint servo(simulator.address());
  double error = 0.0;
  double error_sparse = 0.0;
  double sum = 0.0;
  link::ToolState state;
  for (int answer = 1; answer <= 24; ++answer) {
    for (int i = 0; i < kStates; ++i) {
      const Eigen::Vector3d position_W = place_W(static_cast<int>(state.sequence));
      state.servo_time_ns = 1'000'000'000 + 2'000'000LL * ++state.sequence;
      state.position_W_m = {position_W.x(), position_W.y(), position_W.z()};
      servo.send(state);
      all->was_at(1e-9 * static_cast<double>(state.servo_time_ns), position_W);
    }
    const Eigen::Vector3d end_W(state.position_W_m[0], state.position_W_m[1],
                                state.position_W_m[2]);
    Eigen::Vector3d force_W[2];
    for (const int i : {0, 1}) {
      ToolContact& contact = i == 0 ? *all : *sparse;
      contact.tell_time(1e-9 * static_cast<double>(state.servo_time_ns));
      force_W[i] = contact.step(end_W).equilibrium.force_W;
    }
    std::optional<link::ForceSample> sample;
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (!sample && std::chrono::steady_clock::now() < give_up) {
      servo.wait(2ms);
      while (const auto each = servo.receive()) {
        sample = each->echo_sequence == state.sequence ? each : sample;
      }
    }
    ASSERT_TRUE(sample);
    if (answer > 10) {
      const Eigen::Vector3d linked_W(sample->force_W_N[0], sample->force_W_N[1],
                                     sample->force_W_N[2]);
      error += (force_W[0] - linked_W).squaredNorm();
      error_sparse += (force_W[1] - linked_W).squaredNorm();
      sum += linked_W.squaredNorm();
    }
  }
  // A tick that falls between the positions of an answer ends the way there for a moment.
  EXPECT_LT(std::sqrt(error / sum), 0.01);
  EXPECT_GT(std::sqrt(error_sparse / sum), 0.03);
  EXPECT_EQ(simulator.stop().contacts, 1U);
}

TEST(RunSimulator, DelaysItsAnswersAsASlowerMachineWould) {
  SimulatorOptions options;
  options.link_conditions.delay_s = 0.3;
  options.send_stiffness = false;
  RunningSimulator simulator(options);
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  const auto start = std::chrono::steady_clock::now();
  const auto sample = answer_at(servo, sequence, {0, 0, 0.02});
  ASSERT_TRUE(sample);
  EXPECT_GE(std::chrono::steady_clock::now() - start, 300ms);
  EXPECT_FALSE(sample->has_stiffness);
  simulator.stop();
}

// Rate, wall and cut while it runs, as a person changes them in the live view.
class ControlledSimulator : public ::testing::Test {
 public:
  ~ControlledSimulator() override { std::filesystem::remove_all(folder_); }

 protected:
  ControlledSimulator() {
    char folder[] = "/tmp/forcegrid_simulator_XXXXXX";
    EXPECT_NE(::mkdtemp(folder), nullptr);
    folder_ = folder;
    SimulatorOptions options;
    options.control = folder_ + "/simulator";
    simulator_ = std::make_unique<RunningSimulator>(options);
    person_ = std::make_unique<rt::LocalDatagrams>(folder_ + "/person");
    servo_ = std::make_unique<link::ServoEndpoint>(simulator_->address());
  }

  // Rate [Hz], delay, jitter [ms], loss [%], wall [mm], cut; false: it answers something else.
  bool set(const std::array<double, 6>& value) {
    struct Datagram {
      std::uint64_t number;
      std::array<double, 6> value;
    };
    std::array<std::uint8_t, sizeof(Datagram)> bytes =
        std::bit_cast<std::array<std::uint8_t, sizeof(Datagram)>>(Datagram{++number_, value});
    EXPECT_TRUE(person_->send(folder_ + "/simulator", bytes));
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (person_->receive(bytes) < 0 && std::chrono::steady_clock::now() < give_up) {
      std::this_thread::sleep_for(1ms);
    }
    const auto answer = std::bit_cast<Datagram>(bytes);
    for (std::size_t i = 0; i < value.size(); ++i) {
      if (!std::isnan(value[i]) && value[i] != answer.value[i]) {
        return false;
      }
    }
    return answer.number == number_;
  }

  // An answer to a state that was sent after this call.
  link::ForceSample at(double z_m) {
    const std::uint32_t before = sequence_;
    for (;;) {
      const auto sample = answer_at(*servo_, sequence_, {0, 0, z_m});
      if (!sample || sample->echo_sequence > before) {
        EXPECT_TRUE(sample);
        return sample.value_or(link::ForceSample{});
      }
    }
  }

  static constexpr double kSame = std::numeric_limits<double>::quiet_NaN();
  std::string folder_;
  std::unique_ptr<RunningSimulator> simulator_;
  std::unique_ptr<rt::LocalDatagrams> person_;
  std::unique_ptr<link::ServoEndpoint> servo_;
  std::uint64_t number_ = 0;
  std::uint32_t sequence_ = 0;
};

TEST_F(ControlledSimulator, PutsAWallInTheWayOfAToolThatHoldsTheObject) {
  at(0.005);
  at(-0.0001);  // it touches
  const link::ForceSample before = at(0.009);
  ASSERT_TRUE(before.in_contact);
  ASSERT_TRUE(set({kSame, kSame, kSame, kSame, 6.0, kSame}));
  const link::ForceSample with_wall = at(0.009);
  EXPECT_GT(with_wall.contact_epoch, before.contact_epoch) << "the force jumps";
  // 1000 N/m over 3 mm.
  EXPECT_NEAR(with_wall.force_W_N[2], before.force_W_N[2] - 3.0, 0.02);
  EXPECT_NEAR(with_wall.stiffness_W_N_per_m[8], before.stiffness_W_N_per_m[8] - 1000.0, 20.0);
  EXPECT_NEAR(at(0.0059).force_W_N[2], 0.59 / 0.9 * before.force_W_N[2],
              0.1 * std::abs(before.force_W_N[2]))
      << "below the wall there is the object alone";
}

TEST_F(ControlledSimulator, CutsTheObjectUnderTheToolAndMakesItWhole) {
  at(0.005);
  at(-0.0001);
  const link::ForceSample whole = at(0.008);
  ASSERT_TRUE(set({kSame, kSame, kSame, kSame, kSame, 1.0}));
  const link::ForceSample cut = at(0.008);
  ASSERT_TRUE(cut.in_contact) << "the tool still holds it";
  EXPECT_GT(cut.contact_epoch, whole.contact_epoch);
  EXPECT_LT(std::abs(cut.force_W_N[2]), 0.9 * std::abs(whole.force_W_N[2]));
  EXPECT_GT(std::abs(cut.force_W_N[2]), 0.05 * std::abs(whole.force_W_N[2]));
  ASSERT_TRUE(set({kSame, kSame, kSame, kSame, kSame, 0.0}));
  const link::ForceSample again = at(0.008);
  EXPECT_GT(again.contact_epoch, cut.contact_epoch);
  EXPECT_NEAR(again.force_W_N[2], whole.force_W_N[2], 0.02 * std::abs(whole.force_W_N[2]));
}

TEST_F(ControlledSimulator, ReportsWhatWasChanged) {
  at(0.02);
  ASSERT_TRUE(set({100.0, kSame, kSame, 100.0, kSame, kSame}));
  EXPECT_FALSE(set({-5.0, kSame, kSame, kSame, kSame, kSame}));
  link::ToolState state;
  state.sequence = ++sequence_;
  state.servo_time_ns = 1000 + sequence_;
  servo_->send(state);
  for (const auto end = std::chrono::steady_clock::now() + 200ms;
       std::chrono::steady_clock::now() < end;) {
    EXPECT_FALSE(servo_->wait(20ms) && servo_->receive()) << "every answer is lost";
  }
  const SimulatorSummary summary = simulator_->stop();
  EXPECT_EQ(summary.control_changes, 2U) << "rate and loss";
  EXPECT_EQ(summary.rate_Hz, 100.0);
  EXPECT_EQ(summary.link.loss, 1.0);
  EXPECT_GE(summary.lost_on_purpose, 1U);
}

TEST(RunSimulator, EndsWhenItsStandardInputCloses) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  RunningSimulator simulator({}, ends[0]);
  EXPECT_EQ(simulator.result().wait_for(0s), std::future_status::timeout);
  ::close(ends[1]);
  EXPECT_EQ(simulator.result().wait_for(kPatience), std::future_status::ready);
  ::close(ends[0]);
}

TEST(RunSimulator, RefusesOptionsOutOfRangeByName) {
  const std::atomic<bool> stop{false};
  const auto message = [&stop](const SimulatorOptions& options) -> std::string {
    std::ostringstream out;
    try {
      run_simulator(options, out, stop);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  };
  SimulatorOptions options;
  options.scene = "bloc";
  EXPECT_THAT(message(options), HasSubstr("block, block_linear"));
  options = {};
  options.rate_Hz = 0.0;
  EXPECT_THAT(message(options), HasSubstr("rate"));
  options = {};
  options.link_conditions.delay_s = -1.0;
  EXPECT_THAT(message(options), HasSubstr("delay"));
  options = {};
  options.scene = "small";
  options.listen = "192.0.2.1:5000";
  EXPECT_THAT(message(options), HasSubstr("192.0.2.1"));
  RunningSimulator running;
  options.listen = running.address();
  EXPECT_THAT(message(options), HasSubstr(running.address()));
}

}  // namespace
}  // namespace forcegrid::simulator
