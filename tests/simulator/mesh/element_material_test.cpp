// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/element_material.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr unsigned kSeed = 23;

Matrix3d random_matrix(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> entry(-size, size);
  Matrix3d result;
  for (int i = 0; i < 9; ++i) {
    result(i % 3, i / 3) = entry(random);
  }
  return result;
}

Matrix3d random_rotation(std::mt19937& random) {
  std::uniform_real_distribution<double> entry(-1.0, 1.0);
  const Eigen::Quaterniond q(entry(random), entry(random), entry(random), entry(random));
  return q.normalized().toRotationMatrix();
}

class ElementMaterials : public testing::TestWithParam<ElementModel> {
 protected:
  ElementMaterial material_ = soft(GetParam());
};

TEST_P(ElementMaterials, StressIsTheSlopeOfTheEnergy) {
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  constexpr double kStep = 1e-6;
  for (int n = 0; n < 20; ++n) {
    const Matrix3d f =
        random_rotation(random) * (Matrix3d::Identity() + random_matrix(random, 0.3));
    const Matrix3d stress = stress_Pa(material_, f);
    for (int i = 0; i < 9; ++i) {
      Matrix3d by = Matrix3d::Zero();
      by(i % 3, i / 3) = kStep;
      const double slope =
          (strain_energy_J_per_m3(material_, f + by) - strain_energy_J_per_m3(material_, f - by)) /
          (2.0 * kStep);
      EXPECT_NEAR(stress(i % 3, i / 3), slope, 1e-6 * material_.youngs_modulus_Pa);
    }
  }
}

TEST_P(ElementMaterials, SlopeOfStressIsThatOfFiniteDifferencesAlsoOfInvertedElements) {
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  std::mt19937 random(kSeed);
  constexpr double kStep = 1e-5;
  for (int n = 0; n < 20; ++n) {
    Matrix3d f = random_rotation(random) * (Matrix3d::Identity() + random_matrix(random, 0.3));
    if (n % 4 == 3) {
      f.col(0) *= -1.5;  // |det| is far from zero, and one singular value is the smallest
    }
    const Eigen::Matrix<double, 9, 9> slope = stress_slope_Pa(material_, f);
    EXPECT_LT((slope - slope.transpose()).norm(), 1e-9 * slope.norm());
    for (int i = 0; i < 9; ++i) {
      Matrix3d by = Matrix3d::Zero();
      by(i % 3, i / 3) = kStep;
      const Matrix3d difference =
          (stress_Pa(material_, f + by) - stress_Pa(material_, f - by)) / (2.0 * kStep);
      EXPECT_LT((slope.col(i).reshaped(3, 3) - difference).norm(),
                1e-5 * material_.youngs_modulus_Pa)
          << "element " << n << ", entry " << i;
    }
  }
}

TEST_P(ElementMaterials, ARotationCostsNothing) {
  std::mt19937 random(kSeed);
  for (int n = 0; n < 10; ++n) {
    const Matrix3d r = random_rotation(random);
    EXPECT_LT(stress_Pa(material_, r).norm(), 1e-11 * material_.youngs_modulus_Pa);
    // An energy may have a constant: that of neo_hookean is not 0 at rest.
    EXPECT_NEAR(strain_energy_J_per_m3(material_, r),
                strain_energy_J_per_m3(material_, Matrix3d::Identity()),
                1e-12 * material_.youngs_modulus_Pa);
  }
}

TEST_P(ElementMaterials, StressTurnsWithTheElement) {
  std::mt19937 random(kSeed);
  const Matrix3d f = Matrix3d::Identity() + random_matrix(random, 0.3);
  const Matrix3d r = random_rotation(random);
  EXPECT_LT((stress_Pa(material_, r * f) - r * stress_Pa(material_, f)).norm(),
            1e-11 * material_.youngs_modulus_Pa);
}

TEST_P(ElementMaterials, SmallStrainsFollowHooke) {
  std::mt19937 random(kSeed);
  const Matrix3d by = 1e-7 * random_matrix(random, 1.0);
  const Matrix3d strain = 0.5 * (by + by.transpose());
  const double mu = 5e3 / 2.6;              // E / (2 (1 + nu)), nu = 0.3
  const double lambda = 1.5e3 / 1.3 / 0.4;  // E nu / ((1 + nu) (1 - 2 nu))
  const Matrix3d hooke = 2.0 * mu * strain + lambda * strain.trace() * Matrix3d::Identity();
  EXPECT_LT((stress_Pa(material_, Matrix3d::Identity() + by) - hooke).norm(), 1e-5 * hooke.norm());
}

INSTANTIATE_TEST_SUITE_P(Models, ElementMaterials, testing::ValuesIn(kElementModels),
                         [](const auto& each) { return std::string(name_of(each.param)); });

// Stress of a bar that is stretched along x and held across.
TEST(ElementMaterial, StretchAlongOneAxisIsAsInClosedForm) {
  const double mu = 5e3 / 2.6;
  const double lambda = 1.5e3 / 1.3 / 0.4;
  for (const double s : {0.4, 0.8, 1.0, 1.3, 2.0}) {
    const Matrix3d f = Vector3d(s, 1.0, 1.0).asDiagonal();
    const Matrix3d corotated = stress_Pa(soft(ElementModel::kCorotated), f);
    EXPECT_NEAR(corotated(0, 0), (2.0 * mu + lambda) * (s - 1.0), 1e-8);
    EXPECT_NEAR(corotated(1, 1), lambda * (s - 1.0), 1e-8);
    const Matrix3d stvk = stress_Pa(soft(ElementModel::kStVenantKirchhoff), f);
    EXPECT_NEAR(stvk(0, 0), s * (mu + 0.5 * lambda) * (s * s - 1.0), 1e-8);
    EXPECT_NEAR(stvk(1, 1), 0.5 * lambda * (s * s - 1.0), 1e-8);
    const double m = 4.0 / 3.0 * mu;
    const double l = lambda + 5.0 / 6.0 * mu;
    const double a = 1.0 + 0.75 * m / l;
    const Matrix3d neo = stress_Pa(soft(ElementModel::kNeoHookean), f);
    EXPECT_NEAR(neo(0, 0), m * s * (1.0 - 1.0 / (s * s + 3.0)) + l * (s - a), 1e-8);
    EXPECT_NEAR(neo(1, 1), m * (1.0 - 1.0 / (s * s + 3.0)) + l * (s - a) * s, 1e-8);
  }
}

TEST(ElementMaterial, RotationOfAnInvertedElementIsStillARotation) {
  const Matrix3d r = nearest_rotation(Vector3d(2.0, 1.5, -0.3).asDiagonal());
  EXPECT_NEAR(r.determinant(), 1.0, 1e-14);
  EXPECT_LT((r - Matrix3d::Identity()).norm(), 1e-14);  // the smallest stretch is the negative one
}

}  // namespace
}  // namespace forcegrid::simulator
