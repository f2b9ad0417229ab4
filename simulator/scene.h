#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "simulator/spring_mesh.h"

namespace forcegrid::simulator {

/// An object to touch, by name:
///
///   block         0.1 m cube, 22 x 22 x 21 vertices, 84,566 cubic springs of k = 10 N/m
///   block_linear  the same with linear springs
///   small         0.1 m cube, 11 x 11 x 9 vertices, 8,268 cubic springs of k = 20 N/m
///   small_linear  the same with linear springs
///
/// All have face diagonals of 0.7 k, +-30 % random stiffness and a fixed bottom.
struct Scene {
  std::string name;
  SpringMesh mesh;
};

/// The names that make_scene takes.
std::vector<std::string> scene_names();

/// @param top_centre_W  [m] where the centre of the object's top face lies in W.
/// Throws Error for an unknown name, listing the known ones.
Scene make_scene(std::string_view name,
                 const Eigen::Vector3d& top_centre_W = Eigen::Vector3d::Zero());

}  // namespace forcegrid::simulator
