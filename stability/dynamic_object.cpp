// SPDX-License-Identifier: Apache-2.0
#include "stability/dynamic_object.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

namespace forcegrid::stability {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixX3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr std::array<int, 3> kMasses = {7, 7, 4};
constexpr int kAll = kMasses[0] * kMasses[1] * kMasses[2];

// The lattice with springs of 1 N/m, decomposed into its modes.
struct Lattice {
  VectorXd eigenvalues_N_per_m;
  MatrixX3d to_tool_N_per_m;  // K_t in the modes
  Matrix3d tool_N_per_m;      // K_tt
  Matrix3d stiffness_at_rest_N_per_m;
};

constexpr int kFixed = -1;
constexpr int kTool = -2;

// Number of a free mass, or a marker for a fixed or held one.
std::array<int, kAll> places(int& free) {
  std::array<int, kAll> place{};
  free = 0;
  for (int z = 0, i = 0; z < kMasses[2]; ++z) {
    for (int y = 0; y < kMasses[1]; ++y) {
      for (int x = 0; x < kMasses[0]; ++x, ++i) {
        const bool held = z == kMasses[2] - 1 && std::abs(2 * x + 1 - kMasses[0]) <= 2 &&
                          std::abs(2 * y + 1 - kMasses[1]) <= 2;
        place[static_cast<std::size_t>(i)] = z == 0 ? kFixed : held ? kTool : free++;
      }
    }
  }
  return place;
}

// Each direction to a neighbour once.
std::vector<std::array<int, 3>> directions() {
  std::vector<std::array<int, 3>> all;
  for (int z = 0; z <= 1; ++z) {
    for (int y = -1; y <= 1; ++y) {
      for (int x = -1; x <= 1; ++x) {
        if (z > 0 || y > 0 || (y == 0 && x > 0)) {
          all.push_back({x, y, z});
        }
      }
    }
  }
  return all;
}

Lattice make_lattice() {
  int free = 0;
  const std::array<int, kAll> place = places(free);
  Eigen::MatrixXd inner = Eigen::MatrixXd::Zero(3 * free, 3 * free);
  MatrixX3d across = MatrixX3d::Zero(3 * free, 3);
  Lattice lattice;
  lattice.tool_N_per_m.setZero();
  const auto add = [&](int to, int from, const Matrix3d& block) {
    if (to >= 0 && from >= 0) {
      inner.block<3, 3>(3 * to, 3 * from) += block;
    } else if (to >= 0 && from == kTool) {
      across.block<3, 3>(3 * to, 0) += block;
    } else if (to == kTool && from == kTool) {
      lattice.tool_N_per_m += block;
    }
  };
  const auto index = [](int x, int y, int z) { return x + kMasses[0] * (y + kMasses[1] * z); };
  for (const auto& [dx, dy, dz] : directions()) {
    const Vector3d along = Vector3d(dx, dy, dz).normalized();
    const Matrix3d spring = along * along.transpose();
    for (int z = 0; z + dz < kMasses[2]; ++z) {
      for (int y = std::max(0, -dy); y + std::max(0, dy) < kMasses[1]; ++y) {
        for (int x = std::max(0, -dx); x + std::max(0, dx) < kMasses[0]; ++x) {
          const int a = place[static_cast<std::size_t>(index(x, y, z))];
          const int b = place[static_cast<std::size_t>(index(x + dx, y + dy, z + dz))];
          add(a, a, spring);
          add(b, b, spring);
          add(a, b, -spring);
          add(b, a, -spring);
        }
      }
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(inner);
  lattice.eigenvalues_N_per_m = modes.eigenvalues();
  lattice.to_tool_N_per_m = modes.eigenvectors().transpose() * across;
  lattice.stiffness_at_rest_N_per_m =
      lattice.tool_N_per_m - lattice.to_tool_N_per_m.transpose() *
                                 lattice.eigenvalues_N_per_m.cwiseInverse().asDiagonal() *
                                 lattice.to_tool_N_per_m;
  return lattice;
}

const Lattice& lattice() {
  static const Lattice made = make_lattice();
  return made;
}

constexpr double kOneMass_kg = DynamicObject::kMass_kg / kAll;

}  // namespace

DynamicObject::DynamicObject(double stiffness_N_per_m, const Vector3d& contact_point_W,
                             double damping_time_s)
    : stiffness_N_per_m_(stiffness_N_per_m),
      contact_point_W_(contact_point_W),
      damping_time_s_(damping_time_s),
      scale_(stiffness_N_per_m / lattice().stiffness_at_rest_N_per_m(2, 2)),
      modes_m_(Eigen::ArrayXd::Zero(lattice().eigenvalues_N_per_m.size())),
      rates_m_per_s_(modes_m_) {}

void DynamicObject::advance(double time_s, const Vector3d& position_W) {
  const Vector3d displacement_W = position_W - contact_point_W_;
  const auto steps = static_cast<int>(std::floor((time_s - last_s_) / kStep_s + 0.5));
  for (int i = 1; i <= steps; ++i) {
    step(last_W_ + static_cast<double>(i) / steps * (displacement_W - last_W_));
  }
  last_W_ = displacement_W;
  last_s_ += steps * kStep_s;
}

void DynamicObject::step(const Vector3d& displacement_W) {
  const Lattice& made = lattice();
  // Lags a steady motion by exactly kRateOver_s.
  lately_W_ += kStep_s / (kRateOver_s + kStep_s) * (displacement_W - lately_W_);
  const Vector3d tool = displacement_W + damping_time_s_ * rate_W(displacement_W);
  const Eigen::ArrayXd per_mass = scale_ / kOneMass_kg * made.eigenvalues_N_per_m.array();
  const Eigen::ArrayXd pull = scale_ / kOneMass_kg * (made.to_tool_N_per_m * tool).array();
  rates_m_per_s_ = (rates_m_per_s_ - kStep_s * (per_mass * modes_m_ + pull)) /
                   (1.0 + kStep_s * (damping_time_s_ + kStep_s) * per_mass);
  modes_m_ += kStep_s * rates_m_per_s_;
}

VirtualObject::Value DynamicObject::at(const Vector3d& position_W) const {
  const Lattice& made = lattice();
  const Vector3d displacement_W = position_W - contact_point_W_;
  const Vector3d tool = displacement_W + damping_time_s_ * rate_W(displacement_W);
  const VectorXd modes = modes_m_ + damping_time_s_ * rates_m_per_s_;
  return {-scale_ * (made.tool_N_per_m * tool + made.to_tool_N_per_m.transpose() * modes),
          -scale_ * made.stiffness_at_rest_N_per_m};
}

double DynamicObject::slowest_period_s() const {
  return 2.0 * std::numbers::pi *
         std::sqrt(kOneMass_kg / (scale_ * lattice().eigenvalues_N_per_m[0]));
}

}  // namespace forcegrid::stability
