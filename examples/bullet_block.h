// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <BulletSoftBody/btSoftBody.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <memory>
#include <vector>

/// A soft block simulated by Bullet's btSoftBody, a body of nodes and links made for games.
///
/// The block is 0.1 x 0.1 x 0.05 m. The centre of its top is W's origin, its bottom is fixed.
/// Bullet's link stiffness kLST is a relaxation factor, not a stiffness in N/m. With all links
/// alike Bullet's positions tend to the equilibrium of equal linear springs. The force on the tool
/// is therefore computed from these positions with Hooke's law,
///
///   F = sum of k (l - l0) (x_free - x_held) / l over the links that end in a held node.
///
/// Real-time: no. Threads: one.
class BulletBlock {
 public:
  using Vector3 = std::array<double, 3>;

  /// @param stiffness_N_per_m  Hooke's k of every link, > 0
  explicit BulletBlock(double stiffness_N_per_m);

  /// Whether a tool at `position_W_m` is inside the block: below its top, within its sides.
  [[nodiscard]] static bool inside(const Vector3& position_W_m);

  /// The tool takes hold of the nodes within 12 mm of it.
  void grab(const Vector3& position_W_m);
  /// Lets go; the block is at rest again.
  void release();
  [[nodiscard]] bool held() const { return !held_.empty(); }

  struct Answer {
    Vector3 force_W_N{};
    /// Norm of the unbalanced forces at the free nodes, over the force (at least 0.05 N).
    double relative_residual = 0.0;
  };
  /// Moves the held nodes with the tool and lets Bullet step until it is steady or `budget` has
  /// passed.
  Answer move_to(const Vector3& position_W_m, std::chrono::nanoseconds budget);

 private:
  void add_links();
  void set_node_masses();
  void step(const btVector3& displacement_W);
  [[nodiscard]] Answer read_forces();

  double stiffness_N_per_m_;
  btSoftBodyWorldInfo world_;
  std::unique_ptr<btSoftBody> body_;
  btSoftBody::Material* to_immovable_ = nullptr;
  std::vector<btVector3> rest_W_m_;
  std::vector<double> rest_length_m_;  ///< by link
  std::vector<int> held_;
  std::vector<char> is_held_;  ///< by node
  std::vector<btVector3> imbalance_W_N_;
  btVector3 grabbed_at_W_m_{0, 0, 0};
};
