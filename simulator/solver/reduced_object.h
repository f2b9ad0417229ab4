#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <future>
#include <optional>
#include <string>

#include "simulator/solver/elastic_object.h"
#include "simulator/solver/reduced_training.h"
#include "simulator/solver/reduced_use.h"
#include "simulator/solver/solver_report.h"

namespace forcegrid::simulator {

struct ReducedObjectOptions {
  SolverOptions solver;             ///< of the full object
  ReducedTrainingOptions training;  ///< `cancel` is not used
  /// When there are most_states, apart_m grows; when a check fails it shrinks.
  StateSpacing spacing;
  std::size_t first_states = 8;  ///< of a grab, before the first training; >= 1
  /// Full answers without a new state after which fewer are enough, 3 for the first training and
  /// one for the next: the tool keeps to a line; >= 1.
  int patience = 60;
  /// A model is used while |F - F_full| is at most this times the larger of |F_full| and the RMS
  /// force of its training states; > 0.
  double check_tolerance = 3e-3;
  int passes = 3;         ///< checks in a row that a new model has to pass before it is used; >= 1
  int passes_again = 10;  ///< the same after a failed one; >= 1
  double reach_m = 6e-3;  ///< beyond this from the nearest training state the full object answers
  int check_every = 1;    ///< answers of the model from one check to the next; >= 1
  /// Trainings and checks run on threads of their own; false: within move_to().
  bool own_threads = true;
  std::function<void(const std::string&)> say;  ///< what changes, in a line; may be empty
};

/// A mass-spring object under a tool that holds a patch of it, which learns as the grab lasts.
///
/// At first the full object answers, and its states are kept. When there are enough of them, or no
/// new ones come, a reduced model is trained, and again as they become a quarter more, or some more
/// after a failed check. It is tried beside the full object until it has given the same force
/// several times in a row, and from then on it answers where states are near. The full object
/// follows on a thread of its own and checks it at every check_every-th place. A failed check, a
/// place out of reach, or a model without an equilibrium give the answers back to the full object;
/// what its state then is, is trained on, too. The next grab knows nothing of this one.
///
/// Force and stiffness differ by at most the tolerance where one takes over from the other. When
/// the full object has left its branch of equilibria, all that was learnt is forgotten, and the
/// next answer says so (Equilibrium::left_branch).
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

  const ReducedUse& use() const noexcept { return use_; }
  SolverReport report() const noexcept { return {.reduced = use_}; }

 private:
  // What a check brings back.
  struct Checked {
    Equilibrium full;
    Eigen::Vector3d reduced_force_W = Eigen::Vector3d::Zero();
    std::optional<ReducedSnapshot> state;
  };

  void tell(const std::string& what);
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
  bool left_branch_ = false;  // by a check, and not told yet
  std::uint64_t told_ = 0;
  ReducedUse use_;
  std::future<Checked> check_;
  std::future<ReducedTraining> training_;
};

}  // namespace forcegrid::simulator
