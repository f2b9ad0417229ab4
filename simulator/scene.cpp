#include "simulator/scene.h"

#include "simulator/error.h"
#include "simulator/lattice_block.h"

namespace forcegrid::simulator {
namespace {

struct NamedBlock {
  const char* name;
  std::array<int, 3> vertex_count;
  double stiffness_N_per_m;
  double cubic_coefficient;
};

constexpr NamedBlock kBlocks[] = {
    {"block", {22, 22, 21}, 10.0, 5.0},
    {"block_linear", {22, 22, 21}, 10.0, 0.0},
    {"small", {11, 11, 9}, 20.0, 5.0},
    {"small_linear", {11, 11, 9}, 20.0, 0.0},
};

}  // namespace

std::vector<std::string> scene_names() {
  std::vector<std::string> names;
  for (const NamedBlock& block : kBlocks) {
    names.emplace_back(block.name);
  }
  return names;
}

Scene make_scene(std::string_view name, const Eigen::Vector3d& top_centre_W) {
  for (const NamedBlock& block : kBlocks) {
    if (name == block.name) {
      LatticeBlockOptions options;
      options.vertex_count = block.vertex_count;
      options.stiffness_N_per_m = block.stiffness_N_per_m;
      options.cubic_coefficient = block.cubic_coefficient;
      options.top_centre_W = top_centre_W;
      return {block.name, make_lattice_block(options)};
    }
  }
  std::string known;
  for (const std::string& each : scene_names()) {
    known += (known.empty() ? "" : ", ") + each;
  }
  throw Error("unknown scene '" + std::string(name) + "'; known scenes: " + known);
}

}  // namespace forcegrid::simulator
