// SPDX-License-Identifier: Apache-2.0
#include "evaluation/objects/force_table.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <mutex>
#include <optional>
#include <sstream>

#include "evaluation/files/text_file.h"
#include "rt/clock.h"
#include "rt/parallel_jobs.h"
#include "simulator/reference/reference_solution.h"

namespace forcegrid::evaluation {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

constexpr int kFewestNodes = 4;  // what not-a-knot ends need
constexpr int kMostNodes = 1000;
// Increase when simulator/ changes its answers: tables of another version are not used.
constexpr std::uint64_t kSolverVersion = 1;
constexpr char kFileMark[8] = {'F', 'G', 'T', 'A', 'B', 'L', 'E', '1'};
// Rounding may put a displacement on the lattice's edge outside.
constexpr double kEdgeTolerance_m = 1e-9;
constexpr std::chrono::milliseconds kProgressPeriod{200};

// Inverse of the matrix that maps the n + 2 coefficients of a cubic spline to its values at the n
// nodes, with the third derivative continuous at the second and the last but one.
Eigen::MatrixXd interpolation_matrix(int nodes) {
  const int size = nodes + 2;
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(size, size);
  for (int i = 0; i < nodes; ++i) {
    values.block<1, 3>(i + 1, i) = Eigen::RowVector3d(1.0, 4.0, 1.0) / 6.0;
  }
  Eigen::Matrix<double, 1, 5> fourth_difference;
  fourth_difference << 1.0, -4.0, 6.0, -4.0, 1.0;
  values.block<1, 5>(0, 0) = fourth_difference;
  values.block<1, 5>(size - 1, size - 5) = fourth_difference;
  return values.inverse();
}

// The four B-splines that don't vanish at the fraction t of an interval, and their derivatives.
void b_splines(double t, std::array<double, 4>& value, std::array<double, 4>& slope) {
  const double u = 1.0 - t;
  value = {u * u * u / 6.0, (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
           (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0, t * t * t / 6.0};
  slope = {-0.5 * u * u, t * (1.5 * t - 2.0), u * (2.0 - 1.5 * u), 0.5 * t * t};
}

std::string in_mm(const Vector3d& length_m) {
  std::ostringstream text;
  text << '(' << 1e3 * length_m.x() << ", " << 1e3 * length_m.y() << ", " << 1e3 * length_m.z()
       << ") mm";
  return text.str();
}

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) {
    throw ChartError("folder " + folder.string() + " can't be made (" + error.message() +
                     "); name another one");
  }
}

void add(ContentHash& hash, const Vector3d& vector) {
  for (int axis = 0; axis < 3; ++axis) {
    hash.add(vector[axis]);
  }
}

ContentHash object_hash(const simulator::SpringMesh& mesh, const TableOptions& options) {
  ContentHash hash;
  hash.add(kSolverVersion);
  for (const Vector3d& position_W : mesh.rest_position_W) {
    add(hash, position_W);
  }
  hash.add(mesh.fixed.data(), mesh.fixed.size());
  for (const simulator::Spring& spring : mesh.springs) {
    hash.add(static_cast<std::uint64_t>(spring.a));
    hash.add(static_cast<std::uint64_t>(spring.b));
    hash.add(spring.stiffness_N_per_m);
    hash.add(spring.natural_length_m);
    hash.add(static_cast<std::uint64_t>(spring.law));
  }
  for (const simulator::Tetrahedron& element : mesh.tetrahedra) {
    for (const std::int32_t vertex : element.vertex) {
      hash.add(static_cast<std::uint64_t>(vertex));
    }
    hash.add(static_cast<std::uint64_t>(element.material));
  }
  for (const simulator::ElementMaterial& material : mesh.materials) {
    hash.add(static_cast<std::uint64_t>(material.model));
    hash.add(material.youngs_modulus_Pa);
    hash.add(material.poissons_ratio);
  }
  for (const Vector3d& position_W : mesh.unstrained_W) {
    add(hash, position_W);
  }
  for (const simulator::SpringLaw& law : mesh.laws) {
    hash.add(law.cubic_coefficient);
    hash.add(law.exponent);
  }
  for (const double home_N_per_m : mesh.home_stiffness_N_per_m) {
    hash.add(home_N_per_m);
  }
  for (const Vector3d& load_N : mesh.load_W_N) {
    add(hash, load_N);
  }
  add(hash, mesh.top_W);
  hash.add(options.patch_radius_m);
  hash.add(options.relative_tolerance);
  hash.add(options.max_step_m);
  return hash;
}

simulator::ReferenceSolution solve(const simulator::SpringMesh& mesh, const TableOptions& options,
                                   const std::vector<Vector3d>& displacements_W, unsigned threads,
                                   const std::atomic<bool>* cancel, const Progress& progress) {
  simulator::ReferenceOptions reference;
  reference.contact_point_W = mesh.top_W;
  reference.relative_tolerance = options.relative_tolerance;
  reference.patch_radius_m = options.patch_radius_m;
  reference.max_step_m = options.max_step_m;
  reference.threads = threads;
  reference.progress = progress;
  reference.cancel = cancel;
  std::vector<Vector3d> positions_W;
  positions_W.reserve(displacements_W.size());
  for (const Vector3d& displacement_W : displacements_W) {
    positions_W.push_back(reference.contact_point_W + displacement_W);
  }
  return simulator::simulate_reference(mesh, positions_W, reference);
}

// The content of a table's cache file.
struct Layers {
  std::vector<std::uint8_t> known;         // one per layer of equal z
  std::vector<std::uint64_t> unconverged;  // one per layer
  std::vector<Vector3d> forces_W;          // one per node
};

template <typename Item>
void append(std::string& bytes, const std::vector<Item>& items) {
  bytes.append(reinterpret_cast<const char*>(items.data()), items.size() * sizeof(Item));
}

template <typename Item>
void take(const char*& at, std::vector<Item>& items) {
  std::memcpy(static_cast<void*>(items.data()), at, items.size() * sizeof(Item));
  at += items.size() * sizeof(Item);
}

fs::path table_file(const TableOptions& options, const std::string& key) {
  return options.cache / ("table-" + key + ".bin");
}

void keep(const TableOptions& options, const std::string& key, const Layers& layers) {
  if (options.cache.empty()) {
    return;
  }
  std::string body;
  append(body, layers.known);
  append(body, layers.unconverged);
  append(body, layers.forces_W);
  ContentHash check;
  check.add(body);
  write_file(table_file(options, key),
             std::string(kFileMark, sizeof kFileMark) + key + check.text() + body);
}

// The layers that an earlier call finished. A damaged file counts as having none.
void fetch(const TableOptions& options, const std::string& key, Layers& layers) {
  if (options.cache.empty()) {
    return;
  }
  std::ifstream file(table_file(options, key), std::ios::binary);
  if (!file) {
    return;
  }
  std::ostringstream content;
  content << file.rdbuf();
  const std::string bytes = content.str();
  const std::size_t header = sizeof kFileMark + 2 * key.size();
  const std::size_t expected = header + layers.known.size() +
                               layers.unconverged.size() * sizeof(std::uint64_t) +
                               layers.forces_W.size() * sizeof(Vector3d);
  if (bytes.size() != expected || bytes.compare(0, sizeof kFileMark, kFileMark, 8) != 0) {
    return;
  }
  ContentHash check;
  check.add(bytes.substr(header));
  if (bytes.substr(sizeof kFileMark, header - sizeof kFileMark) != key + check.text()) {
    return;
  }
  const char* at = bytes.data() + header;
  take(at, layers.known);
  take(at, layers.unconverged);
  take(at, layers.forces_W);
}

// From rest up or down to the layer's centre, then row by row, to and fro. The layer's first node
// is at index `first`.
std::vector<Vector3d> path_of_layer(const TableLattice& lattice, int layer,
                                    std::vector<std::size_t>& numbers) {
  const auto nx = static_cast<std::size_t>(lattice.nodes[0]);
  const auto ny = static_cast<std::size_t>(lattice.nodes[1]);
  std::vector<Vector3d> path;
  numbers.clear();
  for (std::size_t j = 0; j < ny; ++j) {
    for (std::size_t step = 0; step < nx; ++step) {
      const std::size_t i = j % 2 == 0 ? step : nx - 1 - step;
      numbers.push_back(i + nx * (j + ny * static_cast<std::size_t>(layer)));
      path.push_back(lattice.node_W_m(numbers.back()));
    }
  }
  path.insert(path.begin(), {0.0, 0.0, path.front().z()});
  return path;
}

}  // namespace

