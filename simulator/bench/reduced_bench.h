// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

/// The cost of making a reduced model, and how near its states are to the full solver's.
struct ReducedRow {
  std::size_t states = 0;   ///< that it was trained on
  double training_s = 0.0;  ///< processor time, without the full solver's
  int modes = 0;
  std::size_t springs = 0;
  std::size_t memory_bytes = 0;
  double training_error_percent =
      0.0;                           ///< RMS of |F - F_full| in % of RMS |F_full|, trained states
  double state_error_percent = 0.0;  ///< RMS of |x - x_full| in % of RMS |x_full - X|
  double max_state_error_percent = 0.0;  ///< the largest state's, in % of the same
  double farthest_mm = 0.0;  ///< from a place of the motion to the nearest trained state
};

/// A reduced model of a scene's object held at its top, trained on one motion, to be measured on
/// others. Threads: one.
class ReducedBench {
 public:
  /// @param training_W  [m] displacements of the tool since the grab, 30 per second.
  /// Throws Error for a scene whose top can't be held, or a motion that leaves nothing to train on.
  ReducedBench(const Scene& scene, const std::vector<Eigen::Vector3d>& training_W);
  ~ReducedBench();
  ReducedBench(ReducedBench&&) noexcept;

  std::string setting() const;  ///< modes and springs in words
  Equilibrium move_to(const Eigen::Vector3d& displacement_W) noexcept;

  /// Compares its states along `displacements_W` [m] with the full solver's at a residual of 1e-4.
  ReducedRow compare_states(const std::vector<Eigen::Vector3d>& displacements_W);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// How a ReducedObject learned along a motion.
struct LearningRow {
  std::size_t answers = 0;
  double rate_Hz = 0.0;
  double by_model_percent = 0.0;     ///< part of the answers that a reduced model gave
  double model_error_percent = 0.0;  ///< of these, RMS of |F - F_full| in % of RMS |F_full| of all
  double max_error_percent = 0.0;    ///< the largest of all answers, in % of the same
  double model_median_ms = 0.0;      ///< wall time of a model's answer, without its check
  double model_p99_ms = 0.0;
  std::uint64_t trainings = 0;
  std::uint64_t checks = 0;
  std::uint64_t failed_checks = 0;
};

/// Moves a new ReducedObject that holds the scene's top along `displacements_W` [m]. Trainings and
/// checks run within the moves, so that the outcome doesn't depend on the machine's speed. Compares
/// with the full solver at a residual of 1e-4. Throws Error for a scene whose top can't be held, or
/// an empty motion.
LearningRow bench_learning(const Scene& scene, const std::vector<Eigen::Vector3d>& displacements_W,
                           double rate_Hz);

/// Keys carry the units.
nlohmann::json to_json(const ReducedRow& row);
nlohmann::json to_json(const LearningRow& row);

}  // namespace forcegrid::simulator
