// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <ostream>

#include "simulator/mesh/scene.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/solver_contact.h"
#include "tests/simulator/little_jelly.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kRate_Hz = 30.0;
constexpr double kRounding_m = 1e-7;  // of single precision, 0.1 m from the mesh's top

class CopiedPositions : public ::testing::TestWithParam<SolverKind> {
 protected:
  CopiedPositions()
      : scene_(GetParam() == SolverKind::kDynamic   ? testing::little_jelly()
               : GetParam() == SolverKind::kPressed ? make_scene("small_slide")
                                                    : make_scene("small")) {
    SolverChoice choice;
    if (GetParam() == SolverKind::kPressed) {
      choice.kind = SolverKind::kPressed;
    } else {
      choice = choose_solver(GetParam(), vertices(), kRate_Hz, SolverOptions{},
                             dynamics_of(scene_.mesh));
    }
    contact_ = make_solver_contact(scene_, choice, scene_.tool, kRate_Hz);
    all_.resize(vertices());
    std::iota(all_.begin(), all_.end(), 0);
  }

  std::size_t vertices() const { return scene_.mesh.rest_position_W.size(); }

  ToolContact::Answer step(const Vector3d& position_W) {
    time_s_ += 1.0 / kRate_Hz;
    contact_->tell_time(time_s_);
    return contact_->step(position_W);
  }

  std::vector<Vector3d> positions_W() {
    std::vector<Vector3d> position_W;
    contact_->copy_positions(all_, position_W);
    return position_W;
  }

  void expect_at_rest(const char* when) {
    const std::vector<Vector3d> position_W = positions_W();
    ASSERT_EQ(position_W.size(), vertices());
    for (std::size_t i = 0; i < vertices(); ++i) {
      ASSERT_LT((position_W[i] - scene_.mesh.rest_position_W[i]).norm(), kRounding_m)
          << when << ", vertex " << i;
    }
  }

  Scene scene_;
  std::unique_ptr<ToolContact> contact_;
  std::vector<std::int32_t> all_;
  double time_s_ = 0.0;
};

TEST_P(CopiedPositions, AreAtRestFollowTheToolAndAreAtRestAgain) {
  expect_at_rest("before any step");
  step({0.0, 0.0, 0.02});
  expect_at_rest("above the object");
  ToolContact::Answer answer = step({0.0, 0.0, -0.0002});
  ASSERT_TRUE(answer.in_contact);
  const double sign = GetParam() == SolverKind::kPressed ? -1.0 : 1.0;
  for (int k = 1; k <= 4; ++k) {
    answer = step(answer.point_W + 1e-3 * Vector3d(0.1 * k, 0.0, sign * k));
    ASSERT_TRUE(answer.in_contact && answer.equilibrium.reached);
    const Vector3d moved_W = answer.position_W - answer.point_W;
    const std::vector<Vector3d> position_W = positions_W();
    double most_m = 0.0;
    int held = 0;
    for (std::size_t i = 0; i < vertices(); ++i) {
      const Vector3d& rest_W = scene_.mesh.rest_position_W[i];
      const double way_m = (position_W[i] - rest_W).norm();
      if (scene_.mesh.fixed[i] != 0) {
        EXPECT_LT(way_m, kRounding_m) << "fixed vertex " << i;
      } else if (GetParam() != SolverKind::kPressed &&
                 (rest_W - answer.point_W).norm() < scene_.patch_radius_m) {
        ++held;
        // The jelly may have moved a little when it was grabbed.
        EXPECT_LT((position_W[i] - rest_W - moved_W).norm(), 1e-6) << "held vertex " << i;
      } else {
        most_m = std::max(most_m, way_m);
      }
    }
    EXPECT_GT(most_m, 0.2e-3 * k) << "the neighbours follow";
    EXPECT_LT(most_m, 1.2e-3 * k);
    EXPECT_EQ(held > 0, GetParam() != SolverKind::kPressed);
  }
  contact_->reset();
  expect_at_rest("after a reset");
}

TEST_P(CopiedPositions, AreThoseOfTheVerticesAskedFor) {
  step({0.0, 0.0, 0.02});
  const ToolContact::Answer answer = step({0.0, 0.0, -0.0002});
  step(answer.point_W + 1e-3 * Vector3d(0.0, 0.0, GetParam() == SolverKind::kPressed ? -2.0 : 2.0));
  const std::vector<Vector3d> all_W = positions_W();
  const std::vector<std::int32_t> some{static_cast<std::int32_t>(vertices()) - 1, 7, 50};
  std::vector<Vector3d> position_W;
  contact_->copy_positions(some, position_W);
  ASSERT_EQ(position_W.size(), some.size());
  for (std::size_t n = 0; n < some.size(); ++n) {
    EXPECT_LT((position_W[n] - all_W[static_cast<std::size_t>(some[n])]).norm(), kRounding_m);
  }
}

INSTANTIATE_TEST_SUITE_P(EverySolver, CopiedPositions,
                         ::testing::Values(SolverKind::kQuasiStatic, SolverKind::kLocal,
                                           SolverKind::kTwoRates, SolverKind::kReduced,
                                           SolverKind::kDynamic, SolverKind::kPressed),
                         [](const auto& kind) { return to_string(kind.param); });

}  // namespace
}  // namespace forcegrid::simulator
