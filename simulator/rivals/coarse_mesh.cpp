// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/coarse_mesh.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/rivals/rest_model.h"

namespace forcegrid::simulator {
namespace {

// So that vertices that are equally near up to rounding are all held.
constexpr double kNearestWithMargin = 1.0 + 1e-9;

DirectOptions coarse_direct_options(const CoarseObject& object, bool grab_on_own_thread) {
  DirectOptions options;
  options.patch_radius_m = object.patch_radius_m;
  options.grab_on_own_thread = grab_on_own_thread;
  return options;
}

// -dFz/dz at rest.
double normal_stiffness_N_per_m(const SpringMesh& mesh, double patch_radius_m) {
  const std::vector<std::int32_t> patch = vertices_within(mesh, mesh.top_W, patch_radius_m);
  if (patch.empty()) {
    throw Error("coarse-mesh: no free vertex within " + std::to_string(patch_radius_m) +
                " m of the object's top; use a larger grip");
  }
  return -rest_stiffness_W(mesh, patch)(2, 2);
}

}  // namespace

CoarseObject match_at_rest(const SpringMesh& fine, SpringMesh coarse, double patch_radius_m) {
  check_positive(patch_radius_m, "coarse-mesh: patch_radius_m");
  CoarseObject object;
  object.mesh = std::move(coarse);
  double nearest_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < object.mesh.rest_position_W.size(); ++i) {
    if (object.mesh.fixed[i] == 0) {
      nearest_m = std::min(nearest_m, (object.mesh.rest_position_W[i] - object.mesh.top_W).norm());
    }
  }
  object.patch_radius_m = std::max(patch_radius_m, kNearestWithMargin * nearest_m);
  scale_forces(object.mesh, normal_stiffness_N_per_m(fine, patch_radius_m) /
                                normal_stiffness_N_per_m(object.mesh, object.patch_radius_m));
  return object;
}

CoarseMeshMethod::CoarseMeshMethod(const CoarseObject& object, bool grab_on_own_thread)
    : direct_(object.mesh, coarse_direct_options(object, grab_on_own_thread)) {}

std::size_t CoarseMeshMethod::memory_bytes() const noexcept {
  return sizeof *this - sizeof direct_ + direct_.memory_bytes();
}

void CoarseMeshMethod::take_sample(const Sample& sample) noexcept { direct_.take_sample(sample); }

void CoarseMeshMethod::contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept {
  direct_.contact_made(epoch, point_W);
}

void CoarseMeshMethod::contact_lost() noexcept { direct_.contact_lost(); }

void CoarseMeshMethod::observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
  direct_.observe(time_s, position_W);
}

int CoarseMeshMethod::work(int budget) noexcept { return direct_.work(budget); }

ForceEstimate CoarseMeshMethod::force(double time_s,
                                      const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate = direct_.force(time_s, position_W);
  // What the solver leaves over is not the error: the coarse object itself is another one.
  estimate.uncertainty_N = std::numeric_limits<double>::quiet_NaN();
  return estimate;
}

}  // namespace forcegrid::simulator
