// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "simulator/kernels/spring_table.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/region.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

SolverOptions local(double border_tolerance) {
  return {.relative_tolerance = 1e-4, .border_tolerance = border_tolerance};
}

SpringMesh little_block() {
  LatticeBlockOptions options;
  options.vertex_count = {12, 12, 9};
  options.law.cubic_coefficient = 5.0;
  return make_lattice_block(options);
}

// An anchored surface: what the tool does to it fades within some rings.
const Scene& stomach() {
  static const Scene scene = make_scene("stomach");
  return scene;
}

TEST(Region, NumbersThePatchFirstAndEverySpringLeadsAtMostOneLevelOn) {
  const SpringMesh mesh = little_block();
  SpringTable<float> table = make_spring_table<float>(mesh);
  const auto vertices = static_cast<std::int32_t>(mesh.rest_position_W.size());
  Region region(vertices);
  const std::vector<std::int32_t> patch{700, 701, 713};
  const std::vector<std::int32_t> order = region.number_around(patch, table.rows);
  EXPECT_TRUE(std::equal(patch.begin(), patch.end(), order.begin()));
  std::vector<std::int32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  for (std::int32_t i = 0; i < vertices; ++i) {
    ASSERT_EQ(sorted[static_cast<std::size_t>(i)], i);
  }
  renumber_springs(order, table.rows, table.constants);
  for (int levels = 1; levels <= region.levels(); ++levels) {
    region.set(levels, Vector3d::Zero(), table.rows);
    EXPECT_LE(region.solved_vertices(), table.rows.active);
    EXPECT_LE(table.rows.active, table.rows.reach);
    for (std::int32_t s = 0; s < table.rows.row_begin[static_cast<std::size_t>(table.rows.active)];
         ++s) {
      const std::int32_t other = table.rows.other[static_cast<std::size_t>(s)];
      ASSERT_LT(table.rows.owner[static_cast<std::size_t>(s)], other);
      ASSERT_LT(other, table.rows.reach);
    }
  }
  EXPECT_TRUE(region.is_whole());
  EXPECT_EQ(table.rows.active, vertices);
}

