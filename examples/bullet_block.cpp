// SPDX-License-Identifier: Apache-2.0
#include "bullet_block.h"

#include <algorithm>
#include <cmath>

namespace {

constexpr int kNodesAcross = 15;
constexpr int kNodesDeep = 8;
constexpr double kSide_m = 0.1;
constexpr double kDepth_m = 0.05;
constexpr double kPatchRadius_m = 0.012;
constexpr double kLeastForce_N = 0.05;  // a residual is compared with at least this
// The relaxation that comes nearest to the springs' equilibrium in the time of a tick. A larger one
// hardens the block; a smaller one does not converge in time.
constexpr btScalar kRelaxation = 0.1f;
constexpr btScalar kDamping = 0.05f;
constexpr btScalar kStep_s = 1.0f / 60.0f;
constexpr int kStepsBetweenLooks = 8;
constexpr double kSteady = 1e-4;  // of the force, from one check to the next

int node_at(int i, int j, int k) { return (k * kNodesAcross + j) * kNodesAcross + i; }

btVector3 place_W_m(int i, int j, int k) {
  return btVector3(btScalar(kSide_m * (double(i) / (kNodesAcross - 1) - 0.5)),
                   btScalar(kSide_m * (double(j) / (kNodesAcross - 1) - 0.5)),
                   btScalar(-kDepth_m * (1.0 - double(k) / (kNodesDeep - 1))));
}

btVector3 vector(const BulletBlock::Vector3& v) {
  return btVector3(btScalar(v[0]), btScalar(v[1]), btScalar(v[2]));
}

}  // namespace

BulletBlock::BulletBlock(double stiffness_N_per_m) : stiffness_N_per_m_(stiffness_N_per_m) {
  world_.m_gravity.setZero();
  world_.air_density = 0;
  for (int k = 0; k < kNodesDeep; ++k) {
    for (int j = 0; j < kNodesAcross; ++j) {
      for (int i = 0; i < kNodesAcross; ++i) {
        rest_W_m_.push_back(place_W_m(i, j, k));
      }
    }
  }
  is_held_.resize(rest_W_m_.size());
  imbalance_W_N_.resize(rest_W_m_.size());
  release();
}

bool BulletBlock::inside(const Vector3& p) {
  return p[2] <= 0.0 && p[2] >= -kDepth_m && std::abs(p[0]) <= 0.5 * kSide_m &&
         std::abs(p[1]) <= 0.5 * kSide_m;
}

void BulletBlock::release() {
  held_.clear();
  std::fill(is_held_.begin(), is_held_.end(), char(0));
  const std::vector<btScalar> masses(rest_W_m_.size(), btScalar(1));
  body_ =
      std::make_unique<btSoftBody>(&world_, int(rest_W_m_.size()), rest_W_m_.data(), masses.data());
  body_->m_cfg.kDP = kDamping;
  body_->m_cfg.piterations = 1;
  body_->m_cfg.collisions = 0;
  body_->m_materials[0]->m_kLST = kRelaxation;
  to_immovable_ = body_->appendMaterial();
  // Bullet moves only one end of such a link, which makes it twice as stiff.
  to_immovable_->m_kLST = kRelaxation / 2;
  add_links();
  set_node_masses();
  // Bullet's first step takes the present lengths as rest lengths.
  step(btVector3(0, 0, 0));
}

// Each node with its neighbours along edges, and across faces and cells.
void BulletBlock::add_links() {
  rest_length_m_.clear();
  for (int k = 0; k < kNodesDeep; ++k) {
    for (int j = 0; j < kNodesAcross; ++j) {
      for (int i = 0; i < kNodesAcross; ++i) {
        for (int other = 14; other < 27; ++other) {  // half of the 26 neighbours
          const int to_i = i + other % 3 - 1;
          const int to_j = j + other / 3 % 3 - 1;
          const int to_k = k + other / 9 - 1;
          if (to_i < 0 || to_i >= kNodesAcross || to_j < 0 || to_j >= kNodesAcross ||
              to_k >= kNodesDeep) {
            continue;
          }
          body_->appendLink(node_at(i, j, k), node_at(to_i, to_j, to_k));
          rest_length_m_.push_back(
              double((place_W_m(i, j, k) - place_W_m(to_i, to_j, to_k)).length()));
        }
      }
    }
  }
}

