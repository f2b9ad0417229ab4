// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/dynamic_contact.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/touch/sticky_contact_steps.h"
#include "simulator/touch/time_stepped_object.h"
#include "simulator/touch/tool_path.h"

namespace forcegrid::simulator {

FORCEGRID_INSTANTIATE_STICKY_CONTACT(TimeSteppedObject);

namespace {

constexpr double kAlmostWhole = 1.0 - 1e-9;  // of a step, so that rounding adds none

// Adds the counts of an earlier move of the same step to those of `to`.
void add_up(const Equilibrium& earlier, Equilibrium& to) {
  to.iterations += earlier.iterations;
  to.evaluations += earlier.evaluations;
  to.steps += earlier.steps;
  to.solve_time_s += earlier.solve_time_s;
  to.converged = to.converged && earlier.converged;
  to.relative_residual = std::max(to.relative_residual, earlier.relative_residual);
}

class StickingInTime final : public ToolContact {
 public:
  StickingInTime(const Scene& scene, const DynamicOptions& solver, const ContactOptions& options)
      : object_(scene.mesh, solver), contact_(scene.mesh, options) {}

  void was_at(double time_s, const Eigen::Vector3d& position_W) override {
    path_.add(time_s, position_W);
  }
  void tell_time(double time_s) noexcept override { time_s_ = time_s; }

  Answer step(const Eigen::Vector3d& position_W) override {
    path_.add(time_s_, position_W);
    const double elapsed_s = last_s_ ? std::max(0.0, time_s_ - *last_s_) : 0.0;
    const double begin_s = time_s_ - elapsed_s;
    const int moves = position_W.allFinite() ? moves_in(elapsed_s) : 1;
    long_step_ = false;
    Answer answer;
    for (int move = 1; move <= moves; ++move) {
      const bool at_end = move == moves;
      const double t_s = at_end ? time_s_ : begin_s + elapsed_s * move / moves;
      const bool on_path = elapsed_s > 0.0 && position_W.allFinite();
      const Equilibrium before = answer.equilibrium;
      answer = step(elapsed_s / moves, on_path ? path_.at(t_s) : position_W);
      if (move > 1 && answer.in_contact) {
        add_up(before, answer.equilibrium);
      }
    }
    answer.stiffness_known = false;
    last_s_ = time_s_;
    path_.forget_before(time_s_);
    return answer;
  }

  void reset() noexcept override {
    TimeSteppedObject timed{object_};
    contact_.reset(timed);
    object_.rest();
    path_.clear();
    last_s_.reset();
    long_step_ = false;
  }

  bool in_contact() const noexcept override { return contact_.in_contact(); }
  std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept override {
    return contact_.expected_touch(position_W, velocity_W, within_s);
  }
  bool depends_on_position_alone() const noexcept override { return false; }
  SolverReport report() const noexcept override { return {.long_step = long_step_}; }
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) override {
    object_.copy_positions(vertices, position_W);
  }
  std::size_t vertex_count() const noexcept override { return object_.vertex_count(); }
  std::size_t spring_count() const noexcept override { return object_.spring_count(); }

 private:
  // One per time step; after a pause a single one, which the solver divides into longer steps.
  int moves_in(double elapsed_s) const noexcept {
    const double wanted = std::ceil(elapsed_s / object_.options().step_s * kAlmostWhole);
    return wanted > object_.options().max_steps ? 1 : std::max(1, static_cast<int>(wanted));
  }

  Answer step(double duration_s, const Eigen::Vector3d& position_W) {
    TimeSteppedObject timed{object_, duration_s};
    const bool touched_before = contact_.in_contact();
    if (!touched_before) {
      object_.advance(timed.left_s, Eigen::Vector3d::Zero());
      timed.left_s = 0.0;
    }
    const Answer answer = contact_.step(timed, position_W);
    long_step_ = long_step_ || (touched_before && object_.long_step());
    return answer;
  }

  DynamicObject object_;
  StickyContact contact_;
  ToolPath path_;
  double time_s_ = 0.0;
  std::optional<double> last_s_;
  bool long_step_ = false;
};

}  // namespace

std::unique_ptr<ToolContact> make_dynamic_contact(const Scene& scene, const DynamicOptions& solver,
                                                  const ToolOptions& options) {
  if (options.contact == "slide") {
    throw Error(
        "tool: --contact slide needs equilibria; give --contact sticky with --solver dynamic");
  }
  return std::make_unique<StickingInTime>(
      scene, solver,
      ContactOptions{.patch_radius_m = scene.patch_radius_m, .tool = tool_shape(options)});
}

}  // namespace forcegrid::simulator
