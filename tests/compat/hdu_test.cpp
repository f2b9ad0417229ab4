// SPDX-License-Identifier: Apache-2.0
#include <HDU/hdu.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>

namespace {

constexpr double kRounding = 1e-12;
constexpr double kPi = std::numbers::pi;

// What libHD writes for a pose: rotation and translation, column by column.
std::array<double, 16> transform_of(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& p) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topLeftCorner<3, 3>() = rotation;
  pose.topRightCorner<3, 1>() = p;
  std::array<double, 16> memory{};
  Eigen::Map<Eigen::Matrix4d>(memory.data()) = pose;
  return memory;
}

struct KnownRotation {
  Eigen::AngleAxisd rotation;
  Eigen::Vector4d quaternion;  // s, x, y, z by hand
};

// A quarter turn about x, a third of a turn about the diagonal, and half a turn about y.
const std::array<KnownRotation, 3> kRotations = {{
    {{kPi / 2, Eigen::Vector3d::UnitX()}, {std::sqrt(0.5), std::sqrt(0.5), 0, 0}},
    {{2 * kPi / 3, Eigen::Vector3d(1, 1, 1).normalized()}, {0.5, 0.5, 0.5, 0.5}},
    {{kPi, Eigen::Vector3d::UnitY()}, {0, 0, 1, 0}},
}};

TEST(HduQuaternion, DescribesTheRotationWhoseColumnsAreTheMemory) {
  for (const KnownRotation& known : kRotations) {
    const auto memory = transform_of(known.rotation.toRotationMatrix(), {1, 2, 3});
    hduMatrix matrix(memory.data());
    EXPECT_EQ(matrix[3][0], 1);
    EXPECT_EQ(matrix[3][1], 2);
    EXPECT_EQ(matrix[3][2], 3);
    matrix.getRotationMatrix(matrix);
    EXPECT_EQ(matrix[3][0], 0);
    const hduQuaternion q(matrix);
    const double sign = std::abs(q.s()) < kRounding && q.v()[1] < 0 ? -1 : 1;
    for (int i = 0; i < 4; ++i) {
      EXPECT_NEAR(sign * q[i], known.quaternion[i], kRounding);
    }
    hduMatrix back;
    q.toRotationMatrix(back);
    for (int i = 0; i < 16; ++i) {
      EXPECT_NEAR(static_cast<const double*>(back)[i], static_cast<const double*>(matrix)[i],
                  kRounding);
    }
  }
}

// Programs also transpose and then read ordinary rows, or read the transpose by hand.
TEST(HduMatrix, TransposedReadsAsOrdinaryRows) {
  for (const KnownRotation& known : kRotations) {
    const Eigen::Matrix3d rotation = known.rotation.toRotationMatrix();
    hduMatrix matrix(transform_of(rotation, {1, 2, 3}).data());
    const hduMatrix as_written = matrix;
    matrix.transpose();
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(matrix[r][c], rotation(r, c), kRounding);
        EXPECT_NEAR(as_written[c][r], rotation(r, c), kRounding);
      }
      EXPECT_EQ(matrix[r][3], r + 1);
    }
  }
}

TEST(HduMatrix, TurnsAndMovesPointsAsRows) {
  const hduMatrix turn = hduMatrix::createRotation(0, 0, 1, kPi / 2);
  const hduMatrix move = hduMatrix::createTranslation(1, 2, 3);
  hduVector3Dd point(1, 0, 0);
  (turn * move).multVecMatrix(point, point);  // first turned to (0, 1, 0), then moved
  EXPECT_NEAR(point[0], 1, kRounding);
  EXPECT_NEAR(point[1], 3, kRounding);
  EXPECT_NEAR(point[2], 3, kRounding);

  hduMatrix by_right = turn;
  by_right.multRight(move);
  hduMatrix by_left = move;
  by_left.multLeft(turn);
  for (int i = 0; i < 16; ++i) {
    EXPECT_EQ(by_right[i / 4][i % 4], by_left[i / 4][i % 4]);
    EXPECT_EQ(by_right[i / 4][i % 4], (turn * move)[i / 4][i % 4]);
  }
  const hduMatrix none = (turn * move) * (turn * move).getInverse();
  for (int i = 0; i < 16; ++i) {
    EXPECT_NEAR(none[i / 4][i % 4], i / 4 == i % 4 ? 1 : 0, kRounding);
  }
}

