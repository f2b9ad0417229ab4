#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>

#include "simulator/mesh/scene.h"
#include "simulator/mesh/tool_options.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_report.h"
#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// How the simulator's tool meets its object. Threads: one.
class ToolContact {
 public:
  using Answer = StickyContact::Answer;

  virtual ~ToolContact() = default;

  /// Where the tool was [m] on its way to the next step(), which is the last of these if there are
  /// any. `time_s` is of the servo's clock. Equilibria know no way.
  virtual void was_at(double time_s, const Eigen::Vector3d& position_W) {
    static_cast<void>(time_s);
    static_cast<void>(position_W);
  }
  /// The moment [s], of the servo's clock, at which the tool is where the next step() moves it.
  /// Equilibria know no time.
  virtual void tell_time(double time_s) noexcept { static_cast<void>(time_s); }
  /// Moves the tool to `position_W` [m]. One that is not finite answers as the last one did, with
  /// converged and reached false.
  virtual Answer step(const Eigen::Vector3d& position_W) = 0;
  /// A new run: no contact, epoch 0, the object at rest.
  virtual void reset() noexcept = 0;
  virtual bool in_contact() const noexcept = 0;
  /// Where a tool in the air at `position_W` that goes straight on with `velocity_W` [m/s] will be
  /// when it touches, within `within_s`.
  virtual std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                        const Eigen::Vector3d& velocity_W,
                                                        double within_s) const noexcept = 0;
  /// Whether force is a function of the position since the touch, so that it can be foretold.
  virtual bool depends_on_position_alone() const noexcept = 0;
  /// What the solver can say beside its answers, as of the last step.
  virtual SolverReport report() const noexcept = 0;
  virtual std::size_t vertex_count() const noexcept = 0;
  virtual std::size_t spring_count() const noexcept = 0;
};

/// The tool's shape; nothing for a point.
/// Throws Error as make_tool_contact() does.
std::optional<contact::ToolShape> tool_shape(const ToolOptions& options);

/// Throws Error naming the option that is out of range, unknown, or does not go with the others.
std::unique_ptr<ToolContact> make_tool_contact(const Scene& scene, const SolverOptions& solver,
                                               const ToolOptions& options);

}  // namespace forcegrid::simulator
