// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/tool_torque.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace forcegrid::servo {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kRounding_Nm = 1e-14;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
const Vector3d kHere_W = Vector3d::Zero();  // where a sample is unless it says otherwise
const ToolTorqueOptions kWide = {.max_torque_Nm = 100.0, .max_lever_m = 10.0, .max_shift_m = 1.0};

ToolTorque with(const ToolTorque::Wrench& wrench, const ToolTorqueOptions& options = kWide) {
  ToolTorque torque(options);
  torque.take(wrench);
  return torque;
}

void expect_near(const Vector3d& actual, const Vector3d& expected, double within = kRounding_Nm) {
  EXPECT_LE((actual - expected).norm(), within)
      << actual.transpose() << " expected " << expected.transpose();
}

// A rod along z whose tip is the operational point, pressed at 30 mm above it from its side.
TEST(ToolTorque, OfARodPressedAtItsSideFollowsTheForce) {
  const Vector3d pressed_at(0.0, 0.0, 0.03);
  const Vector3d force_W(0.0, -2.0, 0.0);
  const auto torque = with({.force_W = force_W, .torque_W_Nm = pressed_at.cross(force_W)});
  expect_near(torque.lever_W(), pressed_at);
  // 30 mm times 2 N, about x; then times what the method renders half a cycle later.
  expect_near(torque.torque_W_Nm(kHere_W, Quaterniond::Identity(), force_W, 1.0), {0.06, 0.0, 0.0});
  expect_near(torque.torque_W_Nm(kHere_W, Quaterniond::Identity(), 1.5 * force_W, 1.0),
              {0.09, 0.0, 0.0});
  expect_near(torque.torque_W_Nm(kHere_W, Quaterniond::Identity(), {1.0, 0.0, 0.0}, 1.0),
              {0.0, 0.03, 0.0});
}

// A torsion spring of 0.04 N m/rad about z, wound by 0.5 rad, without any force.
TEST(ToolTorque, OfAPureTwistGoesWithTheAngle) {
  constexpr double kSpring_Nm_per_rad = 0.04;
  constexpr double kWound_rad = 0.5;
  ToolTorque::Wrench wrench;
  wrench.torque_W_Nm = {0.0, 0.0, -kSpring_Nm_per_rad * kWound_rad};
  wrench.orientation_WT = AngleAxisd(kWound_rad, Vector3d::UnitZ());
  wrench.has_rotational_stiffness = true;
  wrench.rotational_stiffness_W_Nm_per_rad(2, 2) = -kSpring_Nm_per_rad;
  const auto torque = with(wrench);
  for (const double angle_rad : {0.1, 0.5, 0.7, 0.95}) {
    const Quaterniond now(AngleAxisd(angle_rad, Vector3d::UnitZ()));
    expect_near(torque.torque_W_Nm(kHere_W, now, Vector3d::Zero(), 1.0),
                {0.0, 0.0, -kSpring_Nm_per_rad * angle_rad});
    expect_near(torque.torque_W_Nm(kHere_W, Quaterniond(-now.coeffs()), Vector3d::Zero(), 1.0),
                {0.0, 0.0, -kSpring_Nm_per_rad * angle_rad});
  }
  // The linear part ends at max_rotation_rad.
  const Quaterniond far(AngleAxisd(kWound_rad + 2.0, Vector3d::UnitZ()));
  expect_near(torque.torque_W_Nm(kHere_W, far, Vector3d::Zero(), 1.0),
              {0.0, 0.0, -kSpring_Nm_per_rad * (kWound_rad + kWide.max_rotation_rad)});
}

TEST(ToolTorque, WithoutAStiffnessIsHeldInTheToolsFrame) {
  const Vector3d lever(0.0, 0.0, 0.03);
  const Vector3d force_W(2.0, 0.0, 0.0);
  const Vector3d couple(0.25, 0.0, 0.0);  // along the force
  const auto torque = with({.force_W = force_W, .torque_W_Nm = lever.cross(force_W) + couple});
  const Quaterniond quarter(AngleAxisd(M_PI_2, Vector3d::UnitX()));  // z goes to -y, x stays
  expect_near(torque.torque_W_Nm(kHere_W, quarter, force_W, 1.0),
              Vector3d(0.0, -0.03, 0.0).cross(force_W) + couple);
}

