// SPDX-License-Identifier: Apache-2.0
// Cheaper models of a block of finite elements, their errors worked out by the reference solution.
#include "simulator/reference/model_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/reference/reference_solution.h"
#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using testing::HasSubstr;

constexpr double kRate_Hz = 30.0;
constexpr double kReach_m = 0.003;  // a tenth of the block's height

Scene block(ElementModel model) {
  Scene scene;
  scene.name = "block of elements";
  scene.patch_radius_m = 0.012;
  scene.mesh = element_block({8, 8, 5}, 0.006, soft(model, 0.4));
  return scene;
}

ModelOptions options(double tolerance_percent, ElementModel model) {
  return {.tolerance_percent = tolerance_percent,
          .rate_Hz = kRate_Hz,
          .solver = {},
          .solver_options = {},
          .coarser = [model](Fineness fineness) {
            return fineness == Fineness::kHalf ? element_block({4, 4, 3}, 0.012, soft(model, 0.4))
                                               : element_block({5, 5, 3}, 0.0096, soft(model, 0.4));
          }};
}

std::vector<Vector3d> forces_N(const SpringMesh& mesh, const Scene& scene) {
  std::vector<Vector3d> path_W;
  for (int tick = 0; tick <= static_cast<int>(kRate_Hz); ++tick) {
    const double turn = std::numbers::pi * tick / kRate_Hz;
    path_W.emplace_back(kReach_m * 0.5 * std::sin(3.0 * turn),
                        kReach_m * 0.3 * std::sin(5.0 * turn), -kReach_m * std::sin(2.0 * turn));
  }
  ReferenceOptions reference;
  reference.patch_radius_m = scene.patch_radius_m;
  return simulate_reference(mesh, path_W, reference).forces_W;
}

// RMS |F - F_written| in % of RMS |F_written|.
double error_percent(const SpringMesh& mesh, const Scene& written) {
  const std::vector<Vector3d> force_N = forces_N(mesh, written);
  const std::vector<Vector3d> written_N = forces_N(written.mesh, written);
  double error_N2 = 0.0;
  double force_N2 = 0.0;
  for (std::size_t i = 0; i < force_N.size(); ++i) {
    error_N2 += (force_N[i] - written_N[i]).squaredNorm();
    force_N2 += written_N[i].squaredNorm();
  }
  return 100.0 * std::sqrt(error_N2 / force_N2);
}

const ModelTrial& trial_of(const ModelChoice& choice, const std::string& model) {
  const auto found = std::find_if(choice.trials.begin(), choice.trials.end(),
                                  [&model](const ModelTrial& t) { return t.model == model; });
  EXPECT_NE(found, choice.trials.end()) << model;
  return found == choice.trials.end() ? choice.trials.front() : *found;
}

TEST(ModelChoice, ErrorsAreThoseOfTheModelsConvergedForces) {
  const Scene scene = block(ElementModel::kStVenantKirchhoff);
  const ModelChoice choice = choose_model(scene, options(100.0, ElementModel::kStVenantKirchhoff));
  ASSERT_EQ(choice.trials.size(), 12U);  // two energies, three meshes, two solvers
  EXPECT_TRUE(choice.left_out.empty());
  SpringMesh corotated = scene.mesh;
  corotated.materials = {soft(ElementModel::kCorotated, 0.4)};
  const double by_energy = error_percent(corotated, scene);
  EXPECT_GT(by_energy, 0.1);  // else this shows nothing
  EXPECT_NEAR(trial_of(choice, "corotated, 1920 elements, quasi_static").error_percent, by_energy,
              0.02);
  const SpringMesh coarse =
      element_block({4, 4, 3}, 0.012, soft(ElementModel::kStVenantKirchhoff, 0.4));
  EXPECT_NEAR(trial_of(choice, "stvk, 288 elements, quasi_static").error_percent,
              error_percent(coarse, scene), 0.02);
  EXPECT_LT(trial_of(choice, "stvk, 1920 elements, quasi_static").error_percent, 0.02);
}

