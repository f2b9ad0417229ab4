// SPDX-License-Identifier: Apache-2.0
#include "stability/theory.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <unsupported/Eigen/MatrixFunctions>

namespace forcegrid::stability {
namespace {

constexpr double kLeast_N_per_m = 1.0;
constexpr double kMost_N_per_m = 1e6;
constexpr double kScanFactor = 1.05;
constexpr double kExactness = 1e-4;

// x and x' after `duration_s` of a constant force: [transition | response].
Eigen::Matrix<double, 2, 3> discretised(const SampledSpring& spring, double duration_s) {
  Eigen::Matrix3d rates = Eigen::Matrix3d::Zero();
  rates(0, 1) = 1.0;
  rates(1, 0) = -spring.hand_stiffness_N_per_m / spring.mass_kg;
  rates(1, 1) = -spring.damping_N_s_per_m / spring.mass_kg;
  rates(1, 2) = 1.0 / spring.mass_kg;
  return Eigen::Matrix3d((duration_s * rates).exp()).topRows<2>();
}

}  // namespace

SampledSpring sampled_spring(const DeviceDynamics& device, const Hand& hand, double period_s,
                             double age_s) {
  SampledSpring spring;
  spring.mass_kg = device.mass_kg + hand.impedance.mass_kg;
  spring.damping_N_s_per_m = device.damping_N_s_per_m + hand.impedance.damping_N_s_per_m;
  spring.hand_stiffness_N_per_m = hand.impedance.stiffness_N_per_m;
  spring.period_s = period_s;
  spring.age_s = age_s;
  return spring;
}

// State: x, x', x_{j-1}, and the forces f_{j-1} .. f_{j-n-1} that are under way, where
// tau = n T + rest. Between j T and j T + rest acts f_{j-n-1}, after it f_{j-n}.
double spectral_radius(const SampledSpring& spring, double stiffness_N_per_m) {
  const auto whole = static_cast<Eigen::Index>(std::floor(spring.age_s / spring.period_s + 1e-9));
  const double rest_s = std::max(0.0, spring.age_s - static_cast<double>(whole) * spring.period_s);
  const Eigen::Matrix<double, 2, 3> first = discretised(spring, rest_s);
  const Eigen::Matrix<double, 2, 3> second = discretised(spring, spring.period_s - rest_s);
  const Eigen::Matrix2d later = second.leftCols<2>();

  const Eigen::Index size = 3 + whole + 1;
  // f_j as a row over the state.
  Eigen::RowVectorXd newest = Eigen::RowVectorXd::Zero(size);
  const double damping_N_per_m = spring.virtual_damping_N_s_per_m / spring.period_s;
  newest[0] = -(stiffness_N_per_m + damping_N_per_m);
  newest[2] = damping_N_per_m;
  const auto force_before = [&](Eigen::Index steps) {  // f_{j - steps}
    return steps == 0 ? newest : Eigen::RowVectorXd(Eigen::RowVectorXd::Unit(size, 2 + steps));
  };
  Eigen::MatrixXd next = Eigen::MatrixXd::Zero(size, size);
  next.topLeftCorner<2, 2>() = later * first.leftCols<2>();
  next.topRows<2>() += later * first.col(2) * force_before(whole + 1);
  next.topRows<2>() += second.col(2) * force_before(whole);
  next(2, 0) = 1.0;
  for (Eigen::Index steps = 1; steps <= whole + 1; ++steps) {
    next.row(2 + steps) = force_before(steps - 1);
  }
  return next.eigenvalues().cwiseAbs().maxCoeff();
}

double eigenvalue_limit_N_per_m(const SampledSpring& spring) {
  const auto stable = [&](double stiffness) { return spectral_radius(spring, stiffness) < 1.0; };
  if (!stable(kLeast_N_per_m)) {
    return 0.0;
  }
  double low = kLeast_N_per_m;
  double high = low * kScanFactor;
  for (; stable(high); high *= kScanFactor) {
    if (high > kMost_N_per_m) {
      return std::numeric_limits<double>::infinity();
    }
    low = high;
  }
  while (high / low > 1.0 + kExactness) {
    const double middle = std::sqrt(low * high);
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

double colgate_schenkel_N_per_m(double damping_N_s_per_m, double period_s,
                                double virtual_damping_N_s_per_m) {
  return std::max(0.0, 2.0 * (damping_N_s_per_m - std::abs(virtual_damping_N_s_per_m)) / period_s);
}

double delay_rule_N_per_m(double damping_N_s_per_m, double age_s) {
  return age_s > 0.0 ? damping_N_s_per_m / age_s : std::numeric_limits<double>::infinity();
}

double abbott_okamura_N_per_m(double damping_N_s_per_m, double period_s, double coulomb_friction_N,
                              double position_step_m) {
  const double by_damping = 2.0 * damping_N_s_per_m / period_s;
  return position_step_m > 0.0 ? std::min(by_damping, 2.0 * coulomb_friction_N / position_step_m)
                               : by_damping;
}

}  // namespace forcegrid::stability
