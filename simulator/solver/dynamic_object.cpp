// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/dynamic_object.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>

#include "simulator/kernels/dynamic_kernels.h"
#include "simulator/kernels/eigen_lanes.h"
#include "simulator/kernels/element_forces.h"
#include "simulator/kernels/kernel_support.h"
#include "simulator/kernels/spring_table.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/tetrahedra.h"

namespace forcegrid::simulator {
namespace {

using kernels::Double4;
using kernels::Precise;

const std::string kWho = "dynamic object: ";
// A step whose matrix is not definite is taken in two halves, and so on: so often at most.
constexpr int kMaxStepHalvings = 6;
constexpr double kAlmostWhole = 1.0 - 1e-9;  // of a step, so that rounding adds none

Double4 lanes(const Eigen::Vector3d& v) { return kernels::to_precise(v).xyz; }
Double4 all(double value) { return Double4{value, value, value, value}; }

void check_options(const DynamicOptions& options) {
  check_positive(options.step_s, kWho + "step_s");
  check_positive(options.max_move_m, kWho + "max_move_m");
  check_positive(options.max_steps, kWho + "max_steps");
  check_positive(options.relative_tolerance, kWho + "relative_tolerance");
  check_positive(options.force_floor_N, kWho + "force_floor_N");
  check_positive(options.max_iterations, kWho + "max_iterations");
}

const SpringMesh& with_masses(const SpringMesh& mesh) {
  check(mesh);
  if (mesh.mass_kg.empty()) {
    throw Error(kWho + "the object has no masses; give each [[object]] of the scene a mass_kg");
  }
  return mesh;
}

std::vector<Eigen::Vector3d> vectors(const std::vector<Precise>& values) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(values.size());
  for (const Precise& value : values) {
    result.push_back(kernels::to_vector(value));
  }
  return result;
}

}  // namespace

class DynamicObject::Implementation {
 public:
  Implementation(const SpringMesh& mesh, const DynamicOptions& options)
      : options_(options),
        table_(make_spring_table<double>(with_masses(mesh))),
        mass_kg_(mesh.mass_kg),
        drag_Ns_per_m_(mesh.drag_Ns_per_m),
        fixed_(mesh.fixed) {
    check_options(options);
    const std::size_t vertices = mesh.rest_position_W.size();
    for (const Eigen::Vector3d& rest_W : mesh.rest_position_W) {
      rest_.push_back({lanes(rest_W)});
    }
    drag_Ns_per_m_.resize(vertices, 0.0);
    home_N_per_m_ = mesh.home_stiffness_N_per_m;
    home_N_per_m_.resize(vertices, 0.0);
    for (const Eigen::Vector3d& load_N : mesh.load_W_N) {
      load_.push_back({lanes(load_N)});
    }
    load_.resize(vertices, Precise{});
    damper_Ns_per_m_.resize(table_.constants.size(), 0.0);
    for (std::size_t s = 0; s < table_.springs; ++s) {
      const Spring& spring = mesh.springs[static_cast<std::size_t>(table_.mesh_spring[s])];
      damper_Ns_per_m_[s] = spring.stiffness_N_per_m *
                            mesh.laws[static_cast<std::size_t>(spring.law)].retardation_time_s;
    }
    for (std::vector<Precise>* array : {&position_, &velocity_, &force_, &damping_, &residual_,
                                        &direction_, &product_, &velocity_before_}) {
      array->resize(vertices, Precise{});
    }
    if (!mesh.tetrahedra.empty()) {
      elements_ = std::make_unique<ElementForces<double>>(mesh);
      element_tau_s_.assign(vertices, 0.0);
      edge_scale_.assign(vertices, 0.0);
      for (const Tetrahedron& element : mesh.tetrahedra) {
        for (const std::int32_t vertex : element.vertex) {
          element_tau_s_[static_cast<std::size_t>(vertex)] =
              mesh.materials[static_cast<std::size_t>(element.material)].retardation_time_s;
        }
      }
    }
    inertia_kg_.resize(vertices);
    inverse_.resize(vertices);
    t_N_per_m_.resize(table_.constants.size());
    tangent_.resize(table_.constants.size());
    step_.resize(table_.springs);
    rest();
  }

