// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/solver_motion.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "rt/checkpoint.h"
#include "rt/percentiles.h"
#include "rt/thread_time.h"
#include "simulator/mesh/error.h"
#include "simulator/reference/reference_solution.h"
#include "simulator/solver/newton_cg_baseline.h"
#include "simulator/solver/solver_kind.h"
#include "text/text.h"

namespace forcegrid::simulator {
void require_held(int held, const Scene& scene) {
  if (held == 0) {
    throw Error("no free vertex within " + text::number_text(scene.patch_radius_m) +
                " m of the top of scene " + scene.name + "; use a larger patch_radius_m");
  }
}

namespace {

using Eigen::Vector3d;

SolverSubject::Answer answer_of(const Equilibrium& e) {
  return {e.force_W, e.relative_residual, static_cast<double>(e.iterations),
          static_cast<double>(e.vertices), e.converged && e.reached};
}

// The processor that solves the whole object.
class OtherProcessor {
 public:
  explicit OtherProcessor(TwoRatesObject& object) : object_(object) {}

  double tick(double period_s) {
    double time_s = 0.0;
    if (ticks_left_ == 0 && object_.whole_is_due()) {
      const double start_s = rt::thread_time_s();
      object_.solve_whole();
      time_s = rt::thread_time_s() - start_s;
      ticks_left_ = std::max(1, static_cast<int>(std::ceil(time_s / period_s)));
    }
    if (ticks_left_ > 0 && --ticks_left_ == 0) {
      object_.hand_over();
    }
    return 1e3 * time_s;
  }

