// SPDX-License-Identifier: Apache-2.0
#include "paper/paper.h"

#include <chrono>
#include <cstdio>
#include <list>

namespace forcegrid::paper {
namespace {

void tell(const PaperOptions& options, const RecordedMotion& recorded) {
  if (!options.say) {
    return;
  }
  char words[256];
  std::snprintf(
      words, sizeof words,
      "%s on %s: %zu reference forces %s; %zu missed the tolerance, %zu on another branch",
      recorded.motion.c_str(), recorded.scene.c_str(), recorded.trace.servo.size(),
      recorded.from_cache ? "from the cache" : "solved", recorded.unconverged,
      recorded.branch_changes);
  options.say(words);
}

}  // namespace

Results run_experiments(const PaperOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  Results results;
  results.timing = measure_timing();
  results.figures = make_figures(options);
  tell(options, results.figures.motion);
  std::vector<const RecordedMotion*> motions{&results.figures.motion};
  std::list<RecordedMotion> others;  // elements keep their addresses as it grows
  for (std::size_t i = 1; i < options.plan.motions.size(); ++i) {
    others.push_back(record_motion(options.plan.scene, options.plan.motions[i], options));
    tell(options, others.back());
    motions.push_back(&others.back());
  }
  std::vector<const RecordedMotion*> compared = motions;
  for (const std::string& scene : options.plan.compared_scenes) {
    for (const std::string& motion : options.plan.motions) {
      others.push_back(record_motion(scene, motion, options));
      tell(options, others.back());
      compared.push_back(&others.back());
    }
  }
  results.comparison = compare_rivals(compared, results.timing.bare_read_ns, options);
  results.resolutions = sweep_resolutions(motions, options);
  results.discrimination = discriminate(options);
  results.shapes = compare_shapes(options);
  results.elapsed_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return results;
}

}  // namespace forcegrid::paper
