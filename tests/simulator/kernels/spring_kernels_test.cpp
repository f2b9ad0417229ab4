// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/spring_kernels.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "simulator/kernels/coarse_correction.h"

namespace forcegrid::simulator::kernels {
namespace {

using Eigen::Vector3d;

constexpr std::size_t kVertices = 700;  // enough for a coarse grid
constexpr unsigned kSeed = 5;

std::vector<Vector3d> scattered_points_m() {
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> coordinate_m(-0.05, 0.05);
  std::vector<Vector3d> points_m(kVertices);
  for (Vector3d& point_m : points_m) {
    point_m = {coordinate_m(random), 2.0 * coordinate_m(random), coordinate_m(random)};
  }
  return points_m;
}

// Every vertex free, with the identity as its block's inverse.
std::vector<BlockInverse> free_vertices() {
  return std::vector<BlockInverse>(kVertices, {Float4{1.0F, 1.0F, 1.0F, 1.0F}, Float4{}});
}

// What the coarse grid's values amount to at the vertices.
std::vector<Lanes> interpolated(const CoarseGrid& coarse, const std::vector<Lanes>& nodes) {
  std::vector<Lanes> direction(kVertices, Lanes{});
  std::vector<Lanes> product(kVertices, Lanes{});
  next_direction(static_cast<std::int32_t>(kVertices), Float4{}, free_vertices().data(), coarse,
                 nodes.data(), direction.data(), product.data());
  return direction;
}

TEST(Predict, AnErrorOfTheSensitivitiesThatNothingCorrectsStaysBounded) {
  const float error = 1e-3F;
  Lanes state{};
  Lanes before{};
  state.component[0] = Float4{0.0F, 1.0F + error, 0.0F, 0.0F};
  before.component[0] = Float4{0.0F, 1.0F, 0.0F, 0.0F};
  const float step_m[3] = {0.0F, 0.0F, 0.0F};
  for (int step = 0; step < 200; ++step) {
    predict(1, step_m, 1.0F, &state, &before);
  }
  // The sum of 1 + 1/2 + 1/4 + ..., with single precision's rounding.
  EXPECT_NEAR(state.component[0][1] - 1.0F, 2.0F * error, 1e-5F);
}

TEST(Predict, FollowsSensitivitiesThatChangeInProportionToTheWayToSecondOrder) {
  // x = 3 P + 5 P^2, S = 3 + 10 P: from P = 0.1 and 0.2 to 0.3, exact in x to the second order.
  Lanes state{};
  Lanes before{};
  state.component[1] = Float4{3.0F * 0.2F + 5.0F * 0.04F, 0.0F, 5.0F, 0.0F};
  before.component[1] = Float4{3.0F * 0.1F + 5.0F * 0.01F, 0.0F, 4.0F, 0.0F};
  const float step_m[3] = {0.0F, 0.1F, 0.0F};
  predict(1, step_m, 1.0F, &state, &before);
  EXPECT_NEAR(state.component[1][0], 3.0F * 0.3F + 5.0F * 0.09F, 1e-6F);
  EXPECT_FLOAT_EQ(before.component[1][2], 5.0F);
}

TEST(CoarseGrid, ReproducesALinearFieldAtEveryVertex) {
  const std::vector<Vector3d> rest_m = scattered_points_m();
  const CoarseGrid coarse = make_coarse_grid(rest_m);
  ASSERT_EQ(coarse.member.size(), kVertices);
  Vector3d low_m = rest_m.front();
  Vector3d high_m = low_m;
  for (const Vector3d& at_m : rest_m) {
    low_m = low_m.cwiseMin(at_m);
    high_m = high_m.cwiseMax(at_m);
  }
  const int nodes_x = coarse.stride_y;
  const int nodes_y = coarse.stride_z / coarse.stride_y;
  const int nodes_z = coarse.node_count / coarse.stride_z;
  const auto field = [](const Vector3d& at_m, int lane) {
    return static_cast<float>(7.0 * at_m.x() - (3.0 + lane) * at_m.y() + 11.0 * at_m.z() + 0.5);
  };
  std::vector<Lanes> nodes(static_cast<std::size_t>(coarse.node_count), Lanes{});
  for (int n = 0; n < coarse.node_count; ++n) {
    const Vector3d share(static_cast<double>(n % nodes_x) / (nodes_x - 1),
                         static_cast<double>(n / nodes_x % nodes_y) / (nodes_y - 1),
                         static_cast<double>(n / coarse.stride_z) / (nodes_z - 1));
    const Vector3d at_m = low_m + share.cwiseProduct(high_m - low_m);
    for (int lane = 0; lane < 4; ++lane) {
      nodes[static_cast<std::size_t>(n)].component[2][lane] = field(at_m, lane);
    }
  }
  const std::vector<Lanes> found = interpolated(coarse, nodes);
  for (std::size_t i = 0; i < kVertices; ++i) {
    for (int lane = 0; lane < 4; ++lane) {
      ASSERT_NEAR(found[i].component[2][lane], field(rest_m[i], lane), 1e-5F) << i;
      ASSERT_EQ(found[i].component[0][lane], 0.0F);
    }
  }
}

TEST(CoarseGrid, SumsResidualsWithTheWeightsThatItInterpolatesWith) {
  // <P e, r> = <e, P^T r> for any e and r.
  const CoarseGrid coarse = make_coarse_grid(scattered_points_m());
  std::mt19937 random(kSeed + 1);
  std::uniform_real_distribution<float> number(-1.0F, 1.0F);
  const auto fill = [&](std::vector<Lanes>& values) {
    for (Lanes& value : values) {
      for (Float4& component : value.component) {
        component = Float4{number(random), number(random), number(random), number(random)};
      }
    }
  };
  std::vector<Lanes> nodes(static_cast<std::size_t>(coarse.node_count));
  std::vector<Lanes> residual(kVertices);
  fill(nodes);
  fill(residual);
  const std::vector<Lanes> at_vertices = interpolated(coarse, nodes);
  std::vector<Lanes> none(kVertices, Lanes{});
  std::vector<Lanes> product(kVertices, Lanes{});
  std::vector<Lanes> sums(nodes.size());
  take_step(static_cast<std::int32_t>(kVertices), Float4{}, free_vertices().data(), coarse,
            none.data(), none.data(), residual.data(), product.data(), sums.data());
  const auto dot = [](const std::vector<Lanes>& a, const std::vector<Lanes>& b, int lane) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (int c = 0; c < 3; ++c) {
        sum += static_cast<double>(a[i].component[c][lane]) *
               static_cast<double>(b[i].component[c][lane]);
      }
    }
    return sum;
  };
  for (int lane = 0; lane < 4; ++lane) {
    EXPECT_NEAR(dot(at_vertices, residual, lane), dot(nodes, sums, lane), 1e-3) << lane;
  }
}