std::size_t TableLattice::node_count() const noexcept {
  return static_cast<std::size_t>(nodes[0]) * static_cast<std::size_t>(nodes[1]) *
         static_cast<std::size_t>(nodes[2]);
}

Vector3d TableLattice::node_W_m(std::size_t number) const noexcept {
  const auto nx = static_cast<std::size_t>(nodes[0]);
  const auto ny = static_cast<std::size_t>(nodes[1]);
  return min_W_m + spacing_m * Vector3d(static_cast<double>(number % nx),
                                        static_cast<double>(number / nx % ny),
                                        static_cast<double>(number / (nx * ny)));
}

Vector3d TableLattice::max_W_m() const noexcept {
  return min_W_m + spacing_m * Vector3d(nodes[0] - 1, nodes[1] - 1, nodes[2] - 1);
}

void TableLattice::check() const {
  for (const int count : nodes) {
    if (count < kFewestNodes || count > kMostNodes) {
      throw ChartError("force table: " + std::to_string(count) +
                       " nodes along an axis; use 4 to 1000");
    }
  }
  if (!(spacing_m > 0.0) || !std::isfinite(spacing_m) || !min_W_m.allFinite()) {
    throw ChartError("force table: the lattice needs a finite corner and a spacing above zero");
  }
}

struct ForceTable::Weights {
  std::array<std::size_t, 3> first;  // coefficient along each axis
  std::array<std::array<double, 4>, 3> value;
  std::array<std::array<double, 4>, 3> slope;
};