TEST(Region, IsLimitedToWholeRingsOfAtMostSoManyVertices) {
  const SpringMesh mesh = little_block();
  SpringTable<float> table = make_spring_table<float>(mesh);
  Region region(table.rows.vertex_count());
  region.number_around({700, 701, 713}, table.rows);
  const int all = region.levels();
  EXPECT_EQ(region.limited(all, 0), all) << "0 is no limit";
  EXPECT_EQ(region.limited(2, 100'000), 2);
  EXPECT_EQ(region.limited(all, 1), 1) << "the patch stays";
  const int levels = region.limited(all, 400);
  region.set(levels, Vector3d::Zero(), table.rows);
  EXPECT_LE(region.solved_vertices(), 400);
  region.set(levels + 1, Vector3d::Zero(), table.rows);
  EXPECT_GT(region.solved_vertices(), 400);
}

TEST(Region, RenumberedSpringsKeepTheirEndsAndConstants) {
  const SpringMesh mesh = little_block();
  SpringTable<double> table = make_spring_table<double>(mesh);
  const SpringTable<double> before = table;
  Region region(table.rows.vertex_count());
  const std::vector<std::int32_t> order = region.number_around({650}, table.rows);
  renumber_springs(order, table.rows, table.constants);
  const auto key = [](const SpringTable<double>& t, std::size_t s,
                      const std::vector<std::int32_t>* names) {
    const auto name = [names](std::int32_t i) {
      return names == nullptr ? i : (*names)[static_cast<std::size_t>(i)];
    };
    const auto [a, b] = std::minmax({name(t.rows.owner[s]), name(t.rows.other[s])});
    return std::tuple{a, b, t.constants[s].scale_N, t.constants[s].inverse_length_per_m};
  };
  std::vector<std::tuple<int, int, double, double>> was;
  std::vector<std::tuple<int, int, double, double>> is;
  for (std::size_t s = 0; s < before.springs; ++s) {
    was.push_back(key(before, s, nullptr));
    is.push_back(key(table, s, &order));
  }
  std::sort(was.begin(), was.end());
  std::sort(is.begin(), is.end());
  EXPECT_EQ(was, is);
}

TEST(LocalSolver, FindsTheForceOfAnAnchoredSurfaceFromAPartOfIt) {
  const Scene& scene = stomach();
  ElasticObject<double> reference(scene.mesh, {.relative_tolerance = 1e-7});
  ElasticObject<float> object(scene.mesh, local(1e-3));
  ASSERT_EQ(object.grab(scene.mesh.top_W, scene.patch_radius_m),
            reference.grab(scene.mesh.top_W, scene.patch_radius_m));
  EXPECT_EQ(object.patch(), reference.patch());
  for (int step = 1; step <= 10; ++step) {
    const Vector3d at_W(0.0002 * step, -0.0001 * step, 0.0004 * step);
    const Equilibrium answer = object.move_to(at_W);
    const Vector3d expected_W = reference.move_to(at_W).force_W;
    EXPECT_TRUE(answer.converged) << step;
    EXPECT_LT((answer.force_W - expected_W).norm(), 5e-3 * expected_W.norm()) << step;
    EXPECT_LE(answer.border_work_N, 1e-3 * std::max(answer.force_W.norm(), 0.05));
    EXPECT_LT(answer.vertices, 3000) << step;
  }
}

TEST(LocalSolver, TheRegionGrowsWithWhatIsDisturbedAndShrinksAgain) {
  const Scene& scene = stomach();
  ElasticObject<float> object(scene.mesh, local(3e-3));
  object.grab(scene.mesh.top_W, scene.patch_radius_m);
  const int little = object.move_to({0.0, 0.0, 0.0005}).vertices;
  int largest = 0;
  for (int step = 1; step <= 20; ++step) {
    largest = std::max(largest, object.move_to({0.0, 0.0, 0.001 * step}).vertices);
  }
  int last = 0;
  for (int step = 0; step < 80; ++step) {
    last = object.move_to({0.0, 0.0, 0.0005}).vertices;
  }
  EXPECT_GT(largest, 2 * little);
  EXPECT_LT(last, largest);
}

TEST(LocalSolver, KeepsTheMeshsNumberingAndTheRestOfTheObjectFollows) {
  const SpringMesh mesh = little_block();
  ElasticObject<double> whole(mesh, {.relative_tolerance = 1e-6});
  ElasticObject<double> part(mesh, local(0.5));
  const Vector3d at_W(0.001, 0.0, 0.002);
  whole.grab(Vector3d::Zero(), 0.012);
  part.grab(Vector3d::Zero(), 0.012);
  const Equilibrium answer = part.move_to(at_W);
  whole.move_to(at_W);
  ASSERT_LT(answer.vertices, static_cast<int>(mesh.rest_position_W.size())) << "nothing was left";
  const auto expected_W = whole.positions_W();
  const auto found_W = part.positions_W();
  for (std::size_t i = 0; i < expected_W.size(); ++i) {
    // S at rest gives what lies outside; a tenth of the tool's way covers how the law bends.
    EXPECT_LT((found_W[i] - expected_W[i]).norm(), 0.1 * at_W.norm()) << i;
    if (mesh.fixed[i] != 0) {
      EXPECT_EQ(found_W[i], mesh.rest_position_W[i]);
    }
  }
  for (const std::int32_t i : part.patch()) {
    const auto at = static_cast<std::size_t>(i);
    EXPECT_LT((found_W[at] - mesh.rest_position_W[at] - at_W).norm(), 1e-12);
    EXPECT_LT((part.sensitivity(at) - Eigen::Matrix3d::Identity()).norm(), 1e-6);
  }
}

TEST(LocalSolver, WithABorderThatMayHaveNothingItSolvesTheWholeObject) {
  const SpringMesh mesh = little_block();
  ElasticObject<double> whole(mesh, {.relative_tolerance = 1e-7});
  SolverOptions options = local(1e-12);
  options.relative_tolerance = 1e-7;
  ElasticObject<double> part(mesh, options);
  whole.grab(Vector3d::Zero(), 0.012);
  part.grab(Vector3d::Zero(), 0.012);
  for (int step = 1; step <= 5; ++step) {
    const Vector3d at_W(0.001 * step, 0.0, 0.002 * step);
    const Equilibrium answer = part.move_to(at_W);
    const Vector3d expected_W = whole.move_to(at_W).force_W;
    EXPECT_EQ(answer.vertices, static_cast<int>(mesh.rest_position_W.size()));
    EXPECT_LT((answer.force_W - expected_W).norm(), 1e-5 * expected_W.norm());
  }
}

TEST(LocalSolver, StaysWithinItsVerticesIfTheyAreLimited) {
  const SpringMesh mesh = little_block();
  SolverOptions options = local(1e-3);  // without a limit it would grow to the whole block
  options.most_vertices = 300;
  ElasticObject<float> object(mesh, options);
  object.grab(Vector3d::Zero(), 0.012);
  const std::vector<std::int32_t> neighbourhood = object.neighbourhood();
  EXPECT_LT(neighbourhood.size(), mesh.rest_position_W.size());
  double border_work_N = 0.0;
  double force_N = 0.0;
  for (int cycle = 1; cycle <= 24; ++cycle) {
    const Equilibrium answer = object.move_to({0.0, 1e-4 * cycle, 2e-4 * cycle});
    EXPECT_LT(answer.vertices, static_cast<int>(neighbourhood.size())) << cycle;
    border_work_N = answer.border_work_N;
    force_N = answer.force_W.norm();
  }
  EXPECT_GT(border_work_N, 1e-3 * force_N) << "the limit was of no importance";
}

// Copies of one object at one place, given to another one that stands elsewhere.
template <typename Real>
void expect_corrected_by_the_difference() {
  const SpringMesh mesh = little_block();
  SolverOptions options = local(1e-3);
  options.most_vertices = 300;
  ElasticObject<Real> part(mesh, options);
  ElasticObject<float> whole(mesh, {.relative_tolerance = 1e-5});
  part.grab(Vector3d::Zero(), 0.012);
  whole.grab(Vector3d::Zero(), 0.012);
  const std::vector<std::int32_t> vertices = part.neighbourhood();
  Neighbourhood was{.vertices = std::vector<Neighbourhood::Vertex>(vertices.size())};
  Neighbourhood is = was;
  const Vector3d asked_W(0.0, 0.001, 0.004);
  part.move_to(asked_W);
  part.copy(vertices, was);
  part.move_to({0.0, 0.001, 0.005});
  const std::vector<Vector3d> before_W = part.positions_W();
  whole.move_to(asked_W);
  whole.copy(vertices, is);
  EXPECT_EQ(is.displacement_W, asked_W);
  part.correct(was, is);
  const std::vector<Vector3d> after_W = part.positions_W();
  const Vector3d step_W(0.0, 0.0, 0.001);
  double most_m = 0.0;
  for (std::size_t n = 0; n < vertices.size(); ++n) {
    const auto at = static_cast<std::size_t>(vertices[n]);
    const Vector3d by = (is.vertices[n].position_W - was.vertices[n].position_W).cast<double>();
    const Eigen::Matrix3d s =
        (is.vertices[n].sensitivity_W - was.vertices[n].sensitivity_W).cast<double>();
    const Vector3d found = after_W[at] - before_W[at];
    EXPECT_LT((found - by - s * step_W).norm(), 1e-7) << n;
    most_m = std::max(most_m, found.norm());
  }
  EXPECT_GT(most_m, 1e-5) << "nothing was to be corrected";
}

TEST(LocalSolver, IsCorrectedByWhatAnotherObjectFoundWhereItWas) {
  expect_corrected_by_the_difference<float>();
  expect_corrected_by_the_difference<double>();
}

TEST(LocalSolver, ForgetsItsRegionWhenItLetsGo) {
  const Scene& scene = stomach();
  ElasticObject<float> object(scene.mesh, local(1e-3));
  object.grab(scene.mesh.top_W, scene.patch_radius_m);
  const Equilibrium first = object.move_to({0.0, 0.0, 0.001});
  object.move_to({0.0, 0.003, 0.006});
  object.release();
  ASSERT_GT(object.grab(scene.mesh.top_W, scene.patch_radius_m), 0);
  const Equilibrium again = object.move_to({0.0, 0.0, 0.001});
  EXPECT_LT((again.force_W - first.force_W).norm(), 1e-4 * first.force_W.norm());
  for (std::size_t i = 0; i < scene.mesh.fixed.size(); ++i) {
    if (scene.mesh.fixed[i] != 0) {
      EXPECT_LT((object.positions_W()[i] - scene.mesh.rest_position_W[i]).norm(), 1e-8);
      break;
    }
  }
}

TEST(LocalSolver, RefusesANegativeBorderToleranceAndALimitWithoutABorder) {
  EXPECT_THROW(ElasticObject<float>(little_block(), local(-0.1)), Error);
  EXPECT_THROW(ElasticObject<float>(little_block(), {.most_vertices = 100}), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
