// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/reference_solution.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "rt/clock.h"
#include "rt/parallel_jobs.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::simulator {
namespace {

// On the way to its part a thread needs only enough accuracy to stay on the branch.
constexpr double kApproachTolerance = 1e-3;
constexpr std::size_t kFewestCyclesAThread = 64;
constexpr std::chrono::milliseconds kProgressPeriod{100};
// Estimate of the time left before the first position is done: measured in a typical run.
constexpr double kNoGuess_s = 30.0;

struct Part {
  std::size_t begin = 0;
  std::size_t end = 0;
  std::size_t approach_steps = 0;  // of the list of stops: those before `begin`
};

void check(const std::vector<Eigen::Vector3d>& positions_W, const ReferenceOptions& options) {
  for (std::size_t i = 0; i < positions_W.size(); ++i) {
    if (!positions_W[i].allFinite()) {
      throw Error("reference force: position " + std::to_string(i) +
                  " of the path is not finite; cut the path there");
    }
  }
  if (!options.contact_point_W.allFinite()) {
    throw Error("reference force: contact_point_W is not finite; give where the tool touched");
  }
  if (options.first_contact_cycle >= positions_W.size()) {
    throw Error("reference force: contact begins at cycle " +
                std::to_string(options.first_contact_cycle) + " but the path has " +
                std::to_string(positions_W.size()) + " positions");
  }
  if (!(options.patch_radius_m > 0.0)) {
    throw Error("reference force: patch_radius_m is " + std::to_string(options.patch_radius_m) +
                "; it must be > 0");
  }
}

// Indices of the path's positions that lie just within `step_m` of each other.
std::vector<std::size_t> stops_along(const std::vector<Eigen::Vector3d>& positions_W,
                                     std::size_t first, double step_m) {
  std::vector<std::size_t> stops;
  Eigen::Vector3d last = positions_W[first];
  for (std::size_t i = first + 1; i < positions_W.size(); ++i) {
    if ((positions_W[i] - last).norm() > step_m) {
      stops.push_back(i - 1);
      last = positions_W[i - 1];
    }
  }
  return stops;
}

// Cuts the path into parts that take equally long, including the way to their beginning.
std::vector<Part> divide(std::size_t first, std::size_t end, const std::vector<std::size_t>& stops,
                         std::size_t threads) {
  const auto steps_before = [&stops](std::size_t cycle) {
    return static_cast<std::size_t>(std::lower_bound(stops.begin(), stops.end(), cycle) -
                                    stops.begin());
  };
  std::vector<Part> parts;
  const auto cut = [&](std::size_t work) {
    parts.clear();
    std::size_t begin = first;
    while (begin < end && parts.size() < threads) {
      const std::size_t approach = begin == first ? 0 : steps_before(begin - 1);
      if (work <= approach) {
        return false;
      }
      const std::size_t part_end = std::min(end, begin + work - approach);
      parts.push_back({begin, part_end, approach});
      begin = part_end;
    }
    return begin >= end;
  };
  std::size_t too_little = 0;
  std::size_t enough = end - first;
  while (enough - too_little > 1) {
    const std::size_t middle = too_little + (enough - too_little) / 2;
    (cut(middle) ? enough : too_little) = middle;
  }
  cut(enough);
  return parts;
}

struct PartResult {
  std::size_t unconverged = 0;
  std::size_t branch_changes = 0;
  double worst_relative_residual = 0.0;
  Eigen::Vector3d force_before_W = Eigen::Vector3d::Zero();  // at begin - 1
  bool force_before_known = false;
};

// Follows one part of the path, from rest; `object` has the part's own state. Forces go to
// `reference`, where no other part writes. Returns false if it was stopped before the part's end.
bool solve_part(const Part& part, const std::vector<Eigen::Vector3d>& positions_W,
                const ReferenceOptions& options, const std::vector<std::size_t>& stops,
                ElasticObject<double> object, ReferenceSolution& reference, PartResult& result,
                rt::Job& job) {
  const std::size_t first = options.first_contact_cycle;
  object.grab(options.contact_point_W, options.patch_radius_m);
  const auto displacement = [&](std::size_t cycle) -> Eigen::Vector3d {
    return positions_W[cycle] - options.contact_point_W;
  };
  object.set_relative_tolerance(std::max(kApproachTolerance, options.relative_tolerance));
  if (part.begin != first) {
    object.move_to(displacement(first));
  }
  for (std::size_t s = 0; s < part.approach_steps && !job.stopping(); ++s) {
    object.move_to(displacement(stops[s]));
  }
  object.set_relative_tolerance(options.relative_tolerance);
  if (part.begin != first && !job.stopping()) {
    result.force_before_W = object.move_to(displacement(part.begin - 1)).force_W;
    result.force_before_known = true;
  }
  Equilibrium equilibrium;
  for (std::size_t cycle = part.begin; cycle < part.end; ++cycle) {
    if (job.stopping()) {
      return false;
    }
    const bool repeated = cycle > part.begin && positions_W[cycle] == positions_W[cycle - 1];
    if (!repeated) {
      equilibrium = object.move_to(displacement(cycle));
      result.branch_changes += equilibrium.left_branch ? 1 : 0;
    }
    reference.forces_W[cycle] = equilibrium.force_W;
    reference.known[cycle] = 1;
    result.unconverged += equilibrium.converged && equilibrium.reached ? 0 : 1;
    result.worst_relative_residual =
        std::max(result.worst_relative_residual, equilibrium.relative_residual);
    job.report(static_cast<double>(cycle + 1 - part.begin) /
               static_cast<double>(part.end - part.begin));
  }
  return true;
}

// Adds the counts of the parts and how well they agree where they meet.
void add_up(const std::vector<Part>& parts, const std::vector<PartResult>& results,
            ReferenceSolution& reference) {
  for (std::size_t p = 0; p < parts.size(); ++p) {
    const PartResult& result = results[p];
    reference.unconverged += result.unconverged;
    reference.branch_changes += result.branch_changes;
    reference.worst_relative_residual =
        std::max(reference.worst_relative_residual, result.worst_relative_residual);
    const std::size_t before = parts[p].begin - (p > 0 ? 1 : 0);
    if (p > 0 && result.force_before_known && reference.known[before] != 0) {
      reference.worst_seam_N = std::max(
          reference.worst_seam_N, (result.force_before_W - reference.forces_W[before]).norm());
    }
  }
}

}  // namespace

