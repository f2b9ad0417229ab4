// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/shared_reference.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <string>
#include <thread>
#include <tuple>
#include <utility>

#include "rt/clock.h"
#include "rt/parallel_jobs.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/shared_object.h"

namespace forcegrid::simulator {
namespace {

constexpr std::size_t kFewestMomentsAThread = 64;
constexpr std::chrono::milliseconds kSharedProgressPeriod{100};
// Estimate of the time left before the first position is done: measured in a typical run.
constexpr double kSharedGuess_s = 60.0;

enum class What { kLetGo, kTouch, kCycle };

// Something that happens to one of the tools.
struct Moment {
  double time_s = 0.0;
  What what = What::kCycle;
  std::size_t tool = 0;
  std::size_t cycle = 0;
};

void check_paths(const std::vector<ToolPath>& tools, const ReferenceOptions& options) {
  if (tools.empty()) {
    throw Error("reference forces: no tool; give the path of one or more");
  }
  if (!(options.patch_radius_m > 0.0)) {
    throw Error("reference forces: patch_radius_m is " + std::to_string(options.patch_radius_m) +
                "; it must be > 0");
  }
  for (std::size_t k = 0; k < tools.size(); ++k) {
    const ToolPath& tool = tools[k];
    const std::string who = "reference forces: tool " + std::to_string(k + 1) + ": ";
    if (tool.times_s.size() != tool.positions_W.size()) {
      throw Error(who + std::to_string(tool.times_s.size()) + " times but " +
                  std::to_string(tool.positions_W.size()) + " positions; give one per time");
    }
    const bool rising =
        std::ranges::adjacent_find(tool.times_s, std::greater_equal<>()) == tool.times_s.end();
    const bool finite =
        std::ranges::all_of(tool.times_s, [](double time_s) { return std::isfinite(time_s); }) &&
        std::ranges::all_of(tool.positions_W, [](const auto& at_W) { return at_W.allFinite(); });
    if (!rising || !finite) {
      throw Error(who + "times must rise, and times and positions must be finite; cut the path");
    }
    if (tool.touched_s < ToolPath::kNever_s &&
        (!tool.contact_point_W.allFinite() || tool.positions_W.empty() ||
         tool.tools_before_touch_W.size() != tools.size())) {
      throw Error(who + "touches, but has no path, no contact point, or does not say where all " +
                  "tools were before");
    }
  }
}

std::vector<Moment> moments_of(const std::vector<ToolPath>& tools) {
  std::vector<Moment> moments;
  for (std::size_t k = 0; k < tools.size(); ++k) {
    const ToolPath& tool = tools[k];
    if (tool.touched_s == ToolPath::kNever_s) {
      continue;
    }
    moments.push_back({tool.touched_s, What::kTouch, k, 0});
    if (tool.let_go_s < ToolPath::kNever_s) {
      moments.push_back({tool.let_go_s, What::kLetGo, k, 0});
    }
    for (std::size_t i = 0; i < tool.times_s.size(); ++i) {
      if (tool.times_s[i] >= tool.touched_s && tool.times_s[i] < tool.let_go_s) {
        moments.push_back({tool.times_s[i], What::kCycle, k, i});
      }
    }
  }
  std::ranges::sort(moments, {}, [](const Moment& moment) {
    return std::tuple(moment.time_s, moment.what, moment.tool);
  });
  return moments;
}

// Between two cycles on the straight line; before the first and after the last where it was then.
Eigen::Vector3d position_at(const ToolPath& tool, double time_s) {
  const auto after = std::ranges::lower_bound(tool.times_s, time_s);
  if (after == tool.times_s.begin()) {
    return tool.positions_W.front();
  }
  if (after == tool.times_s.end()) {
    return tool.positions_W.back();
  }
  const auto i = static_cast<std::size_t>(after - tool.times_s.begin());
  if (tool.times_s[i] == time_s) {
    return tool.positions_W[i];
  }
  const double fraction = (time_s - tool.times_s[i - 1]) / (tool.times_s[i] - tool.times_s[i - 1]);
  return tool.positions_W[i - 1] + fraction * (tool.positions_W[i] - tool.positions_W[i - 1]);
}

// The object under all tools, taken through the moments in their order.
class Follower {
 public:
  Follower(const SpringMesh& mesh, const std::vector<ToolPath>& tools,
           const ReferenceOptions& options)
      : tools_(tools),
        patch_radius_m_(options.patch_radius_m),
        near_m_(0.5 * options.max_step_m),
        object_(mesh, reference_solver_options(options), tools.size()),
        solved_W_(tools.size(), Eigen::Vector3d::Zero()) {}