ForceTable::ForceTable(const TableLattice& lattice, const std::vector<Vector3d>& forces_W)
    : lattice_(lattice) {
  lattice.check();
  if (forces_W.size() != lattice.node_count()) {
    throw ChartError("force table: " + std::to_string(forces_W.size()) + " forces for " +
                     std::to_string(lattice.node_count()) + " nodes");
  }
  for (std::size_t i = 0; i < forces_W.size(); ++i) {
    if (!forces_W[i].allFinite()) {
      throw ChartError("force table: the force at " + in_mm(lattice.node_W_m(i)) +
                       " is not finite");
    }
  }
  // One axis after the other, from values at nodes to coefficients.
  std::array<std::size_t, 3> size{static_cast<std::size_t>(lattice.nodes[0]),
                                  static_cast<std::size_t>(lattice.nodes[1]),
                                  static_cast<std::size_t>(lattice.nodes[2])};
  coefficients_W_N_ = forces_W;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Eigen::MatrixXd matrix = interpolation_matrix(lattice.nodes[axis]);
    std::array<std::size_t, 3> grown = size;
    grown[axis] += 2;
    std::vector<Vector3d> next(grown[0] * grown[1] * grown[2], Vector3d::Zero());
    std::array<std::size_t, 3> at{};
    for (at[2] = 0; at[2] < grown[2]; ++at[2]) {
      for (at[1] = 0; at[1] < grown[1]; ++at[1]) {
        for (at[0] = 0; at[0] < grown[0]; ++at[0]) {
          Vector3d& sum = next[at[0] + grown[0] * (at[1] + grown[1] * at[2])];
          std::array<std::size_t, 3> from = at;
          for (std::size_t node = 0; node < size[axis]; ++node) {
            from[axis] = node;
            sum +=
                matrix(static_cast<Eigen::Index>(at[axis]), static_cast<Eigen::Index>(node + 1)) *
                coefficients_W_N_[from[0] + size[0] * (from[1] + size[1] * from[2])];
          }
        }
      }
    }
    coefficients_W_N_ = std::move(next);
    size = grown;
  }
  coefficients_ = size;
}

