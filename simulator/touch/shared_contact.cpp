// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/shared_contact.h"

#include <memory>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/solver/shared_object.h"
#include "simulator/touch/sticky_contact_steps.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/touch/tool_geometry.h"

namespace forcegrid::simulator {

/// One tool's share of the object, for StickyContact. The move is made later, together with the
/// other tools', so the equilibrium that move_to() returns is the last one.
class ShareOfObject {
 public:
  ShareOfObject(SharedObject<float>& object, std::size_t tool) : object_(object), tool_(tool) {}

  int grab(const Eigen::Vector3d& point_W, double radius_m) {
    return object_.grab(tool_, point_W, radius_m);
  }
  bool turns() const noexcept { return object_.turns(); }
  Equilibrium move_to(const Eigen::Vector3d& displacement_W) noexcept {
    object_.aim(tool_, displacement_W);
    return last();
  }
  Equilibrium move_to(const Eigen::Vector3d& displacement_W,
                      const Eigen::Quaterniond& turn_W) noexcept {
    object_.aim(tool_, displacement_W, turn_W);
    return last();
  }
  void release() noexcept { object_.release(tool_); }

 private:
  Equilibrium last() const noexcept {
    Equilibrium found = object_.equilibrium(tool_);
    found.left_branch = false;  // solve() says it once
    return found;
  }

  SharedObject<float>& object_;
  std::size_t tool_;
};

FORCEGRID_INSTANTIATE_STICKY_CONTACT(ShareOfObject);

class SharedContact::State {
 public:
  State(const Scene& scene, const SolverOptions& solver, const ToolOptions& options,
        std::size_t tools)
      : object(scene.mesh, solver, tools) {
    if (options.turns) {
      object.turn(scene.mesh);
    }
    const ContactOptions contact{.patch_radius_m = scene.patch_radius_m,
                                 .tool = tool_shape(options)};
    for (std::size_t k = 0; k < tools; ++k) {
      each.push_back(std::make_unique<Tool>(object, k, scene.mesh, contact));
    }
  }

  struct Tool {
    Tool(SharedObject<float>& object, std::size_t number, const SpringMesh& mesh,
         const ContactOptions& options)
        : share(object, number), contact(mesh, options), way_in(mesh, options.tool) {}

    ShareOfObject share;
    StickyContact contact;
    WayIn way_in;
    std::optional<Eigen::Vector3d> last_position_W;
    std::uint32_t more_epochs = 0;  // beside the contact's own
    Answer answer;
  };

  // The force function of the tools in contact changes when another one's contact does.
  void begin_epochs_but_of(const Tool& changed) noexcept {
    for (const auto& tool : each) {
      if (tool.get() != &changed && tool->contact.in_contact()) {
        ++tool->more_epochs;
      }
    }
  }

