// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include "simulator/solver/elastic_object.h"
#include "simulator/solver/neighbourhood.h"
#include "simulator/solver/reduced_training.h"
#include "simulator/solver/reduced_use.h"
#include "simulator/solver/solver_report.h"

namespace forcegrid::simulator {

struct ReducedObjectOptions {
  SolverOptions solver;             ///< of the full object
  ReducedTrainingOptions training;  ///< `cancel` is not used
  /// apart_m grows when there are most_states states, and shrinks after a failed check.
  StateSpacing spacing;
  std::size_t first_states = 8;  ///< of a grab, before the first training; >= 1
  /// After this many full answers without a new state (the tool keeps to a line), a training needs
  /// fewer states: 3 for the first one, 1 more for each later one; >= 1.
  int patience = 60;
  /// A model is used while |F - F_full| is at most this times the larger of |F_full| and the RMS
  /// force of its training states; > 0.
  double check_tolerance = 3e-3;
  int passes = 3;         ///< checks in a row that a new model must pass before it is used; >= 1
  int passes_again = 10;  ///< the same after a failed check; >= 1
  double reach_m = 6e-3;  ///< farther from the nearest training state the full object answers
  int check_every = 1;    ///< answers of the model from one check to the next; >= 1
  /// Whether trainings and checks run on separate threads; false: within move_to().
  bool own_threads = true;
  std::function<void(const std::string&)> say;  ///< gets one line per change of model; may be empty
};

/// A mass-spring object under a tool that holds a patch of it. It learns a reduced model of itself
/// during the grab.
///
/// At first the full object answers, and its states are kept. A reduced model is trained when there
/// are enough states or no new ones come. It is trained again when there are a quarter more states,
/// or some more after a failed check. A new model is compared with the full object until it has
/// given the same force several times in a row; from then on it answers near its training states.
/// The full object follows on a second thread and checks the model at every check_every-th place.
/// After a failed check, out of the model's reach, or where the model finds no equilibrium, the
/// full object answers again, and its states there are added to the training. Each grab starts
/// without a model.
///
/// At a change between model and full object, force and stiffness differ by at most the tolerance.
/// When the full object leaves its branch of equilibria, the model and its states are dropped, and
/// the next answer reports it (Equilibrium::left_branch).
///
/// Real-time: no; a model's answer takes microseconds, but taking a state allocates. Threads: one
/// at a time, besides its own.
class ReducedObject {
 public:
  /// Throws Error for a mesh that check() refuses or options out of range.
  explicit ReducedObject(const SpringMesh& mesh, ReducedObjectOptions options = {});
  ~ReducedObject();
  ReducedObject(const ReducedObject&) = delete;
  ReducedObject& operator=(const ReducedObject&) = delete;

  std::size_t vertex_count() const noexcept { return full_.vertex_count(); }
  std::size_t spring_count() const noexcept { return full_.spring_count(); }

  /// As ElasticObject's.
  int grab(const Eigen::Vector3d& point_W, double radius_m);
  void release() noexcept;

  /// As ElasticObject's; a model's answer is described at ReducedModel::move_to(), its
  /// relative_residual is no less than the error of the last check.
  /// Throws std::system_error when no thread can be started.
  Equilibrium move_to(const Eigen::Vector3d& displacement_W);

  /// Copies where `vertices` (the mesh's numbering) stand, [m] in W, into `position_W`, which gets
  /// their number. A model knows no positions: after its answers they are those of the full object
  /// at its last finished check, moved on along S to the tool's present place, which the held
  /// vertices follow exactly. When other vertices are asked for than in the call before and a check
  /// runs, this waits for it.
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W);

  const ReducedUse& use() const noexcept { return use_; }
  SolverReport report() const noexcept { return {.reduced = use_}; }

 private:
  // What a check brings back.
  struct Checked {
    Equilibrium full;
    Eigen::Vector3d reduced_force_W = Eigen::Vector3d::Zero();
    std::optional<ReducedSnapshot> state;
  };

  Equilibrium answer(const Eigen::Vector3d& displacement_W);
  void tell(const std::string& what);
  void see() noexcept;
  void collect();
  void start_check(const Equilibrium& reduced);
  void finish_check();
  void finish_training();
  void judge(const Eigen::Vector3d& reduced_force_W, const Eigen::Vector3d& full_force_W);
  void keep(ReducedSnapshot state);
  void train_if_worth_it();
  Equilibrium full_answer(const Eigen::Vector3d& displacement_W);
  void forget() noexcept;
  std::launch policy() const noexcept;

  SpringMesh mesh_;
  ReducedObjectOptions options_;
  ElasticObject<float> full_;  // the check's while there is one
  ReducedTrainingSet set_;     // read by the training while there is one, and not changed
  double apart_m_ = 0.0;
  std::size_t new_states_ = 0;  // since the last training
  std::atomic<bool> cancel_{false};
  std::optional<ReducedModel> model_;
  double model_force_N_ = 0.0;  // RMS of its training states
  bool has_failed_ = false;     // a check, since the last training
  int since_new_state_ = 0;     // full answers
  double last_check_ = 0.0;
  int passes_left_ = 0;
  int until_check_ = 0;
  bool left_branch_ = false;                 // found by a check, not reported yet
  std::vector<std::int32_t> seen_vertices_;  // that copy_positions() was last asked for
  Neighbourhood seen_;                       // these in the full object, when it was last idle
  bool held_ = false;
  Eigen::Vector3d displacement_W_ = Eigen::Vector3d::Zero();  // [m] of the last answer
  std::uint64_t told_ = 0;
  ReducedUse use_;
  std::future<Checked> check_;
  std::future<ReducedTraining> training_;
};

}  // namespace forcegrid::simulator