SolverOptions reference_solver_options(const ReferenceOptions& options) {
  SolverOptions solver;
  solver.relative_tolerance = options.relative_tolerance;
  solver.max_step_m = options.max_step_m;
  solver.max_steps = 1000;
  solver.max_iterations = 2000;
  solver.max_recovery_steps = 100;
  return solver;
}

ReferenceSolution simulate_reference(const std::vector<Eigen::Vector3d>& positions_W,
                                     const ReferenceOptions& options) {
  const Scene scene = make_scene(options.scene);
  ReferenceOptions with_patch = options;
  with_patch.patch_radius_m = scene.patch_radius_m;
  return simulate_reference(scene.mesh, positions_W, with_patch);
}

ReferenceSolution simulate_reference(const SpringMesh& mesh,
                                     const std::vector<Eigen::Vector3d>& positions_W,
                                     const ReferenceOptions& options) {
  const rt::TimePoint start = rt::Clock::now();
  check(positions_W, options);
  const SolverOptions solver = reference_solver_options(options);
  // Built here, so that a wrong mesh or option throws before any thread runs.
  const ElasticObject<double> first_object(mesh, solver);
  if (first_object.count_grabbable(options.contact_point_W, options.patch_radius_m) == 0) {
    throw Error("reference force: no free vertex within " + std::to_string(options.patch_radius_m) +
                " m of the contact point; check scene and contact point");
  }
  ReferenceSolution reference;
  reference.relative_tolerance = options.relative_tolerance;
  reference.forces_W.assign(positions_W.size(), Eigen::Vector3d::Zero());
  reference.known.assign(positions_W.size(), 1);
  const std::size_t first = options.first_contact_cycle;
  const std::size_t end = positions_W.size();
  std::fill(reference.known.begin() + static_cast<std::ptrdiff_t>(first), reference.known.end(),
            std::uint8_t{0});

  const std::vector<std::size_t> stops = stops_along(positions_W, first, options.max_step_m);
  const unsigned wanted =
      options.threads != 0 ? options.threads : std::max(1U, std::thread::hardware_concurrency());
  const std::size_t threads =
      std::clamp<std::size_t>((end - first) / kFewestCyclesAThread, 1, wanted);
  const std::vector<Part> parts = divide(first, end, stops, threads);
  reference.threads = static_cast<unsigned>(parts.size());

  rt::JobOptions jobs{.threads = reference.threads};
  for (const Part& part : parts) {
    jobs.weights.push_back(static_cast<double>(part.end - part.begin));
  }
  jobs.progress = options.progress;
  jobs.first_guess_s = kNoGuess_s;
  jobs.period = kProgressPeriod;
  jobs.cancel = options.cancel;
  std::vector<PartResult> results(parts.size());
  const bool finished = rt::run_jobs(parts.size(), jobs, [&](rt::Job& job) {
    const std::size_t p = job.number();
    return solve_part(parts[p], positions_W, options, stops, ElasticObject<double>(mesh, solver),
                      reference, results[p], job);
  });
  add_up(parts, results, reference);
  reference.cancelled = !finished;
  reference.elapsed_s = rt::seconds(rt::Clock::now() - start);
  return reference;
}

nlohmann::json ReferenceSolution::to_json() const {
  return {{"cycles", forces_W.size()},
          {"cancelled", cancelled},
          {"unconverged", unconverged},
          {"branch_changes", branch_changes},
          {"relative_tolerance", relative_tolerance},
          {"worst_relative_residual", worst_relative_residual},
          {"worst_seam_N", worst_seam_N},
          {"threads", threads},
          {"elapsed_s", elapsed_s}};
}

}  // namespace forcegrid::simulator
