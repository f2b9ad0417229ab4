// SPDX-License-Identifier: Apache-2.0
#include "contact/distance.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace forcegrid::contact {
namespace {

// Below this fraction of its sides' lengths a triangle has no plane, and an axis no direction.
constexpr double kFlat = 1e-12;
constexpr double kSmallest_m = 1e-12;

double along(const Eigen::Vector3d& point, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d path = to - from;
  const double squared = path.squaredNorm();
  return squared > 0.0 ? std::clamp((point - from).dot(path) / squared, 0.0, 1.0) : 0.0;
}

Eigen::Vector3d blend(const Eigen::Vector3d& weights, const Corners& corners) {
  return weights[0] * corners[0] + weights[1] * corners[1] + weights[2] * corners[2];
}

void take_if_nearer(AxisToTriangle& best, const Eigen::Vector3d& on_axis,
                    const Eigen::Vector3d& weights, const Corners& corners) {
  const Eigen::Vector3d on_triangle = blend(weights, corners);
  const double distance_m = (on_axis - on_triangle).norm();
  if (distance_m < best.distance_m) {
    best = {distance_m, on_axis, on_triangle, weights};
  }
}

// Parameters of the nearest points of two segments. Source: Ericson, section 5.1.9.
std::array<double, 2> nearest_on_segments(const Eigen::Vector3d& from_1,
                                          const Eigen::Vector3d& path_1,
                                          const Eigen::Vector3d& from_2,
                                          const Eigen::Vector3d& path_2) {
  const Eigen::Vector3d apart = from_1 - from_2;
  const double a = path_1.squaredNorm();
  const double e = path_2.squaredNorm();
  const double f = path_2.dot(apart);
  const double c = path_1.dot(apart);
  const double b = path_1.dot(path_2);
  const double determinant = a * e - b * b;
  double s =
      determinant > kFlat * a * e ? std::clamp((b * f - c * e) / determinant, 0.0, 1.0) : 0.0;
  double t = e > 0.0 ? (b * s + f) / e : 0.0;
  if (t < 0.0 || t > 1.0) {
    t = std::clamp(t, 0.0, 1.0);
    s = a > 0.0 ? std::clamp((b * t - c) / a, 0.0, 1.0) : 0.0;
  }
  return {s, t};
}

// The point where the segment goes through the triangle's inside, if it does.
bool crosses(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Corners& corners,
             AxisToTriangle& crossing) {
  const Eigen::Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
  const double above = normal.dot(from - corners[0]);
  const double below = normal.dot(to - corners[0]);
  if (above * below > 0.0 || above == below) {
    return false;
  }
  const Eigen::Vector3d point = from + above / (above - below) * (to - from);
  const double squared = normal.squaredNorm();
  Eigen::Vector3d weights;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d& second = corners[(k + 1) % 3];
    const Eigen::Vector3d& third = corners[(k + 2) % 3];
    weights[static_cast<Eigen::Index>(k)] =
        normal.dot((third - second).cross(point - second)) / squared;
  }
  if (!(weights.minCoeff() >= 0.0)) {
    return false;
  }
  crossing = {0.0, point, blend(weights, corners), weights};
  return true;
}

Eigen::Vector3d across(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d direction =
      axis.norm() > kSmallest_m ? axis.normalized() : Eigen::Vector3d(Eigen::Vector3d::UnitX());
  return direction.unitOrthogonal();
}

}  // namespace

Eigen::Vector3d nearest_weights(const Eigen::Vector3d& point, const Corners& corners) noexcept {
  const Eigen::Vector3d ab = corners[1] - corners[0];
  const Eigen::Vector3d ac = corners[2] - corners[0];
  const Eigen::Vector3d normal = ab.cross(ac);
  const double squared = normal.squaredNorm();
  if (squared > kFlat * ab.squaredNorm() * ac.squaredNorm()) {
    const Eigen::Vector3d ap = point - corners[0];
    const double v = normal.dot(ap.cross(ac)) / squared;
    const double w = normal.dot(ab.cross(ap)) / squared;
    if (v >= 0.0 && w >= 0.0 && v + w <= 1.0) {
      return {1.0 - v - w, v, w};
    }
  }
  Eigen::Vector3d best = Eigen::Vector3d::UnitX();
  double best_squared_m2 = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    const double t = along(point, corners[k], corners[next]);
    const double squared_m2 = (point - (1.0 - t) * corners[k] - t * corners[next]).squaredNorm();
    if (squared_m2 < best_squared_m2) {
      best_squared_m2 = squared_m2;
      best.setZero();
      best[static_cast<Eigen::Index>(k)] = 1.0 - t;
      best[static_cast<Eigen::Index>(next)] = t;
    }
  }
  return best;
}

