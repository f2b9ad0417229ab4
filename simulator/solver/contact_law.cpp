// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/contact_law.h"

#include <algorithm>

#include "contact/distance.h"

namespace forcegrid::simulator {
namespace {

Reaction hold(const Eigen::Vector3d& from_anchor, const ContactPoint& point, double e_N_per_m) {
  Reaction reaction;
  reaction.state = Reaction::State::kHeld;
  reaction.force_W = point.held_W - e_N_per_m * from_anchor;
  reaction.stiffness_W = e_N_per_m * Eigen::Matrix3d::Identity();
  reaction.convex_stiffness_W = reaction.stiffness_W;
  reaction.rigid_stiffness_W = reaction.stiffness_W;
  reaction.anchor_T = point.anchor_T;
  return reaction;
}

}  // namespace

Reaction react(const contact::ToolShape& tool, const Eigen::Vector3d& position_W,
               const Eigen::Vector3d& point_W, const ContactPoint& point,
               const ContactLaw& law) noexcept {
  const Eigen::Vector3d from_tool_W = point_W - position_W;
  const Eigen::Vector3d from_anchor_W = from_tool_W - tool.rotation_WT() * point.anchor_T;
  if (point.held) {
    return hold(from_anchor_W, point, law.e_N_per_m);
  }
  const contact::PointInTool here = contact::locate(tool, position_W, point_W);
  Reaction reaction;
  reaction.gap_m = here.gap_m;
  reaction.normal_N = std::max(0.0, point.normal_N - law.e_N_per_m * here.gap_m);
  if (!(reaction.normal_N > 0.0)) {
    return reaction;
  }
  reaction.normal_W = here.normal_W;
  const Eigen::Matrix3d normal_part = here.normal_W * here.normal_W.transpose();
  const Eigen::Matrix3d tangential_part = Eigen::Matrix3d::Identity() - normal_part;
  const double known_N = std::min(point.normal_N, reaction.normal_N);
  const Eigen::Vector3d way = tangential_part * from_anchor_W;
  const double way_m = way.norm();
  const double friction_N_per_m = law.friction * known_N / std::max(way_m, law.stick_m);
  reaction.force_W = reaction.normal_N * here.normal_W - friction_N_per_m * way;
  reaction.rigid_stiffness_W = law.e_N_per_m * normal_part;
  reaction.convex_stiffness_W = reaction.rigid_stiffness_W + friction_N_per_m * tangential_part;
  if (way_m < law.stick_m) {
    reaction.state = Reaction::State::kStick;
    reaction.anchor_T = point.anchor_T;
  } else {
    reaction.state = Reaction::State::kSlip;
    reaction.convex_stiffness_W -= friction_N_per_m / (way_m * way_m) * way * way.transpose();
    reaction.anchor_T = tool.rotation_WT().transpose() * (from_tool_W - law.stick_m / way_m * way);
  }
  // With what is known, since far from equilibrium e g may be huge.
  reaction.stiffness_W = reaction.convex_stiffness_W - known_N * here.turning_W_per_m;
  return reaction;
}

}  // namespace forcegrid::simulator
