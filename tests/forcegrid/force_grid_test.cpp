#include "forcegrid/force_grid.h"

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

CandleLight narrow_light() { return {0.004, 0.001}; }

// Gives every vertex a force of its own: with r below half the spacing and a sample exactly on the
// vertex, that vertex alone is filled and holds exactly that force.
template <typename ForceAt>
void fill_vertices(ForceGrid& grid, ForceAt force_at) {
  const GridGeometry& g = grid.geometry();
  for (int i = 0; i <= g.cells.x(); ++i) {
    for (int j = 0; j <= g.cells.y(); ++j) {
      for (int k = 0; k <= g.cells.z(); ++k) {
        const Vector3d at =
            (g.min_W + Vector3d(i, j, k).cwiseProduct(g.spacing_m())).cwiseMin(g.max_W);
        ForceGrid::Fill fill;
        ASSERT_TRUE(grid.begin_fill(at, force_at(i, j, k), fill));
        while (!grid.finished(fill)) {
          grid.continue_fill(fill, 1000);
        }
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

TEST(ForceGrid, GivesThePapersExpandedPolynomial) {
  SCOPED_TRACE(kSeed);
  ForceGrid grid(uneven_box(), narrow_light());
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

TEST(ForceGrid, IsContinuousAcrossCellFaces) {
  ForceGrid grid(uneven_box(), narrow_light());
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
      // 2 nm apart at slopes below 2 N a cell of at least 8 mm, and single precision.
      EXPECT_LT((grid.sample(below).force_W - grid.sample(above).force_W).norm(), 5e-6)
          << "axis " << axis << " face " << face;
    }
  }
}

TEST(ForceGrid, CoversEveryCellUpToTheUpperBorderAndNothingBeyond) {
  ForceGrid grid(uneven_box(), narrow_light());
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

TEST(ForceGrid, AnswersNotFiniteWithAStatusAndZero) {
  ForceGrid grid(uneven_box(), narrow_light());
  fill_vertices(grid, vertex_force);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const Vector3d& at :
       {Vector3d(nan, 0, 0), Vector3d(0, infinity, 0), Vector3d(0, 0, -infinity)}) {
    EXPECT_EQ(grid.sample(at).status, EstimateStatus::kNotFinite);
    EXPECT_EQ(grid.sample(at).force_W, Vector3d::Zero());
  }
  ForceGrid::Fill fill;
  EXPECT_FALSE(grid.begin_fill(Vector3d(nan, 0, 0), Vector3d::Zero(), fill));
  EXPECT_FALSE(grid.begin_fill(Vector3d::Zero(), Vector3d(0, nan, 0), fill));
  EXPECT_FALSE(grid.begin_fill(Vector3d::Zero(), Vector3d(0, 1e300, 0), fill));
  EXPECT_FALSE(grid.begin_fill(Vector3d(1, 0, 0), Vector3d::Zero(), fill));
}

TEST(ForceGrid, SaysWhatIsUnknownAndWhatIsPartlyKnown) {
  ForceGrid grid(uneven_box(), CandleLight{0.025, 0.001});
  EXPECT_EQ(grid.sample(Vector3d::Zero()).status, EstimateStatus::kUnknown);
  ForceGrid::Fill fill;
  ASSERT_TRUE(grid.begin_fill(Vector3d::Zero(), Vector3d(1, 2, 3), fill));
  while (!grid.finished(fill)) {
    grid.continue_fill(fill, 64);
  }
  const ForceEstimate near = grid.sample(Vector3d(0.001, 0.001, 0.001));
  EXPECT_EQ(near.status, EstimateStatus::kOk);
  // The paper: after one sample every vertex in reach holds exactly that force.
  EXPECT_LT((near.force_W - Vector3d(1, 2, 3)).norm(), 1e-6);
  EXPECT_EQ(grid.sample(Vector3d(0.027, 0.0, 0.0)).status, EstimateStatus::kPartlyKnown);
  EXPECT_EQ(grid.sample(Vector3d(0.055, 0.07, 0.0)).status, EstimateStatus::kUnknown);
}

TEST(CandleLight, FallsFromOneToZeroAtTheRadius) {
  const CandleLight light{0.02, 0.001};
  EXPECT_DOUBLE_EQ(light.weight(0.0), 1.0);
  EXPECT_NEAR(light.weight(0.02), 1.0 / 401.0 - 1.0 / 401.0, 1e-15);
  EXPECT_EQ(light.weight(0.0201), 0.0);
  // d = 5 units, r = 20 units: 1/26 - 5/(20 * 401).
  EXPECT_NEAR(light.weight(0.005), 1.0 / 26.0 - 5.0 / 8020.0, 1e-15);
}

// The update formulae as the paper writes them, in double, over every vertex of the grid.
struct ReferenceGrid {
  explicit ReferenceGrid(const GridGeometry& geometry) : g(geometry) {
    force.assign(g.vertex_count(), Vector3d::Zero());
    weight.assign(g.vertex_count(), 0.0);
  }
  std::size_t index(int i, int j, int k) const {
    return static_cast<std::size_t>((i * (g.cells.y() + 1) + j) * (g.cells.z() + 1) + k);
  }
  void add(const CandleLight& light, const Vector3d& at, const Vector3d& f) {
    for (int i = 0; i <= g.cells.x(); ++i) {
      for (int j = 0; j <= g.cells.y(); ++j) {
        for (int k = 0; k <= g.cells.z(); ++k) {
          const Vector3d v = g.min_W + Vector3d(i, j, k).cwiseProduct(g.spacing_m());
          const double w = light.weight((v - at).norm());
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

TEST(ForceGrid, FillsAsTheUpdateFormulaeSayInsideAndAtTheBorders) {
  SCOPED_TRACE(kSeed);
  const CandleLight light{0.0267, 0.001};
  ForceGrid grid(uneven_box(), light);
  ReferenceGrid reference(uneven_box());
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::uniform_real_distribution<double> newtons(-5.0, 5.0);
  for (int trial = 0; trial < 60; ++trial) {
    const Vector3d at =
        reference.g.min_W + Vector3d(unit(random), unit(random), unit(random))
                                .cwiseProduct(reference.g.max_W - reference.g.min_W);
    const Vector3d f(newtons(random), newtons(random), newtons(random));
    reference.add(light, at, f);
    ForceGrid::Fill fill;
    ASSERT_TRUE(grid.begin_fill(at, f, fill));
    while (!grid.finished(fill)) {
      grid.continue_fill(fill, 40);
    }
  }
  for (int i = 0; i <= 12; ++i) {
    for (int j = 0; j <= 20; ++j) {
      for (int k = 0; k <= 9; ++k) {
        const Eigen::Vector4f v = grid.vertex(i, j, k);
        const std::size_t n = reference.index(i, j, k);
        // Single precision; a weight near zero (d close to r) is a difference of like numbers.
        ASSERT_NEAR(v[3], reference.weight[n], 2e-6);
        if (reference.weight[n] > 1e-4) {
          ASSERT_LT((v.head<3>().cast<double>() - reference.force[n]).norm(), 5e-3);
        }
      }
    }
  }
}

TEST(ForceGrid, GivesTheSameFieldHoweverTheBudgetSplitsAFill) {
  const CandleLight light{0.0267, 0.001};
  ForceGrid whole(uneven_box(), light);
  ForceGrid split(uneven_box(), light);
  const Vector3d at(0.011, -0.023, 0.007);
  const Vector3d f(1.0, -2.0, 0.5);
  ForceGrid::Fill one;
  ForceGrid::Fill many;
  ASSERT_TRUE(whole.begin_fill(at, f, one));
  ASSERT_TRUE(split.begin_fill(at, f, many));
  whole.continue_fill(one, 1 << 20);
  int visited = 0;
  double farthest_filled_m = 0.0;
  while (!split.finished(many)) {
    const int step = split.continue_fill(many, 64);
    ASSERT_LE(step, 64);
    visited += step;
    // Nearest first: no vertex well within the farthest filled one is still empty.
    double nearest_empty_m = 1.0;
    for (int i = 0; i <= 12; ++i) {
      for (int j = 0; j <= 20; ++j) {
        for (int k = 0; k <= 9; ++k) {
          const GridGeometry& g = split.geometry();
          const double d = (g.min_W + Vector3d(i, j, k).cwiseProduct(g.spacing_m()) - at).norm();
          if (split.vertex(i, j, k)[3] > 0.0F) {
            farthest_filled_m = std::max(farthest_filled_m, d);
          } else {
            nearest_empty_m = std::min(nearest_empty_m, d);
          }
        }
      }
    }
    ASSERT_LE(farthest_filled_m, nearest_empty_m + split.geometry().spacing_m().norm());
  }
  EXPECT_EQ(visited, split.vertices_per_fill());
  for (int i = 0; i <= 12; ++i) {
    for (int j = 0; j <= 20; ++j) {
      for (int k = 0; k <= 9; ++k) {
        ASSERT_EQ(whole.vertex(i, j, k), split.vertex(i, j, k));
      }
    }
  }
}

TEST(GridGeometry, RefusesWhatIsNotABox) {
  GridGeometry geometry = uneven_box();
  geometry.cells.y() = 0;
  EXPECT_THROW(ForceGrid(geometry, narrow_light()), std::invalid_argument);
  geometry = uneven_box();
  geometry.max_W.z() = geometry.min_W.z();
  EXPECT_THROW(ForceGrid(geometry, narrow_light()), std::invalid_argument);
  geometry = uneven_box();
  geometry.min_W.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(ForceGrid(geometry, narrow_light()), std::invalid_argument);
  EXPECT_THROW(ForceGrid(uneven_box(), CandleLight{0.0, 0.001}), std::invalid_argument);
  EXPECT_THROW(ForceGrid(uneven_box(), CandleLight{0.01, -1.0}), std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid
