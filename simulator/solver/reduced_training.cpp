// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/reduced_training.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>
#include <string>
#include <utility>

#include "simulator/kernels/eigen_lanes.h"
#include "simulator/kernels/kernel_support.h"
#include "simulator/kernels/spring_table.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/sparse_weights.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Index;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
// One row per component of a vertex, one column per field over the vertices.
using Fields = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr double kSensitivityReach_m = 3e-3;
constexpr Index kMostFields = 400;
constexpr double kMostFieldNumbers = 1e8;  // of 4 bytes
constexpr Index kFewestPlaces = 60;        // at which the springs' forces must agree
constexpr Index kMostConditions = 2400;    // rows that the springs' weights must satisfy
// The modes' forces are weighted by their effect on the tool, but with no less than this share of
// the largest effect.
constexpr double kLeastShare = 0.03;
constexpr double kSmallestMode = 1e-7;  // of the largest one's energy: single precision's limit

// f u = t d and the Hessian w w^T + t I of a spring.
struct Law {
  double t_N_per_m = 0.0;
  Vector3d w = Vector3d::Zero();
};

// The laws of one spring at many lengths at once: a star of springs from vertex 0.
class LawTable {
 public:
  explicit LawTable(std::size_t count) : count_(count) {
    const std::size_t padded =
        (count + kernels::kSpringPadding - 1) / kernels::kSpringPadding * kernels::kSpringPadding;
    rows_.row_begin = {0, static_cast<std::int32_t>(padded)};
    rows_.owner.assign(padded, 0);
    for (std::size_t s = 0; s < padded; ++s) {
      rows_.other.push_back(static_cast<std::int32_t>(s + 1));
    }
    rows_.active = 1;
    rows_.reach = static_cast<std::int32_t>(padded + 1);
    constants_.resize(padded);
    position_.resize(padded + 1);
    t_N_per_m_.resize(padded);
    tangent_.resize(padded);
  }
  void set(std::size_t k, const kernels::SpringConstants<double>& constants, const Vector3d& edge) {
    constants_[k] = constants;
    position_[k + 1] = kernels::to_precise(edge);
    exponential_ = exponential_ || constants.exponent > 0.0;
  }
  void find() {
    kernels::find_tangents(rows_, constants_.data(), exponential_, position_.data(),
                           t_N_per_m_.data(), tangent_.data());
  }
  std::size_t count() const { return count_; }
  Law law(std::size_t k) const {
    const kernels::SpringTangent& t = tangent_[k];
    return {t_N_per_m_[k], Vector3d(t.w_x, t.w_y, t.w_z)};
  }

 private:
  std::size_t count_;
  bool exponential_ = false;
  kernels::SpringRows rows_;
  std::vector<kernels::SpringConstants<double>> constants_;
  std::vector<kernels::Precise> position_;
  std::vector<double> t_N_per_m_;
  std::vector<kernels::SpringTangent> tangent_;
};

class Training {
 public:
  Training(const SpringMesh& mesh, const ReducedTrainingSet& set,
           const ReducedTrainingOptions& options)
      : mesh_(mesh), set_(set), options_(options), table_(make_spring_table<double>(mesh)) {
    const std::size_t n = mesh.rest_position_W.size();
    free_.assign(n, 1);
    for (std::size_t i = 0; i < n; ++i) {
      free_[i] = mesh.fixed[i] == 0 ? 1 : 0;
    }
    for (const std::int32_t i : set.patch) {
      free_[static_cast<std::size_t>(i)] = 0;
    }
    find_rest_laws();
    for (const ReducedSnapshot& snapshot : set.snapshots) {
      mean_force2_N2_ += snapshot.force_W.squaredNorm();
    }
    mean_force2_N2_ /= static_cast<double>(set.snapshots.size());
  }

  ReducedTraining run() {
    const auto start = std::chrono::steady_clock::now();
    ReducedTraining done;
    find_modes(done);
    if (!cancelled()) {
      weigh_states();
      reduce_linear_part();
      pick_springs(done);
    }
    if (!cancelled()) {
      done.model.emplace(assemble());
      done.training_error = training_error(*done.model);
    }
    done.basis = std::move(basis_);
    done.time_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return done;
  }

 private:
  bool cancelled() const { return options_.cancel != nullptr && *options_.cancel; }
  Index states() const { return static_cast<Index>(set_.snapshots.size()); }
  const ReducedSnapshot& state(Index k) const {
    return set_.snapshots[static_cast<std::size_t>(k)];
  }
  Index vertex_rows() const { return 3 * static_cast<Index>(free_.size()); }

