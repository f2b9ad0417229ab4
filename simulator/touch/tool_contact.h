// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/mesh/tool_options.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_report.h"
#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// Contact of the simulator's tool with its object. All positions are in the workspace frame W.
/// Threads: one.
class ToolContact {
 public:
  using Answer = StickyContact::Answer;

  virtual ~ToolContact() = default;

  /// Adds a position [m] of the tool's path to the next step(), which ends at the last of them.
  /// Solvers of equilibria ignore it, since their force does not depend on the path.
  /// @param time_s  of the servo's clock.
  virtual void was_at(double time_s, const Eigen::Vector3d& position_W) {
    static_cast<void>(time_s);
    static_cast<void>(position_W);
  }
  /// Sets the time [s] of the servo's clock that the next step() belongs to. Solvers of equilibria
  /// ignore it.
  virtual void tell_time(double time_s) noexcept { static_cast<void>(time_s); }
  /// Sets the tool's orientation for the next step(): the rotation from its frame T to W, a unit
  /// quaternion. One that is not finite is ignored. Ignored also by tools that do not turn, and by
  /// solvers that know no such tool (ToolOptions::turns is for make_tool_contact() alone).
  virtual void turn_to(const Eigen::Quaterniond& orientation_WT) noexcept {
    static_cast<void>(orientation_WT);
  }
  /// Moves the tool to `position_W` [m]. For a position that is not finite the last answer is
  /// repeated, with converged and reached false.
  virtual Answer step(const Eigen::Vector3d& position_W) = 0;
  /// Starts a new run: no contact, epoch 0, the object at rest.
  virtual void reset() noexcept = 0;
  virtual bool in_contact() const noexcept = 0;
  /// [m] Where a tool at `position_W` [m] with the constant velocity `velocity_W` [m/s] touches the
  /// object within `within_s`; nothing if it does not, or touches already.
  virtual std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                        const Eigen::Vector3d& velocity_W,
                                                        double within_s) const noexcept = 0;
  /// Whether force is a function of the displacement since the touch alone. Only then queries can
  /// be answered.
  virtual bool depends_on_position_alone() const noexcept = 0;
  /// The solver's report as of the last step.
  virtual SolverReport report() const noexcept = 0;
  /// Copies where `vertices` (the mesh's numbering) stand after the last step, [m] in W, into
  /// `position_W`, which gets their number. Solvers that do not solve for every vertex in every
  /// step give the best that they know: ElasticObject::copy_positions() (local),
  /// TwoRatesObject::copy_positions(), ReducedObject::copy_positions().
  virtual void copy_positions(const std::vector<std::int32_t>& vertices,
                              std::vector<Eigen::Vector3d>& position_W) = 0;
  virtual std::size_t vertex_count() const noexcept = 0;
  virtual std::size_t spring_count() const noexcept = 0;
};

/// The tool's shape; nothing for a point.
/// Throws Error as make_tool_contact() does.
std::optional<contact::ToolShape> tool_shape(const ToolOptions& options);

/// Makes the contact of a tool that slides, or that sticks to an object solved for equilibria.
/// Throws Error naming the option that is out of range, unknown, or excluded by another one.
std::unique_ptr<ToolContact> make_tool_contact(const Scene& scene, const SolverOptions& solver,
                                               const ToolOptions& options);

}  // namespace forcegrid::simulator
