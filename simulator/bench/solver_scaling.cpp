// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/solver_scaling.h"

#include <cmath>
#include <cstdlib>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/missing_part.h"
#include "simulator/solver/direct_method.h"
#include "simulator/touch/solver_choice.h"

namespace forcegrid::simulator {
namespace {

constexpr int kLeast = 1'000;
constexpr int kMost = 1'000'000;
constexpr double kBorder = 1e-3;

void measure(const Scene& scene, bool block, const SolverScalingOptions& options,
             std::vector<SolverScalingRow>& rows) {
  const std::size_t vertices = scene.mesh.rest_position_W.size();
  const auto say = [&](const std::string& what) {
    if (options.say) {
      options.say(scene.name + ", " + std::to_string(vertices) + " vertices: " + what);
    }
  };
  say("converged forces");
  const SolverMotion motion(scene, options.displacements_W, options.rate_Hz, options.settling_s,
                            options.reference_every);
  const auto add = [&](SolverSubject subject, const std::string& name) {
    subject.name = name;
    rows.push_back({scene.name, block, vertices, scene.mesh.springs.size(),
                    scene.mesh.tetrahedra.size(), motion.measure(subject)});
  };
  say("two_rates");
  add(two_rates_subject(scene, two_rates_options(options.rate_Hz, {}), "as direct"),
      to_string(SolverKind::kTwoRates));
  SolverOptions solver = DirectOptions{}.solver;
  say("whole");
  add(elastic_subject(scene, solver, "as direct"), "whole");
  solver.border_tolerance = kBorder;
  say("local");
  add(elastic_subject(scene, solver, "as direct"), to_string(SolverKind::kLocal));
}

}  // namespace

std::array<int, 3> block_counts(int vertices) {
  if (vertices < kLeast || vertices > kMost) {
    throw Error("block size: " + std::to_string(vertices) + " vertices; give " +
                std::to_string(kLeast) + " to " + std::to_string(kMost));
  }
  const int edge = static_cast<int>(std::cbrt(static_cast<double>(vertices)));
  std::array<int, 3> best{edge, edge, edge};
  const auto off = [vertices](const std::array<int, 3>& n) {
    return std::abs(n[0] * n[1] * n[2] - vertices);
  };
  for (const int low : {edge, edge + 1}) {
    for (int longer = 0; longer < 3; ++longer) {
      const std::array<int, 3> counts{low + (longer > 0 ? 1 : 0), low + (longer > 1 ? 1 : 0), low};
      best = off(counts) < off(best) ? counts : best;
    }
  }
  return best;
}

Scene block_of_size(int vertices) {
  Scene scene = make_scene("block");
  LatticeBlockOptions block;
  block.vertex_count = block_counts(vertices);
  scene.mesh = make_lattice_block(block);
  return scene;
}

std::vector<std::string> scenes_at_hand(const std::vector<std::string>& scenes,
                                        const std::function<void(const std::string&)>& left_out) {
  std::vector<std::string> found;
  for (const std::string& name : scenes) {
    try {
      make_scene(name);
      found.push_back(name);
    } catch (const MissingPart& part) {
      left_out(name + " is left out: " + part.what());
    }
  }
  return found;
}

std::vector<SolverScalingRow> bench_scaling(const SolverScalingOptions& options) {
  std::vector<SolverScalingRow> rows;
  for (const int size : options.block_sizes) {
    block_counts(size);
  }
  for (const std::string& name : options.scenes) {
    measure(make_scene(name), false, options, rows);
  }
  for (const int size : options.block_sizes) {
    measure(block_of_size(size), true, options, rows);
  }
  return rows;
}

}  // namespace forcegrid::simulator