  std::size_t vertex_count() const noexcept { return rest_.size(); }
  std::size_t spring_count() const noexcept { return table_.springs; }
  const DynamicOptions& options() const noexcept { return options_; }
  bool grabbed() const noexcept { return !held_.empty(); }
  double last_step_s() const noexcept { return step_s_; }
  bool long_step() const noexcept { return step_s_ * kAlmostWhole > options_.step_s; }
  std::vector<Eigen::Vector3d> positions_W() const { return vectors(position_); }
  std::vector<Eigen::Vector3d> velocities_W() const { return vectors(velocity_); }
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const {
    position_W.resize(vertices.size());
    for (std::size_t n = 0; n < vertices.size(); ++n) {
      position_W[n] = kernels::to_vector(position_[static_cast<std::size_t>(vertices[n])]);
    }
  }

  int grab(const Eigen::Vector3d& point_W, double radius_m) {
    if (grabbed()) {
      throw Error(kWho + "a patch is held already; call release() first");
    }
    for (std::size_t i = 0; i < position_.size(); ++i) {
      if (free_[i] != 0 && (kernels::to_vector(position_[i]) - point_W).norm() <= radius_m) {
        held_.push_back(i);
        held_at_.push_back(position_[i]);
      }
    }
    for (const std::size_t i : held_) {
      free_[i] = 0;
      velocity_[i] = Precise{};
    }
    displacement_W_.setZero();
    return static_cast<int>(held_.size());
  }

  void release() noexcept {
    held_.clear();
    held_at_.clear();
    for (std::size_t i = 0; i < fixed_.size(); ++i) {
      free_[i] = fixed_[i] == 0 ? 1 : 0;
    }
    displacement_W_.setZero();
    tool_force_W_.setZero();
  }

  void rest() noexcept {
    free_.resize(fixed_.size());
    release();
    std::copy(rest_.begin(), rest_.end(), position_.begin());
    std::fill(velocity_.begin(), velocity_.end(), Precise{});
    step_s_ = 0.0;
    evaluate();
  }

  Equilibrium advance(double duration_s, const Eigen::Vector3d& displacement_W) noexcept {
    const auto start = std::chrono::steady_clock::now();
    Equilibrium result;
    const Eigen::Vector3d target_W =
        grabbed() ? displacement_W : Eigen::Vector3d(Eigen::Vector3d::Zero());
    if (!(duration_s >= 0.0) || !std::isfinite(duration_s) || !target_W.allFinite()) {
      result.reached = false;
      result.force_W = result.raw_force_W = tool_force_W_;
      result.displacement_W = displacement_W_;
      return result;
    }
    result.converged = true;
    step_s_ = 0.0;
    if (duration_s > 0.0) {
      live_through(duration_s, target_W, result);
    } else {
      result.reached = target_W == displacement_W_;
    }
    feel();
    result.force_W = result.raw_force_W = tool_force_W_;
    result.displacement_W = displacement_W_;
    result.vertices = static_cast<int>(rest_.size());
    result.converged = result.converged && result.reached && result.force_W.allFinite() &&
                       std::isfinite(result.relative_residual);
    result.solve_time_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return result;
  }

 private:
  void live_through(double duration_s, const Eigen::Vector3d& target_W,
                    Equilibrium& result) noexcept {
    const Eigen::Vector3d way_W = target_W - displacement_W_;
    const double wanted = std::max(duration_s / options_.step_s * kAlmostWhole,
                                   way_W.norm() / options_.max_move_m * kAlmostWhole);
    const int steps = static_cast<int>(
        std::clamp(std::ceil(wanted), 1.0, static_cast<double>(options_.max_steps)));
    step_s_ = duration_s / steps;
    const Eigen::Vector3d from_W = displacement_W_;
    for (int step = 1; step <= steps; ++step) {
      const Eigen::Vector3d next_W =
          step == steps ? target_W : Eigen::Vector3d(from_W + step * (way_W / steps));
      take_step(next_W, result);
    }
    result.steps = steps;
  }

  // Moves the positions to the step's end and evaluates the springs there. Elements' exact Hessian
  // may be indefinite; the masses outweigh it if the step is short enough.
  void take_step(const Eigen::Vector3d& next_W, Equilibrium& result, int halvings = 0) noexcept {
    fill_matrix();
    if (elements_) {
      std::copy(velocity_.begin(), velocity_.end(), velocity_before_.begin());
    }
    const double scale_N = std::max(tool_force_W_.norm(), options_.force_floor_N);
    const double residual_N = solve(options_.relative_tolerance * scale_N,
                                    (next_W - displacement_W_) / step_s_, result.iterations);
    if (indefinite_ && halvings < kMaxStepHalvings) {
      std::copy(velocity_before_.begin(), velocity_before_.end(), velocity_.begin());
      const Eigen::Vector3d middle_W = 0.5 * (displacement_W_ + next_W);
      step_s_ *= 0.5;
      take_step(middle_W, result, halvings + 1);
      take_step(next_W, result, halvings + 1);
      step_s_ *= 2.0;
      ++result.halvings;
      return;
    }
    result.converged = result.converged && !indefinite_;
    result.relative_residual = std::max(result.relative_residual, residual_N / scale_N);
    result.converged = result.converged && residual_N <= options_.relative_tolerance * scale_N;
    displacement_W_ = next_W;
    for (std::size_t i = 0; i < position_.size(); ++i) {
      position_[i].xyz += all(step_s_) * velocity_[i].xyz;
    }
    // From the place of the grab, so that the rounding of many steps does not add up.
    for (std::size_t k = 0; k < held_.size(); ++k) {
      position_[held_[k]].xyz = held_at_[k].xyz + lanes(displacement_W_);
    }
    evaluate();
    ++result.evaluations;
  }

