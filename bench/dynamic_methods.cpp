// SPDX-License-Identifier: Apache-2.0
// Errors of force methods on an object that moves by itself: along `random`, with a simulator at 30
// Hz whose answers arrive one period late, for three retardation times. Runs in simulated time with
// the simulator's contact and solver, against the reference force of `run`.
//
//   forcegrid_dynamic_methods [SEEDS [METHOD...]]     four seeds, `auto` and `hold`

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "evaluation/judge/judge.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/traces/trace.h"
#include "forcegrid/methods.h"
#include "simulator/mesh/scene.h"
#include "simulator/reference/dynamic_reference.h"
#include "simulator/reference/reference_solution.h"
#include "simulator/touch/dynamic_contact.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;

constexpr double kServo_Hz = 500.0;
constexpr double kSimulator_Hz = 30.0;
constexpr double kCount_m = 23e-6;
constexpr double kDuration_s = 8.0;
constexpr double kApproach_s = 0.3;
constexpr double kApproach_m_per_s = 0.03;
constexpr double kJudgedFrom_s = 1.0;

struct Motion {
  std::vector<double> times_s;
  std::vector<Vector3d> positions_W;  // rounded to encoder counts
};

// Down to the object's top, then along evaluation::Trajectory.
Motion make_motion(const Vector3d& top_W, std::uint64_t seed) {
  const evaluation::Trajectory random("random", seed);
  Motion motion;
  for (int i = 0; i < std::lround((kApproach_s + kDuration_s) * kServo_Hz); ++i) {
    const double time_s = i / kServo_Hz;
    const double since_s = time_s - kApproach_s;
    const Vector3d displacement_W =
        since_s < 0.0 ? Vector3d(0.0, 0.0, -kApproach_m_per_s * since_s)
                      : Vector3d(random.position_W(since_s) - evaluation::first_contact_point_W());
    motion.times_s.push_back(time_s);
    motion.positions_W.push_back(kCount_m *
                                 ((top_W + displacement_W) / kCount_m).array().round().matrix());
  }
  return motion;
}

struct Answers {
  std::vector<evaluation::DeliveredSample> samples;
  Vector3d contact_W = Vector3d::Zero();
};

// At each tick the simulator has all positions up to that time, or with `sparse` only the newest.
Answers simulate(const simulator::Scene& scene, const Motion& motion, bool sparse) {
  const auto contact = simulator::make_dynamic_contact(scene, {}, {});
  Answers answers;
  int tick = 0;
  for (std::size_t i = 0; i < motion.times_s.size(); ++i) {
    const double time_s = motion.times_s[i];
    if (!sparse) {
      contact->was_at(time_s, motion.positions_W[i]);
    }
    if (time_s < tick / kSimulator_Hz) {
      continue;
    }
    contact->tell_time(time_s);
    const simulator::ToolContact::Answer answer = contact->step(motion.positions_W[i]);
    if (answer.in_contact) {
      Sample sample;
      sample.time_s = time_s;
      sample.position_W = answer.position_W;
      sample.force_W = answer.equilibrium.force_W;
      sample.contact_epoch = answer.epoch;
      sample.contact_point_W = answer.point_W;
      answers.samples.push_back({sample, (tick + 1) / kSimulator_Hz});
      answers.contact_W = answer.point_W;
    }
    ++tick;
  }
  return answers;
}

// The cycle on the way down in which the tool was nearest to its contact point.
std::size_t first_contact_cycle(const Motion& motion, const Vector3d& contact_W) {
  std::size_t nearest = 0;
  for (std::size_t i = 0; motion.times_s[i] <= kApproach_s; ++i) {
    const double away_m = (motion.positions_W[i] - contact_W).norm();
    nearest = away_m < (motion.positions_W[nearest] - contact_W).norm() ? i : nearest;
  }
  return nearest;
}

std::vector<Vector3d> reference_W(const simulator::Scene& scene, const Motion& motion,
                                  const Answers& answers) {
  simulator::ReferenceOptions options;
  options.contact_point_W = answers.contact_W;
  options.first_contact_cycle = first_contact_cycle(motion, answers.contact_W);
  return simulator::simulate_dynamic_reference(scene, motion.positions_W, motion.times_s, options)
      .forces_W;
}

