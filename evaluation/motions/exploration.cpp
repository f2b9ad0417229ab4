// SPDX-License-Identifier: Apache-2.0
#include "evaluation/motions/exploration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "evaluation/motions/minimum_jerk.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kMoveOver_s = 1.0;

// Positions of the tiles, in tiles, from the middle one outwards.
constexpr int kSpiral[kTiles][2] = {{0, 0},  {1, 0},   {1, 1},  {0, 1}, {-1, 1},
                                    {-1, 0}, {-1, -1}, {0, -1}, {1, -1}};

constexpr double kAmplitude_m = 0.020;  // A
struct Fold {
  double share;        // a
  double offset_m[2];  // o, along x and y
  bool turned;
};
constexpr std::array<Fold, 2> kFolds{{{0.6, {0.010, -0.015}, false}, {0.5, {-0.022, 0.018}, true}}};

ForceTable::Value folded(const ForceTable& table, const Vector3d& displacement_W) {
  ForceTable::Value sum{Vector3d::Zero(), Matrix3d::Zero()};
  Matrix3d quarter = Matrix3d::Zero();  // R: x to y, y to -x
  quarter(0, 1) = -1.0;
  quarter(1, 0) = quarter(2, 2) = 1.0;
  for (const Fold& fold : kFolds) {
    Vector3d at_m = displacement_W;  // g
    Vector3d slope = Vector3d::Ones();
    Vector3d bend_per_m = Vector3d::Zero();
    for (int axis = 0; axis < 2; ++axis) {
      const double phase_rad = (displacement_W[axis] - fold.offset_m[axis]) / kAmplitude_m;
      at_m[axis] = kAmplitude_m * std::sin(phase_rad);
      slope[axis] = std::cos(phase_rad);
      bend_per_m[axis] = -std::sin(phase_rad) / kAmplitude_m;
    }
    const Matrix3d r = fold.turned ? quarter : Matrix3d(Matrix3d::Identity());
    const ForceTable::Value value = table.at(r.transpose() * at_m);
    const Vector3d force_W = r * value.force_W;
    sum.force_W += fold.share * slope.cwiseProduct(force_W);
    sum.stiffness_W += fold.share * (slope.asDiagonal() * (r * value.stiffness_W * r.transpose()) *
                                     slope.asDiagonal());
    sum.stiffness_W.diagonal() += fold.share * bend_per_m.cwiseProduct(force_W);
  }
  return sum;
}

// Mean of squares over a window.
struct Window {
  double from_s, to_s;
  double squares_N2 = 0.0;
  double count = 0.0;
  void take(double since_s, double error_N2) {
    if (since_s >= from_s && since_s < to_s) {
      squares_N2 += error_N2;
      count += 1.0;
    }
  }
  double percent_of(double rms_N) const {
    return count > 0.0 && rms_N > 0.0 ? 100.0 * std::sqrt(squares_N2 / count) / rms_N
                                      : std::numeric_limits<double>::quiet_NaN();
  }
};

}  // namespace

Vector3d tile_centre_W_m(int visit) {
  const auto& tile = kSpiral[visit % kTiles];
  return kTileSide_m * Vector3d(tile[0], tile[1], 0.0);
}

Vector3d exploration_centre_W_m(double time_s) {
  const int visit = std::clamp(static_cast<int>(time_s / kTileStay_s), 0, kTileVisits - 1);
  const Vector3d here_W = tile_centre_W_m(visit);
  const Vector3d before_W = tile_centre_W_m(std::max(0, visit - 1));
  return before_W +
         minimum_jerk((time_s - visit * kTileStay_s) / kMoveOver_s) * (here_W - before_W);
}

ForceTable::Value large_object(const ForceTable& table, const Vector3d& displacement_W) {
  ForceTable::Value value = folded(table, displacement_W);
  value.force_W -= folded(table, Vector3d::Zero()).force_W;
  return value;
}

Vector3d clamped_to_large_object(const ForceTable& table, const Vector3d& displacement_W) noexcept {
  return {displacement_W.x(), displacement_W.y(), table.clamped(displacement_W).z()};
}

ReturnErrors return_errors(const std::vector<ServoInstant>& servo, const Vector3d& contact_point_W,
                           const std::vector<Vector3d>& forces_W) {
  std::array<Window, 5> windows{{{0.0, 0.033}, {0.033, 0.1}, {0.1, 0.5}, {0.5, 1.0}, {0.0, 1e9}}};
  double reference_N2 = 0.0;
  int entered = -1;  // the visit whose tile the tool has entered
  double entered_s = 0.0;
  for (std::size_t i = 0; i < servo.size() && i < forces_W.size(); ++i) {
    const ServoInstant& instant = servo[i];
    reference_N2 += instant.force_W.squaredNorm();
    const int visit = static_cast<int>(instant.time_s / kTileStay_s);
    const Vector3d from_centre_W = instant.position_W - contact_point_W - tile_centre_W_m(visit);
    if (visit > entered && from_centre_W.head<2>().cwiseAbs().maxCoeff() <= 0.5 * kTileSide_m) {
      entered = visit;
      entered_s = instant.time_s;
    }
    if (visit < kTiles) {
      continue;
    }
    const double error_N2 = (forces_W[i] - instant.force_W).squaredNorm();
    windows[4].take(instant.time_s, error_N2);
    if (entered == visit) {
      for (std::size_t w = 0; w < 4; ++w) {
        windows[w].take(instant.time_s - entered_s, error_N2);
      }
    }
  }
  const double rms_N =
      std::sqrt(reference_N2 / static_cast<double>(std::max<std::size_t>(1, servo.size())));
  return {windows[0].percent_of(rms_N), windows[1].percent_of(rms_N), windows[2].percent_of(rms_N),
          windows[3].percent_of(rms_N), windows[4].percent_of(rms_N)};
}

}  // namespace forcegrid::evaluation
