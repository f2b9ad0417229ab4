#include "simulator/spring_mesh.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "simulator/error.h"

namespace forcegrid::simulator {

void check(const SpringMesh& mesh) {
  const std::size_t vertices = mesh.rest_position_W.size();
  if (vertices == 0 || mesh.springs.empty()) {
    throw Error("spring mesh: " + std::to_string(vertices) + " vertices and " +
                std::to_string(mesh.springs.size()) + " springs; give at least one of each");
  }
  if (mesh.fixed.size() != vertices) {
    throw Error("spring mesh: " + std::to_string(mesh.fixed.size()) + " entries in 'fixed' for " +
                std::to_string(vertices) + " vertices; give one a vertex");
  }
  if (std::none_of(mesh.fixed.begin(), mesh.fixed.end(), [](std::uint8_t f) { return f != 0; })) {
    throw Error("spring mesh: no vertex is fixed, so the object has no place; fix some");
  }
  if (!(mesh.cubic_coefficient >= 0.0) || !std::isfinite(mesh.cubic_coefficient)) {
    throw Error("spring mesh: cubic_coefficient is " + std::to_string(mesh.cubic_coefficient) +
                "; it must be finite and >= 0");
  }
  for (std::size_t i = 0; i < vertices; ++i) {
    if (!mesh.rest_position_W[i].allFinite()) {
      throw Error("spring mesh: the position of vertex " + std::to_string(i) + " is not finite");
    }
  }
  std::vector<std::uint8_t> held(vertices, 0);
  for (std::size_t s = 0; s < mesh.springs.size(); ++s) {
    const Spring& spring = mesh.springs[s];
    const std::string name = "spring mesh: spring " + std::to_string(s);
    const auto outside = [vertices](std::int32_t v) {
      return v < 0 || static_cast<std::size_t>(v) >= vertices;
    };
    if (outside(spring.a) || outside(spring.b) || spring.a == spring.b) {
      throw Error(name + " joins vertices " + std::to_string(spring.a) + " and " +
                  std::to_string(spring.b) + "; name two different ones in 0.." +
                  std::to_string(vertices - 1));
    }
    const auto a = static_cast<std::size_t>(spring.a);
    const auto b = static_cast<std::size_t>(spring.b);
    if (!((mesh.rest_position_W[a] - mesh.rest_position_W[b]).norm() > 0.0)) {
      throw Error(name + " has no length; merge its two vertices");
    }
    if (!(spring.stiffness_N_per_m > 0.0) || !std::isfinite(spring.stiffness_N_per_m)) {
      throw Error(name + " has a stiffness of " + std::to_string(spring.stiffness_N_per_m) +
                  " N/m; it must be finite and > 0");
    }
    held[a] = 1;
    held[b] = 1;
  }
  for (std::size_t i = 0; i < vertices; ++i) {
    if (held[i] == 0 && mesh.fixed[i] == 0) {
      throw Error("spring mesh: free vertex " + std::to_string(i) +
                  " has no spring; remove it or fix it");
    }
  }
}

}  // namespace forcegrid::simulator
