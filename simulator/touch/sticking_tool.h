// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/touch/sticky_contact.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/touch/tool_geometry.h"

namespace forcegrid::simulator {

/// A tool that sticks where its path crosses the surface. A servo, which samples far more often,
/// sees the touch there too, and not where the next simulator step finds the tool inside. Object:
/// one that StickyContact can hold and whose force is a function of the position alone. Threads:
/// one.
template <typename Object>
class StickingTool final : public ToolContact {
 public:
  template <typename Options>
  StickingTool(const Scene& scene, Options&& solver, const ContactOptions& options)
      : object_(scene.mesh, std::forward<Options>(solver)),
        contact_(scene.mesh, options),
        way_in_(scene.mesh, options.tool) {}

  /// From the next touch on the tool turns by turn_to(), and its force depends on how it is turned.
  /// @param mesh  the scene's.
  void let_turn(const SpringMesh& mesh) {
    object_.turn(mesh);
    turns_ = true;
  }

  void turn_to(const Eigen::Quaterniond& orientation_WT) noexcept override {
    if (turns_) {
      contact_.turn_to(orientation_WT);
      way_in_.turn_to(orientation_WT);
    }
  }
  Answer step(const Eigen::Vector3d& position_W) override {
    if (!contact_.in_contact() && last_position_W_ && position_W.allFinite()) {
      if (const auto touch_W = way_in_.between(*last_position_W_, position_W)) {
        contact_.step(object_, *touch_W);
      }
    }
    if (position_W.allFinite()) {
      last_position_W_ = position_W;
    }
    return contact_.step(object_, position_W);
  }
  void reset() noexcept override {
    contact_.reset(object_);
    way_in_.turn_to(Eigen::Quaterniond::Identity());
    last_position_W_.reset();
  }
  bool in_contact() const noexcept override { return contact_.in_contact(); }
  std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept override {
    return contact_.expected_touch(position_W, velocity_W, within_s);
  }
  bool depends_on_position_alone() const noexcept override { return !turns_; }
  SolverReport report() const noexcept override {
    if constexpr (requires(const Object& object) { object.report(); }) {
      return object_.report();
    } else {
      return {};
    }
  }
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) override {
    object_.copy_positions(vertices, position_W);
  }
  std::size_t vertex_count() const noexcept override { return object_.vertex_count(); }
  std::size_t spring_count() const noexcept override { return object_.spring_count(); }

 private:
  Object object_;
  StickyContact contact_;
  WayIn way_in_;
  std::optional<Eigen::Vector3d> last_position_W_;
  bool turns_ = false;
};

}  // namespace forcegrid::simulator