// A tool on a spring that pulls at a point 30 mm above its tip toward an anchor: F = k (a - q) and
// tau = s x F with q = P + s, so dF/dP = -k 1 and d(tau)/dP = -k [s]x. The force follows the hand,
// as a method renders it; so must the torque, which is linear in P.
TEST(ToolTorque, OfASpringBesideTheTipFollowsTheHandsWay) {
  constexpr double kSpring_N_per_m = 150.0;
  const Vector3d at(0.004, -0.002, 0.03);
  const Vector3d anchor_W(0.01, 0.02, 0.0);
  const auto force_W = [&](const Vector3d& position_W) {
    return Vector3d(kSpring_N_per_m * (anchor_W - position_W - at));
  };
  ToolTorque::Wrench wrench;
  wrench.position_W = {0.002, 0.001, -0.003};
  wrench.force_W = force_W(wrench.position_W);
  wrench.torque_W_Nm = at.cross(wrench.force_W);
  wrench.has_rotational_stiffness = true;
  wrench.has_gradient = true;
  wrench.stiffness_W_N_per_m = -kSpring_N_per_m * Matrix3d::Identity();
  for (int axis = 0; axis < 3; ++axis) {
    wrench.gradient_W_N.col(axis) = -kSpring_N_per_m * at.cross(Vector3d::Unit(axis));
  }
  const auto torque = with(wrench);
  ASSERT_GT((torque.lever_W() - at).norm(), 0.01) << "the central axis is not the spring's end";
  const auto rendered_Nm = [&](const ToolTorque& of, const Vector3d& position_W) {
    return of.torque_W_Nm(position_W, Quaterniond::Identity(), force_W(position_W), 1.0);
  };
  for (const Vector3d& way_W :
       {Vector3d(0.003, 0.0, 0.0), Vector3d(-0.002, 0.004, 0.001), Vector3d(0.0, 0.0, -0.006)}) {
    const Vector3d position_W = wrench.position_W + way_W;
    expect_near(rendered_Nm(torque, position_W), at.cross(force_W(position_W)));
  }
  // The linear part ends at max_shift_m.
  const auto bounded = with(wrench, {.max_torque_Nm = 100.0, .max_shift_m = 0.002});
  const Vector3d far_W = wrench.position_W + Vector3d(0.008, 0.0, 0.0);
  const Vector3d missing_W(0.006, 0.0, 0.0);
  const Vector3d lost_Nm = -kSpring_N_per_m * (at - bounded.lever_W()).cross(missing_W);
  expect_near(rendered_Nm(bounded, far_W), at.cross(force_W(far_W)) - lost_Nm);
  // Without the gradient the lever arm alone follows the force, and is wrong.
  wrench.has_gradient = false;
  EXPECT_GT((rendered_Nm(with(wrench), far_W) - at.cross(force_W(far_W))).norm(), 1e-3);
}

TEST(ToolTorque, IsTheSamplesAtTheSamplesPoseWhateverTheWrench) {
  constexpr unsigned kSeed = 24;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal;
  const auto vector = [&](double scale) {
    return Vector3d(scale * Vector3d(normal(random), normal(random), normal(random)));
  };
  for (int i = 0; i < 500; ++i) {
    ToolTorque::Wrench wrench;
    wrench.force_W = vector(2.0);
    wrench.torque_W_Nm = vector(0.1);
    wrench.orientation_WT =
        Quaterniond(normal(random), normal(random), normal(random), normal(random)).normalized();
    wrench.has_rotational_stiffness = i % 2 == 0;
    if (wrench.has_rotational_stiffness) {
      wrench.rotational_stiffness_W_Nm_per_rad.col(i % 3) = vector(0.3);
    }
    wrench.position_W = vector(0.05);
    wrench.has_gradient = i % 5 == 0;
    if (wrench.has_gradient) {
      wrench.gradient_W_N.col(i % 3) = vector(2.0);
      wrench.stiffness_W_N_per_m.col(i % 3) = vector(200.0);
    }
    const auto torque =
        with(wrench,
             i % 3 == 0 ? kWide : ToolTorqueOptions{.max_torque_Nm = 100.0, .max_lever_m = 0.02});
    expect_near(torque.torque_W_Nm(wrench.position_W, wrench.orientation_WT, wrench.force_W, 1.0),
                wrench.torque_W_Nm, 1e-12);
    EXPECT_LE(torque.lever_W().norm(), (i % 3 == 0 ? 10.0 : 0.02) * (1.0 + 1e-12));
  }
}

TEST(ToolTorque, FadesWithTheForceThatTheLoopFades) {
  const Vector3d lever(0.0, 0.02, 0.0);
  const Vector3d force_W(0.0, 0.0, 3.0);
  ToolTorque::Wrench wrench;
  wrench.force_W = force_W;
  wrench.torque_W_Nm = lever.cross(force_W) + Vector3d(0.0, 0.0, 0.01);
  const auto torque = with(wrench);
  const Quaterniond same = Quaterniond::Identity();
  for (const double gain : {1.0, 0.5, 0.1, 0.0}) {
    expect_near(torque.torque_W_Nm(kHere_W, same, gain * force_W, gain), gain * wrench.torque_W_Nm);
  }
  // A gain beyond its range is the range's end.
  expect_near(torque.torque_W_Nm(kHere_W, same, force_W, 7.0), wrench.torque_W_Nm);
  expect_near(torque.torque_W_Nm(kHere_W, same, Vector3d::Zero(), -1.0), Vector3d::Zero());
}