  Vector3d rest_edge(std::size_t s) const {
    return mesh_.rest_position_W[static_cast<std::size_t>(table_.rows.other[s])] -
           mesh_.rest_position_W[static_cast<std::size_t>(table_.rows.owner[s])];
  }

  void find_rest_laws() {
    LawTable laws(table_.springs);
    for (std::size_t s = 0; s < table_.springs; ++s) {
      laws.set(s, table_.constants[s], rest_edge(s));
    }
    laws.find();
    for (std::size_t s = 0; s < table_.springs; ++s) {
      rest_law_.push_back(laws.law(s));
    }
  }

  // K fields at rest, home springs included.
  Fields times_stiffness(const Fields& fields) const {
    Fields product = Fields::Zero(fields.rows(), fields.cols());
    Fields edge(3, fields.cols());
    Eigen::Matrix<float, 1, Eigen::Dynamic> along(fields.cols());
    for (std::size_t s = 0; s < table_.springs; ++s) {
      const Index a = 3 * table_.rows.owner[s];
      const Index b = 3 * table_.rows.other[s];
      const Eigen::Vector3f w = rest_law_[s].w.cast<float>();
      const auto t = static_cast<float>(rest_law_[s].t_N_per_m);
      edge = fields.middleRows<3>(b) - fields.middleRows<3>(a);
      along = w[0] * edge.row(0) + w[1] * edge.row(1) + w[2] * edge.row(2);
      for (Index c = 0; c < 3; ++c) {
        edge.row(c) = w[c] * along + t * edge.row(c);
      }
      product.middleRows<3>(b) += edge;
      product.middleRows<3>(a) -= edge;
    }
    for (std::size_t i = 0; i < mesh_.home_stiffness_N_per_m.size(); ++i) {
      const Index row = 3 * static_cast<Index>(i);
      product.middleRows<3>(row) +=
          static_cast<float>(mesh_.home_stiffness_N_per_m[i]) * fields.middleRows<3>(row);
    }
    return product;
  }

  // What the linear modes leave of every state and, as far as there is room, of its sensitivity.
  Fields leftovers() {
    const auto room = static_cast<Index>(kMostFieldNumbers / static_cast<double>(vertex_rows()));
    const Index most = std::max(states(), std::min(kMostFields, room));
    const Index with_sensitivity = std::min(states(), (most - states()) / 3);
    Fields fields = Fields::Zero(vertex_rows(), states() + 3 * with_sensitivity);
    for (Index k = 0; k < states(); ++k) {
      fields.col(k) =
          state(k).moved_m - set_.rest_sensitivity * state(k).displacement_W.cast<float>();
    }
    for (Index j = 0; j < with_sensitivity; ++j) {
      const Index k = j * states() / std::max<Index>(with_sensitivity, 1);
      sensitive_states_.push_back(k);
      fields.middleCols<3>(states() + 3 * j) =
          static_cast<float>(kSensitivityReach_m) * (state(k).sensitivity - set_.rest_sensitivity);
    }
    for (std::size_t i = 0; i < free_.size(); ++i) {
      if (free_[i] == 0) {
        fields.middleRows<3>(3 * static_cast<Index>(i)).setZero();
      }
    }
    return fields;
  }

  void find_modes(ReducedTraining& done) {
    const Fields fields = leftovers();
    const Fields forces = times_stiffness(fields);
    const MatrixXd gram = (fields.transpose() * forces).cast<double>();
    const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(0.5 * (gram + gram.transpose()));
    const VectorXd value = solver.eigenvalues().reverse();
    const MatrixXd vector = solver.eigenvectors().rowwise().reverse();
    modes_ = count_modes(value, vector, done);
    const VectorXd root = value.head(modes_).cwiseSqrt();
    const MatrixXd mixture = vector.leftCols(modes_) * root.cwiseInverse().asDiagonal();
    amplitudes_ = root.asDiagonal() * vector.topRows(states()).leftCols(modes_).transpose();
    follow_ = root.asDiagonal() *
              vector.bottomRows(fields.cols() - states()).leftCols(modes_).transpose() /
              kSensitivityReach_m;
    basis_.setZero(vertex_rows(), 3 + modes_);
    basis_.leftCols<3>() = set_.rest_sensitivity;
    for (std::size_t i = 0; i < free_.size(); ++i) {
      if (free_[i] == 0) {  // exactly: the solver's S is rounded
        basis_.middleRows<3>(3 * static_cast<Index>(i)).leftCols<3>().setIdentity();
        if (mesh_.fixed[i] != 0) {
          basis_.middleRows<3>(3 * static_cast<Index>(i)).leftCols<3>().setZero();
        }
      }
    }
    basis_.rightCols(modes_) = fields * mixture.cast<float>();
  }

