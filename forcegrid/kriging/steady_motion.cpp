// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/steady_motion.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>

namespace forcegrid::kriging {
namespace {

constexpr int kFits = 2;  // the second with the first one's s2

}  // namespace

void SteadyMotion::begin(double time_s, const Eigen::Vector3d& shift_m,
                         const Eigen::Vector3d& velocity_m_per_s,
                         const Covariance& covariance) noexcept {
  begin_s_ = time_s;
  start_ << shift_m, velocity_m_per_s;
  eta_.setZero();
  prior_inverse_ = covariance.inverse();
  covariance_ = covariance;
  explained_squares_ = 0.0;
}

bool SteadyMotion::fit(const Products& products, int rows) noexcept {
  constexpr int kC = kUnknowns;
  constexpr int kForces = kTerms;
  const Covariance b_b = products.topLeftCorner<kUnknowns, kUnknowns>();
  const Vector b_y = products.col(kForces).head<kUnknowns>() + products.col(kC).head<kUnknowns>();
  const double y_y = products(kForces, kForces) + 2.0 * products(kForces, kC) + products(kC, kC);
  double s2 = 1.0;
  double left = y_y;
  Covariance information;
  for (int i = 0; i < kFits; ++i) {
    s2 = std::max(1.0, i == 0 ? 1.0 : left / std::max(1, rows));
    information = s2 * prior_inverse_ + b_b;
    eta_ = information.ldlt().solve(b_y);
    left = y_y - b_y.dot(eta_);
  }
  covariance_ = s2 * information.inverse();
  explained_squares_ = products(kForces, kForces) - left;
  return eta_.allFinite() && covariance_.allFinite() &&
         (covariance_.diagonal().array() > 0.0).all();
}

SteadyMotion::Columns SteadyMotion::design(double time_s) const noexcept {
  Columns design = Columns::Zero();
  design.leftCols<3>().setIdentity();
  design.rightCols<3>().diagonal().setConstant(time_s - begin_s_);
  return design;
}

SteadyMotion::Covariance SteadyMotion::covariance_at(double time_s) const noexcept {
  Covariance step = Covariance::Identity();
  step.topRightCorner<3, 3>().diagonal().setConstant(time_s - begin_s_);
  return step * covariance_ * step.transpose();
}

Eigen::Vector3d SteadyMotion::shift_m(double time_s, const Vector& eta) const noexcept {
  return design(time_s) * (start_ + eta);
}

SteadyMotion::Terms SteadyMotion::terms(double time_s, const Eigen::Matrix3d& slope_N_per_m,
                                        const Vector& eta) const noexcept {
  Terms terms;
  terms.leftCols<kUnknowns>() = -slope_N_per_m * design(time_s);
  terms.col(kUnknowns) = terms.leftCols<kUnknowns>() * eta;
  return terms;
}

Eigen::Matrix<double, SteadyMotion::kTerms, 1> SteadyMotion::factors() const noexcept {
  Eigen::Matrix<double, kTerms, 1> factors;
  factors << -eta_, 1.0;
  return factors;
}

}  // namespace forcegrid::kriging
