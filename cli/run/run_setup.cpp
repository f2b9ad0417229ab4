// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_setup.h"

#include "cli/common/budget_option.h"
#include "driver/device_url.h"
#include "rt/vectors.h"

namespace forcegrid::cli {

std::string profile_name_of(const std::string& device, const std::string& profile) {
  if (device.starts_with(kEmulatedPrefix)) {
    return device.substr(sizeof kEmulatedPrefix - 1);
  }
  if (!profile.empty()) {
    return profile;
  }
  const bool falcon = driver::parse_device_url(device).kind == driver::DeviceUrl::Kind::kFalcon;
  return falcon ? "falcon" : "woodenhaptics_v2015";
}

MethodOptions method_options(const RunOptions& options, const profiles::DeviceProfile& profile,
                             const servo::WorkspaceMap& workspace) {
  MethodOptions method;
  method.grid.min_W = workspace.position_W(rt::to_vector(profile.limits.workspace_min_m));
  method.grid.max_W = workspace.position_W(rt::to_vector(profile.limits.workspace_max_m));
  method.grid.cells = {options.cells[0], options.cells[1], options.cells[2]};
  const double longest_m = (method.grid.max_W - method.grid.min_W).maxCoeff();
  method.influence_radius_m =
      options.influence_radius_mm > 0.0 ? 1e-3 * options.influence_radius_mm : longest_m / 6.0;
  method.unit_m = 1e-3 * options.unit_mm;
  method.samples_per_cell = options.samples_per_cell;
  std::vector<std::string> methods = options.evaluated;
  methods.push_back(options.method);
  method.budget_reads = budget_reads(options.budget, methods);
  return method;
}

}  // namespace forcegrid::cli
