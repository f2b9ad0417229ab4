// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/shared_reference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/scene.h"
#include "simulator/touch/shared_contact.h"
#include "tests/simulator/two_tool_newton.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

// Ground -40 N/m- left -10 N/m- free -20 N/m- right, 0.1 m apart along z.
constexpr double kGround_N_per_m = 40.0;
constexpr double kBetween_N_per_m = 10.0 * 20.0 / (10.0 + 20.0);  // two springs in series
const Vector3d kLeft_W(0, 0, 0.1);
const Vector3d kRight_W(0, 0, 0.3);

SpringMesh chain() {
  SpringMesh mesh;
  mesh.fixed = {1, 0, 0, 0};
  mesh.laws = {{.cubic_coefficient = 0.0}};
  for (int i = 0; i < 4; ++i) {
    mesh.rest_position_W.emplace_back(0, 0, 0.1 * i);
  }
  mesh.springs = {{0, 1, kGround_N_per_m}, {1, 2, 10.0}, {2, 3, 20.0}};
  return mesh;
}

// Where a tool of the chain is above its vertex at rest. The right one is always farther, since a
// chain that is pressed buckles.
double left_m(double time_s) { return 0.004 * std::sin(2.0 * std::numbers::pi * time_s); }
double right_m(double time_s) { return 0.04 * time_s; }

template <typename Way>
ToolPath path_along_z(const Vector3d& rest_W, double first_s, double period_s, int cycles,
                      Way way_m) {
  ToolPath path;
  for (int i = 0; i < cycles; ++i) {
    path.times_s.push_back(first_s + period_s * i);
    path.positions_W.push_back(rest_W + Vector3d(0, 0, way_m(path.times_s.back())));
  }
  path.touched_s = first_s;
  path.contact_point_W = rest_W;
  path.tools_before_touch_W = {kLeft_W, kRight_W};
  return path;
}

ReferenceOptions tight(unsigned threads = 1) {
  ReferenceOptions options;
  options.relative_tolerance = 1e-9;
  options.patch_radius_m = 0.01;
  options.threads = threads;
  return options;
}

// The cycles of the two do not coincide: each is solved with the other on its way between two.
TEST(SharedReference, SpringsInSeriesBetweenTwoTools) {
  const std::vector<ToolPath> paths = {path_along_z(kLeft_W, 0.0, 0.002, 300, left_m),
                                       path_along_z(kRight_W, 0.0007, 0.003, 200, right_m)};
  const auto found = simulate_shared_reference(chain(), paths, tight());
  ASSERT_EQ(found.size(), 2U);
  // The left one's way is bent by at most 0.004 (2 pi)^2 m/s^2: a chord of 2 ms is off by 80 nm.
  constexpr double kChord_m = 8e-8;
  for (std::size_t i = 0; i < 200; ++i) {
    const double t = paths[1].times_s[i];
    const double expected_N = -kBetween_N_per_m * (right_m(t) - left_m(t));
    ASSERT_NEAR(found[1].forces_W[i].z(), expected_N, kBetween_N_per_m * kChord_m + 1e-8) << i;
  }
  for (std::size_t i = 1; i < 299; ++i) {  // the right one has no cycle after 0.5977 s
    const double t = paths[0].times_s[i];
    const double expected_N =
        kBetween_N_per_m * (right_m(t) - left_m(t)) - kGround_N_per_m * left_m(t);
    ASSERT_NEAR(found[0].forces_W[i].z(), expected_N, 1e-8) << i;
  }
  // Before the right one touched, there was nothing beyond the left one that could pull.
  EXPECT_NEAR(found[0].forces_W[0].z(), -kGround_N_per_m * left_m(0.0), 1e-12);
  EXPECT_EQ(found[0].unconverged + found[1].unconverged, 0U);
}

// The right tool takes hold of a vertex that the left one has carried off, and leaves it there.
TEST(SharedReference, ALaterTouchHoldsWhatTheOtherToolHasMoved) {
  std::vector<ToolPath> paths = {
      path_along_z(kLeft_W, 0.0, 0.002, 200, [](double) { return 0.005; }),
      path_along_z(kRight_W, 0.1, 0.002, 100, [](double t) { return t < 0.2 ? 0.0 : 0.002; })};
  paths[1].tools_before_touch_W[0] = kLeft_W + Vector3d(0, 0, 0.005);
  paths[1].let_go_s = 0.25;
  const auto found = simulate_shared_reference(chain(), paths, tight());
  for (std::size_t i = 0; i < 100; ++i) {
    const double t = paths[1].times_s[i];
    // All above the left tool has moved with it: relaxed until the right one moves its own end.
    const double pull_N = t < 0.2 || t >= 0.25 ? 0.0 : kBetween_N_per_m * 0.002;
    EXPECT_NEAR(found[1].forces_W[i].z(), -pull_N, 1e-8) << t;
    EXPECT_NEAR(found[0].forces_W[50 + i].z(), pull_N - kGround_N_per_m * 0.005, 1e-8) << t;
  }
}

