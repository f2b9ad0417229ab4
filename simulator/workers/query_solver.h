#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// A force that is asked for, with all that an answer depends on.
struct QueryJob {
  std::uint32_t epoch = 0;  ///< of the contact, for which alone the answer is of use
  bool touching = false;    ///< the tool holds the object, or soon will; else there is no force
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();     ///< [m] where it took hold
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();  ///< [m] where the force is wanted

  /// The epoch that an answer states: 0 where there is nothing to touch.
  [[nodiscard]] std::uint32_t answer_epoch() const noexcept { return touching ? epoch : 0; }

  /// An answer to the one is of use where the other is asked for.
  [[nodiscard]] bool same_contact(const QueryJob& other) const noexcept {
    return epoch == other.epoch && touching == other.touching &&
           (!touching || point_W == other.point_W);
  }
};

/// Answers queries from an object of its own, so that the one that the tool is felt through keeps
/// its warm start. Real-time: no. Threads: one.
class QuerySolver {
 public:
  /// Throws Error as ElasticObject does.
  QuerySolver(const Scene& scene, const SolverOptions& options);

  /// Its solve time is that of the move, without the grab, which comes once a contact. What is not
  /// finite makes the next answer begin at rest.
  StickyContact::Answer answer(const QueryJob& job);
  /// [s] Of the last answer.
  [[nodiscard]] double last_solve_s() const noexcept { return last_solve_s_; }
  void release() noexcept { object_.release(); }

 private:
  ElasticObject<float> object_;
  double patch_radius_m_;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();  ///< [m] where the object is held
  double last_solve_s_ = 0.0;
};

/// Everything in it is a number.
bool finite(const Equilibrium& equilibrium);

}  // namespace forcegrid::simulator
