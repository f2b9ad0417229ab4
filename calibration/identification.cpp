// SPDX-License-Identifier: Apache-2.0
#include "calibration/identification.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

namespace forcegrid::calibration {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kHalfWindow_s = 0.07;
constexpr double kGrid_s = 0.02;
constexpr double kLeastTanh = 0.99;  // slower samples depend on how friction sets in
constexpr std::size_t kLeastPoints = 12;
constexpr double kLongestStep = 4.0;  // in median steps: in a longer one the host paused
constexpr double kOutlier = 4.0;      // in standard deviations, estimated by the median
constexpr double kMostOutliers = 0.2;
constexpr int kRefits = 3;
constexpr std::size_t kLeastSamples = 40;
// Neighbouring windows share points: this many of them count as one.
constexpr double kOverlap = kHalfWindow_s / kGrid_s;
constexpr int kColumns = 4;  // per row: rigid, tanh, speed, rate of the torque

struct Rows {
  MatrixXd regressors;  // samples x kColumns
  VectorXd torque_Nm;
};

double window(double x) { return x * x >= 1.0 ? 0.0 : 0.9375 * (1.0 - x * x) * (1.0 - x * x); }

// Integral of window() from 0.
double window_sum(double x) {
  x = std::clamp(x, -1.0, 1.0);
  return 0.9375 * x * (1.0 - x * x * (2.0 / 3.0 - x * x / 5.0));
}

// One joint's trace with the poses of its points.
struct Motion {
  const Trace& trace;
  std::vector<driver::ArmPose> poses;
  std::vector<double> holding_Nm;
};

Motion motion_of(const Trace& trace, RigidBody& body, int joint) {
  Motion motion{trace, {}, {}};
  for (const TracePoint& point : trace) {
    motion.poses.push_back(body.pose(point.counts));
    motion.holding_Nm.push_back(body.holding_Nm(motion.poses.back())[joint]);
  }
  return motion;
}

struct Row {
  Eigen::Matrix<double, 1, kColumns> regressors;
  double torque_Nm;
};

// The window about `center_s` with the points [first, last); nothing next to a reversal.
std::optional<Row> row_at(const Motion& motion, RigidBody& body, double smoothing_s_per_rad,
                          int joint, double center_s, std::size_t first, std::size_t last) {
  const auto count = static_cast<Eigen::Index>(last - first);
  MatrixXd powers(count, 4);
  MatrixXd places(count, 6);  // joint angles, tip
  double torque_Nm = 0.0;
  double torque_rate_Nm_per_s = 0.0;
  double holding_Nm = 0.0;
  double weight = 0.0;
  std::size_t nearest = first;
  for (std::size_t i = first; i < last; ++i) {
    const TracePoint& point = motion.trace[i];
    const double x = (point.time_s - center_s) / kHalfWindow_s;
    const double x_before = (motion.trace[i - 1].time_s - center_s) / kHalfWindow_s;
    const auto row = static_cast<Eigen::Index>(i - first);
    powers.row(row) << 1.0, x, x * x, x * x * x;
    places.row(row) << motion.poses[i].joint_angle_rad.transpose(),
        motion.poses[i].position_D.transpose();
    torque_Nm += point.joint_torque_Nm[joint] * (window_sum(x) - window_sum(x_before));
    torque_rate_Nm_per_s -=
        point.joint_torque_Nm[joint] * (window(x) - window(x_before)) / kHalfWindow_s;
    holding_Nm += window(x) * motion.holding_Nm[i];
    weight += window(x);
    if (std::abs(point.time_s - center_s) < std::abs(motion.trace[nearest].time_s - center_s)) {
      nearest = i;
    }
  }
  const MatrixXd cubic = powers.householderQr().solve(places);
  const auto speed_at = [&](double x) {
    return (cubic(1, joint) + 2.0 * cubic(2, joint) * x + 3.0 * cubic(3, joint) * x * x) /
           kHalfWindow_s;
  };
  const double least_rad_per_s = std::atanh(kLeastTanh) / smoothing_s_per_rad;
  const double speed_rad_per_s = speed_at(0.0) + 3.0 / 7.0 * cubic(3, joint) / kHalfWindow_s;
  for (const double x : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
    if (speed_at(x) * std::copysign(1.0, speed_rad_per_s) < least_rad_per_s) {
      return std::nullopt;
    }
  }
  const Eigen::Matrix<double, 6, 1> acceleration =
      2.0 * cubic.row(2).transpose() / (kHalfWindow_s * kHalfWindow_s);
  const double rigid_Nm =
      holding_Nm / weight + body.inertial_Nm(motion.poses[nearest], acceleration.tail<3>(),
                                             acceleration.head<3>())[joint];
  Row row;
  row.regressors << rigid_Nm, std::tanh(smoothing_s_per_rad * speed_rad_per_s), speed_rad_per_s,
      torque_rate_Nm_per_s;
  row.torque_Nm = torque_Nm;
  return row;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double median_step_s(const Trace& trace) {
  std::vector<double> steps_s;
  for (std::size_t i = 1; i < trace.size(); ++i) {
    steps_s.push_back(trace[i].time_s - trace[i - 1].time_s);
  }
  return steps_s.empty() ? 0.0 : median(std::move(steps_s));
}

Rows rows_of(const Trace& trace, RigidBody& body, double smoothing_s_per_rad, int joint) {
  std::vector<Row> rows;
  if (!trace.empty()) {
    const Motion motion = motion_of(trace, body, joint);
    const double longest_step_s = kLongestStep * median_step_s(trace);
    const auto paused_before = [&](const TracePoint& point) {
      return point.time_s - (&point - 1)->time_s > longest_step_s;
    };
    std::size_t first = 1;
    std::size_t last = 1;
    for (double center_s = trace.front().time_s + 2.0 * kHalfWindow_s;
         center_s < trace.back().time_s - 2.0 * kHalfWindow_s; center_s += kGrid_s) {
      while (trace[first].time_s < center_s - kHalfWindow_s) {
        ++first;
      }
      // Adds one point, whose command flows at the window's end; it has no weight itself.
      while (last < trace.size() && trace[last].time_s < center_s + kHalfWindow_s) {
        ++last;
      }
      const std::size_t end = std::min(last + 1, trace.size());
      if (end - first < kLeastPoints ||
          std::any_of(trace.begin() + static_cast<std::ptrdiff_t>(first),
                      trace.begin() + static_cast<std::ptrdiff_t>(end), paused_before)) {
        continue;
      }
      if (const auto row = row_at(motion, body, smoothing_s_per_rad, joint, center_s, first, end)) {
        rows.push_back(*row);
      }
    }
  }
  if (rows.size() < kLeastSamples) {
    throw CalibrationError(
        "joint " + std::to_string(joint + 1) +
        " hardly moved, so its friction can't be measured: clear its way, and look "
        "whether its motor has power; the motors have no current");
  }
  Rows result{MatrixXd(static_cast<Eigen::Index>(rows.size()), kColumns),
              VectorXd(static_cast<Eigen::Index>(rows.size()))};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    result.regressors.row(static_cast<Eigen::Index>(i)) = rows[i].regressors;
    result.torque_Nm[static_cast<Eigen::Index>(i)] = rows[i].torque_Nm;
  }
  return result;
}

struct Solution {
  VectorXd value;
  VectorXd error;
  VectorXd residual;
  VectorXd weight;  // of each row: 1, or 0 where it was left out
};

// Columns are scaled first, so that the rank does not depend on units.
Solution solve(const MatrixXd& regressors, const VectorXd& torque_Nm) {
  Solution solution;
  solution.weight = VectorXd::Ones(torque_Nm.size());
  const Eigen::RowVectorXd size =
      regressors.colwise().norm().cwiseMax(std::numeric_limits<double>::min());
  const MatrixXd scaled = regressors.array().rowwise() / size.array();
  const Eigen::CompleteOrthogonalDecomposition<MatrixXd> factor(scaled);
  solution.value = factor.solve(torque_Nm).array() / size.transpose().array();
  solution.residual = torque_Nm - regressors * solution.value;
  const double freedom = std::max(1.0, static_cast<double>(regressors.rows() - regressors.cols()));
  const double variance = kOverlap * solution.residual.squaredNorm() / freedom;
  const MatrixXd inverse = factor.pseudoInverse();
  solution.error =
      (variance * inverse.rowwise().squaredNorm().array()).sqrt() / size.transpose().array();
  // If the data do not determine every column, the result is unknown.
  if (factor.rank() < regressors.cols()) {
    solution.error.setConstant(std::numeric_limits<double>::infinity());
  }
  return solution;
}

// The same without the few rows that fit far worse than the others: somebody touched the arm, or it
// swung back after the host had paused. If there are many such rows, the model is wrong and all
// count.
Solution solve_without_outliers(const MatrixXd& regressors, const VectorXd& torque_Nm) {
  const Solution whole = solve(regressors, torque_Nm);
  Solution best = whole;
  for (int i = 0; i < kRefits; ++i) {
    const VectorXd size = best.residual.cwiseAbs();
    const double limit = kOutlier * 1.4826 * median({size.data(), size.data() + size.size()});
    std::vector<Eigen::Index> kept;
    for (Eigen::Index row = 0; row < size.size(); ++row) {
      if (size[row] <= limit) {
        kept.push_back(row);
      }
    }
    if (static_cast<double>(kept.size()) <
        (1.0 - kMostOutliers) * static_cast<double>(size.size())) {
      return whole;
    }
    best = solve(regressors(kept, Eigen::all), torque_Nm(kept));
    best.residual = torque_Nm - regressors * best.value;
    best.weight = VectorXd::Zero(torque_Nm.size());
    best.weight(kept).setOnes();
  }
  return best;
}

std::size_t rows_in(const VectorXd& weight) {
  return static_cast<std::size_t>(std::lround(weight.sum()));
}

double rms(const VectorXd& values, const VectorXd& weight) {
  return std::sqrt(values.cwiseAbs2().dot(weight) / std::max(1.0, weight.sum()));
}

Estimate estimate(const Solution& solution, Eigen::Index at) {
  return {solution.value[at], solution.error[at]};
}

}  // namespace

