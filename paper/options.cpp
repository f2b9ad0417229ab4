// SPDX-License-Identifier: Apache-2.0
#include "paper/options.h"

#include "evaluation/charts/chart_plan.h"
#include "evaluation/objects/force_table.h"

namespace forcegrid::paper {

Plan plan_of(bool quick) {
  Plan plan;
  if (quick) {
    plan.motions = {"chirp"};
    plan.compared_scenes.clear();
    plan.touches = 24;
    plan.contrasts = {1.0, 0.25, 0.06, 0.0};
  }
  return plan;
}

void check_stop(const PaperOptions& options) {
  if (options.cancel != nullptr && *options.cancel) {
    throw evaluation::Stopped();
  }
}

std::unique_ptr<ForceMethod> make_method(const std::string& text) {
  // Mesh and grip matter only to `direct`, which is not made here.
  return evaluation::make({text, false, {}}, {}, 0.0);
}

}  // namespace forcegrid::paper