TEST(ToolTorque, KeepsItsBoundAndItsDirection) {
  const auto torque =
      with({.force_W = Vector3d::Zero(), .torque_W_Nm = {0.3, 0.0, -0.4}}, {.max_torque_Nm = 0.25});
  expect_near(torque.torque_W_Nm(kHere_W, Quaterniond::Identity(), Vector3d::Zero(), 1.0),
              {0.15, 0.0, -0.2});
}

TEST(ToolTorque, IsZeroWithoutASampleAndForInputThatIsNotFinite) {
  const Quaterniond same = Quaterniond::Identity();
  const Vector3d force_W(1.0, 0.0, 0.0);
  ToolTorque torque(kWide);
  EXPECT_FALSE(torque.known());
  expect_near(torque.torque_W_Nm(kHere_W, same, force_W, 1.0), Vector3d::Zero(), 0.0);
  const ToolTorque::Wrench sound = {.force_W = force_W, .torque_W_Nm = {0.0, 0.1, 0.0}};
  torque.take(sound);
  EXPECT_TRUE(torque.known());
  expect_near(torque.torque_W_Nm(kHere_W, same, Vector3d(kNaN, 0.0, 0.0), 1.0), Vector3d::Zero(),
              0.0);
  expect_near(torque.torque_W_Nm(kHere_W, same, force_W, kNaN), Vector3d::Zero(), 0.0);
  expect_near(torque.torque_W_Nm(kHere_W, Quaterniond(kNaN, 0.0, 0.0, 0.0), force_W, 1.0),
              Vector3d::Zero(), 0.0);
  expect_near(torque.torque_W_Nm(kHere_W, Quaterniond(2.0, 0.0, 0.0, 0.0), force_W, 1.0),
              Vector3d::Zero(), 0.0);
  torque.forget();
  expect_near(torque.torque_W_Nm(kHere_W, same, force_W, 1.0), Vector3d::Zero(), 0.0);
  expect_near(torque.lever_W(), Vector3d::Zero(), 0.0);
  expect_near(torque.torque_W_Nm(Vector3d(0.0, kNaN, 0.0), same, force_W, 1.0), Vector3d::Zero(),
              0.0);
  for (int which = 0; which < 7; ++which) {
    ToolTorque::Wrench bad = sound;
    bad.has_rotational_stiffness = true;
    switch (which) {
      case 0:
        bad.force_W[1] = kNaN;
        break;
      case 1:
        bad.torque_W_Nm[2] = std::numeric_limits<double>::infinity();
        break;
      case 2:
        bad.orientation_WT = Quaterniond(0.5, 0.0, 0.0, 0.0);
        break;
      case 3:
        bad.position_W[0] = kNaN;
        break;
      case 4:
        bad.has_gradient = true;
        bad.gradient_W_N(2, 0) = kNaN;
        break;
      case 5:
        bad.has_gradient = true;
        bad.stiffness_W_N_per_m(1, 1) = kNaN;
        break;
      default:
        bad.rotational_stiffness_W_Nm_per_rad(1, 2) = kNaN;
    }
    torque.take(sound);
    torque.take(bad);
    EXPECT_FALSE(torque.known()) << which;
  }
}

TEST(ToolTorque, AForceTooSmallToDivideByHasNoLeverArm) {
  const auto torque = with({.force_W = {1e-200, 0.0, 0.0}, .torque_W_Nm = {0.0, 0.1, 0.0}});
  expect_near(torque.torque_W_Nm(kHere_W, Quaterniond::Identity(), Vector3d::Zero(), 1.0),
              {0.0, 0.1, 0.0});
}

TEST(ToolTorque, NamesTheOptionThatCannotBeUsed) {
  const auto refused = [](const ToolTorqueOptions& options, const char* name) {
    EXPECT_THAT([&] { ToolTorque{options}; },
                testing::ThrowsMessage<std::invalid_argument>(testing::HasSubstr(name)));
  };
  refused({.max_torque_Nm = 0.0}, "max_torque_Nm");
  refused({.max_torque_Nm = kNaN}, "max_torque_Nm");
  refused({.max_lever_m = -0.1}, "max_lever_m");
  refused({.max_rotation_rad = -0.1}, "max_rotation_rad");
  refused({.max_shift_m = -0.1}, "max_shift_m");
}

}  // namespace
}  // namespace forcegrid::servo
