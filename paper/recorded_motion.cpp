// SPDX-License-Identifier: Apache-2.0
#include "paper/recorded_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "evaluation/charts/page_text.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/scenarios/scenarios.h"
#include "simulator/reference/reference_solution.h"

namespace forcegrid::paper {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;
using nlohmann::json;

// Increase when the meaning of a cached recording changes.
constexpr std::uint64_t kCacheVersion = 1;
// A tick that differs from a servo instant only by rounding belongs to it.
constexpr double kSameInstant_s = 1e-9;

std::vector<Vector3d> positions_of(const evaluation::Trajectory& trajectory) {
  const auto instants =
      static_cast<std::size_t>(std::ceil(trajectory.duration_s() * kServoRate_Hz - 1e-6));
  std::vector<Vector3d> positions_W;
  for (std::size_t i = 0; i < instants; ++i) {
    positions_W.push_back(trajectory.position_W(static_cast<double>(i) / kServoRate_Hz));
  }
  return positions_W;
}

void measure_travel(RecordedMotion& recorded) {
  const auto& servo = recorded.trace.servo;
  const auto ticks = static_cast<std::size_t>(servo.back().time_s * kSimulatorRate_Hz);
  double sum_m2 = 0.0;
  const auto at = [&](std::size_t tick) {
    return servo[static_cast<std::size_t>(static_cast<double>(tick) * kServoRate_Hz /
                                          kSimulatorRate_Hz)]
        .position_W;
  };
  for (std::size_t k = 0; k < ticks; ++k) {
    const double travel_m = (at(k + 1) - at(k)).norm();
    recorded.longest_travel_m = std::max(recorded.longest_travel_m, travel_m);
    sum_m2 += travel_m * travel_m;
  }
  recorded.rms_travel_m = std::sqrt(sum_m2 / static_cast<double>(ticks));
}

// The files of a recording in the cache: its forces, and the quality of their solution.
struct Place {
  fs::path trace;
  fs::path facts;
};

Place place_of(const fs::path& cache, const std::string& key) {
  return {cache / ("offline_" + key + ".csv.gz"), cache / ("offline_" + key + ".json")};
}

bool read_cached(const Place& place, RecordedMotion& recorded) {
  if (!fs::exists(place.trace) || !fs::exists(place.facts)) {
    return false;
  }
  const json facts = json::parse(evaluation::read_text(place.facts), nullptr, false);
  try {
    recorded.trace = evaluation::read_trace(place.trace.string());
    recorded.unconverged = facts.at("unconverged");
    recorded.branch_changes = facts.at("branch_changes");
    recorded.worst_seam_N = facts.at("worst_seam_N");
  } catch (const json::exception&) {
    return false;  // damaged: solved again
  } catch (const evaluation::TraceError&) {
    return false;
  }
  recorded.from_cache = true;
  return true;
}

void solve(const simulator::SpringMesh& mesh, double patch_radius_m,
           const std::vector<Vector3d>& positions_W, const PaperOptions& options,
           RecordedMotion& recorded) {
  simulator::ReferenceOptions solving;
  solving.contact_point_W = evaluation::first_contact_point_W();
  solving.patch_radius_m = patch_radius_m;
  solving.threads = options.jobs;
  solving.cancel = options.cancel;
  if (options.progress) {
    const std::string what = "reference forces of " + recorded.motion + " on " + recorded.scene;
    solving.progress = [&options, what](double done, double remaining_s) {
      options.progress(what, done, remaining_s);
    };
  }
  const simulator::ReferenceSolution reference =
      simulator::simulate_reference(mesh, positions_W, solving);
  if (reference.cancelled) {
    throw evaluation::Stopped();
  }
  recorded.trace =
      trace_of_path(positions_W, reference.forces_W, evaluation::first_contact_point_W());
  recorded.solved_s = reference.elapsed_s;
  recorded.unconverged = reference.unconverged;
  recorded.branch_changes = reference.branch_changes;
  recorded.worst_seam_N = reference.worst_seam_N;
}

}  // namespace

