// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/force_grid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr unsigned kSeed = 7;

GridGeometry uneven_box() {
  GridGeometry geometry;
  geometry.min_W = Vector3d(-0.06, -0.08, -0.05);
  geometry.max_W = Vector3d(0.06, 0.08, 0.07);
  geometry.cells = Vector3i(12, 20, 9);
  return geometry;
}

RadialWeight weighting_of(double radius_m) {
  RadialWeight weighting;
  weighting.influence_radius_m = radius_m;
  return weighting;
}

// Reaches one vertex only: less than half a spacing.
RadialWeight narrow_weighting() { return weighting_of(0.004); }

using DenseGrid = ForceGrid<DenseStorage<ForceSegment>>;
using BlockGrid = ForceGrid<BlockStorage<ForceSegment>>;

template <typename Grid>
Grid make_grid(const GridGeometry& geometry, const RadialWeight& weighting);

template <>
DenseGrid make_grid(const GridGeometry& geometry, const RadialWeight& weighting) {
  return {geometry, weighting, DenseStorage<ForceSegment>(geometry.cells.array() + 1, false)};
}

template <>
BlockGrid make_grid(const GridGeometry& geometry, const RadialWeight& weighting) {
  const Eigen::Vector3i vertices = geometry.cells.array() + 1;
  return {geometry, weighting,
          BlockStorage<ForceSegment>(vertices, false,
                                     BlockStorage<ForceSegment>::block_count(vertices))};
}

template <typename Grid>
class ForceGrids : public testing::Test {};
using Grids = testing::Types<DenseGrid, BlockGrid>;
TYPED_TEST_SUITE(ForceGrids, Grids);

Sample sample_of(const Vector3d& position_W, const Vector3d& force_W) {
  Sample sample;
  sample.position_W = position_W;
  sample.force_W = force_W;
  return sample;
}

template <typename Grid>
void fill_whole(Grid& grid, const Sample& sample, bool with_stiffness = false) {
  ASSERT_TRUE(grid.inside(sample.position_W));
  GridFill fill = grid.begin_fill(sample, with_stiffness);
  while (!grid.finished(fill)) {
    grid.continue_fill(fill, 1000);
  }
}

// Gives every vertex a force of its own: with r below half the spacing and a sample exactly on the
// vertex, that vertex alone is filled and holds exactly that force.
template <typename Grid, typename ForceAt>
void fill_vertices(Grid& grid, ForceAt force_at) {
  const GridGeometry& g = grid.geometry();
  for (int i = 0; i <= g.cells.x(); ++i) {
    for (int j = 0; j <= g.cells.y(); ++j) {
      for (int k = 0; k <= g.cells.z(); ++k) {
        const Vector3d at =
            (g.min_W + Vector3d(i, j, k).cwiseProduct(g.spacing_m())).cwiseMin(g.max_W);
        fill_whole(grid, sample_of(at, force_at(i, j, k)));
      }
    }
  }
}

Vector3d vertex_force(int i, int j, int k) {
  // Any numbers without structure; their sines are as good as random and need no table.
  return {std::sin(1.0 + 12.9898 * i + 78.233 * j + 37.719 * k),
          std::sin(2.0 + 39.3468 * i + 11.135 * j + 83.155 * k),
          std::sin(3.0 + 73.1560 * i + 52.235 * j + 9.151 * k)};
}