double Estimate::relative_error() const noexcept {
  return value == 0.0 ? std::numeric_limits<double>::infinity() : error / std::abs(value);
}

JointFit fit_joint(const Trace& trace, RigidBody& body, double smoothing_s_per_rad, int joint) {
  const Rows rows = rows_of(trace, body, smoothing_s_per_rad, joint);
  const Solution solution = solve_without_outliers(rows.regressors, rows.torque_Nm);
  return {.scale = estimate(solution, 0),
          .coulomb_Nm = estimate(solution, 1),
          .viscous_Nm_s_per_rad = estimate(solution, 2),
          .delay_s = estimate(solution, 3),
          .residual_Nm = rms(solution.residual, solution.weight),
          .samples = rows_in(solution.weight)};
}

std::array<JointFit, 3> fit_joints_of_one_scale(const std::array<Trace, 3>& traces, RigidBody& body,
                                                double smoothing_s_per_rad) {
  std::array<Rows, 3> rows;
  Eigen::Index count = 0;
  for (std::size_t joint = 0; joint < 3; ++joint) {
    rows[joint] = rows_of(traces[joint], body, smoothing_s_per_rad, static_cast<int>(joint));
    count += rows[joint].torque_Nm.size();
  }
  // Columns: scale; friction, damping and delay of each joint.
  MatrixXd regressors = MatrixXd::Zero(count, 1 + 3 * (kColumns - 1));
  VectorXd torque_Nm(count);
  Eigen::Index begin = 0;
  for (std::size_t joint = 0; joint < 3; ++joint) {
    const Eigen::Index size = rows[joint].torque_Nm.size();
    const auto first = static_cast<Eigen::Index>(1 + joint * (kColumns - 1));
    regressors.block(begin, 0, size, 1) = rows[joint].regressors.leftCols(1);
    regressors.block(begin, first, size, kColumns - 1) =
        rows[joint].regressors.rightCols(kColumns - 1);
    torque_Nm.segment(begin, size) = rows[joint].torque_Nm;
    begin += size;
  }
  const Solution solution = solve_without_outliers(regressors, torque_Nm);
  std::array<JointFit, 3> fits;
  begin = 0;
  for (std::size_t joint = 0; joint < 3; ++joint) {
    const Eigen::Index size = rows[joint].torque_Nm.size();
    const auto first = static_cast<Eigen::Index>(1 + joint * (kColumns - 1));
    fits[joint] = {.scale = estimate(solution, 0),
                   .coulomb_Nm = estimate(solution, first),
                   .viscous_Nm_s_per_rad = estimate(solution, first + 1),
                   .delay_s = estimate(solution, first + 2),
                   .residual_Nm = rms(solution.residual.segment(begin, size),
                                      solution.weight.segment(begin, size)),
                   .samples = rows_in(solution.weight.segment(begin, size))};
    begin += size;
  }
  return fits;
}

}  // namespace forcegrid::calibration
