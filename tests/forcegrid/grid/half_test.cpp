// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/half.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>

#include "forcegrid/grid/grid_instances.h"
#include "forcegrid/grid/grid_plan.h"
#include "forcegrid/grid/grid_segments.h"

namespace forcegrid {
namespace {

// IEEE 754-2008, section 3.4: 1 sign, 5 exponent and 10 mantissa bits, bias 15.
double value_of(std::uint16_t bits) {
  const double sign = (bits & 0x8000) != 0 ? -1.0 : 1.0;
  const int exponent = bits >> 10 & 31;
  const int mantissa = bits & 1023;
  if (exponent == 0) {
    return sign * std::ldexp(mantissa, -24);
  }
  return sign * std::ldexp(1024 + mantissa, exponent - 25);
}

TEST(Half, HasTheValueOfTheStandardForAllItsBits) {
  for (std::uint32_t all = 0; all < 0x10000; ++all) {
    const auto bits = static_cast<std::uint16_t>(all);
    const float value = Half::from_bits(bits).value();
    if ((bits >> 10 & 31) == 31) {
      EXPECT_FALSE(std::isfinite(value)) << all;
      EXPECT_EQ(std::isnan(value), (bits & 1023) != 0) << all;
      continue;
    }
    ASSERT_EQ(static_cast<double>(value), value_of(bits)) << all;
    ASSERT_EQ(Half(value).bits(), bits) << all;
  }
}

TEST(Half, RoundsToTheNearestAndTiesToEven) {
  for (std::uint16_t bits = 0; bits < 0x7bff; ++bits) {
    const auto above = static_cast<std::uint16_t>(bits + 1);
    const auto middle = static_cast<float>(0.5 * (value_of(bits) + value_of(above)));
    ASSERT_EQ(Half(middle).bits(), bits % 2 == 0 ? bits : above) << bits;
    ASSERT_EQ(Half(std::nextafter(middle, 0.0F)).bits(), bits) << bits;
    ASSERT_EQ(Half(std::nextafter(middle, 1e9F)).bits(), above) << bits;
    ASSERT_EQ(Half(-middle).bits() & 0x7fff, Half(middle).bits()) << bits;
  }
}

TEST(Half, IsInfiniteBeyondItsLargest) {
  EXPECT_EQ(Half(65519.0F).value(), Half::kLargest);
  EXPECT_TRUE(std::isinf(Half(65520.0F).value()));
  EXPECT_TRUE(std::isinf(Half(-1e30F).value()));
  EXPECT_TRUE(std::isnan(Half(std::numeric_limits<float>::quiet_NaN()).value()));
}

TEST(HalfVertex, IsWithoutDataAtFirstAndBoundedAfterwards) {
  HalfVertex stored;
  EXPECT_EQ(unpacked(stored).weight, ForceVertex::kNoData);
  pack({.force_W_N = {1e6F, -1e6F, 0.5F}, .weight = 1e6F}, stored);
  const ForceVertex vertex = unpacked(stored);
  EXPECT_EQ(vertex.force_W_N, (std::array<float, 3>{65504.0F, -65504.0F, 0.5F}));
  EXPECT_EQ(vertex.weight, 65504.0F);
}

GridPlan small_plan() {
  GridPlan plan;
  plan.name = "forcegrid";
  plan.geometry.min_W.setConstant(-0.04);
  plan.geometry.max_W.setConstant(0.04);
  plan.geometry.cells.setConstant(16);
  plan.weighting.influence_radius_m = 0.015;
  plan.instructions = Instructions::kScalar;
  plan.pool_blocks = 27;
  return plan;
}

Sample sample_at(const Eigen::Vector3d& position_W, const Eigen::Vector3d& force_W) {
  Sample sample;
  sample.position_W = position_W;
  sample.force_W = force_W;
  return sample;
}

void take(ForceMethod& method, const Sample& sample) {
  method.take_sample(sample);
  while (method.work(4096) > 0) {
  }
}

TEST(HalfBlockGrid, GivesAForceThatItCanHoldExactlyWhereverASampleReached) {
  const auto method = make_half_block_grid(small_plan());
  ASSERT_NE(method, nullptr);
  const Eigen::Vector3d force_W(1.5, -2.25, 0.125);
  method->contact_made(1, Eigen::Vector3d::Zero());
  EXPECT_EQ(method->force(0.0, Eigen::Vector3d::Zero()).status, EstimateStatus::kUnknown);
  for (int i = 0; i < 30; ++i) {
    take(*method, sample_at(Eigen::Vector3d(0.001 * i - 0.015, 0.002, -0.001), force_W));
  }
  for (const double x_m : {-0.012, 0.0003, 0.011}) {
    const ForceEstimate estimate = method->force(0.0, {x_m, 0.001, 0.003});
    EXPECT_EQ(estimate.status, EstimateStatus::kOk);
    EXPECT_LT((estimate.force_W - force_W).norm(), 1e-6) << x_m;
  }
  EXPECT_EQ(method->force(0.0, {0.0, 0.0, 0.035}).status, EstimateStatus::kUnknown);
}

TEST(HalfBlockGrid, FollowsTheGridInSinglePrecisionToThreeDigitsInHalfItsMemory) {
  const GridPlan plan = small_plan();
  const auto half = make_half_block_grid(plan);
  const auto single = make_block_force_grid(plan);
  half->contact_made(1, Eigen::Vector3d::Zero());
  single->contact_made(1, Eigen::Vector3d::Zero());
  double worst = 0.0;
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector3d p(0.02 * std::sin(0.11 * i), 0.02 * std::sin(0.07 * i + 1.0),
                            0.02 * std::sin(0.05 * i + 2.0));
    const Eigen::Vector3d force_W = -200.0 * p + Eigen::Vector3d(0.0, 0.0, 1.0);
    take(*half, sample_at(p, force_W));
    take(*single, sample_at(p, force_W));
    const ForceEstimate h = half->force(0.0, p);
    const ForceEstimate s = single->force(0.0, p);
    ASSERT_EQ(h.status, s.status);
    worst = std::max(worst, (h.force_W - s.force_W).norm() / 5.0);
  }
  // Half a unit of the last of 11 bits for each rounding; an average rounds once for each sample.
  EXPECT_LT(worst, 10 * std::ldexp(1.0, -12));
  EXPECT_GT(worst, 0.0);
  EXPECT_LT(static_cast<double>(half->memory_bytes()),
            0.6 * static_cast<double>(single->memory_bytes()));
}

}  // namespace
}  // namespace forcegrid
