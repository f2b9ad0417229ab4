// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/contact_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "contact/distance.h"

namespace forcegrid::simulator {
namespace {

// e over the stiffness of a point whose neighbours are held. A larger ratio lets a substitution
// leave less of the error; a smaller one limits the error of a step that goes too far.
constexpr double kOverPointStiffness = 4.0;

std::vector<Eigen::Vector3d> rest_positions(const PressedSprings& springs) {
  std::vector<Eigen::Vector3d> positions;
  for (std::size_t i = 0; i < springs.vertex_count(); ++i) {
    positions.push_back(springs.position(i));
  }
  return positions;
}

double point_stiffness_N_per_m(const SurfacePoint& point, const PressedSprings& springs) {
  double compliance_m_per_N = 0.0;
  for (std::size_t k = 0; k < 3; ++k) {
    compliance_m_per_N +=
        point.weight[k] * point.weight[k] /
        springs.stiffness_at_rest_N_per_m(static_cast<std::size_t>(point.vertex[k]));
  }
  return 1.0 / compliance_m_per_N;
}

}  // namespace

ContactPoints::ContactPoints(const SpringMesh& mesh, const PressedSprings& springs,
                             double spacing_m, const ContactLaw& law)
    : surface_(make_surface_points(mesh, spacing_m)),
      tree_(mesh.triangles, rest_positions(springs)),
      rest_tree_(tree_),
      law_(law),
      rest_(rest_positions(springs)),
      positions_(rest_),
      positions_before_(positions_) {
  const std::size_t n = surface_.point.size();
  for (const SurfacePoint& point : surface_.point) {
    e_N_per_m_.push_back(kOverPointStiffness * point_stiffness_N_per_m(point, springs));
  }
  known_.resize(n);
  seen_.assign(n, 0);
  anchored_.assign(n, 0);
  bearing_.reserve(n);
  saved_bearing_.reserve(n);
  saved_.reserve(n);
  active_.reserve(n);
}

void ContactPoints::clear() noexcept {
  for (const std::int32_t point : bearing_) {
    known_[static_cast<std::size_t>(point)] = ContactPoint{};
  }
  bearing_.clear();
  active_.clear();
  unsettled_ = {};
}

void ContactPoints::follow(const PressedSprings& springs) noexcept {
  for (std::size_t i = 0; i < positions_.size(); ++i) {
    positions_[i] = springs.position(i);
  }
  static_cast<void>(tree_.refit(positions_));  // refuses what is not finite; so does the solver
}

void ContactPoints::begin_step(const PressedSprings& springs, const contact::ToolShape& tool,
                               const Eigen::Vector3d& tool_place) noexcept {
  ++step_;
  for (std::size_t i = 0; i < positions_before_.size(); ++i) {
    positions_before_[i] = springs.position(i);
  }
  tool_before_ = tool_place;
  rotation_before_WT_ = tool.rotation_WT();
  saved_bearing_.assign(bearing_.begin(), bearing_.end());
  saved_.clear();
  for (const std::int32_t point : bearing_) {
    saved_.push_back(known_[static_cast<std::size_t>(point)]);
  }
}

void ContactPoints::restore() noexcept {
  clear();
  for (std::size_t k = 0; k < saved_bearing_.size(); ++k) {
    known_[static_cast<std::size_t>(saved_bearing_[k])] = saved_[k];
    bearing_.push_back(saved_bearing_[k]);
  }
}

Eigen::Vector3d ContactPoints::place(std::size_t point,
                                     const std::vector<Eigen::Vector3d>& positions) const noexcept {
  const SurfacePoint& at = surface_.point[point];
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < 3; ++k) {
    place += at.weight[k] * positions[static_cast<std::size_t>(at.vertex[k])];
  }
  return place;
}