// setMass() would make the present shape the one at rest.
void BulletBlock::set_node_masses() {
  for (int n = 0; n < body_->m_nodes.size(); ++n) {
    const bool at_bottom = n < kNodesAcross * kNodesAcross;
    body_->m_nodes[n].m_im = at_bottom || is_held_[std::size_t(n)] ? btScalar(0) : btScalar(1);
  }
  for (int l = 0; l < body_->m_links.size(); ++l) {
    btSoftBody::Link& link = body_->m_links[l];
    const bool immovable = link.m_n[0]->m_im == 0 || link.m_n[1]->m_im == 0;
    link.m_material = immovable ? to_immovable_ : body_->m_materials[0];
  }
  body_->updateLinkConstants();
}

void BulletBlock::grab(const Vector3& position_W_m) {
  grabbed_at_W_m_ = vector(position_W_m);
  for (std::size_t n = 0; n < rest_W_m_.size(); ++n) {
    if (double((rest_W_m_[n] - grabbed_at_W_m_).length()) <= kPatchRadius_m) {
      held_.push_back(int(n));
      is_held_[n] = 1;
    }
  }
  set_node_masses();
}

void BulletBlock::step(const btVector3& displacement_W) {
  for (const int n : held_) {
    body_->m_nodes[n].m_x = rest_W_m_[std::size_t(n)] + displacement_W;
    body_->m_nodes[n].m_v.setZero();
  }
  body_->predictMotion(kStep_s);
  body_->solveConstraints();
  body_->integrateMotion();
}

BulletBlock::Answer BulletBlock::read_forces() {
  std::fill(imbalance_W_N_.begin(), imbalance_W_N_.end(), btVector3(0, 0, 0));
  const btSoftBody::Node* first = &body_->m_nodes[0];
  for (int l = 0; l < body_->m_links.size(); ++l) {
    const btSoftBody::Link& link = body_->m_links[l];
    const btVector3 along = link.m_n[1]->m_x - link.m_n[0]->m_x;
    const double length_m = double(along.length());
    const btVector3 pull_N =
        along *
        btScalar(stiffness_N_per_m_ * (length_m - rest_length_m_[std::size_t(l)]) / length_m);
    imbalance_W_N_[std::size_t(link.m_n[0] - first)] += pull_N;
    imbalance_W_N_[std::size_t(link.m_n[1] - first)] -= pull_N;
  }
  btVector3 force_N(0, 0, 0);
  double free_squared_N2 = 0.0;
  for (std::size_t n = 0; n < imbalance_W_N_.size(); ++n) {
    if (is_held_[n]) {
      force_N += imbalance_W_N_[n];
    } else if (body_->m_nodes[int(n)].m_im > 0) {
      free_squared_N2 += double(imbalance_W_N_[n].length2());
    }
  }
  Answer answer;
  answer.force_W_N = {double(force_N.x()), double(force_N.y()), double(force_N.z())};
  answer.relative_residual =
      std::sqrt(free_squared_N2) / std::max(double(force_N.length()), kLeastForce_N);
  return answer;
}

BulletBlock::Answer BulletBlock::move_to(const Vector3& position_W_m,
                                         std::chrono::nanoseconds budget) {
  const auto deadline = std::chrono::steady_clock::now() + budget;
  const btVector3 displacement_W = vector(position_W_m) - grabbed_at_W_m_;
  Answer answer;
  for (;;) {
    for (int i = 0; i < kStepsBetweenLooks; ++i) {
      step(displacement_W);
    }
    const Answer before = answer;
    answer = read_forces();
    const double change_N = double((vector(answer.force_W_N) - vector(before.force_W_N)).length());
    const double force_N = double(vector(answer.force_W_N).length());
    if (change_N <= kSteady * std::max(force_N, kLeastForce_N) ||
        std::chrono::steady_clock::now() >= deadline) {
      return answer;
    }
  }
}