TYPED_TEST(ForceGrids, GivesThePapersExpandedPolynomial) {
  SCOPED_TRACE(kSeed);
  TypeParam grid = make_grid<TypeParam>(uneven_box(), narrow_weighting());
  fill_vertices(grid, vertex_force);
  const GridGeometry& g = grid.geometry();
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int trial = 0; trial < 2000; ++trial) {
    const Vector3d at =
        g.min_W +
        Vector3d(unit(random), unit(random), unit(random)).cwiseProduct(g.max_W - g.min_W);
    const Vector3d cells = (at - g.min_W).cwiseQuotient(g.spacing_m());
    const int i = static_cast<int>(cells.x());
    const int j = static_cast<int>(cells.y());
    const int k = static_cast<int>(cells.z());
    const double x = cells.x() - i;
    const double y = cells.y() - j;
    const double z = cells.z() - k;
    // Paper, Figure 3: F1..F8 at (0,0,0) (1,0,0) (0,1,0) (0,0,1) (1,1,0) (1,0,1) (0,1,1) (1,1,1).
    const Vector3d f1 = vertex_force(i, j, k), f2 = vertex_force(i + 1, j, k);
    const Vector3d f3 = vertex_force(i, j + 1, k), f4 = vertex_force(i, j, k + 1);
    const Vector3d f5 = vertex_force(i + 1, j + 1, k), f6 = vertex_force(i + 1, j, k + 1);
    const Vector3d f7 = vertex_force(i, j + 1, k + 1), f8 = vertex_force(i + 1, j + 1, k + 1);
    const Vector3d expected = f1 + x * (f2 - f1) + y * (f3 - f1) + z * (f4 - f1) +
                              x * y * (f5 - f3 - f2 + f1) + x * z * (f6 - f4 - f2 + f1) +
                              y * z * (f7 - f4 - f3 + f1) +
                              x * y * z * (f8 - f7 - f6 - f5 + f4 + f3 + f2 - f1);
    const ForceEstimate estimate = grid.sample(at);
    ASSERT_EQ(estimate.status, EstimateStatus::kOk);
    constexpr double kTolerance_N = 5e-6;  // single precision storage of forces near 1 N
    EXPECT_LT((estimate.force_W - expected).norm(), kTolerance_N);
  }
}

TYPED_TEST(ForceGrids, IsContinuousAcrossCellFaces) {
  TypeParam grid = make_grid<TypeParam>(uneven_box(), narrow_weighting());
  fill_vertices(grid, vertex_force);
  const GridGeometry& g = grid.geometry();
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(0.05, 0.95);
  for (int axis = 0; axis < 3; ++axis) {
    for (int face = 1; face < g.cells[axis]; ++face) {
      Vector3d at =
          g.min_W +
          Vector3d(unit(random), unit(random), unit(random)).cwiseProduct(g.max_W - g.min_W);
      at[axis] = g.min_W[axis] + face * g.spacing_m()[axis];
      Vector3d below = at;
      Vector3d above = at;
      below[axis] -= 1e-9;
      above[axis] += 1e-9;
      // 2 nm apart at slopes below 2 N per cell of at least 8 mm, and single precision.
      EXPECT_LT((grid.sample(below).force_W - grid.sample(above).force_W).norm(), 5e-6)
          << "axis " << axis << " face " << face;
    }
  }
}

TYPED_TEST(ForceGrids, CoversEveryCellUpToTheUpperBorderAndNothingBeyond) {
  TypeParam grid = make_grid<TypeParam>(uneven_box(), narrow_weighting());
  fill_vertices(grid, vertex_force);
  const GridGeometry& g = grid.geometry();
  const ForceEstimate corner = grid.sample(g.max_W);
  ASSERT_EQ(corner.status, EstimateStatus::kOk);
  EXPECT_LT((corner.force_W - vertex_force(12, 20, 9)).norm(), 5e-6);
  EXPECT_EQ(grid.sample(g.max_W - 0.5 * g.spacing_m()).status, EstimateStatus::kOk);
  EXPECT_EQ(grid.sample(g.min_W).status, EstimateStatus::kOk);
  for (int axis = 0; axis < 3; ++axis) {
    Vector3d at = g.max_W;
    at[axis] += 1e-9;
    EXPECT_EQ(grid.sample(at).status, EstimateStatus::kOutside);
    EXPECT_EQ(grid.sample(at).force_W, Vector3d::Zero());
    at = g.min_W;
    at[axis] -= 1e-9;
    EXPECT_EQ(grid.sample(at).status, EstimateStatus::kOutside);
  }
}

TYPED_TEST(ForceGrids, AnswersNotFiniteWithAStatusAndZero) {
  TypeParam grid = make_grid<TypeParam>(uneven_box(), narrow_weighting());
  fill_vertices(grid, vertex_force);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const Vector3d& at :
       {Vector3d(nan, 0, 0), Vector3d(0, infinity, 0), Vector3d(0, 0, -infinity)}) {
    EXPECT_EQ(grid.sample(at).status, EstimateStatus::kNotFinite);
    EXPECT_EQ(grid.sample(at).force_W, Vector3d::Zero());
  }
  EXPECT_FALSE(grid.inside(Vector3d(nan, 0, 0)));
  EXPECT_FALSE(grid.inside(Vector3d(1, 0, 0)));
}