  // The modes with most energy first, until what is left out is worth little.
  Index count_modes(const VectorXd& value, const MatrixXd& vector, ReducedTraining& done) const {
    const double worth_J =
        options_.mode_tolerance * std::sqrt(mean_force2_N2_) * options_.mode_length_m;
    // The share of each mode in the states' mean energy.
    const VectorXd part = vector.topRows(states()).colwise().squaredNorm().transpose() /
                          static_cast<double>(states());
    const VectorXd share = 0.5 * value.cwiseMax(0.0).cwiseProduct(part);
    const Index most = std::min<Index>(options_.most_modes, value.size());
    double left_J = share.sum();
    Index count = 0;
    while (count < most && left_J > worth_J && value[count] > kSmallestMode * value[0]) {
      left_J -= share[count];
      ++count;
    }
    done.lacking_energy_J = std::max(left_J, 0.0);
    return count;
  }

  // Chooses the states by which the springs are chosen, and the weight of a force on each
  // coordinate. If there are few states, places beside them along S count as well: they need no
  // equilibrium.
  void weigh_states() {
    const Index n = 3 + modes_;
    const Index room = std::max<Index>(kMostConditions / n, 8);
    const Index count = std::min(states(), room);
    const Index beside = follow_.cols() == 0 ? 0 : std::min(kFewestPlaces, room) - count;
    coordinates_.resize(n, count + std::max<Index>(beside, 0));
    for (Index j = 0; j < count; ++j) {
      const Index k = j * states() / count;
      coordinates_.col(j) << state(k).displacement_W, amplitudes_.col(k);
    }
    for (Index j = 0; j < beside; ++j) {
      const Index column = j % follow_.cols();
      const Index k = sensitive_states_[static_cast<std::size_t>(column / 3)];
      const double move_m =
          (j / follow_.cols()) % 2 == 0 ? kSensitivityReach_m : -kSensitivityReach_m;
      coordinates_.col(count + j) << state(k).displacement_W + move_m * Vector3d::Unit(column % 3),
          amplitudes_.col(k) + move_m * follow_.col(column);
    }
    worth_.setOnes(n);
    if (modes_ > 0 && follow_.cols() > 0) {
      const VectorXd moved =
          (follow_.rowwise().squaredNorm() / static_cast<double>(follow_.cols())).cwiseSqrt();
      worth_.tail(modes_) = moved.cwiseMax(kLeastShare * moved.maxCoeff());
    }
  }

  Matrix3Xd basis_of(std::size_t s) const {
    const Index a = 3 * table_.rows.owner[s];
    const Index b = 3 * table_.rows.other[s];
    return (basis_.middleRows<3>(b) - basis_.middleRows<3>(a)).cast<double>();
  }

  Eigen::Matrix3d rest_hessian(std::size_t s) const {
    const Law& law = rest_law_[s];
    return law.w * law.w.transpose() + law.t_N_per_m * Eigen::Matrix3d::Identity();
  }

  // The linear part of all springs, home springs and loads.
  void reduce_linear_part() {
    const Index n = 3 + modes_;
    linear_stiffness_.setZero(n, n);
    rest_force_.setZero(n);
    for (std::size_t s = 0; s < table_.springs; ++s) {
      const Matrix3Xd basis = basis_of(s);
      linear_stiffness_.noalias() += basis.transpose() * (rest_hessian(s) * basis);
      rest_force_.noalias() -= basis.transpose() * (rest_law_[s].t_N_per_m * rest_edge(s));
    }
    for (std::size_t i = 0; i < free_.size(); ++i) {
      const Matrix3Xd basis = basis_.middleRows<3>(3 * static_cast<Index>(i)).cast<double>();
      if (!mesh_.home_stiffness_N_per_m.empty()) {
        linear_stiffness_.noalias() += mesh_.home_stiffness_N_per_m[i] * basis.transpose() * basis;
      }
      if (!mesh_.load_W_N.empty()) {
        rest_force_.noalias() += basis.transpose() * mesh_.load_W_N[i];
      }
    }
  }