void ContactPoints::react_at(std::int32_t point, const contact::ToolShape& tool,
                             const Eigen::Vector3d& tool_place) noexcept {
  const auto at = static_cast<std::size_t>(point);
  if (seen_[at] == search_) {
    return;
  }
  seen_[at] = search_;
  const SurfacePoint& material = surface_.point[at];
  ContactPoint& known = known_[at];
  if (!known.touching && anchored_[at] != step_) {
    anchored_[at] = step_;
    known.anchor_T =
        rotation_before_WT_.transpose() * (place(at, positions_before_) - tool_before_);
  }
  law_.e_N_per_m = e_N_per_m_[at];
  const Reaction reaction = react(tool, tool_place, place(at, positions_), known, law_);
  const double change_N = reaction.state == Reaction::State::kHeld
                              ? (reaction.force_W - known.held_W).norm()
                              : std::abs(reaction.normal_N - known.normal_N);
  unsettled_.place_m = std::max(unsettled_.place_m, change_N / law_.e_N_per_m);
  if (reaction.state == Reaction::State::kOpen) {
    return;
  }
  Eigen::Matrix3d pull_W = known.pull_W;
  if (reaction.state != Reaction::State::kHeld) {
    const double friction_N = (reaction.force_W - reaction.normal_N * reaction.normal_W).norm();
    if (reaction.state == Reaction::State::kSlip) {
      unsettled_.friction_N += law_.friction * reaction.normal_N - friction_N;
    }
    pull_W = reaction.normal_W * (reaction.normal_W.transpose() * pull_W);
  }
  active_.push_back({point, material.vertex, material.weight, reaction, pull_W});
}

void ContactPoints::find(const contact::ToolShape& tool, const Eigen::Vector3d& tool_place,
                         const PressedSprings& springs) noexcept {
  follow(springs);
  ++search_;
  active_.clear();
  unsettled_ = {};
  for (const std::int32_t point : bearing_) {
    react_at(point, tool, tool_place);
  }
  tree_.visit_near(tool, tool_place, 0.0, [&](std::int32_t triangle) {
    const auto t = static_cast<std::size_t>(triangle);
    for (std::int32_t k = surface_.begin[t]; k < surface_.begin[t + 1]; ++k) {
      react_at(surface_.of[static_cast<std::size_t>(k)], tool, tool_place);
    }
  });
}

Eigen::Matrix3d ContactPoints::lag(const PointLoad& load,
                                   const PressedSprings& springs) const noexcept {
  Eigen::Matrix3d lag = Eigen::Matrix3d::Identity();
  for (std::size_t k = 0; k < 3; ++k) {
    lag -= load.weight[k] * springs.sensitivity(static_cast<std::size_t>(load.vertex[k]));
  }
  return lag;
}

double ContactPoints::pull_unsettled(const PressedSprings& springs) const noexcept {
  double largest = 0.0;
  for (const PointLoad& load : active_) {
    const double pull_N_per_m = (load.reaction.rigid_stiffness_W * lag(load, springs)).norm();
    largest = std::max(largest, pull_N_per_m / e_N_per_m_[static_cast<std::size_t>(load.point)]);
  }
  return largest;
}

void ContactPoints::substitute(const PressedSprings& springs) noexcept {
  for (const std::int32_t point : bearing_) {
    ContactPoint& known = known_[static_cast<std::size_t>(point)];
    known.normal_N = 0.0;
    known.pull_W.setZero();
  }
  // Adds all points that bear now to those that bore before, each once.
  ++search_;
  const std::size_t before = bearing_.size();
  for (std::size_t k = 0; k < before; ++k) {
    seen_[static_cast<std::size_t>(bearing_[k])] = search_;
  }
  for (const PointLoad& load : active_) {
    const auto at = static_cast<std::size_t>(load.point);
    known_[at].normal_N = load.reaction.normal_N;
    if (known_[at].held) {
      known_[at].held_W = load.reaction.force_W;
    }
    known_[at].pull_W = load.known_pull_W + load.reaction.rigid_stiffness_W * lag(load, springs);
    if (seen_[at] != search_) {
      seen_[at] = search_;
      bearing_.push_back(load.point);
    }
  }
}

void ContactPoints::accept(const PressedSprings& springs) noexcept {
  substitute(springs);
  ++search_;
  for (const PointLoad& load : active_) {
    seen_[static_cast<std::size_t>(load.point)] = search_;
  }
  for (const std::int32_t point : bearing_) {
    if (seen_[static_cast<std::size_t>(point)] != search_) {
      known_[static_cast<std::size_t>(point)] = ContactPoint{};
    }
  }
  bearing_.clear();
  for (const PointLoad& load : active_) {
    ContactPoint& known = known_[static_cast<std::size_t>(load.point)];
    known.touching = true;
    known.anchor_T = load.reaction.anchor_T;
    bearing_.push_back(load.point);
  }
  follow(springs);
}