  // A touch or its end.
  void change(const Moment& moment) {
    if (moment.what == What::kLetGo) {
      object_.release(moment.tool);
      return;
    }
    const ToolPath& tool = tools_[moment.tool];
    solve([&](std::size_t other) { return tool.tools_before_touch_W[other]; });
    if (object_.grab(moment.tool, tool.contact_point_W, patch_radius_m_) == 0) {
      throw Error("reference forces: no free vertex within " + std::to_string(patch_radius_m_) +
                  " m of the contact point of tool " + std::to_string(moment.tool + 1) +
                  "; check scene and contact point");
    }
    solved_W_[moment.tool] = tool.contact_point_W;
  }

  // Every tool goes where it is at this time.
  const Equilibrium& follow(const Moment& moment) {
    solve([&](std::size_t tool) { return position_at(tools_[tool], moment.time_s); });
    return object_.equilibrium(moment.tool);
  }

  // On the way to a stretch: solves only where a tool has come so far that a later step would be
  // long.
  void approach(const Moment& moment) {
    for (std::size_t k = 0; k < tools_.size(); ++k) {
      if (object_.grabbed(k) &&
          (position_at(tools_[k], moment.time_s) - solved_W_[k]).norm() > near_m_) {
        follow(moment);
        return;
      }
    }
  }

 private:
  template <typename Position>
  void solve(Position position_W) {
    for (std::size_t k = 0; k < tools_.size(); ++k) {
      if (object_.grabbed(k)) {
        solved_W_[k] = position_W(k);
        object_.aim(k, solved_W_[k] - tools_[k].contact_point_W);
      }
    }
    object_.solve();
  }

