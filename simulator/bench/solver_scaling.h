// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/reference/solver_motion.h"

namespace forcegrid::simulator {

/// How often SolverScalingOptions::say is called for each object.
inline constexpr int kScalingSteps = 4;

/// What a servo cycle costs against the size of the object, for each solver.
struct SolverScalingOptions {
  std::vector<int> block_sizes{1'000, 10'000, 100'000};  ///< vertices, each in 1,000..1,000,000
  /// Beside the blocks, as make_scene().
  std::vector<std::string> scenes{"stomach", "liver", "liver_fine"};
  /// [m] Displacements of the tool since it took hold of the top, one per servo cycle of `rate_Hz`;
  /// the first near zero.
  std::vector<Eigen::Vector3d> displacements_W;
  double rate_Hz = 500.0;
  double settling_s = 0.5;   ///< cycles before it are solved, but not counted
  int reference_every = 10;  ///< cycles from one comparison with the converged force to the next
  std::function<void(const std::string&)> say;  ///< what is being measured; may be empty
};

/// One solver on one object. `motion.solver`: whole (quasi_static as direct), local (border 1e-3)
/// or two_rates, whose time is the servo's share alone.
struct SolverScalingRow {
  std::string scene;
  bool block = false;  ///< one of the row of blocks that differ in size alone
  std::size_t vertices = 0;
  std::size_t springs = 0;
  std::size_t tetrahedra = 0;
  MotionRow motion;
};

/// Vertices along x, y and z of the block whose number of vertices is nearest to `vertices`, none
/// of them two apart; x has the most. Throws Error outside 1,000..1,000,000.
std::array<int, 3> block_counts(int vertices);

/// The scene `block` with that many vertices, in the same cube of 0.1 m.
Scene block_of_size(int vertices);

/// `scenes` without those that lack a part, such as a mesh that `make scenes` has not made. Calls
/// `left_out` with a line for each of these: its name and what is missing.
/// Throws Error for a scene that can't be used for another reason.
std::vector<std::string> scenes_at_hand(const std::vector<std::string>& scenes,
                                        const std::function<void(const std::string&)>& left_out);

/// Measures one after the other on the calling thread.
/// Throws Error for sizes and scenes that can't be used, or motions without a counted cycle.
std::vector<SolverScalingRow> bench_scaling(const SolverScalingOptions& options);

}  // namespace forcegrid::simulator
