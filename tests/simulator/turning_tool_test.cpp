// SPDX-License-Identifier: Apache-2.0
// The simulator's tool turned by the servo's hand, over the link.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <sstream>
#include <thread>

#include "link/servo_endpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/touch/tool_contact.h"
#include "tests/simulator/running_simulator.h"

namespace forcegrid::simulator {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using ::testing::HasSubstr;

link::Quaternion to_link(const Quaterniond& q) { return {q.w(), q.x(), q.y(), q.z()}; }

// As answer_at(), for a tool that is turned.
std::optional<link::ForceSample> answer_to(link::ServoEndpoint& servo, std::uint32_t& sequence,
                                           const link::Vector3& position_W_m,
                                           const Quaterniond& orientation_WT) {
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  const std::uint32_t first = sequence + 1;
  while (std::chrono::steady_clock::now() < give_up) {
    link::ToolState state;
    state.sequence = ++sequence;
    state.servo_time_ns = 1000 + sequence;
    state.position_W_m = position_W_m;
    state.has_orientation = true;
    state.orientation_WT = to_link(orientation_WT);
    servo.send(state);
    servo.wait(std::chrono::milliseconds(2));
    while (const auto sample = servo.receive()) {
      if (sample->query_id == 0 && sample->echo_sequence >= first) {
        return sample;
      }
    }
  }
  return std::nullopt;
}

SimulatorOptions turning(ToolOptions tool = {}) {
  tool.turns = true;
  SimulatorOptions options;
  options.tool = tool;
  return options;
}

TEST(TurningTool, AHeldPatchThatIsTwistedSendsTorqueAndItsDerivatives) {
  RunningSimulator simulator(turning());
  link::ServoEndpoint servo(simulator.address(), link::ServoEndpoint::random_session_id(), {}, 0,
                            link::Content::kSensitivities);
  std::uint32_t sequence = 0;
  const Quaterniond held_at(AngleAxisd(0.3, Vector3d::UnitX()));
  const auto above = answer_to(servo, sequence, {0.001, 0.002, 0.02}, held_at);
  ASSERT_TRUE(above);
  EXPECT_FALSE(above->in_contact);
  EXPECT_FALSE(above->has_torque);
  const auto touch = answer_to(servo, sequence, {0.001, 0.002, -0.0001}, held_at);
  ASSERT_TRUE(touch && touch->in_contact && touch->has_torque);

  const Quaterniond turn_W(AngleAxisd(0.2, Vector3d(0.1, 0.2, 1.0).normalized()));
  const link::Vector3 position_W_m{0.001, 0.002, -0.003};
  const auto twisted = answer_to(servo, sequence, position_W_m, turn_W * held_at);
  ASSERT_TRUE(twisted && twisted->has_torque && twisted->has_rotational_stiffness);
  const Quaterniond sent(twisted->orientation_WT[0], twisted->orientation_WT[1],
                         twisted->orientation_WT[2], twisted->orientation_WT[3]);
  EXPECT_LT(sent.angularDistance(turn_W * held_at), 1e-9);

  const SpringMesh mesh = make_scene("small").mesh;
  SolverOptions exactly;
  exactly.relative_tolerance = 1e-8;
  ElasticObject<double> reference(mesh, exactly);
  reference.turn(mesh);
  reference.grab({0.001, 0.002, 0.0}, 0.012);
  const Equilibrium expected = reference.move_to({0.0, 0.0, -0.003}, turn_W);
  ASSERT_TRUE(expected.converged);
  const Vector3d torque_Nm(twisted->torque_W_Nm.data());
  EXPECT_LT(torque_Nm.z(), -1e-4);
  EXPECT_LE((torque_Nm - expected.torque_W_Nm).norm(), 5e-3 * expected.torque_W_Nm.norm());
  const Matrix3d stiffness = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
      twisted->rotational_stiffness_W_Nm_per_rad.data());
  EXPECT_LE((stiffness - expected.rotational_stiffness_W_Nm_per_rad).norm(),
            0.02 * expected.rotational_stiffness_W_Nm_per_rad.norm());
  ASSERT_TRUE(twisted->has_torque_gradient);
  const Matrix3d gradient_N = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
      twisted->torque_gradient_W_N.data());
  EXPECT_LE((gradient_N - expected.torque_gradient_W_N).norm(),
            0.02 * expected.torque_gradient_W_N.norm());
  EXPECT_EQ(twisted->influence_count, 0U);
  EXPECT_EQ(simulator.stop().solver, "quasi_static");
}