 private:
  TwoRatesObject& object_;
  int ticks_left_ = 0;
};

}  // namespace

SolverSubject elastic_subject(const Scene& scene, const SolverOptions& options,
                              std::string setting) {
  const auto object = std::make_shared<ElasticObject<float>>(scene.mesh, options);
  require_held(object->grab(scene.mesh.top_W, scene.patch_radius_m), scene);
  return {to_string(options.border_tolerance > 0.0 ? SolverKind::kLocal : SolverKind::kQuasiStatic),
          std::move(setting), [object](const Vector3d& displacement_W) {
            return answer_of(object->move_to(displacement_W));
          }};
}

SolverSubject newton_subject(const Scene& scene, double relative_tolerance) {
  const auto object = std::make_shared<NewtonCgBaseline>(
      scene.mesh, NewtonCgBaseline::Options{.relative_tolerance = relative_tolerance});
  require_held(object->grab(scene.mesh.top_W, scene.patch_radius_m), scene);
  const auto vertices = static_cast<double>(scene.mesh.rest_position_W.size());
  return {"newton_cg", "|r| " + text::number_text(relative_tolerance),
          [object, vertices](const Vector3d& displacement_W) {
            const NewtonCgBaseline::Answer a = object->move_to(displacement_W);
            return SolverSubject::Answer{a.force_W, a.relative_residual,
                                         static_cast<double>(a.iterations), vertices, a.converged};
          }};
}

SolverSubject two_rates_subject(const Scene& scene, const TwoRatesOptions& options,
                                std::string setting) {
  TwoRatesOptions by_hand = options;
  by_hand.own_thread = false;
  const auto object = std::make_shared<TwoRatesObject>(scene.mesh, by_hand);
  require_held(object->grab(scene.mesh.top_W, scene.patch_radius_m), scene);
  object->solve_whole();  // takes hold of the top, too
  object->hand_over();
  const auto other = std::make_shared<OtherProcessor>(*object);
  return {to_string(SolverKind::kTwoRates), std::move(setting),
          [object](const Vector3d& displacement_W) {
            return answer_of(object->move_to(displacement_W));
          },
          [object, other](double period_s) { return other->tick(period_s); }};
}

SolverMotion::SolverMotion(const Scene& scene, const std::vector<Vector3d>& displacements_W,
                           double rate_Hz, double settling_s, int reference_every)
    : displacements_W_(displacements_W),
      rate_Hz_(rate_Hz),
      first_(static_cast<std::size_t>(std::lround(settling_s * rate_Hz))),
      reference_every_(static_cast<std::size_t>(reference_every)) {
  if (displacements_W.size() <= first_ || reference_every < 1) {
    throw Error("bench: " + std::to_string(displacements_W.size()) + " positions at " +
                text::number_text(rate_Hz) + " Hz, compared every " +
                std::to_string(reference_every) + "; give more than the " + std::to_string(first_) +
                " that settle, and compare every 1 or more");
  }
  ReferenceOptions reference;
  reference.contact_point_W = scene.mesh.top_W;
  reference.patch_radius_m = scene.patch_radius_m;
  reference.progress = [](double done, double) {
    constexpr std::size_t kPieces = 1000;
    rt::note_progress(static_cast<std::size_t>(done * kPieces), kPieces);
  };
  std::vector<Vector3d> positions_W;
  // Starts at rest, so that the converged solver stays on the subjects' branch.
  for (std::size_t tick = first_ % reference_every_; tick < displacements_W.size();
       tick += reference_every_) {
    positions_W.push_back(scene.mesh.top_W + displacements_W[tick]);
  }
  converged_W_ = simulate_reference(scene.mesh, positions_W, reference).forces_W;
  converged_W_.erase(converged_W_.begin(),
                     converged_W_.begin() + static_cast<std::ptrdiff_t>(first_ / reference_every_));
  for (const Vector3d& force_W : converged_W_) {
    mean_square_N2_ += force_W.squaredNorm() / static_cast<double>(converged_W_.size());
  }
}

MotionRow SolverMotion::measure(const SolverSubject& subject) const {
  std::vector<double> times_ms;
  MotionRow row = run(subject, times_ms);
  set_times(times_ms, row);
  return row;
}

std::vector<MotionRow> SolverMotion::measure(
    const std::vector<std::function<SolverSubject()>>& makes, int passes) const {
  std::vector<MotionRow> rows;
  std::vector<std::vector<double>> shortest_ms(makes.size());
  // Slow and quick solvers take turns, so that passes take equal times, their parts do not.
  const auto part_of = [&](int pass, std::size_t k) {
    const double whole = static_cast<double>(passes) * static_cast<double>(makes.size());
    const double before =
        static_cast<double>(pass) * static_cast<double>(makes.size()) + static_cast<double>(k);
    return rt::PartOfWork(before / whole, (before + 1.0) / whole);
  };
  for (std::size_t k = 0; k < makes.size(); ++k) {
    const rt::PartOfWork part = part_of(0, k);
    rows.push_back(run(makes[k](), shortest_ms[k]));
  }
  for (int pass = 1; pass < passes; ++pass) {
    for (std::size_t k = 0; k < makes.size(); ++k) {
      const rt::PartOfWork part = part_of(pass, k);
      std::vector<double> times_ms;
      run(makes[k](), times_ms);
      for (std::size_t tick = 0; tick < times_ms.size(); ++tick) {
        shortest_ms[k][tick] = std::min(shortest_ms[k][tick], times_ms[tick]);
      }
    }
  }
  for (std::size_t k = 0; k < makes.size(); ++k) {
    set_times(shortest_ms[k], rows[k]);
  }
  return rows;
}

void SolverMotion::set_times(const std::vector<double>& times_ms, MotionRow& row) const {
  rt::Percentiles times_us;  // resolves steps of 1/64
  row.mean_ms = row.max_ms = 0.0;
  for (const double time_ms : times_ms) {
    row.mean_ms += time_ms / static_cast<double>(times_ms.size());
    row.max_ms = std::max(row.max_ms, time_ms);
    times_us.add(1e3 * time_ms);
  }
  row.median_ms = 1e-3 * times_us.at(0.5);
}

// One pass; `times_ms` are the counted ticks'.
MotionRow SolverMotion::run(const SolverSubject& subject, std::vector<double>& times_ms) const {
  MotionRow row{.solver = subject.name, .rate_Hz = rate_Hz_, .setting = subject.setting};
  double error_N2 = 0.0;
  double largest_N = 0.0;
  double whole_solutions = 0.0;
  for (std::size_t tick = 0; tick < displacements_W_.size(); ++tick) {
    rt::checkpoint(tick, displacements_W_.size());
    const double start_s = rt::thread_time_s();
    const SolverSubject::Answer answer = subject.move_to(displacements_W_[tick]);
    const double time_ms = 1e3 * (rt::thread_time_s() - start_s);
    const double whole_ms = subject.meanwhile ? subject.meanwhile(1.0 / rate_Hz_) : 0.0;
    if (tick < first_) {
      continue;
    }
    ++row.ticks;
    times_ms.push_back(time_ms);
    row.residual_mean += answer.relative_residual;
    row.iterations_mean += answer.iterations;
    row.vertices_mean += answer.vertices;
    row.unconverged += answer.converged ? 0.0 : 1.0;
    row.whole_mean_ms += whole_ms;
    whole_solutions += whole_ms > 0.0 ? 1.0 : 0.0;
    if ((tick - first_) % reference_every_ == 0) {
      const double error_N =
          (answer.force_W - converged_W_[(tick - first_) / reference_every_]).norm();
      error_N2 += error_N * error_N / static_cast<double>(converged_W_.size());
      largest_N = std::max(largest_N, error_N);
    }
  }
  const auto ticks = static_cast<double>(row.ticks);
  for (double* mean :
       {&row.residual_mean, &row.iterations_mean, &row.vertices_mean, &row.unconverged}) {
    *mean /= ticks;
  }
  row.whole_mean_ms /= std::max(1.0, whole_solutions);
  row.error_percent = 100.0 * std::sqrt(error_N2 / mean_square_N2_);
  row.max_error_percent = 100.0 * largest_N / std::sqrt(mean_square_N2_);
  return row;
}

}  // namespace forcegrid::simulator