TYPED_TEST(ForceGrids, SaysWhatIsUnknownAndWhatIsPartlyKnown) {
  TypeParam grid = make_grid<TypeParam>(uneven_box(), weighting_of(0.025));
  EXPECT_EQ(grid.sample(Vector3d::Zero()).status, EstimateStatus::kUnknown);
  fill_whole(grid, sample_of(Vector3d::Zero(), Vector3d(1, 2, 3)));
  const ForceEstimate near = grid.sample(Vector3d(0.001, 0.001, 0.001));
  EXPECT_EQ(near.status, EstimateStatus::kOk);
  // The paper: after one sample every vertex in reach holds exactly that force.
  EXPECT_LT((near.force_W - Vector3d(1, 2, 3)).norm(), 1e-6);
  EXPECT_EQ(grid.sample(Vector3d(0.027, 0.0, 0.0)).status, EstimateStatus::kPartlyKnown);
  EXPECT_EQ(grid.sample(Vector3d(0.055, 0.07, 0.0)).status, EstimateStatus::kUnknown);
}

TEST(RadialWeight, FallsFromOneToZeroAtTheRadius) {
  const RadialWeight weighting = weighting_of(0.02);
  EXPECT_DOUBLE_EQ(weighting.weight(0.0), 1.0);
  EXPECT_NEAR(weighting.weight(0.02), 1.0 / 401.0 - 1.0 / 401.0, 1e-15);
  EXPECT_EQ(weighting.weight(0.0201), 0.0);
  // d = 5 units, r = 20 units: 1/26 - 5/(20 * 401).
  EXPECT_NEAR(weighting.weight(0.005), 1.0 / 26.0 - 5.0 / 8020.0, 1e-15);
}

Vector3d force_of(const ForceVertex& v) { return {v.force_W_N[0], v.force_W_N[1], v.force_W_N[2]}; }

// The update formulae as the paper writes them, in double, over every vertex of the grid.
struct ReferenceGrid {
  explicit ReferenceGrid(const GridGeometry& geometry) : g(geometry) {
    force.assign(g.vertex_count(), Vector3d::Zero());
    weight.assign(g.vertex_count(), 0.0);
  }
  std::size_t index(int i, int j, int k) const {
    return static_cast<std::size_t>((i * (g.cells.y() + 1) + j) * (g.cells.z() + 1) + k);
  }
  void add(const RadialWeight& weighting, const Vector3d& at, const Vector3d& f) {
    for (int i = 0; i <= g.cells.x(); ++i) {
      for (int j = 0; j <= g.cells.y(); ++j) {
        for (int k = 0; k <= g.cells.z(); ++k) {
          const Vector3d v = g.min_W + Vector3d(i, j, k).cwiseProduct(g.spacing_m());
          const double w = weighting.weight((v - at).norm());
          if (w > 0.0) {
            const std::size_t n = index(i, j, k);
            force[n] = (weight[n] * force[n] + w * f) / (weight[n] + w);
            weight[n] += w;
          }
        }
      }
    }
  }
  GridGeometry g;
  std::vector<Vector3d> force;
  std::vector<double> weight;
};

TYPED_TEST(ForceGrids, FillsAsTheUpdateFormulaeSayInsideAndAtTheBorders) {
  SCOPED_TRACE(kSeed);
  const RadialWeight weighting = weighting_of(0.0267);
  TypeParam grid = make_grid<TypeParam>(uneven_box(), weighting);
  ReferenceGrid reference(uneven_box());
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::uniform_real_distribution<double> newtons(-5.0, 5.0);
  for (int trial = 0; trial < 60; ++trial) {
    const Vector3d at =
        reference.g.min_W + Vector3d(unit(random), unit(random), unit(random))
                                .cwiseProduct(reference.g.max_W - reference.g.min_W);
    const Vector3d f(newtons(random), newtons(random), newtons(random));
    reference.add(weighting, at, f);
    fill_whole(grid, sample_of(at, f));
  }
  for (int i = 0; i <= 12; ++i) {
    for (int j = 0; j <= 20; ++j) {
      for (int k = 0; k <= 9; ++k) {
        const ForceVertex v = grid.vertex(i, j, k);
        const std::size_t n = reference.index(i, j, k);
        // Single precision; a weight near zero (d close to r) is a difference of like numbers.
        ASSERT_NEAR(std::max(v.weight, 0.0F), reference.weight[n], 2e-6);
        if (reference.weight[n] > 1e-4) {
          ASSERT_LT((force_of(v) - reference.force[n]).norm(), 5e-3);
        }
      }
    }
  }
}

