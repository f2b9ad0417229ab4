// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/gravity.h"

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/rest_surface.h"
#include "simulator/mesh/tangent_stiffness.h"
#include "simulator/mesh/tetrahedra.h"
#include "simulator/mesh/vertex_masses.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kBalance = 1e-8;  // of the largest k l0; check() asks for 1e-6
constexpr int kMaxNewtonSteps = 100;
constexpr int kMaxHalvings = 20;
constexpr double kLinearTolerance = 1e-4;
constexpr double kFarAbove_m = 10.0;

// The unknowns are the free vertices' coordinates.
class Settling {
 public:
  explicit Settling(const SpringMesh& mesh) : mesh_(mesh), coordinates_(mesh) {}

  VectorXd residual_N(const std::vector<Vector3d>& position_W) const {
    const std::vector<Vector3d> force_W = vertex_forces_W(mesh_, position_W);
    VectorXd r = VectorXd::Zero(coordinates_.count);
    for (std::size_t i = 0; i < force_W.size(); ++i) {
      if (coordinates_.first[i] >= 0) {
        r.segment<3>(coordinates_.first[i]) = force_W[i];
      }
    }
    return r;
  }

  VectorXd newton_step_m(const std::vector<Vector3d>& position_W, const VectorXd& residual) const {
    const Eigen::SparseMatrix<double> stiffness =
        tangent_stiffness_W(mesh_, coordinates_, position_W);
    Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower | Eigen::Upper> solver;
    solver.setTolerance(kLinearTolerance);
    solver.compute(stiffness);
    return solver.solve(residual);
  }

  std::vector<Vector3d> moved(std::vector<Vector3d> position_W, const VectorXd& step_m) const {
    for (std::size_t i = 0; i < position_W.size(); ++i) {
      if (coordinates_.first[i] >= 0) {
        position_W[i] += step_m.segment<3>(coordinates_.first[i]);
      }
    }
    return position_W;
  }

 private:
  const SpringMesh& mesh_;
  const FreeCoordinates coordinates_;
};

std::vector<Vector3d> find_rest_W(const SpringMesh& mesh, double mass_kg) {
  const double largest_N = force_scale_N(mesh);
  const Settling settling(mesh);
  std::vector<Vector3d> position_W = mesh.rest_position_W;
  VectorXd residual = settling.residual_N(position_W);
  for (int step = 0; step < kMaxNewtonSteps; ++step) {
    rt::checkpoint();
    if (residual.lpNorm<Eigen::Infinity>() <= kBalance * largest_N) {
      return position_W;
    }
    VectorXd move_m = settling.newton_step_m(position_W, residual);
    bool nearer = false;
    for (int halving = 0; halving < kMaxHalvings && !nearer; ++halving, move_m *= 0.5) {
      std::vector<Vector3d> trial_W = settling.moved(position_W, move_m);
      const VectorXd left = settling.residual_N(trial_W);
      nearer = left.norm() < residual.norm();
      if (nearer) {
        position_W.swap(trial_W);
        residual = left;
      }
    }
    if (!nearer) {
      break;
    }
  }
  throw Error("gravity: an object of " + text::number_text(mass_kg) +
              " kg finds no rest under its weight; give it a stiffer material or less mass");
}

}  // namespace

void settle_under_gravity(SpringMesh& mesh, double mass_kg, double gravity_m_per_s2) {
  if (!(mass_kg > 0.0) || !std::isfinite(mass_kg) || !(gravity_m_per_s2 > 0.0) ||
      !std::isfinite(gravity_m_per_s2)) {
    throw Error("gravity: " + text::number_text(mass_kg) + " kg under " +
                text::number_text(gravity_m_per_s2) + " m/s^2; both must be finite and > 0");
  }
  for (Spring& spring : mesh.springs) {
    spring.natural_length_m = natural_length_m(mesh, spring);
  }
  if (!mesh.tetrahedra.empty()) {
    mesh.unstrained_W = unstrained_W(mesh);
  }
  mesh.load_W_N.resize(mesh.rest_position_W.size(), Vector3d::Zero());
  const std::vector<double> masses_kg = vertex_masses_kg(mesh, mass_kg);
  for (std::size_t i = 0; i < masses_kg.size(); ++i) {
    mesh.load_W_N[i].z() -= mesh.fixed[i] == 0 ? masses_kg[i] * gravity_m_per_s2 : 0.0;
  }
  const std::vector<Vector3d> rest_W = find_rest_W(mesh, mass_kg);
  for (std::size_t i = 0; i < mesh.home_stiffness_N_per_m.size(); ++i) {
    // Home stays where the vertex was; what its spring pulls at the new rest becomes a load.
    mesh.load_W_N[i] += mesh.home_stiffness_N_per_m[i] * (mesh.rest_position_W[i] - rest_W[i]);
  }
  mesh.rest_position_W = rest_W;
  if (mesh.triangles.empty()) {
    return;
  }
  const Vector3d above_W = mesh.top_W + Vector3d(0.0, 0.0, kFarAbove_m);
  const auto below_m = RestSurface(mesh).look(above_W).below_m;
  if (!below_m) {
    throw Error(
        "gravity: the object sinks away from under its top; give it a stiffer material or less "
        "mass");
  }
  for (std::vector<Vector3d>* positions_W : {&mesh.rest_position_W, &mesh.unstrained_W}) {
    for (Vector3d& position_W : *positions_W) {
      position_W.z() += *below_m - kFarAbove_m;
    }
  }
}

}  // namespace forcegrid::simulator