evaluation::Trace make_trace(const Motion& motion, const Answers& answers,
                             const std::vector<Vector3d>& forces_W) {
  evaluation::Trace trace;
  const std::size_t first = first_contact_cycle(motion, answers.contact_W);
  for (std::size_t i = first; i < motion.times_s.size(); ++i) {
    trace.servo.push_back({motion.times_s[i], motion.positions_W[i], forces_W[i]});
  }
  trace.samples = answers.samples;
  trace.events.push_back(
      {motion.times_s[first], true, answers.contact_W, answers.samples.front().delivered_s});
  return trace;
}

double percent(double error_sum, double reference_sum) {
  return 100.0 * std::sqrt(error_sum / reference_sum);
}

// [%] Error of the samples themselves, each against the reference force at its time.
double sample_error_percent(const Answers& answers, const std::vector<Vector3d>& forces_W) {
  double error = 0.0;
  double reference = 0.0;
  for (const auto& [sample, delivered_s] : answers.samples) {
    if (sample.time_s >= kApproach_s + kJudgedFrom_s) {
      const auto i = static_cast<std::size_t>(std::lround(sample.time_s * kServo_Hz));
      error += (sample.force_W - forces_W[i]).squaredNorm();
      reference += forces_W[i].squaredNorm();
    }
  }
  return percent(error, reference);
}

simulator::Scene jelly(double retardation_time_s) {
  simulator::Scene scene = simulator::make_scene("jelly", Vector3d::Zero());
  for (simulator::SpringLaw& law : scene.mesh.laws) {
    law.retardation_time_s = retardation_time_s;
  }
  return scene;
}

void measure(double retardation_time_s, std::uint64_t seed, bool sparse,
             const std::vector<std::string>& methods) {
  const simulator::Scene scene = jelly(retardation_time_s);
  const Motion motion = make_motion(scene.mesh.top_W, seed);
  const Answers answers = simulate(scene, motion, sparse);
  const std::vector<Vector3d> forces_W = reference_W(scene, motion, answers);
  std::printf("| %3.0f ms | %llu | %s | %5.2f |", 1e3 * retardation_time_s,
              static_cast<unsigned long long>(seed), sparse ? "one per answer" : "all",
              sample_error_percent(answers, forces_W));
  const evaluation::Trace trace = make_trace(motion, answers, forces_W);
  double rms_N = 0.0;
  for (const std::string& name : methods) {
    const auto method = make_force_method(name, {});
    const evaluation::Verdict verdict = evaluation::judge(*method, trace);
    rms_N = verdict.reference_rms_N;
    std::printf(" %5.2f |", verdict.rms_error_percent_after_1s);
  }
  std::printf(" %.2f |\n", rms_N);
  std::fflush(stdout);
}

}  // namespace
}  // namespace forcegrid

int main(int count, char** arguments) {
  const int seeds = count > 1 ? std::atoi(arguments[1]) : 4;
  std::vector<std::string> methods(arguments + std::min(count, 2), arguments + count);
  if (methods.empty()) {
    methods = {"auto", "hold"};
  }
  if (seeds < 1) {
    std::fprintf(stderr,
                 "forcegrid_dynamic_methods: '%s' is not a number of seeds; give 1 or more\n",
                 arguments[1]);
    return 2;
  }
  std::printf(
      "RMS error after %.0f s in %% of the RMS force\n\n| tau | seed | positions | samples |",
      forcegrid::kJudgedFrom_s);
  for (const std::string& name : methods) {
    std::printf(" %s |", name.c_str());
  }
  std::printf(" force [N] |\n");
  for (const double retardation_time_s : {0.005, 0.02, 0.1}) {
    for (int seed = 1; seed <= seeds; ++seed) {
      for (const bool sparse : {true, false}) {
        forcegrid::measure(retardation_time_s, static_cast<std::uint64_t>(seed), sparse, methods);
      }
    }
  }
  return 0;
}
