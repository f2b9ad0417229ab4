// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/solved_pair.h"

#include <string>

#include "evaluation/files/error.h"
#include "evaluation/motions/pair_motions.h"
#include "evaluation/objects/force_table.h"

namespace forcegrid::evaluation {
namespace {

constexpr std::size_t kTools = 2;

Eigen::Index first_of(std::size_t tool) { return static_cast<Eigen::Index>(3 * tool); }

}  // namespace

simulator::Scene make_elastic_scene(const std::string& name, const std::string& purpose) {
  simulator::Scene scene = simulator::make_scene(name, first_contact_point_W());
  simulator::refuse_sliding_tool(name, scene.tool, purpose);
  return scene;
}

template <typename Real>
SolvedPair<Real>::SolvedPair(const simulator::SpringMesh& mesh,
                             const simulator::SolverOptions& options, double patch_radius_m)
    : object_(mesh, options, kTools) {
  const PairVector points_W = PairMotion::contact_points_W();
  for (std::size_t tool = 0; tool < kTools; ++tool) {
    if (object_.grab(tool, points_W.segment<3>(first_of(tool)), patch_radius_m) == 0) {
      throw ChartError("two tools: the object has no vertex within " +
                       std::to_string(1e3 * patch_radius_m) + " mm of where tool " +
                       std::to_string(tool + 1) +
                       " touches; choose a scene whose top is 75 mm wide, such as small or block");
    }
  }
}

template <typename Real>
void SolvedPair<Real>::move(const PairVector& displacements_m) {
  object_.aim(0, displacements_m.head<3>());
  object_.aim(1, displacements_m.tail<3>());
  object_.solve();
}

template <typename Real>
PairVector SolvedPair<Real>::forces_N() const {
  PairVector forces;
  forces << object_.equilibrium(0).force_W, object_.equilibrium(1).force_W;
  return forces;
}

template <typename Real>
std::optional<PairMatrix> SolvedPair<Real>::stiffness_N_per_m() const {
  PairMatrix stiffness;
  for (std::size_t tool = 0; tool < kTools; ++tool) {
    for (std::size_t other = 0; other < kTools; ++other) {
      const auto block_W = object_.stiffness_W(tool, other);
      if (!block_W) {
        return std::nullopt;
      }
      stiffness.block<3, 3>(first_of(tool), first_of(other)) = *block_W;
    }
  }
  return stiffness;
}

template <typename Real>
bool SolvedPair<Real>::converged() const {
  return object_.equilibrium(0).converged && object_.equilibrium(1).converged;
}

template <typename Real>
bool SolvedPair<Real>::left_branch() const {
  return object_.equilibrium(0).left_branch;
}

template class SolvedPair<float>;
template class SolvedPair<double>;

}  // namespace forcegrid::evaluation