TYPED_TEST(ForceGrids, GivesTheSameFieldHoweverTheBudgetSplitsAFill) {
  const RadialWeight weighting = weighting_of(0.0267);
  TypeParam whole = make_grid<TypeParam>(uneven_box(), weighting);
  TypeParam split = make_grid<TypeParam>(uneven_box(), weighting);
  const Vector3d at(0.011, -0.023, 0.007);
  const Vector3d f(1.0, -2.0, 0.5);
  GridFill one = whole.begin_fill(sample_of(at, f), false);
  GridFill many = split.begin_fill(sample_of(at, f), false);
  const int at_once = whole.continue_fill(one, 1 << 20);
  EXPECT_TRUE(whole.finished(one));
  int visited = 0;
  double farthest_filled_m = 0.0;
  while (!split.finished(many)) {
    const int step = split.continue_fill(many, 64);
    // At most one segment beyond the budget, and with blocks the clearing of a new one.
    ASSERT_LE(step, 64 + 8 + 64);
    visited += step;
    // Nearest first: no vertex well within the farthest filled one is still empty, that is none
    // nearer by more than a segment of eight vertices and a cell's diagonal.
    double nearest_empty_m = 1.0;
    for (int i = 0; i <= 12; ++i) {
      for (int j = 0; j <= 20; ++j) {
        for (int k = 0; k <= 9; ++k) {
          const GridGeometry& g = split.geometry();
          const double d = (g.min_W + Vector3d(i, j, k).cwiseProduct(g.spacing_m()) - at).norm();
          if (split.vertex(i, j, k).weight > 0.0F) {
            farthest_filled_m = std::max(farthest_filled_m, d);
          } else {
            nearest_empty_m = std::min(nearest_empty_m, d);
          }
        }
      }
    }
    ASSERT_LE(farthest_filled_m, nearest_empty_m + 8.0 * split.geometry().spacing_m().z() +
                                     split.geometry().spacing_m().norm());
  }
  EXPECT_EQ(visited, at_once);
  for (int i = 0; i <= 12; ++i) {
    for (int j = 0; j <= 20; ++j) {
      for (int k = 0; k <= 9; ++k) {
        ASSERT_EQ(whole.vertex(i, j, k).force_W_N, split.vertex(i, j, k).force_W_N);
        ASSERT_EQ(whole.vertex(i, j, k).weight, split.vertex(i, j, k).weight);
      }
    }
  }
}

TEST(RadialWeight, FallsSharplyWithTheInversePowers) {
  RadialWeight weighting = weighting_of(0.02);
  weighting.mean_spacing_m = 0.002;
  weighting.kind = WeightKind::kInverse4;
  EXPECT_DOUBLE_EQ(weighting.weight(0.0), 20.0);
  EXPECT_NEAR(weighting.weight(0.004), 0.64 / (0.05 + 16.0), 1e-15);  // d = r/5 = 2 h
  EXPECT_EQ(weighting.weight(0.02), 0.0);
  weighting.kind = WeightKind::kInverse6;
  EXPECT_DOUBLE_EQ(weighting.weight(0.0), 20.0);
  EXPECT_NEAR(weighting.weight(0.004), 0.64 / (0.05 + 4096.0), 1e-15);
  EXPECT_EQ(weighting.weight(0.03), 0.0);
}

TEST(ForceGrid, GivesTheVerticesTheWeightsOfTheFormulae) {
  // Two samples on one vertex's line: its force is their mean by the weights at 4 and 8 mm.
  for (const WeightKind kind : {WeightKind::kPaper, WeightKind::kInverse4, WeightKind::kInverse6}) {
    RadialWeight weighting = weighting_of(0.03);
    weighting.kind = kind;
    weighting.mean_spacing_m = 0.005;
    DenseGrid grid = make_grid<DenseGrid>(uneven_box(), weighting);
    fill_whole(grid, sample_of(Vector3d(0.004, 0.0, 0.0), Vector3d(1.0, 0.0, 0.0)));
    fill_whole(grid, sample_of(Vector3d(-0.008, 0.0, 0.0), Vector3d(0.0, 2.0, 0.0)));
    // Vertex (6, 10, k) is at x = y = 0; of z the nearest is -0.05 + 4 * 0.12 / 9 = 1/300 m.
    const double z_m = 1.0 / 300.0;
    const double near = weighting.weight(std::hypot(0.004, z_m));
    const double far = weighting.weight(std::hypot(0.008, z_m));
    const ForceVertex v = grid.vertex(6, 10, 4);
    EXPECT_NEAR(v.weight, near + far, 1e-5 * (near + far));
    EXPECT_NEAR(v.force_W_N[0], near / (near + far), 1e-5);
    EXPECT_NEAR(v.force_W_N[1], 2.0 * far / (near + far), 1e-5);
  }
}

