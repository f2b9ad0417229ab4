// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/tool_contact.h"

#include "contact/error.h"
#include "simulator/mesh/error.h"
#include "simulator/touch/sliding_contact.h"
#include "simulator/touch/sticking_tool.h"
#include "simulator/touch/sticky_contact_steps.h"

namespace forcegrid::simulator {
namespace {

std::optional<contact::ToolShape> make_shape(const ToolOptions& options) {
  if (options.shape == "point") {
    return std::nullopt;
  }
  if (options.shape == "sphere") {
    return contact::ToolShape::sphere(options.radius_m);
  }
  if (options.shape == "capsule") {
    return contact::ToolShape::capsule(options.radius_m, options.length_m);
  }
  if (options.shape == "grasper") {
    return contact::ToolShape::grasper(options.radius_m, options.length_m, options.opening_rad);
  }
  if (options.shape == "blade") {
    return contact::ToolShape::blade(options.radius_m, options.length_m);
  }
  throw Error("tool: unknown shape '" + options.shape +
              "'; write point, sphere, capsule, grasper or blade");
}

}  // namespace

std::optional<contact::ToolShape> tool_shape(const ToolOptions& options) {
  check_together(options);
  try {
    return make_shape(options);
  } catch (const contact::Error& problem) {
    throw Error(problem.what());
  }
}

std::unique_ptr<ToolContact> make_tool_contact(const Scene& scene, const SolverOptions& solver,
                                               const ToolOptions& options) {
  const std::optional<contact::ToolShape> shape = tool_shape(options);
  if (options.slides()) {
    return std::make_unique<SlidingContact>(
        scene.mesh, *shape,
        SlidingOptions{
            .press = {.friction = options.friction, .rotational_stiffness = options.turns},
            .grasp_N = options.grasp_N,
            .let_go_N = options.let_go_N,
            .turns = options.turns});
  }
  const ContactOptions contact{.patch_radius_m = scene.patch_radius_m, .tool = shape};
  auto tool = std::make_unique<StickingTool<ElasticObject<float>>>(scene, solver, contact);
  if (options.turns) {
    tool->let_turn(scene.mesh);
  }
  return tool;
}

FORCEGRID_INSTANTIATE_STICKY_CONTACT(ElasticObject<float>);
FORCEGRID_INSTANTIATE_STICKY_CONTACT(ElasticObject<double>);

}  // namespace forcegrid::simulator