TEST(CoarseGrid, SolvesWithItsInverseInEveryLane) {
  CoarseGrid coarse = make_coarse_grid(scattered_points_m());
  std::mt19937 random(kSeed + 3);
  std::uniform_real_distribution<float> number(-1.0F, 1.0F);
  // Not a multiple of any register's numbers, and one that is.
  for (const std::int32_t nodes : {coarse.node_count, 16}) {
    coarse.node_count = nodes;
    const auto unknowns = static_cast<std::size_t>(3 * nodes);
    coarse.inverse_m_per_N.assign(unknowns * unknowns, 0.0F);
    for (std::size_t i = 0; i < unknowns; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        coarse.inverse_m_per_N[i * unknowns + j] = coarse.inverse_m_per_N[j * unknowns + i] =
            number(random);
      }
    }
    std::vector<Lanes> residual(static_cast<std::size_t>(nodes));
    for (Lanes& at : residual) {
      for (Float4& component : at.component) {
        component = Float4{number(random), number(random), number(random), number(random)};
      }
    }
    std::vector<Lanes> found(residual.size());
    const Float4 dot = solve_coarse(coarse, residual.data(), found.data());
    double expected_dot[4] = {};
    for (std::size_t i = 0; i < unknowns; ++i) {
      for (int lane = 0; lane < 4; ++lane) {
        double expected = 0.0;
        for (std::size_t j = 0; j < unknowns; ++j) {
          expected += static_cast<double>(coarse.inverse_m_per_N[i * unknowns + j]) *
                      static_cast<double>(residual[j / 3].component[j % 3][lane]);
        }
        ASSERT_NEAR(found[i / 3].component[i % 3][lane], expected, 1e-4) << nodes << ", " << i;
        expected_dot[lane] +=
            expected * static_cast<double>(residual[i / 3].component[i % 3][lane]);
      }
    }
    for (int lane = 0; lane < 4; ++lane) {
      EXPECT_NEAR(dot[lane], expected_dot[lane], 1e-3) << nodes;
    }
  }
}

TEST(TakeStep, SumsTheNewResidualPreconditionedWithTheOneBefore) {
  std::mt19937 random(kSeed + 2);
  std::uniform_real_distribution<float> number(-1.0F, 1.0F);
  constexpr std::size_t kCount = 5;
  constexpr float kInverse = 0.25F;  // of every block
  constexpr float kAlpha = 0.5F;
  std::vector<Lanes> residual(kCount);
  std::vector<Lanes> product(kCount);
  for (std::vector<Lanes>* array : {&residual, &product}) {
    for (Lanes& at : *array) {
      for (Float4& component : at.component) {
        component = Float4{number(random), number(random), number(random), number(random)};
      }
    }
  }
  const std::vector<BlockInverse> inverse(kCount,
                                          {Float4{kInverse, kInverse, kInverse, 1.0F}, Float4{}});
  float expected[4] = {};
  for (std::size_t i = 0; i < kCount; ++i) {
    for (int c = 0; c < 3; ++c) {
      for (int lane = 0; lane < 4; ++lane) {
        const float before = residual[i].component[c][lane];
        expected[lane] += before * kInverse * (before - kAlpha * product[i].component[c][lane]);
      }
    }
  }
  std::vector<Lanes> none(kCount, Lanes{});
  const StepSums sums = take_step(
      static_cast<std::int32_t>(kCount), Float4{kAlpha, kAlpha, kAlpha, kAlpha}, inverse.data(), {},
      none.data(), none.data(), residual.data(), product.data(), nullptr);
  for (int lane = 0; lane < 4; ++lane) {
    EXPECT_NEAR(sums.former[lane], expected[lane], 1e-5F) << lane;
  }
}

}  // namespace
}  // namespace forcegrid::simulator::kernels
