// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// The peer that ElasticObject is measured against: the same object solved by plain Newton with
/// conjugate gradients, without sensitivities. Each move begins from the state extrapolated along
/// the last one (2 x - x_before, scaled with the step; moves of more than max_step_m are divided),
/// and repeats: forces of all springs and elements; block-Jacobi preconditioned conjugate gradients
/// on K dx = r, to a tenth of |r| or half the tolerance, whichever is larger; x += dx, with no
/// vertex further than half a mean spring length and halved while |r| more than doubles. The force
/// is their sum over the patch. Same springs, laws, elements, tangents and SIMD build as
/// ElasticObject<float>; one right-hand side in place of four.
///
/// For measurements: forcegrid simulate --bench. Threads: one at a time.
class NewtonCgBaseline {
 public:
  struct Options {
    double relative_tolerance = 1e-3;  ///< of |r| to max(|F|, force_floor_N); > 0
    double force_floor_N = 0.05;
    double max_step_m = 2e-3;
    int max_newton_steps = 30;  ///< of a divided move's last part; the others take two
    int max_iterations = 2000;  ///< conjugate-gradient iterations of one answer
  };
  struct Answer {
    Eigen::Vector3d force_W = Eigen::Vector3d::Zero();  ///< [N] of the object on the tool
    double relative_residual = 0.0;
    int evaluations = 0;
    int iterations = 0;
    bool converged = false;
  };

  /// Throws Error for a mesh that check() refuses or a tolerance that is not > 0.
  NewtonCgBaseline(const SpringMesh& mesh, const Options& options);
  ~NewtonCgBaseline();
  NewtonCgBaseline(NewtonCgBaseline&&) noexcept;

  /// As ElasticObject::grab, from the rest pose, once.
  int grab(const Eigen::Vector3d& point_W, double radius_m);

  /// Moves the held patch to `displacement_W` [m] from where it was grabbed.
  Answer move_to(const Eigen::Vector3d& displacement_W);

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace forcegrid::simulator