ContactPoints::Sums ContactPoints::sums(const PressedSprings& springs,
                                        const Eigen::Vector3d& tool_place) const noexcept {
  Sums sums;
  double weights_N = 0.0;
  for (const PointLoad& load : active_) {
    const Reaction& reaction = load.reaction;
    ++sums.points;
    sums.slipping += reaction.state == Reaction::State::kSlip ? 1 : 0;
    sums.held += reaction.state == Reaction::State::kHeld ? 1 : 0;
    sums.force_W += reaction.force_W;
    sums.normal_N += reaction.normal_N;
    if (reaction.state != Reaction::State::kHeld) {
      sums.friction_W += reaction.force_W - reaction.normal_N * reaction.normal_W;
    }
    sums.deepest_m = std::max(sums.deepest_m, -reaction.gap_m);
    const double weight_N = reaction.force_W.norm();
    const Eigen::Vector3d at = place(static_cast<std::size_t>(load.point), positions_);
    weights_N += weight_N;
    sums.centre += weight_N * at;
    sums.torque_W_Nm += (at - tool_place).cross(reaction.force_W);
    sums.stiffness_W -= reaction.stiffness_W * lag(load, springs) + load.known_pull_W;
  }
  if (weights_N > 0.0) {
    sums.centre /= weights_N;
  } else if (!active_.empty()) {
    sums.centre = place(static_cast<std::size_t>(active_.front().point), positions_);
  }
  return sums;
}

double ContactPoints::gap_m(const contact::ToolShape& tool, const Eigen::Vector3d& tool_place,
                            double margin_m) const noexcept {
  const auto touch = tree_.nearest(tool, tool_place, margin_m);
  return touch ? touch->touch.gap_m : margin_m;
}

bool ContactPoints::free_at_rest(const contact::ToolShape& tool,
                                 const Eigen::Vector3d& tool_place) const noexcept {
  bool free = held_ == 0;
  rest_tree_.visit_near(tool, tool_place, 0.0, [&](std::int32_t triangle) {
    const auto t = static_cast<std::size_t>(triangle);
    for (std::int32_t k = surface_.begin[t]; free && k < surface_.begin[t + 1]; ++k) {
      const auto point = static_cast<std::size_t>(surface_.of[static_cast<std::size_t>(k)]);
      free = contact::locate(tool, tool_place, place(point, rest_)).gap_m >= 0.0;
    }
  });
  return free;
}

int ContactPoints::grasp(const contact::ToolShape& tool,
                         const Eigen::Vector3d& tool_place) noexcept {
  if (tool.kind() != contact::ToolShape::Kind::kGrasper) {
    return 0;
  }
  for (std::size_t at = 0; at < known_.size(); ++at) {
    const Eigen::Vector3d from_tool_W = place(at, positions_) - tool_place;
    if (!contact::between_jaws(tool, from_tool_W)) {
      continue;
    }
    const auto point = static_cast<std::int32_t>(at);
    const auto load = std::find_if(active_.begin(), active_.end(),
                                   [point](const PointLoad& each) { return each.point == point; });
    ContactPoint& known = known_[at];
    if (load == active_.end()) {
      bearing_.push_back(point);
      known.held_W.setZero();
    } else {
      known.held_W = load->reaction.force_W;
    }
    known.touching = true;
    known.normal_N = 0.0;
    known.anchor_T = tool.rotation_WT().transpose() * from_tool_W;
    known.held = true;
  }
  held_ = static_cast<int>(std::count_if(known_.begin(), known_.end(),
                                         [](const ContactPoint& known) { return known.held; }));
  return held_;
}

void ContactPoints::let_go() noexcept {
  held_ = 0;
  for (const std::int32_t point : bearing_) {
    ContactPoint& known = known_[static_cast<std::size_t>(point)];
    if (known.held) {
      known = ContactPoint{};
    }
  }
}

}  // namespace forcegrid::simulator