  void fill_matrix() noexcept {
    kernels::make_step_springs(table_.springs, tangent_.data(), t_N_per_m_.data(),
                               damper_Ns_per_m_.data(), step_s_, step_.data());
    for (std::size_t i = 0; i < inertia_kg_.size(); ++i) {
      inertia_kg_[i] = mass_kg_[i] + step_s_ * (drag_Ns_per_m_[i] + step_s_ * home_N_per_m_[i]);
    }
    kernels::sum_step_blocks(table_.rows, step_.data(), inertia_kg_.data(), inverse_.data());
    if (elements_) {
      for (std::size_t i = 0; i < edge_scale_.size(); ++i) {
        edge_scale_[i] = step_s_ * (step_s_ + element_tau_s_[i]);
      }
      kernels::add_edge_step_blocks(elements_->rows(), elements_->edges().data(),
                                    edge_scale_.data(), inverse_.data());
    }
    kernels::invert_step_blocks(inverse_.size(), free_.data(), inverse_.data());
  }

  // product = (M + h D + h^2 K) direction.
  void apply_step_matrix(const Precise* direction) noexcept {
    kernels::apply_step_matrix(table_.rows, step_.data(), inertia_kg_.data(), direction,
                               product_.data());
    if (elements_) {
      kernels::add_edge_products(elements_->rows(), elements_->edges().data(), edge_scale_.data(),
                                 direction, product_.data());
    }
  }

  // Leaves v1 in velocity_, and in indefinite_ whether the matrix was not definite. @returns |A v1
  // - b| / h [N].
  double solve(double aim_N, const Eigen::Vector3d& tool_velocity_W, int& iterations) noexcept {
    const std::size_t count = position_.size();
    for (std::size_t i = 0; i < count; ++i) {
      residual_[i].xyz = all(mass_kg_[i]) * velocity_[i].xyz + all(step_s_) * force_[i].xyz;
    }
    for (const std::size_t i : held_) {
      velocity_[i].xyz = lanes(tool_velocity_W);
    }
    apply_step_matrix(velocity_.data());
    indefinite_ = false;
    std::fill(direction_.begin(), direction_.end(), Precise{});
    kernels::DescentSums sums =
        kernels::descend(count, 1.0, free_.data(), inverse_.data(), direction_.data(),
                         velocity_.data(), residual_.data(), product_.data());
    const double aim = aim_N * step_s_;
    double beta = 0.0;
    for (int i = 0; i < options_.max_iterations && std::sqrt(sums.squared) > aim; ++i) {
      kernels::turn_direction(count, beta, product_.data(), direction_.data());
      apply_step_matrix(direction_.data());
      const double before = sums.preconditioned;
      const double curvature = kernels::dot(count, direction_.data(), product_.data());
      if (elements_ && !(curvature > 0.0 && before > 0.0)) {
        indefinite_ = true;
        break;
      }
      sums =
          kernels::descend(count, before / curvature, free_.data(), inverse_.data(),
                           direction_.data(), velocity_.data(), residual_.data(), product_.data());
      beta = sums.preconditioned / before;
      ++iterations;
    }
    return std::sqrt(sums.squared) / step_s_;
  }

  // Forces that don't depend on velocities, at the present positions.
  void evaluate() noexcept {
    kernels::find_tangents(table_.rows, table_.constants.data(), table_.exponential,
                           position_.data(), t_N_per_m_.data(), tangent_.data());
    for (std::size_t i = 0; i < force_.size(); ++i) {
      force_[i].xyz = load_[i].xyz - all(home_N_per_m_[i]) * (position_[i].xyz - rest_[i].xyz);
    }
    kernels::add_spring_forces(table_.rows, t_N_per_m_.data(), position_.data(), force_.data());
    if (elements_) {
      elements_->evaluate_forces(position_.data(), force_.data(), nullptr);
    }
    sum_tool_force(force_);
  }

