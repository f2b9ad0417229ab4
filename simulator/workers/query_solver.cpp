// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/query_solver.h"

#include <cmath>

#include "rt/clock.h"

namespace forcegrid::simulator {

bool finite(const Equilibrium& equilibrium) {
  return equilibrium.force_W.allFinite() && equilibrium.stiffness_W.allFinite() &&
         std::isfinite(equilibrium.relative_residual);
}

QuerySolver::QuerySolver(const Scene& scene, const SolverOptions& options)
    : object_(scene.mesh, options), patch_radius_m_(scene.patch_radius_m) {}

StickyContact::Answer QuerySolver::answer(const QueryJob& job) {
  rt::TimePoint start = rt::Clock::now();
  StickyContact::Answer answer;
  answer.position_W = job.position_W;
  answer.point_W = job.touching ? job.point_W : job.position_W;
  answer.epoch = job.answer_epoch();
  answer.in_contact = job.touching;
  answer.equilibrium.converged = true;
  if (job.touching && (!object_.grabbed() || point_W_ != job.point_W)) {
    object_.release();
    point_W_ = job.point_W;
    answer.in_contact = object_.grab(job.point_W, patch_radius_m_) > 0;
    start = rt::Clock::now();
  }
  if (answer.in_contact) {
    answer.equilibrium = object_.move_to(job.position_W - job.point_W);
    answer.position_W = job.point_W + answer.equilibrium.displacement_W;
  }
  last_solve_s_ = rt::seconds(rt::Clock::now() - start);
  answer.equilibrium.solve_time_s = last_solve_s_;
  if (!finite(answer.equilibrium)) {
    object_.release();
  }
  return answer;
}

}  // namespace forcegrid::simulator
