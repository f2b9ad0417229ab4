// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/gravity.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/rest_surface.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kGravity_m_per_s2 = 9.81;

// Three vertices below one another, 0.1 m apart, the uppermost fixed.
SpringMesh hanging_chain() {
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, 0}, {0, 0, -0.1}, {0, 0, -0.2}};
  mesh.fixed = {1, 0, 0};
  mesh.springs = {{0, 1, 40.0}, {1, 2, 10.0}};
  return mesh;
}

TEST(Gravity, AHangingChainStretchesByTheWeightBelow) {
  SpringMesh mesh = hanging_chain();
  // Equal lengths: a quarter, half and a quarter of the mass on the three vertices.
  settle_under_gravity(mesh, 0.04, kGravity_m_per_s2);
  const double lower_m = 0.01 * kGravity_m_per_s2 / 10.0;
  const double upper_m = 0.03 * kGravity_m_per_s2 / 40.0;
  EXPECT_NEAR(mesh.rest_position_W[1].z(), -0.1 - upper_m, 1e-8);
  EXPECT_NEAR(mesh.rest_position_W[2].z(), -0.2 - upper_m - lower_m, 1e-8);
  EXPECT_EQ(mesh.rest_position_W[0], Vector3d(0, 0, 0));
  EXPECT_NO_THROW(check(mesh));
}

TEST(Gravity, HomeSpringsBearTheirShare) {
  SpringMesh mesh;
  mesh.rest_position_W = {{0, 0, 0}, {0, 0, -0.1}};
  mesh.fixed = {1, 0};
  mesh.springs = {{0, 1, 15.0}};
  mesh.home_stiffness_N_per_m = {0.0, 5.0};
  settle_under_gravity(mesh, 0.02, kGravity_m_per_s2);
  // Half of the mass hangs from two springs side by side.
  EXPECT_NEAR(mesh.rest_position_W[1].z(), -0.1 - 0.01 * kGravity_m_per_s2 / 20.0, 1e-8);
  EXPECT_NO_THROW(check(mesh));
}

TEST(Gravity, ABlockSinksKeepsItsTopInPlaceAndPushesNobodyAtRest) {
  LatticeBlockOptions options;
  options.vertex_count = {8, 8, 7};
  options.stiffness_N_per_m = 20.0;
  options.law.cubic_coefficient = 5.0;
  options.top_centre_W = {0.02, 0.01, 0.03};
  const SpringMesh weightless = make_lattice_block(options);
  SpringMesh mesh = weightless;
  settle_under_gravity(mesh, 0.1, kGravity_m_per_s2);
  ASSERT_NO_THROW(check(mesh));
  EXPECT_NEAR(*RestSurface(mesh).look(mesh.top_W + Vector3d(0, 0, 0.5)).below_m, 0.5, 1e-9);
  double height_before_m = 0.0;
  double height_m = 0.0;
  Vector3d ground_N = Vector3d::Zero();
  Vector3d weight_N = Vector3d::Zero();
  const auto forces_W = vertex_forces_W(mesh, mesh.rest_position_W);
  for (std::size_t i = 0; i < mesh.fixed.size(); ++i) {
    if (mesh.fixed[i] != 0) {
      ground_N += forces_W[i];
      height_before_m = weightless.top_W.z() - weightless.rest_position_W[i].z();
      height_m = mesh.top_W.z() - mesh.rest_position_W[i].z();
    }
    weight_N += mesh.load_W_N[i];
  }
  EXPECT_LT(height_m, height_before_m - 1e-4) << "it did not sink";
  EXPECT_LT((ground_N - weight_N).norm(), 1e-6) << "the ground bears all of it";
  ElasticObject<double> object(mesh, {.relative_tolerance = 1e-6});
  ASSERT_GT(object.grab(mesh.top_W, 0.015), 0);
  EXPECT_LT(object.move_to(Vector3d::Zero()).force_W.norm(), 1e-6);
  const double loaded_N = object.move_to({0, 0, -0.003}).force_W.z();
  EXPECT_GT(loaded_N, 0.0);
}

TEST(Gravity, RefusesWhatHasNoRest) {
  SpringMesh mesh = hanging_chain();
  EXPECT_THROW(settle_under_gravity(mesh, 0.0, kGravity_m_per_s2), Error);
  EXPECT_THROW(settle_under_gravity(mesh, 1.0, -1.0), Error);
}

class GravityScene : public ::testing::Test {
 protected:
  std::string problem_of(const std::string& gravity, const std::string& mass) const {
    const auto file = std::filesystem::temp_directory_path() /
                      ("forcegrid_gravity_" + std::to_string(::getpid()) + ".toml");
    std::ofstream(file) << "description = \"a block\"\n"
                        << gravity
                        << "[[object]]\nshape = \"block\"\nvertex_count = [5, 5, 4]\n"
                           "size_m = [0.05, 0.05, 0.04]\nstiffness_N_per_m = 20.0\n"
                           "law = \"linear\"\n"
                        << mass;
    std::string problem;
    try {
      make_scene(file.string());
    } catch (const Error& error) {
      problem = error.what();
    }
    std::filesystem::remove(file);
    return problem;
  }
};

TEST_F(GravityScene, GravityNeedsMassesAndDampingDoes) {
  const std::string gravity = "gravity_m_per_s2 = 9.81\n";
  EXPECT_EQ(problem_of(gravity, "mass_kg = 0.05\n"), "");
  EXPECT_EQ(problem_of("", ""), "");
  EXPECT_EQ(problem_of("", "mass_kg = 0.05\nretardation_time_s = 0.02\nmass_damping_per_s = 1\n"),
            "");
  EXPECT_THAT(problem_of(gravity, ""), HasSubstr("mass_kg"));
  EXPECT_THAT(problem_of("", "retardation_time_s = 0.02\n"),
              HasSubstr("give the object a mass_kg"));
  EXPECT_THAT(problem_of("", "mass_damping_per_s = 1\n"), HasSubstr("give the object a mass_kg"));
  EXPECT_THAT(problem_of("", "mass_kg = 0.05\nretardation_time_s = -1\n"),
              HasSubstr("retardation_time_s"));
  EXPECT_THAT(problem_of("",
                         "mass_kg = 0.05\n[[object]]\nshape = \"block\"\n"
                         "vertex_count = [3, 3, 3]\nsize_m = [0.02, 0.02, 0.02]\n"
                         "stiffness_N_per_m = 20.0\nlaw = \"linear\"\n"),
              HasSubstr("give it to every [[object]]"));
  EXPECT_THAT(problem_of(gravity, "mass_kg = -1\n"), HasSubstr("mass_kg"));
  EXPECT_THAT(problem_of("gravity_m_per_s2 = 1000\n", "mass_kg = 1\n"),
              HasSubstr("gravity_m_per_s2"));
}

}  // namespace
}  // namespace forcegrid::simulator