  // The scale of the next step's tolerance until feel() adds the dampers.
  void sum_tool_force(const std::vector<Precise>& forces) noexcept {
    tool_force_W_.setZero();
    for (const std::size_t i : held_) {
      tool_force_W_ += kernels::to_vector(forces[i]);
    }
  }

  void feel() noexcept {
    for (std::size_t i = 0; i < force_.size(); ++i) {
      damping_[i].xyz = force_[i].xyz - all(drag_Ns_per_m_[i]) * velocity_[i].xyz;
    }
    kernels::add_damper_forces(table_.rows, tangent_.data(), damper_Ns_per_m_.data(),
                               velocity_.data(), damping_.data());
    if (elements_) {
      for (std::size_t i = 0; i < edge_scale_.size(); ++i) {
        edge_scale_[i] = -element_tau_s_[i];
      }
      kernels::add_edge_products(elements_->rows(), elements_->edges().data(), edge_scale_.data(),
                                 velocity_.data(), damping_.data());
    }
    sum_tool_force(damping_);
  }

  DynamicOptions options_;
  SpringTable<double> table_;
  std::vector<double> mass_kg_;
  std::vector<double> drag_Ns_per_m_;
  std::vector<double> home_N_per_m_;
  std::vector<double> damper_Ns_per_m_;
  std::vector<std::uint8_t> fixed_;
  std::vector<std::uint8_t> free_;
  std::vector<std::size_t> held_;
  std::vector<Precise> held_at_;  // [m] where each was when it was grabbed
  std::vector<Precise> rest_;
  std::vector<Precise> load_;
  std::vector<Precise> position_;
  std::vector<Precise> velocity_;
  std::vector<Precise> force_;    // [N] of springs, home springs and loads
  std::vector<Precise> damping_;  // [N] the same with dampers and drag
  std::vector<Precise> residual_;
  std::vector<Precise> direction_;
  std::vector<Precise> product_;
  std::vector<double> inertia_kg_;
  std::vector<kernels::SymmetricBlock> inverse_;
  std::vector<double> t_N_per_m_;
  std::vector<kernels::SpringTangent> tangent_;
  std::vector<kernels::StepSpring> step_;
  std::unique_ptr<ElementForces<double>> elements_;  // null: springs only
  std::vector<double> element_tau_s_;                // by vertex
  std::vector<double> edge_scale_;                   // by vertex
  std::vector<Precise> velocity_before_;
  bool indefinite_ = false;
  Eigen::Vector3d displacement_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d tool_force_W_ = Eigen::Vector3d::Zero();
  double step_s_ = 0.0;
};

DynamicObject::DynamicObject(const SpringMesh& mesh, const DynamicOptions& options)
    : implementation_(std::make_unique<Implementation>(mesh, options)) {}
DynamicObject::~DynamicObject() = default;
DynamicObject::DynamicObject(DynamicObject&&) noexcept = default;
DynamicObject& DynamicObject::operator=(DynamicObject&&) noexcept = default;
std::size_t DynamicObject::vertex_count() const noexcept { return implementation_->vertex_count(); }
std::size_t DynamicObject::spring_count() const noexcept { return implementation_->spring_count(); }
const DynamicOptions& DynamicObject::options() const noexcept { return implementation_->options(); }
int DynamicObject::grab(const Eigen::Vector3d& point_W, double radius_m) {
  return implementation_->grab(point_W, radius_m);
}
void DynamicObject::release() noexcept { implementation_->release(); }
void DynamicObject::rest() noexcept { implementation_->rest(); }
bool DynamicObject::grabbed() const noexcept { return implementation_->grabbed(); }
Equilibrium DynamicObject::advance(double duration_s,
                                   const Eigen::Vector3d& displacement_W) noexcept {
  return implementation_->advance(duration_s, displacement_W);
}
double DynamicObject::last_step_s() const noexcept { return implementation_->last_step_s(); }
bool DynamicObject::long_step() const noexcept { return implementation_->long_step(); }
std::vector<Eigen::Vector3d> DynamicObject::positions_W() const {
  return implementation_->positions_W();
}
std::vector<Eigen::Vector3d> DynamicObject::velocities_W() const {
  return implementation_->velocities_W();
}
void DynamicObject::copy_positions(const std::vector<std::int32_t>& vertices,
                                   std::vector<Eigen::Vector3d>& position_W) const {
  implementation_->copy_positions(vertices, position_W);
}

}  // namespace forcegrid::simulator