TEST(SharedReference, IsWhatADenseNewtonMethodGives) {
  LatticeBlockOptions block;
  block.vertex_count = {7, 6, 5};
  block.size_m = {0.06, 0.05, 0.04};
  block.law.cubic_coefficient = 5.0;
  const SpringMesh mesh = make_lattice_block(block);
  const TwoToolNewton::Points touch_W = {Vector3d(-0.018, 0, 0), Vector3d(0.018, 0, 0)};
  std::vector<ToolPath> paths(2);
  for (std::size_t k = 0; k < 2; ++k) {
    for (int i = 0; i < 150; ++i) {
      const double t = 0.002 * i + 0.0005 * static_cast<double>(k);
      paths[k].times_s.push_back(t);
      paths[k].positions_W.push_back(touch_W[k] +
                                     t * Vector3d(0.01, 0.004, k == 0 ? -0.02 : 0.015));
    }
    paths[k].touched_s = paths[k].times_s.front();
    paths[k].contact_point_W = touch_W[k];
    paths[k].tools_before_touch_W = {touch_W[0], touch_W[1]};
  }
  ReferenceOptions options = tight(2);
  options.relative_tolerance = 1e-6;
  options.patch_radius_m = 0.012;
  const auto found = simulate_shared_reference(mesh, paths, options);
  EXPECT_EQ(found[0].threads, 2U);
  EXPECT_LT(std::max(found[0].worst_seam_N, found[1].worst_seam_N), 1e-5);
  for (const std::size_t i : {20UL, 75UL, 149UL}) {
    TwoToolNewton dense(mesh, touch_W, options.patch_radius_m);
    // Where both are at a cycle of the left one; the ways are straight.
    const double t = paths[0].times_s[i];
    const Vector3d right_W = t * Vector3d(0.01, 0.004, 0.015);
    const Vector3d right_then_W =
        t > paths[1].times_s.back() ? paths[1].positions_W.back() - touch_W[1] : right_W;
    const Vector3d expected_W =
        dense.at({paths[0].positions_W[i] - touch_W[0], right_then_W}).tool_W[0];
    EXPECT_LT((found[0].forces_W[i] - expected_W).norm(), 1e-5 * expected_W.norm()) << i;
  }
}

// The simulator of several tools, asked along the same ways, agrees within its own tolerance.
TEST(SharedReference, IsWhatTheSimulatorOfSeveralToolsAnswers) {
  const Scene scene = make_scene("small");
  SharedContact contact(scene, {}, ToolOptions{}, 2);
  const std::array<Vector3d, 2> touch_W = {Vector3d(0, -0.015, 0), Vector3d(0, 0.015, 0)};
  std::vector<ToolPath> paths(2);
  constexpr double kTick_s = 0.03;
  std::array<std::vector<Vector3d>, 2> answered_W;
  for (int tick = 0; tick < 40; ++tick) {
    for (std::size_t k = 0; k < 2; ++k) {
      // The right one comes down 10 ticks later, when the left one has moved by 3 mm.
      const int since = tick - (k == 0 ? 1 : 11);
      const Vector3d moved_W =
          since < 0 ? Vector3d(0, 0, 1e-4) : Vector3d(since * Vector3d(1e-4, 2e-4, 3e-4));
      contact.move(k, touch_W[k] + moved_W);
      paths[k].times_s.push_back(kTick_s * tick);
      paths[k].positions_W.push_back(touch_W[k] + moved_W);
    }
    contact.solve();
    for (std::size_t k = 0; k < 2; ++k) {
      answered_W[k].push_back(contact.answer(k).equilibrium.force_W);
    }
  }
  ASSERT_TRUE(contact.in_contact(0) && contact.in_contact(1));
  for (std::size_t k = 0; k < 2; ++k) {
    const int touch_tick = k == 0 ? 1 : 11;
    paths[k].touched_s = kTick_s * touch_tick;
    paths[k].contact_point_W = contact.answer(k).point_W;
    paths[k].tools_before_touch_W = {paths[0].positions_W[std::max(1, touch_tick - 1)],
                                     paths[1].positions_W[std::max(1, touch_tick - 1)]};
  }
  ReferenceOptions options;
  options.scene = "small";
  const auto found = simulate_shared_reference(paths, options);
  for (std::size_t k = 0; k < 2; ++k) {
    for (std::size_t i = 12; i < 40; ++i) {
      const Vector3d expected_W = answered_W[k][i];
      EXPECT_LT((found[k].forces_W[i] - expected_W).norm(), 5e-3 * expected_W.norm() + 1e-3)
          << k << " " << i;
    }
    EXPECT_GT(found[k].forces_W.back().norm(), 0.5);
  }
}

TEST(SharedReference, RefusesPathsThatCannotBeFollowed) {
  const auto complains = [](const std::vector<ToolPath>& paths, const char* of) {
    try {
      static_cast<void>(simulate_shared_reference(chain(), paths, tight()));
      ADD_FAILURE() << "no complaint of " << of;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(of));
    }
  };
  const ToolPath good = path_along_z(kLeft_W, 0.0, 0.002, 10, left_m);
  complains({}, "no tool");
  ToolPath backward = good;
  backward.times_s[5] = backward.times_s[4];
  complains({good, backward}, "tool 2: times must rise");
  ToolPath not_finite = good;
  not_finite.positions_W[3].x() = std::numeric_limits<double>::quiet_NaN();
  complains({not_finite, good}, "tool 1: times must rise, and times and positions must be finite");
  ToolPath in_the_air = good;
  in_the_air.contact_point_W = {1, 1, 1};
  complains({good, in_the_air}, "contact point of tool 2");
  ToolPath alone = good;
  alone.tools_before_touch_W.clear();
  complains({good, alone}, "tool 2: touches, but");
}

}  // namespace
}  // namespace forcegrid::simulator