evaluation::Trace trace_of_path(const std::vector<Vector3d>& positions_W,
                                const std::vector<Vector3d>& forces_W,
                                const Vector3d& contact_point_W) {
  evaluation::Trace trace;
  for (std::size_t i = 0; i < positions_W.size(); ++i) {
    trace.servo.push_back({static_cast<double>(i) / kServoRate_Hz, positions_W[i], forces_W[i]});
  }
  trace.events.push_back({0.0, true, contact_point_W});
  for (std::size_t k = 0;; ++k) {
    const double tick_s = static_cast<double>(k) / kSimulatorRate_Hz;
    const auto at = static_cast<std::size_t>(std::ceil((tick_s - kSameInstant_s) * kServoRate_Hz));
    const double delivered_s = tick_s + 1.0 / kSimulatorRate_Hz;
    if (at >= trace.servo.size() || delivered_s > trace.servo.back().time_s) {
      return trace;
    }
    evaluation::DeliveredSample delivered;
    delivered.sample.time_s = trace.servo[at].time_s;
    delivered.sample.position_W = trace.servo[at].position_W;
    delivered.sample.force_W = trace.servo[at].force_W;
    delivered.sample.contact_epoch = 1;
    delivered.sample.contact_point_W = contact_point_W;
    delivered.delivered_s = delivered_s;
    trace.samples.push_back(delivered);
  }
}

RecordedMotion record_motion(const std::string& scene, const std::string& motion,
                             const PaperOptions& options) {
  const evaluation::ChartScene& chosen = evaluation::chart_scene(scene);
  const evaluation::Trajectory trajectory(motion, options.seed);
  if (!trajectory.is_static()) {
    throw evaluation::ChartError("the motion '" + motion +
                                 "' has more than one contact; choose a motion with a single one");
  }
  const simulator::SpringMesh mesh = evaluation::make_mesh(chosen);
  RecordedMotion recorded;
  recorded.scene = chosen.name;
  recorded.scene_title = chosen.title;
  recorded.motion = motion;
  evaluation::TableOptions hashed;
  hashed.patch_radius_m = chosen.patch_radius_m;
  evaluation::ContentHash hash;
  hash.add(kCacheVersion);
  hash.add(evaluation::table_key(mesh, hashed));
  const std::vector<Vector3d> positions_W = positions_of(trajectory);
  for (const Vector3d& position_W : positions_W) {
    hash.add(position_W.data(), 3 * sizeof(double));
  }
  const Place place = place_of(options.cache, hash.text());
  if (options.cache.empty() || !read_cached(place, recorded)) {
    solve(mesh, chosen.patch_radius_m, positions_W, options, recorded);
    if (!options.cache.empty()) {
      fs::create_directories(options.cache);
      evaluation::write_trace(place.trace.string(), recorded.trace);
      evaluation::write_file(place.facts, json{{"unconverged", recorded.unconverged},
                                               {"branch_changes", recorded.branch_changes},
                                               {"worst_seam_N", recorded.worst_seam_N}}
                                              .dump());
    }
  }
  measure_travel(recorded);
  return recorded;
}

Played play(const std::string& method, const evaluation::Trace& trace) {
  return {method, play(*make_method(method), trace).verdict};
}

Played play(ForceMethod& method, const evaluation::Trace& trace) {
  evaluation::JudgeOptions judging;
  judging.stiffness_to_method = false;
  judging.keep_forces = true;
  return {method.name(), evaluation::judge(method, trace, judging)};
}

double rms_error_percent(const evaluation::Trace& trace, const std::vector<Vector3d>& forces_W,
                         double begin_s, double end_s, double reference_rms_N) {
  double sum_N2 = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < trace.servo.size(); ++i) {
    if (trace.servo[i].time_s >= begin_s && trace.servo[i].time_s < end_s) {
      sum_N2 += (forces_W[i] - trace.servo[i].force_W).squaredNorm();
      ++count;
    }
  }
  return count == 0 ? std::numeric_limits<double>::quiet_NaN()
                    : 100.0 * std::sqrt(sum_N2 / static_cast<double>(count)) / reference_rms_N;
}

}  // namespace forcegrid::paper
