#include "simulator/tool_contact.h"

#include <type_traits>

#include "contact/error.h"
#include "simulator/error.h"
#include "simulator/sliding_contact.h"
#include "simulator/tool_geometry.h"
#include "simulator/two_rates_object.h"

namespace forcegrid::simulator {
namespace {

// It sticks where it comes through the surface, as a servo sees it that looks far more often, and
// not where it is found inside.
template <typename Object, typename Options>
class StickingTool final : public ToolContact {
 public:
  StickingTool(const Scene& scene, const Options& solver, const ContactOptions& options)
      : object_(scene.mesh, solver),
        contact_(scene.mesh, options),
        way_in_(scene.mesh, options.tool) {}

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
    last_position_W_.reset();
  }
  bool in_contact() const noexcept override { return contact_.in_contact(); }
  std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept override {
    return contact_.expected_touch(position_W, velocity_W, within_s);
  }
  bool depends_on_position_alone() const noexcept override { return true; }
  std::size_t vertex_count() const noexcept override { return object_.vertex_count(); }
  std::size_t spring_count() const noexcept override { return object_.spring_count(); }
  std::uint64_t whole_solutions() const noexcept override {
    if constexpr (std::is_same_v<Object, TwoRatesObject>) {
      return object_.whole_solutions();
    } else {
      return 0;
    }
  }

 private:
  Object object_;
  StickyContact contact_;
  WayIn way_in_;
  std::optional<Eigen::Vector3d> last_position_W_;
};

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
  throw Error("tool: unknown shape '" + options.shape +
              "'; write point, sphere, capsule or grasper");
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
    return std::make_unique<SlidingContact>(scene.mesh, *shape,
                                            SlidingOptions{.press = {.friction = options.friction},
                                                           .grasp_N = options.grasp_N,
                                                           .let_go_N = options.let_go_N});
  }
  return std::make_unique<StickingTool<ElasticObject<float>, SolverOptions>>(
      scene, solver, ContactOptions{.patch_radius_m = scene.patch_radius_m, .tool = shape});
}

std::unique_ptr<ToolContact> make_two_rates_contact(const Scene& scene,
                                                    const TwoRatesOptions& solver,
                                                    const ToolOptions& options) {
  if (options.slides()) {
    throw Error(
        "tool: what slides presses the whole object; give --contact sticky with two_rates, or "
        "leave --solver out");
  }
  return std::make_unique<StickingTool<TwoRatesObject, TwoRatesOptions>>(
      scene, solver,
      ContactOptions{.patch_radius_m = scene.patch_radius_m, .tool = tool_shape(options)});
}

}  // namespace forcegrid::simulator