  // One spring's nonlinear generalised forces, in every chosen state one after the other.
  VectorXd contribution(std::size_t s, LawTable& laws) const {
    const Matrix3Xd basis = basis_of(s);
    const Matrix3Xd moved = basis * coordinates_;
    const Vector3d rest = rest_edge(s);
    for (Index k = 0; k < moved.cols(); ++k) {
      laws.set(static_cast<std::size_t>(k), table_.constants[s], rest + moved.col(k));
    }
    laws.find();
    Matrix3Xd pull = -rest_hessian(s) * moved;
    for (Index k = 0; k < moved.cols(); ++k) {
      pull.col(k) += laws.law(static_cast<std::size_t>(k)).t_N_per_m * (rest + moved.col(k)) -
                     rest_law_[s].t_N_per_m * rest;
    }
    const MatrixXd force = -(worth_.asDiagonal() * (basis.transpose() * pull));
    return Eigen::Map<const VectorXd>(force.data(), force.size());
  }

  void pick_springs(ReducedTraining& done) {
    LawTable laws(static_cast<std::size_t>(coordinates_.cols()));
    VectorXd sum = VectorXd::Zero(coordinates_.size());
    std::vector<std::pair<double, std::size_t>> drawn;  // the largest keys win
    std::mt19937_64 numbers(options_.seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    for (std::size_t s = 0; s < table_.springs && !cancelled(); ++s) {
      const VectorXd mine = contribution(s, laws);
      sum += mine;
      // Drawn without replacement in proportion to its size: Efraimidis and Spirakis (2006).
      const double size = mine.norm();
      const double number = uniform(numbers);
      if (size > 0.0) {
        drawn.emplace_back(std::log(std::max(number, 1e-300)) / size, s);
      }
    }
    const std::size_t count =
        std::min(drawn.size(), static_cast<std::size_t>(options_.candidate_springs));
    std::partial_sort(drawn.begin(), drawn.begin() + static_cast<std::ptrdiff_t>(count),
                      drawn.end(), std::greater<>());
    MatrixXd columns(sum.size(), static_cast<Index>(count));
    for (std::size_t k = 0; k < count && !cancelled(); ++k) {
      columns.col(static_cast<Index>(k)) = contribution(drawn[k].second, laws);
    }
    if (cancelled()) {
      return;  // some columns are missing
    }
    const double scale_N = std::sqrt(mean_force2_N2_ * static_cast<double>(coordinates_.cols()));
    const SparseWeights found =
        find_sparse_weights(columns, sum, options_.cubature_tolerance * scale_N,
                            options_.most_springs, options_.cancel);
    done.cubature_error = found.residual / scale_N;
    for (std::size_t k = 0; k < found.column.size(); ++k) {
      chosen_.push_back(drawn[static_cast<std::size_t>(found.column[k])].second);
      weight_.push_back(found.weight[k]);
    }
  }

  ReducedModel assemble() const {
    ReducedModel::Parts parts;
    parts.linear_stiffness = linear_stiffness_;
    parts.rest_force = rest_force_;
    std::vector<ReducedSprings::Chosen> springs;
    for (std::size_t k = 0; k < chosen_.size(); ++k) {
      const std::size_t s = chosen_[k];
      const Matrix3Xd basis = basis_of(s);
      springs.push_back({rest_edge(s), basis, table_.constants[s], weight_[k]});
      parts.linear_stiffness.noalias() -=
          weight_[k] * (basis.transpose() * (rest_hessian(s) * basis));
      parts.rest_force.noalias() +=
          weight_[k] * (basis.transpose() * (rest_law_[s].t_N_per_m * rest_edge(s)));
    }
    parts.springs = ReducedSprings(static_cast<int>(3 + modes_), springs);
    for (Index k = 0; k < states(); ++k) {
      parts.trained_at_W.push_back(state(k).displacement_W);
    }
    parts.trained_amplitudes = amplitudes_;
    return ReducedModel(std::move(parts));
  }

  double training_error(ReducedModel model) const {
    double error2_N2 = 0.0;
    for (const ReducedSnapshot& snapshot : set_.snapshots) {
      error2_N2 +=
          (model.move_to(snapshot.displacement_W).force_W - snapshot.force_W).squaredNorm();
    }
    return std::sqrt(error2_N2 / (mean_force2_N2_ * static_cast<double>(states())));
  }

  const SpringMesh& mesh_;
  const ReducedTrainingSet& set_;
  const ReducedTrainingOptions& options_;
  SpringTable<double> table_;
  std::vector<Law> rest_law_;
  std::vector<std::uint8_t> free_;
  double mean_force2_N2_ = 0.0;
  Index modes_ = 0;
  MatrixXd amplitudes_;  // q of the states
  std::vector<Index> sensitive_states_;
  MatrixXd follow_;  // [1/m] dq/dP of the sensitive states
  Eigen::MatrixXf basis_;
  MatrixXd coordinates_;  // z of the states that springs are chosen by
  VectorXd worth_;
  MatrixXd linear_stiffness_;
  VectorXd rest_force_;
  std::vector<std::size_t> chosen_;
  std::vector<double> weight_;
};

void check(const SpringMesh& mesh, const ReducedTrainingSet& set,
           const ReducedTrainingOptions& options) {
  const auto rows = 3 * static_cast<Index>(mesh.rest_position_W.size());
  if (set.snapshots.empty()) {
    throw Error("reduced model: no states to train on; let the full solver answer first");
  }
  bool fits = set.rest_sensitivity.rows() == rows;
  for (const ReducedSnapshot& snapshot : set.snapshots) {
    fits = fits && snapshot.moved_m.size() == rows && snapshot.sensitivity.rows() == rows;
  }
  if (!fits) {
    throw Error("reduced model: the training states are of another mesh than the one given, of " +
                std::to_string(mesh.rest_position_W.size()) + " vertices");
  }
  check(options);
}

}  // namespace