AxisToTriangle nearest(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                       const Corners& corners) noexcept {
  AxisToTriangle best;
  best.distance_m = std::numeric_limits<double>::infinity();
  if (crosses(from, to, corners, best)) {
    return best;
  }
  take_if_nearer(best, from, nearest_weights(from, corners), corners);
  const Eigen::Vector3d path = to - from;
  if (path.squaredNorm() == 0.0) {
    return best;
  }
  take_if_nearer(best, to, nearest_weights(to, corners), corners);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    const auto [s, t] = nearest_on_segments(from, path, corners[k], corners[next] - corners[k]);
    Eigen::Vector3d weights = Eigen::Vector3d::Zero();
    weights[static_cast<Eigen::Index>(k)] = 1.0 - t;
    weights[static_cast<Eigen::Index>(next)] = t;
    take_if_nearer(best, from + s * path, weights, corners);
  }
  return best;
}

Touch nearest(const ToolShape& tool, const Eigen::Vector3d& position_W,
              const Corners& corners_W) noexcept {
  Touch best;
  best.gap_m = std::numeric_limits<double>::infinity();
  int part = 0;
  for (const Capsule& capsule : tool.parts()) {
    const AxisToTriangle pair =
        nearest(position_W + capsule.from_T, position_W + capsule.to_T, corners_W);
    const double gap_m = pair.distance_m - capsule.radius_m;
    if (gap_m < best.gap_m) {
      best.gap_m = gap_m;
      best.part = part;
      best.point_W = pair.on_triangle;
      best.weights = pair.weights;
      const Eigen::Vector3d away = pair.on_axis - pair.on_triangle;
      const Eigen::Vector3d face = (corners_W[1] - corners_W[0]).cross(corners_W[2] - corners_W[0]);
      if (pair.distance_m > kSmallest_m) {
        best.normal_W = away / pair.distance_m;
      } else if (face.norm() > 0.0) {
        best.normal_W = face.normalized();
      } else {
        best.normal_W = across(capsule.to_T - capsule.from_T);
      }
      best.on_tool_W = pair.on_axis - capsule.radius_m * best.normal_W;
    }
    ++part;
  }
  return best;
}

PointInTool locate(const ToolShape& tool, const Eigen::Vector3d& position_W,
                   const Eigen::Vector3d& point_W) noexcept {
  PointInTool best;
  best.gap_m = std::numeric_limits<double>::infinity();
  const Eigen::Vector3d point_T = point_W - position_W;
  for (const Capsule& capsule : tool.parts()) {
    const double t = along(point_T, capsule.from_T, capsule.to_T);
    const Eigen::Vector3d from_axis = point_T - (1.0 - t) * capsule.from_T - t * capsule.to_T;
    const double distance_m = from_axis.norm();
    if (distance_m - capsule.radius_m >= best.gap_m) {
      continue;
    }
    const Eigen::Vector3d axis = capsule.to_T - capsule.from_T;
    best.gap_m = distance_m - capsule.radius_m;
    if (distance_m <= kSmallest_m) {
      best.normal_W = across(axis);
      best.turning_W_per_m.setZero();
      continue;
    }
    best.normal_W = from_axis / distance_m;
    best.turning_W_per_m = Eigen::Matrix3d::Identity() - best.normal_W * best.normal_W.transpose();
    if (t > 0.0 && t < 1.0) {  // beside the axis the normal turns only around it
      best.turning_W_per_m -= axis * axis.transpose() / axis.squaredNorm();
    }
    best.turning_W_per_m /= distance_m;
  }
  return best;
}

bool between_jaws(const ToolShape& tool, const Eigen::Vector3d& from_tool_W) noexcept {
  if (tool.kind() != ToolShape::Kind::kGrasper) {
    return false;
  }
  const std::span<const Capsule> jaws = tool.parts();
  const Corners between{jaws[0].from_T, jaws[1].from_T, jaws[0].to_T};
  return (blend(nearest_weights(from_tool_W, between), between) - from_tool_W).norm() <=
         jaws[0].radius_m;
}

ToolToTool nearest(const ToolShape& first, const Eigen::Vector3d& first_W, const ToolShape& second,
                   const Eigen::Vector3d& second_W) noexcept {
  ToolToTool best;
  best.gap_m = std::numeric_limits<double>::infinity();
  for (const Capsule& one : first.parts()) {
    const Eigen::Vector3d from_1 = first_W + one.from_T;
    const Eigen::Vector3d path_1 = one.to_T - one.from_T;
    for (const Capsule& other : second.parts()) {
      const Eigen::Vector3d from_2 = second_W + other.from_T;
      const Eigen::Vector3d path_2 = other.to_T - other.from_T;
      const auto [s, t] = nearest_on_segments(from_1, path_1, from_2, path_2);
      const Eigen::Vector3d apart = from_1 + s * path_1 - from_2 - t * path_2;
      const double distance_m = apart.norm();
      const double gap_m = distance_m - one.radius_m - other.radius_m;
      if (gap_m < best.gap_m) {
        best.gap_m = gap_m;
        best.normal_W = distance_m > kSmallest_m ? Eigen::Vector3d(apart / distance_m)
                                                 : Eigen::Vector3d(Eigen::Vector3d::Zero());
      }
    }
  }
  return best;
}

}  // namespace forcegrid::contact