  const std::vector<ToolPath>& tools_;
  double patch_radius_m_;
  double near_m_;
  SharedObject<double> object_;
  std::vector<Eigen::Vector3d> solved_W_;
};

struct Stretch {
  std::size_t begin = 0;
  std::size_t end = 0;
};

std::vector<Stretch> cut(std::size_t moments, unsigned wanted) {
  const std::size_t count = std::clamp<std::size_t>(moments / kFewestMomentsAThread, 1, wanted);
  std::vector<Stretch> stretches;
  for (std::size_t p = 0; p < count; ++p) {
    stretches.push_back({moments * p / count, moments * (p + 1) / count});
  }
  return stretches;
}

// What one stretch adds to the tools' counts.
struct StretchResult {
  std::vector<ReferenceSolution> tools;
  Eigen::Vector3d force_before_W = Eigen::Vector3d::Zero();  // at begin - 1
  bool force_before_known = false;
};

void note(const Moment& moment, const Equilibrium& found, ReferenceSolution& reference,
          StretchResult& result) {
  reference.forces_W[moment.cycle] = found.force_W;
  reference.known[moment.cycle] = 1;
  ReferenceSolution& counts = result.tools[moment.tool];
  counts.unconverged += found.converged && found.reached ? 0 : 1;
  counts.branch_changes += found.left_branch ? 1 : 0;
  counts.worst_relative_residual =
      std::max(counts.worst_relative_residual, found.relative_residual);
}

// Forces go to `references`, where no other stretch writes. Returns false if it was stopped.
bool solve_stretch(const Stretch& stretch, const std::vector<Moment>& moments, Follower follower,
                   std::vector<ReferenceSolution>& references, StretchResult& result,
                   rt::Job& job) {
  for (std::size_t m = 0; m < stretch.end; ++m) {
    if (job.stopping()) {
      return false;
    }
    const Moment& moment = moments[m];
    if (moment.what != What::kCycle) {
      follower.change(moment);
    } else if (m >= stretch.begin) {
      note(moment, follower.follow(moment), references[moment.tool], result);
    } else if (m + 1 == stretch.begin) {
      result.force_before_W = follower.follow(moment).force_W;
      result.force_before_known = true;
    } else {
      follower.approach(moment);
    }
    if (m >= stretch.begin) {
      job.report(static_cast<double>(m + 1 - stretch.begin) /
                 static_cast<double>(stretch.end - stretch.begin));
    }
  }
  return true;
}

// Adds the counts of the stretches and how well they agree where they meet.
void add_stretches(const std::vector<Stretch>& stretches, const std::vector<Moment>& moments,
                   const std::vector<StretchResult>& results,
                   std::vector<ReferenceSolution>& references) {
  for (std::size_t p = 0; p < stretches.size(); ++p) {
    for (std::size_t k = 0; k < references.size(); ++k) {
      const ReferenceSolution& counts = results[p].tools[k];
      references[k].unconverged += counts.unconverged;
      references[k].branch_changes += counts.branch_changes;
      references[k].worst_relative_residual =
          std::max(references[k].worst_relative_residual, counts.worst_relative_residual);
    }
    if (!results[p].force_before_known) {
      continue;
    }
    const Moment& shared = moments[stretches[p].begin - 1];
    ReferenceSolution& reference = references[shared.tool];
    if (reference.known[shared.cycle] != 0) {
      reference.worst_seam_N =
          std::max(reference.worst_seam_N,
                   (results[p].force_before_W - reference.forces_W[shared.cycle]).norm());
    }
  }
}

// Zero forces where the tool does not hold, which are known; unknown ones where it does.
std::vector<ReferenceSolution> unsolved(const std::vector<ToolPath>& tools,
                                        const std::vector<Moment>& moments,
                                        const ReferenceOptions& options) {
  std::vector<ReferenceSolution> references(tools.size());
  for (std::size_t k = 0; k < tools.size(); ++k) {
    references[k].relative_tolerance = options.relative_tolerance;
    references[k].forces_W.assign(tools[k].times_s.size(), Eigen::Vector3d::Zero());
    references[k].known.assign(tools[k].times_s.size(), 1);
  }
  for (const Moment& moment : moments) {
    if (moment.what == What::kCycle) {
      references[moment.tool].known[moment.cycle] = 0;
    }
  }
  return references;
}

}  // namespace

std::vector<ReferenceSolution> simulate_shared_reference(const std::vector<ToolPath>& tools,
                                                         const ReferenceOptions& options) {
  const Scene scene = make_scene(options.scene);
  ReferenceOptions with_patch = options;
  with_patch.patch_radius_m = scene.patch_radius_m;
  return simulate_shared_reference(scene.mesh, tools, with_patch);
}

std::vector<ReferenceSolution> simulate_shared_reference(const SpringMesh& mesh,
                                                         const std::vector<ToolPath>& tools,
                                                         const ReferenceOptions& options) {
  const rt::TimePoint start = rt::Clock::now();
  check_paths(tools, options);
  const std::vector<Moment> moments = moments_of(tools);
  std::vector<ReferenceSolution> references = unsolved(tools, moments, options);
  const unsigned wanted =
      options.threads != 0 ? options.threads : std::max(1U, std::thread::hardware_concurrency());
  const std::vector<Stretch> stretches = cut(moments.size(), wanted);

  rt::JobOptions jobs{.threads = static_cast<unsigned>(stretches.size())};
  for (const Stretch& stretch : stretches) {
    jobs.weights.push_back(std::max(1.0, static_cast<double>(stretch.end - stretch.begin)));
  }
  jobs.progress = options.progress;
  jobs.first_guess_s = kSharedGuess_s;
  jobs.period = kSharedProgressPeriod;
  jobs.cancel = options.cancel;
  std::vector<StretchResult> results(stretches.size());
  for (StretchResult& result : results) {
    result.tools.resize(tools.size());
  }
  const bool finished = rt::run_jobs(stretches.size(), jobs, [&](rt::Job& job) {
    const std::size_t p = job.number();
    return solve_stretch(stretches[p], moments, Follower(mesh, tools, options), references,
                         results[p], job);
  });
  add_stretches(stretches, moments, results, references);
  for (ReferenceSolution& reference : references) {
    reference.cancelled = !finished;
    reference.threads = static_cast<unsigned>(stretches.size());
    reference.elapsed_s = rt::seconds(rt::Clock::now() - start);
  }
  return references;
}

}  // namespace forcegrid::simulator