  SharedObject<float> object;
  std::vector<std::unique_ptr<Tool>> each;
};

SharedContact::SharedContact(const Scene& scene, const SolverOptions& solver,
                             const ToolOptions& options, std::size_t tools) {
  if (options.slides()) {
    throw Error(
        "several tools: a tool that slides is solved alone with its object; use --contact sticky");
  }
  state_ = std::make_unique<State>(scene, solver, options, tools);
}

SharedContact::~SharedContact() = default;

void SharedContact::turn_to(std::size_t tool_number,
                            const Eigen::Quaterniond& orientation_WT) noexcept {
  State::Tool& tool = *state_->each[tool_number];
  if (state_->object.turns() && orientation_WT.coeffs().allFinite()) {
    tool.contact.turn_to(orientation_WT);
    tool.way_in.turn_to(orientation_WT.normalized());
  }
}

void SharedContact::move(std::size_t tool_number, const Eigen::Vector3d& position_W) {
  State::Tool& tool = *state_->each[tool_number];
  const bool held = tool.contact.in_contact();
  if (!held && tool.last_position_W && position_W.allFinite()) {
    if (const auto touch_W = tool.way_in.between(*tool.last_position_W, position_W)) {
      tool.contact.step(tool.share, *touch_W);
    }
  }
  if (position_W.allFinite()) {
    tool.last_position_W = position_W;
  }
  tool.answer = tool.contact.step(tool.share, position_W);
  tool.answer.epoch += tool.more_epochs;
  if (tool.contact.in_contact() != held) {
    state_->begin_epochs_but_of(tool);
  }
}

void SharedContact::solve() {
  state_->object.solve();
  for (std::size_t k = 0; k < state_->each.size(); ++k) {
    State::Tool& tool = *state_->each[k];
    if (!tool.contact.in_contact()) {
      continue;
    }
    const Equilibrium& found = state_->object.equilibrium(k);
    tool.answer.equilibrium = found;
    // Where the force was computed, which is short of the tool's position after a long move.
    tool.answer.position_W = tool.answer.point_W + found.displacement_W;
    tool.answer.orientation_WT = tool.contact.turned_WT(found.turn_W);
    tool.more_epochs += found.left_branch ? 1 : 0;
  }
  for (const auto& tool : state_->each) {
    if (tool->contact.in_contact()) {
      tool->answer.epoch = tool->contact.epoch() + tool->more_epochs;
    }
  }
}

SharedContact::Answer SharedContact::ask(std::size_t tool_number,
                                         const Eigen::Vector3d& position_W) {
  State::Tool& tool = *state_->each[tool_number];
  Answer answer;
  answer.point_W = tool.answer.point_W;
  answer.position_W = position_W;
  answer.equilibrium.converged = true;
  if (!tool.contact.in_contact() || !position_W.allFinite()) {
    return answer;
  }
  answer.epoch = tool.answer.epoch;
  const Eigen::Vector3d before_W = state_->object.equilibrium(tool_number).displacement_W;
  bool left_branch = false;
  const auto move = [&](const Eigen::Vector3d& displacement_W) -> const Equilibrium& {
    state_->object.aim(tool_number, displacement_W);
    state_->object.solve();
    const Equilibrium& found = state_->object.equilibrium(tool_number);
    left_branch = left_branch || found.left_branch;
    return found;
  };
  answer.in_contact = true;
  answer.equilibrium = move(position_W - answer.point_W);
  answer.position_W = answer.point_W + answer.equilibrium.displacement_W;
  answer.orientation_WT = tool.contact.turned_WT(answer.equilibrium.turn_W);
  move(before_W);
  for (const auto& each : state_->each) {
    if (left_branch && each->contact.in_contact()) {
      ++each->more_epochs;
      ++each->answer.epoch;
    }
  }
  return answer;
}

const SharedContact::Answer& SharedContact::answer(std::size_t tool) const noexcept {
  return state_->each[tool]->answer;
}

std::optional<Eigen::Matrix3d> SharedContact::stiffness_W(std::size_t tool,
                                                          std::size_t other) const noexcept {
  return state_->object.stiffness_W(tool, other);
}

void SharedContact::reset(std::size_t tool_number) {
  State::Tool& tool = *state_->each[tool_number];
  if (tool.contact.in_contact()) {
    state_->begin_epochs_but_of(tool);
  }
  tool.contact.reset(tool.share);
  tool.way_in.turn_to(Eigen::Quaterniond::Identity());
  tool.last_position_W.reset();
  tool.more_epochs = 0;
  tool.answer = Answer{};
}

void SharedContact::start_over() {
  for (const auto& tool : state_->each) {
    tool->more_epochs += tool->contact.epoch() + (tool->contact.in_contact() ? 1 : 0);
    tool->contact.reset(tool->share);
    tool->way_in.turn_to(Eigen::Quaterniond::Identity());
    tool->last_position_W.reset();
    tool->answer = Answer{};
  }
}

bool SharedContact::in_contact(std::size_t tool) const noexcept {
  return state_->each[tool]->contact.in_contact();
}

std::optional<Eigen::Vector3d> SharedContact::expected_touch(std::size_t tool,
                                                             const Eigen::Vector3d& position_W,
                                                             const Eigen::Vector3d& velocity_W,
                                                             double within_s) const noexcept {
  return state_->each[tool]->contact.expected_touch(position_W, velocity_W, within_s);
}

void SharedContact::copy_positions(const std::vector<std::int32_t>& vertices,
                                   std::vector<Eigen::Vector3d>& position_W) const {
  state_->object.copy_positions(vertices, position_W);
}

std::size_t SharedContact::vertex_count() const noexcept { return state_->object.vertex_count(); }
std::size_t SharedContact::spring_count() const noexcept { return state_->object.spring_count(); }

}  // namespace forcegrid::simulator
