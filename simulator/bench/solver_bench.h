// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "simulator/bench/dynamic_bench.h"
#include "simulator/bench/reduced_bench.h"
#include "simulator/mesh/scene.h"
#include "simulator/reference/solver_motion.h"

namespace forcegrid::simulator {

/// One state of a solver in progress: the processor time spent so far and what it has reached.
struct StepPoint {
  double time_ms = 0.0;
  double relative_residual = 0.0;  ///< |r| / max(|F|, 0.05 N), as Equilibrium defines it
  double error_percent = 0.0;      ///< |F - F_converged| / |F_converged|
};

/// A peer's solver for the step with linear springs.
struct StepPeer {
  std::string name;
  /// Holds the vertices within the scene's patch radius of its top, moves them by
  /// `displacement_W` [m], and solves; error_percent is against `converged_force_W` [N].
  std::function<std::vector<StepPoint>(const Scene& scene, const Eigen::Vector3d& displacement_W,
                                       const Eigen::Vector3d& converged_force_W)>
      run;
};

struct SolverBenchOptions {
  /// [m] Displacements of the tool since it took hold of the top, the first one near zero.
  std::vector<Eigen::Vector3d> at_30_Hz_W;
  std::vector<Eigen::Vector3d> at_500_Hz_W;
  /// [m] The motion that a reduced model is trained on, 30 per second; empty: none is made.
  std::vector<Eigen::Vector3d> training_W;
  /// [m] The motion along which a reduced model learns, 100 per second; empty: not measured.
  std::vector<Eigen::Vector3d> learning_W;
  int passes = 5;           ///< of each solver, see SolverMotion; 1 beyond 5,000 vertices
  double settling_s = 0.5;  ///< ticks before it are solved, but not counted
  std::vector<StepPeer> peers;
  std::function<void(const std::string&)> say;  ///< what is being measured; may be empty
};

/// A solver after a step of the tool from rest, with linear springs. Infinity: never reached.
struct StepRow {
  std::string solver;
  double to_residual_1e2_ms = 0.0;
  double to_residual_1e3_ms = 0.0;
  double first_error_1_ms = 0.0;  ///< first time within 1 %, perhaps in passing
  double to_error_1_ms = 0.0;     ///< from here on within 1 % of the converged force
  double to_error_01_ms = 0.0;    ///< 0.1 %
  double least_error_percent = 0.0;
  double vertices = 0.0;
};

/// Time of `peer`'s cheapest setting that is as accurate as `solver`, over `solver`'s time.
struct SpeedRatio {
  std::string solver;
  std::string peer;
  std::string at;
  double ratio = 0.0;  ///< infinity: no setting of the peer is as accurate
};

struct SolverBenchResult {
  std::string scene;
  std::size_t vertices = 0;
  std::size_t springs = 0;
  std::size_t tetrahedra = 0;
  std::vector<MotionRow> motion{};
  std::vector<StepRow> step{};
  std::vector<DynamicRow> dynamic{};  ///< of a scene with masses
  std::vector<ReducedRow> reduced{};  ///< if there is a motion to train on; states at 30 Hz
  std::vector<LearningRow> learning{};
  std::vector<SpeedRatio> ratios{};
  std::vector<std::string> remarks{};  ///< what was left out and why
};

/// Measures every solver on the scene against its converged solution: simulate_reference() for the
/// motions (double precision, relative residual 1e-6), 1e-7 for the step of 10 mm upwards. All in
/// one run, one after the other on the calling thread. Of finite elements the solvers that know
/// springs only are left out, and a remark says so.
/// Throws Error for a scene whose top can't be held, or motions without a counted tick.
SolverBenchResult bench_solvers(const Scene& scene, const SolverBenchOptions& options);

/// Keys carry the units; what was never reached is null.
nlohmann::json to_json(const SolverBenchResult& result);

}  // namespace forcegrid::simulator