bool ForceTable::contains(const Vector3d& displacement_W) const noexcept {
  return displacement_W.allFinite() &&
         (displacement_W - clamped(displacement_W)).cwiseAbs().maxCoeff() <= kEdgeTolerance_m;
}

Vector3d ForceTable::clamped(const Vector3d& displacement_W) const noexcept {
  return displacement_W.cwiseMax(lattice_.min_W_m).cwiseMin(lattice_.max_W_m());
}

ForceTable::Weights ForceTable::weights(const Vector3d& displacement_W) const {
  if (!contains(displacement_W)) {
    throw ChartError("force table: the displacement " + in_mm(displacement_W) +
                     " lies outside its range, " + in_mm(lattice_.min_W_m) + " to " +
                     in_mm(lattice_.max_W_m()) + "; use a smaller motion");
  }
  Weights result{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    const double x = (displacement_W[a] - lattice_.min_W_m[a]) / lattice_.spacing_m;
    const double interval =
        std::clamp(std::floor(x), 0.0, static_cast<double>(lattice_.nodes[axis] - 2));
    result.first[axis] = static_cast<std::size_t>(interval);
    b_splines(x - interval, result.value[axis], result.slope[axis]);
  }
  return result;
}

Vector3d ForceTable::force_W(const Vector3d& displacement_W) const {
  return at(displacement_W).force_W;
}

ForceTable::Value ForceTable::at(const Vector3d& displacement_W) const {
  const Weights w = weights(displacement_W);
  Value result{Vector3d::Zero(), Eigen::Matrix3d::Zero()};
  for (std::size_t l = 0; l < 4; ++l) {
    for (std::size_t j = 0; j < 4; ++j) {
      const std::size_t row =
          coefficients_[0] * (w.first[1] + j + coefficients_[1] * (w.first[2] + l)) + w.first[0];
      Vector3d along = Vector3d::Zero();
      Vector3d slope = Vector3d::Zero();
      for (std::size_t i = 0; i < 4; ++i) {
        along += w.value[0][i] * coefficients_W_N_[row + i];
        slope += w.slope[0][i] * coefficients_W_N_[row + i];
      }
      result.force_W += w.value[1][j] * w.value[2][l] * along;
      result.stiffness_W.col(0) += w.value[1][j] * w.value[2][l] * slope;
      result.stiffness_W.col(1) += w.slope[1][j] * w.value[2][l] * along;
      result.stiffness_W.col(2) += w.value[1][j] * w.slope[2][l] * along;
    }
  }
  result.stiffness_W /= lattice_.spacing_m;
  return result;
}

std::string table_key(const simulator::SpringMesh& mesh, const TableOptions& options) {
  ContentHash hash = object_hash(mesh, options);
  add(hash, options.lattice.min_W_m);
  hash.add(options.lattice.spacing_m);
  for (const int count : options.lattice.nodes) {
    hash.add(static_cast<std::uint64_t>(count));
  }
  return hash.text();
}

namespace {

// Solves the `missing` layers on several threads and stores each one as soon as it is finished.
void solve_layers(const simulator::SpringMesh& mesh, const TableOptions& options,
                  const std::string& key, const std::vector<std::size_t>& missing, Layers& layers) {
  std::mutex mutex;  // guards the layers and their file
  rt::JobOptions jobs{.threads = options.threads};
  jobs.progress = options.progress;
  jobs.period = kProgressPeriod;
  jobs.cancel = options.cancel;
  const bool finished = rt::run_jobs(missing.size(), jobs, [&](rt::Job& job) {
    const std::size_t layer = missing[job.number()];
    std::vector<std::size_t> numbers;
    const std::vector<Vector3d> path =
        path_of_layer(options.lattice, static_cast<int>(layer), numbers);
    const simulator::ReferenceSolution reference =
        solve(mesh, options, path, 1, &job.stop_flag(),
              [&job](double done, double /*left*/) { job.report(done); });
    if (reference.cancelled) {
      return false;
    }
    const std::lock_guard lock(mutex);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      layers.forces_W[numbers[i]] = reference.forces_W[i + 1];
    }
    layers.known[layer] = 1;
    layers.unconverged[layer] = reference.unconverged;
    keep(options, key, layers);
    return true;
  });
  if (!finished) {
    throw Stopped();
  }
}

}  // namespace

