#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace forcegrid::simulator {

/// One spring between the vertices `a` and `b`, at rest at the length of the mesh's rest shape.
struct Spring {
  std::int32_t a = 0;
  std::int32_t b = 0;
  double stiffness_N_per_m = 0.0;  ///< k: slope of the force at rest; > 0
};

/// A mass-spring object at rest: what the solver starts from. W is the workspace frame.
///
/// The tension of a spring of rest length l0 and length l, with the strain e = l / l0 - 1, is
///
///   f = k l0 (e + c e^3)      [N], positive when stretched
///
/// with one `cubic_coefficient` c for the whole mesh: 0 is the linear law, 5 hardens as soft tissue
/// does (twice the stiffness of a linear spring at 26 % strain). Masses don't enter: every answer
/// is an equilibrium.
struct SpringMesh {
  std::vector<Eigen::Vector3d> rest_position_W;  ///< [m]
  std::vector<std::uint8_t> fixed;               ///< one a vertex; 1 = never moves
  std::vector<Spring> springs;
  double cubic_coefficient = 0.0;  ///< c >= 0, dimensionless

  /// Where a tool can touch: the rectangle [min, max] at the height of its z, outward normal +z.
  Eigen::Vector3d surface_min_W = Eigen::Vector3d::Zero();  ///< [m] z is the surface's height
  Eigen::Vector3d surface_max_W = Eigen::Vector3d::Zero();  ///< [m] same z
};

/// Throws Error when the mesh can't be solved: no vertex or spring, a `fixed` of another size,
/// nothing fixed (the object would float), a spring that names a missing vertex, the same vertex
/// twice or has no length, a stiffness that is not positive and finite, a position that is not
/// finite, a free vertex without a spring, or c < 0.
void check(const SpringMesh& mesh);

}  // namespace forcegrid::simulator
