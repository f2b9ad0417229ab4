// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// One query with everything that its answer depends on.
struct QueryJob {
  std::uint32_t epoch = 0;  ///< of the contact; the answer is valid only in it
  bool touching = false;    ///< the tool holds the object, or will soon; else the force is zero
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();     ///< [m] where the tool touched
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();  ///< [m] where the force is queried

  /// The epoch that an answer states: 0 without contact.
  [[nodiscard]] std::uint32_t answer_epoch() const noexcept { return touching ? epoch : 0; }

  /// Whether both belong to the same contact, so that an answer to one is valid for the other.
  [[nodiscard]] bool same_contact(const QueryJob& other) const noexcept {
    return epoch == other.epoch && touching == other.touching &&
           (!touching || point_W == other.point_W);
  }
};

/// Answers queries from a second copy of the object, so that the one behind the samples keeps its
/// warm start. Real-time: no. Threads: one.
class QuerySolver {
 public:
  /// Throws Error as ElasticObject does.
  QuerySolver(const Scene& scene, const SolverOptions& options);

  /// The answer's solve time is that of the move; the grab happens once per contact and is left
  /// out. After an answer that is not finite the next one starts at rest.
  StickyContact::Answer answer(const QueryJob& job);
  /// [s] Time of the last answer, the grab included.
  [[nodiscard]] double last_solve_s() const noexcept { return last_solve_s_; }
  void release() noexcept { object_.release(); }

 private:
  ElasticObject<float> object_;
  double patch_radius_m_;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();  ///< [m] where the object is held
  double last_solve_s_ = 0.0;
};

/// Whether every number in it is finite.
bool finite(const Equilibrium& equilibrium);

}  // namespace forcegrid::simulator
