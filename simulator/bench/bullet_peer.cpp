// SPDX-License-Identifier: Apache-2.0
#include "simulator/bench/bullet_peer.h"

#include <BulletSoftBody/btSoftBody.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "rt/checkpoint.h"
#include "rt/thread_time.h"
#include "simulator/mesh/tetrahedra.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr btScalar kDamping = 0.05F;
constexpr btScalar kStep_s = 1.0F / 60.0F;
constexpr double kForceFloor_N = 0.05;
constexpr int kStepsBetweenLooks = 2;
// Stiffnesses differ; each of so many classes has its own material.
constexpr int kMaterials = 64;

btVector3 to_bullet(const Vector3d& v) {
  return {static_cast<btScalar>(v.x()), static_cast<btScalar>(v.y()), static_cast<btScalar>(v.z())};
}

class Body {
 public:
  Body(const Scene& scene, double relaxation)
      : mesh_(scene.mesh), held_(mesh_.rest_position_W.size(), 0) {
    world_.m_gravity.setZero();
    world_.air_density = 0;
    std::vector<btVector3> places;
    for (const Vector3d& position_W : mesh_.rest_position_W) {
      places.push_back(to_bullet(position_W - mesh_.top_W));
    }
    const std::vector<btScalar> masses(places.size(), btScalar(1));
    body_ = std::make_unique<btSoftBody>(&world_, static_cast<int>(places.size()), places.data(),
                                         masses.data());
    body_->m_cfg.kDP = kDamping;
    body_->m_cfg.piterations = 1;
    body_->m_cfg.collisions = 0;
    for (std::size_t i = 0; i < held_.size(); ++i) {
      held_[i] = mesh_.fixed[i] == 0 &&
                 (mesh_.rest_position_W[i] - mesh_.top_W).norm() <= scene.patch_radius_m;
    }
    add_links(relaxation);
    // Bullet's first step takes the present lengths as rest lengths.
    step(Vector3d::Zero());
  }

  void step(const Vector3d& displacement_W) {
    for (std::size_t i = 0; i < held_.size(); ++i) {
      if (held_[i] != 0) {
        btSoftBody::Node& node = body_->m_nodes[static_cast<int>(i)];
        node.m_x = to_bullet(mesh_.rest_position_W[i] - mesh_.top_W + displacement_W);
        node.m_v.setZero();
      }
    }
    body_->predictMotion(kStep_s);
    body_->solveConstraints();
    body_->integrateMotion();
  }

  StepPoint look(const Vector3d& converged_W) const {
    std::vector<Vector3d> position_W;
    for (int i = 0; i < body_->m_nodes.size(); ++i) {
      const btVector3& x = body_->m_nodes[i].m_x;
      position_W.push_back(mesh_.top_W + Vector3d(static_cast<double>(x.x()),
                                                  static_cast<double>(x.y()),
                                                  static_cast<double>(x.z())));
    }
    const std::vector<Vector3d> force_W = vertex_forces_W(mesh_, position_W);
    Vector3d on_tool_W = Vector3d::Zero();
    double squared_N2 = 0.0;
    for (std::size_t i = 0; i < held_.size(); ++i) {
      if (held_[i] != 0) {
        on_tool_W += force_W[i];
      } else if (mesh_.fixed[i] == 0) {
        squared_N2 += force_W[i].squaredNorm();
      }
    }
    return {.relative_residual = std::sqrt(squared_N2) / std::max(on_tool_W.norm(), kForceFloor_N),
            .error_percent = 100.0 * (on_tool_W - converged_W).norm() / converged_W.norm()};
  }

 private:
  bool immovable(std::int32_t vertex) const {
    const auto i = static_cast<std::size_t>(vertex);
    return held_[i] != 0 || mesh_.fixed[i] != 0;
  }

  void add_links(double relaxation) {
    std::vector<btSoftBody::Material*> materials;
    for (int m = 1; m <= kMaterials; ++m) {
      materials.push_back(body_->appendMaterial());
      materials.back()->m_kLST = static_cast<btScalar>(relaxation * m / kMaterials);
    }
    const double stiffest_N_per_m = stiffest();
    // setMass() would make the present shape the one at rest.
    for (std::size_t i = 0; i < held_.size(); ++i) {
      body_->m_nodes[static_cast<int>(i)].m_im =
          immovable(static_cast<std::int32_t>(i)) ? btScalar(0) : btScalar(1);
    }
    for (const Spring& spring : mesh_.springs) {
      const double halved = immovable(spring.a) || immovable(spring.b) ? 0.5 : 1.0;
      const double share = halved * spring.stiffness_N_per_m / stiffest_N_per_m;
      const auto nearest = std::clamp<long>(std::lround(share * kMaterials), 1, kMaterials) - 1;
      body_->appendLink(spring.a, spring.b, materials[static_cast<std::size_t>(nearest)]);
    }
    // Links in the mesh's order would pull the fixed point the same way everywhere.
    body_->randomizeConstraints();
    body_->updateLinkConstants();
  }

  double stiffest() const {
    double stiffest_N_per_m = 0.0;
    for (const Spring& spring : mesh_.springs) {
      stiffest_N_per_m = std::max(stiffest_N_per_m, spring.stiffness_N_per_m);
    }
    return stiffest_N_per_m;
  }

  SpringMesh mesh_;
  std::vector<std::uint8_t> held_;
  btSoftBodyWorldInfo world_;
  std::unique_ptr<btSoftBody> body_;
};

std::vector<StepPoint> run(const Scene& scene, double relaxation, int steps,
                           const Vector3d& displacement_W, const Vector3d& converged_W) {
  refuse_elements(scene.mesh, "scene " + scene.name + ", peer bullet: ",
                  "give it a scene of springs, such as block_linear");
  Body body(scene, relaxation);
  std::vector<StepPoint> points;
  double time_ms = 0.0;
  for (int done = 0; done < steps; done += kStepsBetweenLooks) {
    rt::checkpoint(static_cast<std::size_t>(done), static_cast<std::size_t>(steps));
    const double start_s = rt::thread_time_s();
    for (int i = 0; i < kStepsBetweenLooks; ++i) {
      body.step(displacement_W);
    }
    time_ms += 1e3 * (rt::thread_time_s() - start_s);
    points.push_back(body.look(converged_W));
    points.back().time_ms = time_ms;
  }
  return points;
}

}  // namespace

StepPeer bullet_peer(double relaxation, int steps) {
  return {"bullet, relaxation " + text::number_text(relaxation),
          [relaxation, steps](const Scene& scene, const Vector3d& displacement_W,
                              const Vector3d& converged_W) {
            return run(scene, relaxation, steps, displacement_W, converged_W);
          }};
}

}  // namespace forcegrid::simulator