TEST(HduMatrix, InvertsWhatNeedsAnExchangeOfRows) {
  const double memory[16] = {0, 2, 0, 0, 4, 0, 0, 0, 0, 0, 0, 8, 0, 0, 1, 0};
  const hduMatrix inverse = hduMatrix(memory).getInverse();
  EXPECT_EQ(inverse[0][1], 0.25);
  EXPECT_EQ(inverse[1][0], 0.5);
  EXPECT_EQ(inverse[2][3], 1);
  EXPECT_EQ(inverse[3][2], 0.125);
}

TEST(HduQuaternion, ProductTurnsByTheRightOneFirst) {
  const hduQuaternion x(hduMatrix::createRotation(1, 0, 0, kPi / 2));
  const hduQuaternion z(hduMatrix::createRotation(0, 0, 1, kPi / 2));
  const Eigen::Quaterniond expected =
      Eigen::Quaterniond(Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitZ())) *
      Eigen::Quaterniond(Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitX()));
  const hduQuaternion product = z * x;
  EXPECT_NEAR(product.s(), expected.w(), kRounding);
  EXPECT_NEAR(product.v()[0], expected.x(), kRounding);
  EXPECT_NEAR(product.v()[1], expected.y(), kRounding);
  EXPECT_NEAR(product.v()[2], expected.z(), kRounding);
  const hduQuaternion none = product * product.inverse();
  EXPECT_NEAR(none.s(), 1, kRounding);
  EXPECT_TRUE(none.v().isZero(kRounding));
}

TEST(HduQuaternion, ComesBackFromEveryKindOfRotation) {
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d axis = Eigen::Vector3d(std::cos(i), std::sin(3 * i), std::cos(7 * i + 1));
    const hduMatrix matrix = hduMatrix::createRotation({axis.x(), axis.y(), axis.z()}, 0.1 * i);
    hduQuaternion q;
    matrix.getRotation(q);
    EXPECT_GE(q.s(), 0);
    hduMatrix back;
    q.toRotationMatrix(back);
    for (int j = 0; j < 16; ++j) {
      EXPECT_NEAR(back[j / 4][j % 4], matrix[j / 4][j % 4], kRounding);
    }
  }
}

TEST(HduVector, CalculatesAsByHand) {
  const hduVector3Dd a(1, 2, 3);
  const hduVector3Dd b(4, 5, 6);
  EXPECT_EQ(a.dotProduct(b), 32);
  EXPECT_EQ(a.crossProduct(b), hduVector3Dd(-3, 6, -3));
  EXPECT_EQ(2 * a - b / 2 + -a, hduVector3Dd(-1, -0.5, 0));
  EXPECT_DOUBLE_EQ(hduVector3Dd(2, 3, 6).magnitude(), 7);
  EXPECT_TRUE(normalize(hduVector3Dd(0, 0, 0)).isZero(0));
  EXPECT_NEAR(normalize(b).magnitude(), 1, kRounding);
  EXPECT_TRUE(hduVector3Dd(1e-4, -1e-4, 0).isZero(1e-3));
  EXPECT_FALSE(hduVector3Dd(0, 0, -1e-2).isZero(1e-3));
  std::ostringstream text;
  text << a;
  EXPECT_EQ(text.str(), "(1, 2, 3)");
  double in_place[3] = {1, 2, 3};
  hduVecAdd(in_place, in_place, in_place);
  hduVecSubtract(in_place, in_place, a);
  hduVecScaleInPlace(in_place, 3);
  EXPECT_EQ(hduVector3Dd(in_place), hduVector3Dd(3, 6, 9));
}

TEST(HduPlane, HasSides) {
  const hduPlaned plane(hduVector3Dd(0, 2, 0), hduVector3Dd(5, 1, 5));
  EXPECT_EQ(plane.d(), -2);
  EXPECT_EQ(plane.perpDistance({0, 4, 0}), 3);
  EXPECT_EQ(plane.perpDistance({0, 0, 0}), -1);
  EXPECT_EQ(plane.projectPoint({7, 4, 8}), hduVector3Dd(7, 1, 8));
  EXPECT_EQ(hduPlaned(0, 2, 0, -2).perpDistance({0, 4, 0}), 3);
}

TEST(HduError, KnowsItsClasses) {
  for (unsigned code = 0; code < 0x0700; ++code) {
    const HDErrorInfo error = {code, 0, 0};
    EXPECT_EQ(hduIsForceError(&error) != 0, code >= 0x0200 && code <= 0x0204) << code;
    const bool scheduler = (code >= 0x0302 && code <= 0x0304) || code == 0x0500 || code == 0x0501;
    EXPECT_EQ(hduIsSchedulerError(&error) != 0, scheduler) << code;
  }
}

}  // namespace