BuiltTable build_table(const simulator::SpringMesh& mesh, const TableOptions& options) {
  const rt::TimePoint start = rt::Clock::now();
  options.lattice.check();
  simulator::check(mesh);
  const auto layer_count = static_cast<std::size_t>(options.lattice.nodes[2]);
  const std::string key = table_key(mesh, options);
  Layers layers;
  layers.known.assign(layer_count, 0);
  layers.unconverged.assign(layer_count, 0);
  layers.forces_W.assign(options.lattice.node_count(), Vector3d::Zero());
  if (!options.cache.empty()) {
    make_folder(options.cache);
  }
  fetch(options, key, layers);
  std::vector<std::size_t> missing;
  for (std::size_t layer = 0; layer < layer_count; ++layer) {
    if (layers.known[layer] == 0) {
      missing.push_back(layer);
    }
  }
  solve_layers(mesh, options, key, missing, layers);
  BuiltTable built{ForceTable(options.lattice, layers.forces_W), key, missing.empty(), 0, 0.0};
  for (const std::uint64_t each : layers.unconverged) {
    built.unconverged += each;
  }
  built.elapsed_s = rt::seconds(rt::Clock::now() - start);
  return built;
}

TableDifference compare_with_live(const ForceTable& table, const simulator::SpringMesh& mesh,
                                  const std::vector<Vector3d>& displacements_W,
                                  const TableOptions& options) {
  ContentHash hash = object_hash(mesh, options);
  std::vector<Vector3d> table_W;
  for (const Vector3d& displacement_W : displacements_W) {
    add(hash, displacement_W);
    table_W.push_back(table.force_W(displacement_W));
    add(hash, table_W.back());
  }
  const fs::path file = options.cache / ("difference-" + hash.text() + ".txt");
  TableDifference difference;
  difference.positions = displacements_W.size();
  if (!options.cache.empty()) {
    std::ifstream kept(file);
    if (kept >> difference.rms_percent >> difference.max_N >> difference.live_rms_N >>
        difference.unconverged >> difference.branch_changes) {
      return difference;
    }
    make_folder(options.cache);
  }
  const simulator::ReferenceSolution live =
      solve(mesh, options, displacements_W, options.threads, options.cancel, options.progress);
  if (live.cancelled) {
    throw Stopped();
  }
  double squared_N2 = 0.0;
  double live_N2 = 0.0;
  for (std::size_t i = 0; i < displacements_W.size(); ++i) {
    const double error_N = (table_W[i] - live.forces_W[i]).norm();
    squared_N2 += error_N * error_N;
    live_N2 += live.forces_W[i].squaredNorm();
    difference.max_N = std::max(difference.max_N, error_N);
  }
  const double count = static_cast<double>(std::max<std::size_t>(1, displacements_W.size()));
  difference.rms_percent = live_N2 > 0.0 ? 100.0 * std::sqrt(squared_N2 / live_N2) : 0.0;
  difference.live_rms_N = std::sqrt(live_N2 / count);
  difference.unconverged = live.unconverged;
  difference.branch_changes = live.branch_changes;
  if (!options.cache.empty()) {
    std::ostringstream text;
    text.precision(17);
    text << difference.rms_percent << ' ' << difference.max_N << ' ' << difference.live_rms_N << ' '
         << difference.unconverged << ' ' << difference.branch_changes << '\n';
    write_file(file, text.str());
  }
  return difference;
}

void ContentHash::add(const void* data, std::size_t size) noexcept {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) {
    state_ = (state_ ^ bytes[i]) * 0x100000001b3U;
  }
}

void ContentHash::add(const std::string& text) noexcept {
  add(static_cast<std::uint64_t>(text.size()));
  add(text.data(), text.size());
}

std::string ContentHash::text() const {
  char digits[17];
  std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(state_));
  return digits;
}

void write_file(const fs::path& file, const std::string& text) {
  TextWriter writer(file.string());
  writer.write(text);
  writer.finish();
}

}  // namespace forcegrid::evaluation
