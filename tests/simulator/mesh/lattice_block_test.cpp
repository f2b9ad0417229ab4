// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/lattice_block.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {
namespace {

using ::testing::HasSubstr;

// Looks the other way round from the generator: from the distance between the ends.
std::map<int, int> springs_by_moved_axes(const SpringMesh& mesh) {
  std::map<int, int> count;
  for (const Spring& spring : mesh.springs) {
    const Eigen::Vector3d d = mesh.rest_position_W[static_cast<std::size_t>(spring.a)] -
                              mesh.rest_position_W[static_cast<std::size_t>(spring.b)];
    ++count[static_cast<int>((d.array().abs() > 1e-9).count())];
  }
  return count;
}

TEST(LatticeBlock, DefaultHasTheCountsOfTheSceneBlock) {
  const SpringMesh mesh = make_lattice_block({});
  EXPECT_EQ(mesh.rest_position_W.size(), 10'164U);
  EXPECT_EQ(mesh.springs.size(), 84'566U);
  const auto count = springs_by_moved_axes(mesh);
  ASSERT_EQ(count.size(), 2U);
  EXPECT_EQ(count.at(1), 29'084);  // 21*22*21 + 22*21*21 + 22*22*20
  EXPECT_EQ(count.at(2), 55'482);  // 2 (21*21*21 + 2 * 21*22*20)
}

TEST(LatticeBlock, SmallSceneHasItsCounts) {
  const Scene scene = make_scene("small");
  EXPECT_EQ(scene.mesh.rest_position_W.size(), 1'089U);
  EXPECT_EQ(scene.mesh.springs.size(), 8'268U);
  EXPECT_EQ(scene.mesh.laws.front().cubic_coefficient, 5.0);
}

TEST(LatticeBlock, AnySizeFollowsTheFormula) {
  LatticeBlockOptions options;
  options.vertex_count = {2, 3, 5};
  const SpringMesh mesh = make_lattice_block(options);
  EXPECT_EQ(mesh.rest_position_W.size(), 30U);
  const auto count = springs_by_moved_axes(mesh);
  EXPECT_EQ(count.at(1), 1 * 3 * 5 + 2 * 2 * 5 + 2 * 3 * 4);
  EXPECT_EQ(count.at(2), 2 * (1 * 2 * 5 + 1 * 3 * 4 + 2 * 2 * 4));
}

TEST(LatticeBlock, FillsItsBoxBelowTheTopCentreAndFixesTheBottom) {
  LatticeBlockOptions options;
  options.vertex_count = {3, 4, 5};
  options.size_m = {0.02, 0.06, 0.1};
  options.top_centre_W = {1.0, 2.0, 3.0};
  const SpringMesh mesh = make_lattice_block(options);
  Eigen::Array3d low = mesh.rest_position_W[0].array();
  Eigen::Array3d high = low;
  for (std::size_t i = 0; i < mesh.rest_position_W.size(); ++i) {
    low = low.min(mesh.rest_position_W[i].array());
    high = high.max(mesh.rest_position_W[i].array());
    EXPECT_EQ(mesh.fixed[i] != 0, mesh.rest_position_W[i].z() < 2.9 + 1e-9) << i;
  }
  EXPECT_TRUE(low.isApprox(Eigen::Array3d(0.99, 1.97, 2.9), 1e-12)) << low.transpose();
  EXPECT_TRUE(high.isApprox(Eigen::Array3d(1.01, 2.03, 3.0), 1e-12)) << high.transpose();
  EXPECT_EQ(mesh.top_W, options.top_centre_W);
}

TEST(LatticeBlock, ItsSurfaceIsClosedAndHoldsItsVolumeWithNormalsOutward) {
  LatticeBlockOptions options;
  options.vertex_count = {3, 4, 5};
  options.size_m = {0.02, 0.06, 0.1};
  const SpringMesh mesh = make_lattice_block(options);
  std::map<std::pair<int, int>, int> directed_edges;
  std::set<int> used;
  double volume_m3 = 0.0;
  for (const auto& triangle : mesh.triangles) {
    const auto at = [&](std::size_t k) {
      return mesh.rest_position_W[static_cast<std::size_t>(triangle[k])];
    };
    volume_m3 += at(0).dot(at(1).cross(at(2))) / 6.0;
    for (std::size_t k = 0; k < 3; ++k) {
      ++directed_edges[{triangle[k], triangle[(k + 1) % 3]}];
      used.insert(triangle[k]);
    }
  }
  for (const auto& [edge, count] : directed_edges) {
    EXPECT_EQ(count, 1);
    EXPECT_TRUE(directed_edges.contains({edge.second, edge.first}));
  }
  // Euler's V - E + F of a sphere.
  EXPECT_EQ(static_cast<int>(used.size()) - static_cast<int>(directed_edges.size() / 2) +
                static_cast<int>(mesh.triangles.size()),
            2);
  EXPECT_NEAR(volume_m3, 0.02 * 0.06 * 0.1, 1e-15);  // divergence theorem; rounding only
}

TEST(LatticeBlock, RandomNumbersAreThoseOfTheReferenceSplitMix64) {
  // The published first outputs for the seed 1234567 (Rosetta Code, "Pseudo-random numbers/
  // Splitmix64"), of which the top 53 bits are used.
  const std::uint64_t reference[] = {6457827717110365317ULL, 3203168211198807973ULL,
                                     9817491932198370423ULL, 4593380528125082431ULL,
                                     16408922859458223821ULL};
  for (std::uint64_t i = 0; i < 5; ++i) {
    const double unit = static_cast<double>(reference[i] >> 11) / 9007199254740992.0;  // 2^53
    EXPECT_EQ(spring_random(1234567, i), 2.0 * unit - 1.0) << i;
  }
}

TEST(LatticeBlock, StiffnessesSpreadAsAskedAndComeFromTheSeed) {
  LatticeBlockOptions options;
  options.vertex_count = {6, 6, 6};
  const SpringMesh mesh = make_lattice_block(options);
  options.seed = 2;
  const SpringMesh other = make_lattice_block(options);
  double sum = 0.0;
  double low = 1e9;
  double high = 0.0;
  int differ = 0;
  for (std::size_t s = 0; s < mesh.springs.size(); ++s) {
    const Spring& spring = mesh.springs[s];
    const Eigen::Vector3d d = mesh.rest_position_W[static_cast<std::size_t>(spring.a)] -
                              mesh.rest_position_W[static_cast<std::size_t>(spring.b)];
    const bool diagonal = (d.array().abs() > 1e-9).count() == 2;
    const double factor = spring.stiffness_N_per_m / (diagonal ? 7.0 : 10.0);
    EXPECT_EQ(spring.stiffness_N_per_m,
              10.0 * (diagonal ? 0.7 : 1.0) * (1.0 + 0.3 * spring_random(1, s)));
    sum += factor;
    low = std::min(low, factor);
    high = std::max(high, factor);
    differ += spring.stiffness_N_per_m != other.springs[s].stiffness_N_per_m ? 1 : 0;
  }
  const auto count = static_cast<double>(mesh.springs.size());
  EXPECT_NEAR(sum / count, 1.0, 4.0 * 0.3 / std::sqrt(3.0 * count));  // four standard errors
  EXPECT_GE(low, 0.7);
  EXPECT_LT(low, 0.71);
  EXPECT_LT(high, 1.3);
  EXPECT_GT(high, 1.29);
  EXPECT_EQ(differ, static_cast<int>(mesh.springs.size()));
}

std::string message_of(const LatticeBlockOptions& options) {
  try {
    make_lattice_block(options);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(LatticeBlock, RefusesOptionsOutOfRangeByName) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  LatticeBlockOptions options;
  options.vertex_count[1] = 1;
  EXPECT_THAT(message_of(options), HasSubstr("1 vertices along y"));
  options = {};
  options.vertex_count = {1000, 1000, 1000};
  EXPECT_THAT(message_of(options), HasSubstr("at most"));
  options = {};
  options.size_m.z() = 0.0;
  EXPECT_THAT(message_of(options), HasSubstr("size along z"));
  options = {};
  options.stiffness_N_per_m = nan;
  EXPECT_THAT(message_of(options), HasSubstr("stiffness_N_per_m"));
  options = {};
  options.random_spread = 1.0;
  EXPECT_THAT(message_of(options), HasSubstr("random_spread"));
  options = {};
  options.law.cubic_coefficient = -1.0;
  EXPECT_THAT(message_of(options), HasSubstr("cubic_coefficient"));
  options = {};
  options.top_centre_W.x() = nan;
  EXPECT_THAT(message_of(options), HasSubstr("top_centre_W"));
}

TEST(SpringMesh, RefusesMeshesThatCannotBeSolved) {
  SpringMesh good;
  good.rest_position_W = {{0, 0, 0}, {0, 0, 1}};
  good.fixed = {1, 0};
  good.springs = {{0, 1, 10.0}};
  EXPECT_NO_THROW(check(good));
  const auto message = [](const SpringMesh& mesh) -> std::string {
    try {
      check(mesh);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  SpringMesh bad = good;
  bad.fixed = {0, 0};
  EXPECT_THAT(message(bad), HasSubstr("no vertex is fixed"));
  bad = good;
  bad.fixed = {1};
  EXPECT_THAT(message(bad), HasSubstr("'fixed'"));
  bad = good;
  bad.springs[0].b = 2;
  EXPECT_THAT(message(bad), HasSubstr("spring 0 joins vertices 0 and 2"));
  bad = good;
  bad.springs[0].stiffness_N_per_m = -1.0;
  EXPECT_THAT(message(bad), HasSubstr("stiffness"));
  bad = good;
  bad.rest_position_W[1].setZero();
  EXPECT_THAT(message(bad), HasSubstr("no length"));
  bad = good;
  bad.rest_position_W.emplace_back(1, 1, 1);
  bad.fixed.push_back(0);
  EXPECT_THAT(message(bad), HasSubstr("free vertex 2 has no spring"));
  bad = good;
  bad.springs.clear();
  EXPECT_THAT(message(bad), HasSubstr("0 springs"));
}

}  // namespace
}  // namespace forcegrid::simulator