void check(const ReducedTrainingOptions& options) {
  check_positive(options.mode_tolerance, "reduced model: mode_tolerance");
  check_positive(options.mode_length_m, "reduced model: mode_length_m");
  check_positive(options.cubature_tolerance, "reduced model: cubature_tolerance");
  check_positive(options.most_springs, "reduced model: most_springs");
  check_positive(options.candidate_springs, "reduced model: candidate_springs");
  if (options.most_modes < 1 || options.most_modes > kMostReducedCoordinates - 3) {
    throw Error("reduced model: most_modes is " + std::to_string(options.most_modes) +
                "; give 1 to " + std::to_string(kMostReducedCoordinates - 3));
  }
}

ReducedSnapshot take_snapshot(const SpringMesh& mesh, const ElasticObject<float>& object,
                              const Equilibrium& answer) {
  ReducedSnapshot snapshot{.displacement_W = answer.displacement_W,
                           .force_W = answer.force_W,
                           .moved_m = {},
                           .sensitivity = {}};
  const std::vector<Vector3d> positions_W = object.positions_W();
  const auto rows = 3 * static_cast<Index>(positions_W.size());
  snapshot.moved_m.resize(rows);
  snapshot.sensitivity.resize(rows, 3);
  for (std::size_t i = 0; i < positions_W.size(); ++i) {
    const Index row = 3 * static_cast<Index>(i);
    snapshot.moved_m.segment<3>(row) = (positions_W[i] - mesh.rest_position_W[i]).cast<float>();
    snapshot.sensitivity.middleRows<3>(row) = object.sensitivity(i).cast<float>();
  }
  return snapshot;
}

bool is_new_state(const Equilibrium& answer, double apart_m, const ReducedTrainingSet& set) {
  if (!answer.converged || !answer.reached) {
    return false;
  }
  double nearest_m = answer.displacement_W.norm();
  for (const ReducedSnapshot& known : set.snapshots) {
    nearest_m = std::min(nearest_m, (known.displacement_W - answer.displacement_W).norm());
  }
  return nearest_m >= apart_m;
}

bool add_state(const SpringMesh& mesh, const ElasticObject<float>& object,
               const Equilibrium& answer, const StateSpacing& spacing, ReducedTrainingSet& set) {
  if (set.snapshots.size() >= spacing.most_states || !is_new_state(answer, spacing.apart_m, set)) {
    return false;
  }
  set.snapshots.push_back(take_snapshot(mesh, object, answer));
  return true;
}

ReducedTrainingSet begin_training_set(const SpringMesh& mesh, const ElasticObject<float>& object) {
  return {.patch = object.patch(),
          .rest_sensitivity = take_snapshot(mesh, object, Equilibrium{}).sensitivity,
          .snapshots = {}};
}

ReducedTraining train_reduced_model(const SpringMesh& mesh, const ReducedTrainingSet& set,
                                    const ReducedTrainingOptions& options) {
  check(mesh, set, options);
  return Training(mesh, set, options).run();
}

}  // namespace forcegrid::simulator
