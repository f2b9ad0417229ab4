// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/two_rates_object.h"

namespace forcegrid::simulator {

/// A solver that holds a scene's top at rest.
struct SolverSubject {
  struct Answer {
    Eigen::Vector3d force_W = Eigen::Vector3d::Zero();
    double relative_residual = 0.0;
    double iterations = 0.0;
    double vertices = 0.0;
    bool converged = false;
  };

  std::string name;
  std::string setting;
  std::function<Answer(const Eigen::Vector3d& displacement_W)> move_to;
  /// The work of another processor during a tick of `period_s` [s]. Empty: none.
  /// @returns [ms] its time for a solution that began in this tick; 0: none began.
  std::function<double(double period_s)> meanwhile{};
};

/// Throw Error for a scene whose top can't be held.
SolverSubject elastic_subject(const Scene& scene, const SolverOptions& options,
                              std::string setting);
SolverSubject newton_subject(const Scene& scene, double relative_tolerance);
/// The whole object is solved between the ticks. Its solution is handed over after as many ticks as
/// its processor time takes: what a second processor would do, without the noise of the system's
/// scheduling.
SolverSubject two_rates_subject(const Scene& scene, const TwoRatesOptions& options,
                                std::string setting);

/// A solver along a motion, tick by tick. Times are processor times of one thread.
struct MotionRow {
  std::string solver;
  double rate_Hz = 0.0;
  std::string setting;
  std::size_t ticks = 0;
  double mean_ms = 0.0;
  double median_ms = 0.0;
  double max_ms = 0.0;
  double error_percent = 0.0;      ///< RMS of |F - F_converged| in % of the RMS of |F_converged|
  double max_error_percent = 0.0;  ///< the largest one, in % of the same
  double residual_mean = 0.0;
  double iterations_mean = 0.0;
  double vertices_mean = 0.0;  ///< that the solver touched
  double unconverged = 0.0;    ///< fraction of the ticks whose tolerance was not reached
  /// Two rates: time of one solution of the whole object, on the other processor; 0: none.
  double whole_mean_ms = 0.0;
};

/// A motion of a scene's tool, with the forces of the converged solver: simulate_reference(),
/// double precision, relative residual 1e-6.
class SolverMotion {
 public:
  /// @param displacements_W  [m] of the tool since it took hold of the top, the first near zero.
  /// @param settling_s  ticks before it are solved, but not counted.
  /// @param reference_every  counted ticks from one comparison with the converged force to the
  ///   next.
  /// Throws Error for a motion without a counted tick, or reference_every < 1.
  SolverMotion(const Scene& scene, const std::vector<Eigen::Vector3d>& displacements_W,
               double rate_Hz, double settling_s, int reference_every = 1);

  /// Moves the subject, which must be new, along it.
  MotionRow measure(const SolverSubject& subject) const;

  /// The same for several solvers in turn, each with `passes` >= 1 new subjects. The shortest of a
  /// tick's times counts: all passes solve the same, and only other work on the machine differs.
  /// Everything else is the first pass's.
  std::vector<MotionRow> measure(const std::vector<std::function<SolverSubject()>>& makes,
                                 int passes) const;

 private:
  MotionRow run(const SolverSubject& subject, std::vector<double>& times_ms) const;
  void set_times(const std::vector<double>& times_ms, MotionRow& row) const;

  std::vector<Eigen::Vector3d> displacements_W_;
  double rate_Hz_;
  std::size_t first_;
  std::size_t reference_every_;
  std::vector<Eigen::Vector3d> converged_W_;  // at first_, first_ + reference_every_, ...
  double mean_square_N2_ = 0.0;
};

/// @throws Error if the tool has taken hold of no vertex of the scene (`held` is 0).
void require_held(int held, const Scene& scene);

}  // namespace forcegrid::simulator
