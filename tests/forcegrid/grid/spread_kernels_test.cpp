// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/spread_kernels.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace forcegrid {
namespace {

constexpr unsigned kSeed = 3;
constexpr WeightKind kKinds[] = {WeightKind::kPaper, WeightKind::kInverse4, WeightKind::kInverse6};

SpreadConstants constants(WeightKind kind) {
  RadialWeight weighting;
  weighting.influence_radius_m = 0.02;
  weighting.kind = kind;
  weighting.mean_spacing_m = 0.003;
  return spread_constants(weighting, 0.002);
}

SpreadSample random_sample(std::mt19937& random, bool has_stiffness) {
  std::uniform_real_distribution<float> newtons(-5.0F, 5.0F);
  SpreadSample sample;
  for (float& f : sample.force_W_N) {
    f = newtons(random);
  }
  sample.has_stiffness = has_stiffness;
  for (float& j : sample.stiffness_W_N_per_m) {
    j = 50.0F * newtons(random);
  }
  return sample;
}

template <typename Segment>
std::vector<SegmentWork<Segment>> random_work(std::vector<Segment>& segments,
                                              std::mt19937& random) {
  // Segments of 14 mm and samples with an r of 20 mm: most are reached in part, some not at all.
  std::uniform_real_distribution<float> metres(-0.014F, 0.014F);
  std::vector<SegmentWork<Segment>> work;
  for (Segment& segment : segments) {
    work.push_back({&segment, metres(random), metres(random), metres(random)});
  }
  return work;
}

TEST(SpreadKernels, GiveTheSameForcesWithSimdAsWithoutIt) {
  SCOPED_TRACE(kSeed);
  SCOPED_TRACE(best_instructions());
  for (const WeightKind kind : kKinds) {
    for (const bool has_stiffness : {false, true}) {
      std::vector<ForceSegment> one(200);
      std::vector<ForceSegment> other(200);
      for (int pass = 0; pass < 5; ++pass) {
        std::mt19937 random(kSeed + static_cast<unsigned>(pass));
        const SpreadSample sample = random_sample(random, has_stiffness);
        std::mt19937 again = random;
        const auto work = random_work(one, random);
        const auto same_work = random_work(other, again);
        spread_force_kernel(Instructions::kBest)(constants(kind), sample, work.data(), work.size());
        spread_force_kernel(Instructions::kScalar)(constants(kind), sample, same_work.data(),
                                                   same_work.size());
      }
      int reached = 0;
      for (std::size_t n = 0; n < one.size(); ++n) {
        for (std::size_t lane = 0; lane < kSegmentVertices; ++lane) {
          const ForceVertex& a = one[n].vertices[lane];
          const ForceVertex& b = other[n].vertices[lane];
          // The two round d differently; within 1e-6 of r a vertex may be reached by one alone.
          if (std::abs(a.weight - b.weight) > 1e-5F && std::min(a.weight, b.weight) < 0.0F) {
            EXPECT_LT(std::max(a.weight, b.weight), 1e-6F);
            continue;
          }
          ASSERT_NEAR(a.weight, b.weight, 2e-5F * (1.0F + std::abs(b.weight)));
          if (b.weight > 1e-3F) {
            ++reached;
            for (std::size_t axis = 0; axis < 3; ++axis) {
              ASSERT_NEAR(a.force_W_N[axis], b.force_W_N[axis], 2e-3F);
            }
          }
        }
      }
      EXPECT_GT(reached, 100);
    }
  }
}

TEST(SpreadKernels, GiveTheSameMomentsWithSimdAsWithoutIt) {
  SCOPED_TRACE(kSeed);
  for (const WeightKind kind : kKinds) {
    std::vector<MomentSegment> one(100);
    std::vector<MomentSegment> other(100);
    std::mt19937 random(kSeed);
    const SpreadSample sample = random_sample(random, false);
    std::mt19937 again = random;
    const auto work = random_work(one, random);
    const auto same_work = random_work(other, again);
    spread_moments_kernel(Instructions::kBest)(constants(kind), sample, work.data(), work.size());
    spread_moments_kernel(Instructions::kScalar)(constants(kind), sample, same_work.data(),
                                                 same_work.size());
    float largest = 0.0F;
    for (std::size_t n = 0; n < one.size(); ++n) {
      for (std::size_t i = 0; i < kMoments; ++i) {
        for (std::size_t lane = 0; lane < kSegmentVertices; ++lane) {
          const float a = one[n].moments[i][lane];
          const float b = other[n].moments[i][lane];
          ASSERT_NEAR(a, b, 1e-5F * (0.1F + std::abs(b))) << "moment " << i;
          largest = std::max(largest, std::abs(b));
        }
      }
    }
    EXPECT_GT(largest, 0.1F);
  }
}

// Weighted affine regression of samples around a corner, by Eigen's solver.
TEST(SpreadKernels, FitCornersAsTheNormalEquationsSayWithAndWithoutSimd) {
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  constexpr double kRidge = 1e-3;
  CornerMoments moments{};
  Eigen::Matrix<double, 3, 8> expected = Eigen::Matrix<double, 3, 8>::Zero();
  for (std::size_t corner = 0; corner < 7; ++corner) {  // the eighth stays without samples
    double total = 0.0;
    Eigen::Vector3d su = Eigen::Vector3d::Zero();
    Eigen::Matrix3d suu = Eigen::Matrix3d::Zero();
    Eigen::Vector3d sf = Eigen::Vector3d::Zero();
    Eigen::Matrix3d sfu = Eigen::Matrix3d::Zero();
    for (int n = 0; n < 10; ++n) {
      const double w = 1.0 + 0.5 * unit(random);
      const Eigen::Vector3d u(unit(random), unit(random), unit(random));
      const Eigen::Vector3d f(unit(random), unit(random), unit(random));
      total += w;
      su += w * u;
      suu += w * u * u.transpose();
      sf += w * f;
      sfu += w * f * u.transpose();
    }
    const auto set = [&](std::size_t i, double value) {
      moments.moments[i][corner] = static_cast<float>(value);
    };
    set(0, total);
    for (int i = 0; i < 3; ++i) {
      set(static_cast<std::size_t>(1 + i), su[i]);
      set(static_cast<std::size_t>(4 + i), suu(i, i));
      set(static_cast<std::size_t>(10 + i), sf[i]);
      for (int j = 0; j < 3; ++j) {
        set(static_cast<std::size_t>(13 + 3 * i + j), sfu(i, j));
      }
    }
    set(7, suu(0, 1));
    set(8, suu(0, 2));
    set(9, suu(1, 2));
    const Eigen::Vector3d mean = su / total;
    const Eigen::Matrix3d covariance =
        suu / total - mean * mean.transpose() + kRidge * Eigen::Matrix3d::Identity();
    const Eigen::Matrix3d slope =
        (sfu / total - sf / total * mean.transpose()) * covariance.inverse();
    expected.col(static_cast<Eigen::Index>(corner)) = sf / total - slope * mean;
  }
  for (const Instructions instructions : {Instructions::kBest, Instructions::kScalar}) {
    CornerForces forces;
    fit_corners_kernel(instructions)(moments, kRidge, forces);
    for (std::size_t corner = 0; corner < 8; ++corner) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(forces.force_W_N[axis][corner],
                    expected(static_cast<Eigen::Index>(axis), static_cast<Eigen::Index>(corner)),
                    1e-6);  // the moments are rounded to single precision
      }
    }
  }
}

}  // namespace
}  // namespace forcegrid
