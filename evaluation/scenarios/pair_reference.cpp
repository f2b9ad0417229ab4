// SPDX-License-Identifier: Apache-2.0
#include "evaluation/scenarios/pair_reference.h"

#include <cmath>
#include <system_error>
#include <utility>
#include <vector>

#include "evaluation/files/error.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/scenarios/solved_pair.h"

namespace forcegrid::evaluation {
namespace {

// Short enough that every state stays on the branch of equilibria that starts at rest.
constexpr double kMaxStep_m = 1.5e-3;
constexpr std::size_t kInstantsBetweenReports = 25;

void check(const PairTraceOptions& options) {
  const auto refuse = [](const std::string& what) {
    throw ChartError("trace of two tools: " + what);
  };
  if (!(options.seconds > 1.0 && options.seconds <= PairMotion::kLongest_s)) {
    refuse("its length must be above 1 and at most 16 s, got " + std::to_string(options.seconds));
  }
  if (!(options.simulator_rate_Hz > 0.0 && options.servo_rate_Hz >= options.simulator_rate_Hz)) {
    refuse("the servo's rate must be at least the simulator's, and both positive");
  }
  if (!(options.delay_s >= 0.0 && options.delay_s <= 1.0)) {
    refuse("the delay must be 0 to 1 s, got " + std::to_string(options.delay_s));
  }
  if (!(options.noise_N >= 0.0 && options.noise_N <= 1.0)) {
    refuse("the noise must be 0 to 1 N, got " + std::to_string(options.noise_N));
  }
}

std::string key_of(const simulator::SpringMesh& mesh, const PairMotion& motion,
                   const PairTraceOptions& options, std::uint64_t seed) {
  TableOptions object;
  object.patch_radius_m = options.patch_radius_m;
  object.relative_tolerance = options.relative_tolerance;
  ContentHash hash;
  hash.add(table_key(mesh, object));
  hash.add(motion.name());
  hash.add(seed);
  for (const double number : {options.seconds, options.servo_rate_Hz}) {
    hash.add(number);
  }
  if (options.stiffness) {
    hash.add("stiffness at");
    hash.add(options.simulator_rate_Hz);
  }
  // What the motion is today: another version's file is not taken for this one's.
  for (const double share : {0.1, 0.37, 0.9}) {
    const PairVector at_W = motion.positions_W(share * options.seconds);
    for (const double coordinate_m : at_W) {
      hash.add(coordinate_m);
    }
  }
  return hash.text();
}

simulator::SolverOptions solver_options(const PairTraceOptions& options) {
  simulator::SolverOptions solver;
  solver.relative_tolerance = options.relative_tolerance;
  solver.max_step_m = kMaxStep_m;
  solver.max_steps = 1000;
  solver.max_iterations = 2000;
  solver.max_recovery_steps = 100;
  return solver;
}

// Calls take(tick, index) for each tick of the simulator and the servo instant that it samples.
template <typename Take>
void for_each_tick(const PairTraceOptions& options, std::size_t instants, const Take& take) {
  std::size_t at = 0;
  for (std::size_t tick = 0;; ++tick) {
    const double tick_s = static_cast<double>(tick) / options.simulator_rate_Hz;
    while (at < instants && static_cast<double>(at) / options.servo_rate_Hz < tick_s - 1e-9) {
      ++at;
    }
    if (at == instants) {
      return;
    }
    take(tick_s, at);
  }
}

PairSample sample_of(const PairInstant& instant) {
  PairSample sample;
  sample.time_s = instant.time_s;
  sample.positions_W = instant.positions_W;
  sample.forces_W = instant.forces_W;
  return sample;
}

// The instants, and at those that are sampled the stiffness, if that is asked for.
void solve(const simulator::SpringMesh& mesh, const PairMotion& motion,
           const PairTraceOptions& options, PairReference& reference) {
  SolvedPair<double> object(mesh, solver_options(options), options.patch_radius_m);
  const PairVector touched_W = PairMotion::contact_points_W();
  const auto instants =
      static_cast<std::size_t>(std::floor(options.seconds * options.servo_rate_Hz + 1e-9));
  std::vector<bool> sampled(instants, false);
  for_each_tick(options, instants, [&](double, std::size_t at) { sampled[at] = true; });
  for (std::size_t i = 0; i < instants; ++i) {
    if (options.cancel != nullptr && options.cancel->load()) {
      throw Stopped();
    }
    PairInstant instant;
    instant.time_s = static_cast<double>(i) / options.servo_rate_Hz;
    instant.positions_W = motion.positions_W(instant.time_s);
    object.move(instant.positions_W - touched_W);
    instant.forces_W = object.forces_N();
    reference.unconverged += object.converged() ? 0 : 1;
    reference.branch_changes += object.left_branch() ? 1 : 0;
    reference.trace.servo.push_back(instant);
    if (options.stiffness && sampled[i]) {
      DeliveredPairSample row{sample_of(instant), instant.time_s};
      const auto stiffness_W = object.stiffness_N_per_m();
      row.sample.has_stiffness = stiffness_W.has_value();
      row.sample.stiffness_W = stiffness_W.value_or(PairMatrix::Zero());
      reference.trace.samples.push_back(row);
    }
    if (options.progress && i % kInstantsBetweenReports == 0) {
      options.progress(static_cast<double>(i) / static_cast<double>(instants));
    }
  }
}

// Replaces the samples, exact ones with their stiffness if that is asked for, by delivered ones.
void add_samples(const PairTraceOptions& options, std::uint64_t seed, PairTrace& trace) {
  const std::vector<DeliveredPairSample> exact = std::exchange(trace.samples, {});
  SeededNumbers numbers(seed);
  trace.contacts = {{trace.servo.front().time_s, PairMotion::contact_points_W(), {}}};
  auto next = exact.begin();
  for_each_tick(options, trace.servo.size(), [&](double tick_s, std::size_t at) {
    DeliveredPairSample row{sample_of(trace.servo[at]), 0.0};
    while (next != exact.end() && next->sample.time_s < row.sample.time_s - 1e-9) {
      ++next;
    }
    if (options.stiffness && next != exact.end() &&
        next->sample.time_s < row.sample.time_s + 1e-9) {
      row.sample.has_stiffness = next->sample.has_stiffness;
      row.sample.stiffness_W = next->sample.stiffness_W;
    }
    for (double& force_N : row.sample.forces_W) {
      force_N += options.noise_N * numbers.normal();
    }
    row.delivered_s = tick_s + 1.0 / options.simulator_rate_Hz + options.delay_s;
    trace.samples.push_back(row);
  });
}

}  // namespace

void make_trace_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw ChartError("folder " + folder.string() + " can't be made (" + error.message() +
                     "); name another one");
  }
}

PairReference make_pair_trace(const simulator::SpringMesh& mesh, const PairMotion& motion,
                              const PairTraceOptions& options, std::uint64_t seed) {
  check(options);
  PairReference reference;
  reference.key = key_of(mesh, motion, options, seed);
  std::filesystem::path kept;
  if (!options.cache.empty()) {
    make_trace_folder(options.cache);
    kept = options.cache / ("two-tools-" + reference.key + ".csv.gz");
  }
  if (!kept.empty() && std::filesystem::exists(kept)) {
    reference.trace = read_pair_trace(kept.string());
    reference.from_cache = true;
  } else {
    solve(mesh, motion, options, reference);
    if (!kept.empty() && reference.unconverged == 0 && reference.branch_changes == 0) {
      write_pair_trace(kept.string(), reference.trace);
    }
  }
  add_samples(options, seed, reference.trace);
  return reference;
}

}  // namespace forcegrid::evaluation
