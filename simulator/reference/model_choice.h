// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "simulator/mesh/fineness.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_kind.h"

namespace forcegrid::simulator {

struct ModelOptions {
  double tolerance_percent = 1.0;  ///< see ModelTrial::error_percent; > 0
  double rate_Hz = 30.0;           ///< answers per second; > 0. Tried at 10 to 100
  /// kQuasiStatic or kLocal: try no other solver; nothing: both.
  std::optional<SolverKind> solver;
  SolverOptions solver_options;  ///< that the solvers start from
  /// Makes the scene's object coarser, see make_coarser_mesh(). It may throw Error.
  std::function<SpringMesh(Fineness)> coarser;
};

/// One model of an object, and what it cost along the motion.
struct ModelTrial {
  std::string model;  ///< "corotated, 640 elements, local"
  SolverKind solver = SolverKind::kQuasiStatic;
  double mean_ms = 0.0;  ///< [ms] processor time of an answer
  /// RMS of |F - F_written| in % of the RMS of |F_written|, F_written being the converged force of
  /// the scene as written.
  double error_percent = 0.0;
};

struct ModelChoice {
  SpringMesh mesh;
  SolverKind solver = SolverKind::kQuasiStatic;
  SolverOptions solver_options;
  std::vector<ModelTrial> trials;  ///< the cheapest first
  std::size_t chosen = 0;          ///< index into `trials`
  /// What was chosen, and by how much the next cheaper one missed; one line for a user.
  std::string why;
  std::vector<std::string> left_out;  ///< models that could not be made, each with the reason
  bool within = true;                 ///< false: not even the scene as written is within
};

/// Takes the cheapest model of a scene of finite elements whose force is within a tolerance of the
/// scene's as written: its material or the corotated one, its mesh or coarser ones, the whole
/// object solved or what the tool disturbs. Each is tried on a motion of 1 s that presses, pulls
/// and shears the scene's top by up to 10 mm, or a tenth of the object's height if that is less.
/// The scene as written is exchanged only for a model that takes less than 0.9 of its time.
/// Times are the shorter ones of two passes; on a busy machine models of almost equal cost may
/// change places.
/// Throws Error for options out of range, a scene without elements, and one whose top can't be
/// held. Real-time: no; takes seconds. Threads: as simulate_reference().
ModelChoice choose_model(const Scene& scene, const ModelOptions& options);

}  // namespace forcegrid::simulator
