#include "simulator/dynamic_contact.h"

#include <algorithm>
#include <optional>

#include "simulator/error.h"
#include "simulator/timed_object.h"

namespace forcegrid::simulator {
namespace {

class StickingInTime final : public ToolContact {
 public:
  StickingInTime(const Scene& scene, const DynamicOptions& solver, const ContactOptions& options)
      : object_(scene.mesh, solver), contact_(scene.mesh, options) {}

  void tell_time(double time_s) noexcept override { time_s_ = time_s; }

  Answer step(const Eigen::Vector3d& position_W) override {
    TimedObject timed{object_, elapsed_s()};
    if (!contact_.in_contact()) {
      object_.advance(timed.left_s, Eigen::Vector3d::Zero());
      timed.left_s = 0.0;
    }
    const bool touched_before = contact_.in_contact();
    Answer answer = contact_.step(timed, position_W);
    answer.stiffness_known = false;
    long_steps_ = touched_before && object_.long_step();
    last_s_ = time_s_;
    return answer;
  }

  void reset() noexcept override {
    TimedObject timed{object_};
    contact_.reset(timed);
    object_.rest();
    last_s_.reset();
    long_steps_ = false;
  }

  bool in_contact() const noexcept override { return contact_.in_contact(); }
  std::optional<Eigen::Vector3d> expected_touch(const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept override {
    return contact_.expected_touch(position_W, velocity_W, within_s);
  }
  bool depends_on_position_alone() const noexcept override { return false; }
  bool in_long_steps() const noexcept override { return long_steps_; }
  std::size_t vertex_count() const noexcept override { return object_.vertex_count(); }
  std::size_t spring_count() const noexcept override { return object_.spring_count(); }

 private:
  double elapsed_s() const noexcept { return last_s_ ? std::max(0.0, time_s_ - *last_s_) : 0.0; }

  DynamicObject object_;
  StickyContact contact_;
  double time_s_ = 0.0;
  std::optional<double> last_s_;
  bool long_steps_ = false;
};

}  // namespace

std::unique_ptr<ToolContact> make_dynamic_contact(const Scene& scene, const DynamicOptions& solver,
                                                  const ToolOptions& options) {
  if (options.contact == "slide") {
    throw Error(
        "tool: what slides presses equilibria; give --contact sticky with a dynamic solver");
  }
  return std::make_unique<StickingInTime>(
      scene, solver,
      ContactOptions{.patch_radius_m = scene.patch_radius_m, .tool = tool_shape(options)});
}

}  // namespace forcegrid::simulator