TYPED_TEST(ForceGrids, ReadTricubicallyReproduceQuadraticsInsideAndAffineFieldsAtTheBorder) {
  SCOPED_TRACE(kSeed);
  TypeParam grid = make_grid<TypeParam>(uneven_box(), narrow_weighting());
  fill_vertices(grid, [](int i, int j, int k) {
    return Vector3d(0.1 * i - 0.2 * j + 0.3 * k, 0.01 * (i * i - j * k), 0.02 * (k * k + i * j));
  });
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const GridGeometry& g = grid.geometry();
  for (int trial = 0; trial < 500; ++trial) {
    const Vector3d u =
        Vector3d(unit(random), unit(random), unit(random)).cwiseProduct(g.cells.cast<double>());
    const ForceEstimate estimate = grid.sample_tricubic(g.min_W + u.cwiseProduct(g.spacing_m()));
    ASSERT_EQ(estimate.status, EstimateStatus::kOk);
    constexpr double kTolerance_N = 3e-5;  // single precision at up to 9 N
    EXPECT_NEAR(estimate.force_W.x(), 0.1 * u.x() - 0.2 * u.y() + 0.3 * u.z(), kTolerance_N);
    if ((u.array() >= 1.0).all() && (u.array() <= g.cells.cast<double>().array() - 1.0).all()) {
      EXPECT_NEAR(estimate.force_W.y(), 0.01 * (u.x() * u.x() - u.y() * u.z()), kTolerance_N);
      EXPECT_NEAR(estimate.force_W.z(), 0.02 * (u.z() * u.z() + u.x() * u.y()), kTolerance_N);
    }
  }
}

TEST(ForceGrid, ReadsTrilinearlyWhereATricubicReadMeetsAVertexWithoutData) {
  DenseGrid grid = make_grid<DenseGrid>(uneven_box(), weighting_of(0.02));
  fill_whole(grid, sample_of(Vector3d(0.001, 0.001, 0.001), Vector3d(1, 2, 3)));
  fill_whole(grid, sample_of(Vector3d(0.009, 0.001, 0.001), Vector3d(2, 2, 3)));
  const Vector3d near(0.002, 0.003, 0.001);
  ASSERT_EQ(grid.sample(near).status, EstimateStatus::kOk);
  EXPECT_EQ(grid.sample_tricubic(near).status, EstimateStatus::kOk);
  EXPECT_EQ(grid.sample_tricubic(near).force_W, grid.sample(near).force_W);
  EXPECT_EQ(grid.sample_tricubic(Vector3d(0.055, 0.07, 0.0)).status, EstimateStatus::kUnknown);
}

TYPED_TEST(ForceGrids, ReproduceAnAffineFieldExactlyFromSamplesWithStiffness) {
  SCOPED_TRACE(kSeed);
  RadialWeight weighting = weighting_of(0.05);
  weighting.kind = WeightKind::kInverse6;
  weighting.mean_spacing_m = 0.01;
  TypeParam grid = make_grid<TypeParam>(uneven_box(), weighting);
  Eigen::Matrix3d stiffness;
  stiffness << -100, 20, 5, 10, -300, 40, 0, 7, -50;
  const Vector3d at_rest(1, -2, 3);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> around(-0.01, 0.01);
  for (int n = 0; n < 12; ++n) {
    Sample sample;
    sample.position_W = Vector3d(around(random), around(random), around(random));
    sample.force_W = at_rest + stiffness * sample.position_W;
    sample.stiffness_W = stiffness;
    fill_whole(grid, sample, true);
  }
  for (int n = 0; n < 200; ++n) {
    const Vector3d at(around(random), around(random), around(random));
    const ForceEstimate estimate = grid.sample(at);
    ASSERT_EQ(estimate.status, EstimateStatus::kOk);
    // Single precision of forces up to 15 N at the vertices.
    EXPECT_LT((estimate.force_W - at_rest - stiffness * at).norm(), 2e-5);
  }
}

}  // namespace
}  // namespace forcegrid
