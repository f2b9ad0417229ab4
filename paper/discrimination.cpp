// SPDX-License-Identifier: Apache-2.0
#include "paper/discrimination.h"

#include <chrono>
#include <map>
#include <tuple>

#include "evaluation/motions/trajectories.h"
#include "evaluation/scenarios/scenarios.h"
#include "paper/recorded_motion.h"

namespace forcegrid::paper {
namespace {

using Eigen::Vector3d;
using Forces = std::vector<Vector3d>;
using ThreeForces = std::vector<Forces>;  // one per object

constexpr char kReference[] = "off-line";
constexpr double kTouch_s = 3.0;
constexpr double kWeberFractions[] = {0.07, 0.22};
// So that the random numbers of paths and observer differ.
constexpr std::uint64_t kPathStream = 0x70617468U;
constexpr std::uint64_t kNoiseStream = 0x6665656CU;

std::uint64_t mixed(std::uint64_t seed, std::uint64_t stream, std::uint64_t number) {
  evaluation::ContentHash hash;
  hash.add(seed);
  hash.add(stream);
  hash.add(number);
  return std::stoull(hash.text(), nullptr, 16);
}

evaluation::ForceTable table_of(const std::string& scene, const PaperOptions& options,
                                double& difference_percent) {
  const evaluation::ChartScene& chosen = evaluation::chart_scene(scene);
  const simulator::SpringMesh mesh = evaluation::make_mesh(chosen);
  evaluation::TableOptions building;
  building.patch_radius_m = chosen.patch_radius_m;
  building.threads = options.jobs;
  building.cache = options.cache;
  building.cancel = options.cancel;
  if (options.progress) {
    building.progress = [&options, scene](double done, double remaining_s) {
      options.progress("force table of " + scene, done, remaining_s);
    };
  }
  evaluation::BuiltTable built = evaluation::build_table(mesh, building);
  constexpr double kEvery_s = 0.5;
  difference_percent = evaluation::compare_with_live(
                           built.table, mesh,
                           evaluation::displacements_along_motion(options.seed, kEvery_s), building)
                           .rms_percent;
  return built.table;
}

std::vector<Vector3d> path(std::uint64_t seed) {
  const evaluation::Trajectory motion("random", seed);
  std::vector<Vector3d> positions_W;
  for (int i = 0; i < static_cast<int>(kTouch_s * kServoRate_Hz); ++i) {
    positions_W.push_back(motion.position_W(i / kServoRate_Hz));
  }
  return positions_W;
}

// The objects' forces with their differences scaled by `contrast`.
ThreeForces blended(const ThreeForces& forces_W, double contrast) {
  ThreeForces result = forces_W;
  for (std::size_t k = 0; k < forces_W.front().size(); ++k) {
    Vector3d mean = Vector3d::Zero();
    for (const Forces& each : forces_W) {
      mean += each[k] / static_cast<double>(kObjects);
    }
    for (Forces& each : result) {
      each[k] = mean + contrast * (each[k] - mean);
    }
  }
  return result;
}

Forces looks_of(const Forces& forces_W, double looks_per_s) {
  const auto every = static_cast<std::size_t>(kServoRate_Hz / looks_per_s);
  Forces looks;
  for (std::size_t k = every; k < forces_W.size(); k += every) {
    looks.push_back(forces_W[k]);
  }
  return looks;
}

// Forces of each object that the observer samples through a method, every 1 / looks_per_s.
ThreeForces render(const std::string& method, const std::vector<Vector3d>& positions_W,
                   const ThreeForces& reference_W, double looks_per_s) {
  ThreeForces rendered;
  for (const Forces& forces_W : reference_W) {
    if (method == kReference) {
      rendered.push_back(looks_of(forces_W, looks_per_s));
      continue;
    }
    const evaluation::Trace trace =
        trace_of_path(positions_W, forces_W, evaluation::first_contact_point_W());
    rendered.push_back(looks_of(play(method, trace).verdict.forces_W, looks_per_s));
  }
  return rendered;
}

using RowKey = std::tuple<std::string, Knowledge, double, double>;

// Sorts the rows into the order of presentation.
std::vector<DiscriminationRow> empty_rows(const std::vector<double>& contrasts,
                                          std::map<RowKey, std::size_t>& index) {
  std::vector<DiscriminationRow> rows;
  for (const double weber : kWeberFractions) {
    for (const Knowledge knowledge : {Knowledge::kSameRendering, Knowledge::kRealForces}) {
      for (const std::string& method : discrimination_methods()) {
        for (const double contrast : contrasts) {
          index[{method, knowledge, weber, contrast}] = rows.size();
          rows.push_back({method, knowledge, weber, contrast, {}, {}});
        }
      }
    }
  }
  return rows;
}

void answer(DiscriminationRow& row, const ThreeForces& rendered, const ThreeForces& known,
            FeltNoise noise, std::uint64_t seed) {
  noise.weber_fraction = row.weber_fraction;
  for (std::size_t object = 0; object < kObjects; ++object) {
    const std::size_t named =
        most_likely(feel(rendered[object], noise, mixed(seed, kNoiseStream, object)), known, noise);
    ++row.confusion[object][named];
    ++row.answers.trials;
    row.answers.right += named == object ? 1 : 0;
  }
}

}  // namespace

const char* to_string(Knowledge knowledge) noexcept {
  return knowledge == Knowledge::kSameRendering ? "same rendering" : "real forces";
}

const std::vector<std::string>& discrimination_methods() {
  static const std::vector<std::string> methods{kReference, "auto", "forcegrid", "forcegrid unit=m",
                                                "hold"};
  return methods;
}

Discrimination discriminate(const PaperOptions& options) {
  Discrimination result;
  result.objects = options.plan.objects;
  result.touch_s = kTouch_s;
  std::vector<evaluation::ForceTable> tables;
  for (std::size_t i = 0; i < kObjects; ++i) {
    check_stop(options);
    tables.push_back(table_of(result.objects[i], options, result.table_difference_percent[i]));
  }
  const std::vector<double>& contrasts = options.plan.contrasts;
  const int paths = options.plan.touches;
  std::map<RowKey, std::size_t> index;
  result.rows = empty_rows(contrasts, index);
  const auto start = std::chrono::steady_clock::now();
  for (int p = 0; p < paths; ++p) {
    const std::uint64_t seed = mixed(options.seed, kPathStream, static_cast<std::uint64_t>(p));
    const std::vector<Vector3d> positions_W = path(seed);
    ThreeForces reference_W;
    for (const evaluation::ForceTable& table : tables) {
      reference_W.emplace_back();
      for (const Vector3d& position_W : positions_W) {
        reference_W.back().push_back(
            table.force_W(position_W - evaluation::first_contact_point_W()));
      }
    }
    for (const double contrast : contrasts) {
      const ThreeForces objects_W = blended(reference_W, contrast);
      const ThreeForces real = render(kReference, positions_W, objects_W, result.noise.looks_per_s);
      for (const std::string& method : discrimination_methods()) {
        check_stop(options);
        const ThreeForces rendered =
            render(method, positions_W, objects_W, result.noise.looks_per_s);
        for (const double weber : kWeberFractions) {
          answer(result.rows[index.at({method, Knowledge::kSameRendering, weber, contrast})],
                 rendered, rendered, result.noise, seed);
          answer(result.rows[index.at({method, Knowledge::kRealForces, weber, contrast})], rendered,
                 real, result.noise, seed);
        }
      }
    }
    if (options.progress) {
      const double done = static_cast<double>(p + 1) / paths;
      const double elapsed_s =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      options.progress("discrimination of the objects", done, elapsed_s * (1.0 / done - 1.0));
    }
  }
  return result;
}

}  // namespace forcegrid::paper