TEST(ModelChoice, TakesTheCheapestWithinTheTolerance) {
  const Scene scene = block(ElementModel::kNeoHookean);
  for (const double tolerance_percent : {0.05, 3.0, 100.0}) {
    const ModelChoice choice =
        choose_model(scene, options(tolerance_percent, ElementModel::kNeoHookean));
    EXPECT_TRUE(choice.within);
    const ModelTrial& chosen = choice.trials[choice.chosen];
    EXPECT_LE(chosen.error_percent, tolerance_percent);
    const double written_ms = trial_of(choice, "neo_hookean, 1920 elements, quasi_static").mean_ms;
    for (std::size_t k = 0; k < choice.chosen; ++k) {
      EXPECT_LE(choice.trials[k].mean_ms, chosen.mean_ms);
      EXPECT_TRUE(choice.trials[k].error_percent > tolerance_percent ||
                  choice.trials[k].mean_ms >= 0.9 * written_ms);
    }
    EXPECT_THAT(choice.why, HasSubstr(chosen.model));
    EXPECT_EQ(std::to_string(choice.mesh.tetrahedra.size()),
              chosen.model.substr(13, chosen.model.find(" elements") - 13))
        << chosen.model;
  }
  // An eighth of the elements costs less, whatever the machine does.
  const ModelChoice any = choose_model(scene, options(100.0, ElementModel::kNeoHookean));
  EXPECT_LT(any.mesh.tetrahedra.size(), scene.mesh.tetrahedra.size());
  EXPECT_THAT(any.why, HasSubstr("which takes"));
}

TEST(ModelChoice, KeepsTheSceneIfNothingIsWithinAndSaysSo) {
  const ModelChoice choice =
      choose_model(block(ElementModel::kNeoHookean), options(1e-9, ElementModel::kNeoHookean));
  EXPECT_FALSE(choice.within);
  EXPECT_EQ(choice.trials[choice.chosen].model, "neo_hookean, 1920 elements, quasi_static");
  EXPECT_THAT(choice.why, HasSubstr("no model is within"));
}

TEST(ModelChoice, NamesTheModelsThatCannotBeMade) {
  ModelOptions o = options(100.0, ElementModel::kNeoHookean);
  o.solver = SolverKind::kQuasiStatic;
  o.coarser = [](Fineness) -> SpringMesh { throw Error("Gmsh is not there"); };
  const ModelChoice choice = choose_model(block(ElementModel::kNeoHookean), o);
  EXPECT_EQ(choice.trials.size(), 2U);
  EXPECT_EQ(choice.solver, SolverKind::kQuasiStatic);
  ASSERT_EQ(choice.left_out.size(), 2U);
  EXPECT_EQ(choice.left_out[0], "edges 1.5 times as long: Gmsh is not there");
  EXPECT_EQ(choice.left_out[1], "edges 2 times as long: Gmsh is not there");
}

TEST(ModelChoice, RefusesSpringsAndOtherSolvers) {
  const auto refusal = [](const Scene& scene, const ModelOptions& o) -> std::string {
    try {
      choose_model(scene, o);
    } catch (const Error& error) {
      return error.what();
    }
    return "it was accepted";
  };
  EXPECT_THAT(refusal(make_scene("small"), options(1.0, ElementModel::kNeoHookean)),
              HasSubstr("no finite elements"));
  const Scene scene = block(ElementModel::kNeoHookean);
  ModelOptions o = options(1.0, ElementModel::kNeoHookean);
  o.solver = SolverKind::kTwoRates;
  EXPECT_THAT(refusal(scene, o), HasSubstr("quasi_static and local"));
  EXPECT_THAT(refusal(scene, options(0.0, ElementModel::kNeoHookean)), HasSubstr("more than 0"));
}

}  // namespace
}  // namespace forcegrid::simulator