TEST(TurningTool, WithoutAWristItStaysUprightAndThereIsNoTorqueToSend) {
  RunningSimulator turns(turning());
  RunningSimulator plain;
  link::ServoEndpoint servo_of_turning(turns.address());
  link::ServoEndpoint servo_of_plain(plain.address());
  std::uint32_t sequence = 0;
  for (const double z_m : {0.02, -0.0001, -0.004}) {
    const link::Vector3 position_W_m{0.001, 0.002, z_m};
    const auto found = answer_at(servo_of_turning, sequence, position_W_m);
    const auto expected = answer_at(servo_of_plain, sequence, position_W_m);
    ASSERT_TRUE(found && expected);
    EXPECT_FALSE(found->has_torque);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(found->force_W_N[axis], expected->force_W_N[axis], 2e-3) << z_m;
    }
  }
}

TEST(TurningTool, IgnoresOrientationsUnlessAsked) {
  RunningSimulator simulator;
  link::ServoEndpoint servo(simulator.address());
  std::uint32_t sequence = 0;
  const Quaterniond tilted(AngleAxisd(0.5, Vector3d::UnitY()));
  ASSERT_TRUE(answer_to(servo, sequence, {0.0, 0.0, 0.02}, Quaterniond::Identity()));
  ASSERT_TRUE(answer_to(servo, sequence, {0.0, 0.0, -0.0001}, Quaterniond::Identity()));
  const auto tilted_answer = answer_to(servo, sequence, {0.0, 0.0, -0.003}, tilted);
  ASSERT_TRUE(tilted_answer && tilted_answer->in_contact);
  EXPECT_FALSE(tilted_answer->has_torque);
  const auto upright = answer_to(servo, sequence, {0.0, 0.0, -0.003}, Quaterniond::Identity());
  ASSERT_TRUE(upright);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(tilted_answer->force_W_N[axis], upright->force_W_N[axis], 2e-3);
  }
}

TEST(TurningTool, ARodThatSlidesTouchesWhereItIsTiltedTo) {
  ToolOptions rod;
  rod.shape = "capsule";
  rod.contact = "slide";
  rod.radius_m = 0.004;
  rod.length_m = 0.03;
  rod.turns = true;
  const Scene scene = make_scene("small");
  const auto contact = make_tool_contact(scene, {}, rod);
  EXPECT_FALSE(contact->depends_on_position_alone());
  // Laid down along x, its lowest line is a radius below its axis, which is at the tip's height.
  contact->turn_to(Quaterniond(AngleAxisd(M_PI_2, Vector3d::UnitY())));
  EXPECT_FALSE(contact->step({0.0, 0.0, 0.006}).in_contact);
  const auto pressed = contact->step({0.0, 0.0, 0.002});
  ASSERT_TRUE(pressed.in_contact) << "2 mm deep with 4 mm of radius";
  EXPECT_TRUE(pressed.equilibrium.torque_known);
  EXPECT_EQ(pressed.equilibrium.rotational_stiffness_known, pressed.stiffness_known)
      << "unless a point slips";
  EXPECT_GT(pressed.equilibrium.force_W.z(), 0.05);
  // It lies on the side of +x, so that the block lifts that end: about -y.
  EXPECT_LT(pressed.equilibrium.torque_W_Nm.y(), -1e-4);
  contact->turn_to(Quaterniond::Identity());
  EXPECT_FALSE(contact->step({0.0, 0.0, 0.002}).in_contact) << "upright its tip is above";
}

TEST(TurningTool, RefusesWhatExcludesIt) {
  const auto message = [](SimulatorOptions options) -> std::string {
    std::ostringstream out;
    std::atomic<bool> stop{false};
    options.scene = "small";
    options.listen = "127.0.0.1:0";
    try {
      run_simulator(options, out, stop, -1);
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  };
  SimulatorOptions local = turning();
  local.solver_kind = SolverKind::kLocal;
  EXPECT_THAT(message(local), HasSubstr("quasi_static"));
  SimulatorOptions workers = turning();
  workers.workers = "127.0.0.1:0";
  EXPECT_THAT(message(workers), HasSubstr("--workers"));
  SimulatorOptions models = turning();
  models.material_tolerance_percent = 1.0;
  EXPECT_THAT(message(models), HasSubstr("--material-tolerance-percent"));
}

}  // namespace
}  // namespace forcegrid::simulator
