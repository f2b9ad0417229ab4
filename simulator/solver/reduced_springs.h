// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "simulator/kernels/spring_kernels.h"

namespace forcegrid::simulator {

/// Most generalised coordinates of a reduced model: 3 of the tool and its modes.
inline constexpr int kMostReducedCoordinates = 48;

/// A few weighted springs as functions of n generalised coordinates z, eight side by side in SIMD
/// registers: spring s extends along d_s(z) = d_s(0) + B_s z and has the weight w_s.
///
/// Threads: one at a time, since evaluate() uses scratch memory.
class ReducedSprings {
 public:
  /// One spring that the sums contain.
  struct Chosen {
    Eigen::Vector3d edge_m = Eigen::Vector3d::Zero();  ///< d(0), from its lower vertex
    Eigen::Matrix3Xd basis;                            ///< B, 3 x n
    kernels::SpringConstants<double> law{};
    double weight = 1.0;  ///< w >= 0
  };

  ReducedSprings() = default;
  /// `coordinates` is n, at most kMostReducedCoordinates.
  ReducedSprings(int coordinates, const std::vector<Chosen>& chosen);

  int coordinates() const noexcept { return coordinates_; }
  std::size_t count() const noexcept { return count_; }
  std::size_t memory_bytes() const noexcept;

  /// Their energy's negative gradient and its Hessian at z:
  ///   force     = -sum_s w_s B_s^T f_s u_s
  ///   stiffness = sum_s w_s B_s^T (w w^T + t I) B_s      (SpringTangent)
  /// @param z  n numbers; in m where a coordinate's basis has no unit.
  /// @param force  n numbers, overwritten.
  /// @param stiffness  n x n, row major, overwritten; both triangles.
  /// Real-time: no allocation, lock or throw; time in proportion to springs and n^2.
  void evaluate(const double* z, double* force, double* stiffness) noexcept;

 private:
  struct alignas(32) Eight {
    float number[8];
  };

  int coordinates_ = 0;
  std::size_t count_ = 0;
  std::vector<Eight> edge_;   // 3 per eight springs
  std::vector<Eight> basis_;  // 3 n per eight springs
  kernels::SpringRows rows_;  // a star: vertex s + 1 is where spring s leads to from vertex 0
  std::vector<kernels::SpringConstants<float>> constants_;
  bool exponential_ = false;
  std::vector<kernels::Single> position_;
  std::vector<kernels::SpringTangent> tangent_;
};

}  // namespace forcegrid::simulator
