// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/newton_cg_baseline.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "simulator/kernels/element_forces.h"
#include "simulator/kernels/kernel_support.h"
#include "simulator/kernels/spring_table.h"
#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

using kernels::BlockInverse;
using kernels::EdgeStiffness;
using kernels::Float4;
using kernels::Single;
using kernels::SpringRows;
using kernels::SpringTangent;

constexpr double kForcing = 0.1;
constexpr double kPlainAimBelowTolerance = 0.5;
constexpr double kPlainDivergence = 2.0;
constexpr int kPlainMaxHalvings = 6;
constexpr int kNewtonStepsOnTheWay = 2;
constexpr double kPlainLargestTrend = 2.0;

FORCEGRID_MULTIVERSION void sum_forces(const SpringRows& rows, const SpringTangent* tangent,
                                       const Single* position, Single* force) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    force[i] = Single{};
  }
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Float4 here = position[i].xyz;
    Float4 sum = force[i].xyz;
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const float t = tangent[s].t_N_per_m;
      const Float4 f = (position[rows.other[s]].xyz - here) * Float4{t, t, t, t};
      sum += f;
      force[rows.other[s]].xyz -= f;
    }
    force[i].xyz = sum;
  }
}

// product = K direction; `product` must be zero before. Component 3 of both stays 0.
template <bool kHome>
FORCEGRID_INLINE void apply_rows(const SpringRows& rows, const SpringTangent* tangent,
                                 const float* home_N_per_m, const Single* direction,
                                 Single* product) {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Float4 here = direction[i].xyz;
    Float4 sum = product[i].xyz;
    if constexpr (kHome) {
      sum += kernels::broadcast(home_N_per_m[i]) * here;
    }
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const SpringTangent& h = tangent[s];
      const Float4 w{h.w_x, h.w_y, h.w_z, 0.0F};
      const Float4 d = here - direction[rows.other[s]].xyz;
      const Float4 wd = w * d;
      const float along = wd[0] + wd[1] + wd[2];
      const float t = h.t_N_per_m;
      const Float4 f = Float4{t, t, t, t} * d + Float4{along, along, along, along} * w;
      sum += f;
      product[rows.other[s]].xyz -= f;
    }
    product[i].xyz = sum;
  }
}

FORCEGRID_MULTIVERSION void apply(const SpringRows& rows, const SpringTangent* tangent,
                                  const std::vector<float>& home_N_per_m, const Single* direction,
                                  Single* product) noexcept {
  if (home_N_per_m.empty()) {
    apply_rows<false>(rows, tangent, nullptr, direction, product);
  } else {
    apply_rows<true>(rows, tangent, home_N_per_m.data(), direction, product);
  }
}

// product += K direction of the elements' edges.
FORCEGRID_MULTIVERSION void add_edges(const SpringRows& rows, const EdgeStiffness* edge,
                                      const Single* direction, Single* product) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Float4 here = direction[i].xyz;
    Float4 sum = product[i].xyz;
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const Float4* h = edge[s].row;
      const Float4 d = here - direction[rows.other[s]].xyz;
      const Float4 x = h[0] * d;
      const Float4 y = h[1] * d;
      const Float4 z = h[2] * d;
      sum += Float4{x[0] + x[1] + x[2], y[0] + y[1] + y[2], z[0] + z[1] + z[2], 0.0F};
      product[rows.other[s]].xyz -= Float4{d[0], d[0], d[0], 0.0F} * h[0] +
                                    Float4{d[1], d[1], d[1], 0.0F} * h[1] +
                                    Float4{d[2], d[2], d[2], 0.0F} * h[2];
    }
    product[i].xyz = sum;
  }
}

FORCEGRID_MULTIVERSION void dot_into(const Single* a, const Single* b, std::size_t count,
                                     double* result) noexcept {
  Float4 sum{};
  for (std::size_t i = 0; i < count; ++i) {
    sum += a[i].xyz * b[i].xyz;
  }
  *result = static_cast<double>(sum[0] + sum[1] + sum[2]);
}

double dot(const std::vector<Single>& a, const std::vector<Single>& b) noexcept {
  double sum = 0.0;
  dot_into(a.data(), b.data(), a.size(), &sum);
  return sum;
}

FORCEGRID_INLINE Float4 precondition(const BlockInverse& m, Float4 r) {
  const Float4 r_left = __builtin_shufflevector(r, r, 1, 2, 0, 3);
  const Float4 r_right = __builtin_shufflevector(r, r, 2, 0, 1, 3);
  const Float4 o_right = __builtin_shufflevector(m.off_diagonal, m.off_diagonal, 2, 0, 1, 3);
  return m.diagonal * r + m.off_diagonal * r_left + o_right * r_right;
}

struct StepSums {
  double preconditioned;
  double squared;
};

// move += alpha direction; residual -= alpha product on free vertices; product = M residual.
FORCEGRID_MULTIVERSION void take_step_on(std::size_t count, float alpha,
                                         const BlockInverse* inverse, const Single* direction,
                                         Single* move, Single* residual, Single* product,
                                         StepSums* sums) noexcept {
  Float4 squared{};
  Float4 preconditioned{};
  for (std::size_t i = 0; i < count; ++i) {
    const float free_alpha = alpha * inverse[i].diagonal[3];
    move[i].xyz += Float4{alpha, alpha, alpha, 0.0F} * direction[i].xyz;
    const Float4 r =
        residual[i].xyz - Float4{free_alpha, free_alpha, free_alpha, 0.0F} * product[i].xyz;
    const Float4 z = precondition(inverse[i], r);
    residual[i].xyz = r;
    product[i].xyz = z;
    squared += r * r;
    preconditioned += r * z;
  }
  sums->squared = static_cast<double>(squared[0] + squared[1] + squared[2]);
  sums->preconditioned =
      static_cast<double>(preconditioned[0] + preconditioned[1] + preconditioned[2]);
}

FORCEGRID_MULTIVERSION void next_direction(std::size_t count, float beta, Single* direction,
                                           Single* product) noexcept {
  const Float4 b{beta, beta, beta, beta};
  for (std::size_t i = 0; i < count; ++i) {
    direction[i].xyz = product[i].xyz + b * direction[i].xyz;
    product[i].xyz = Float4{};
  }
}

}  // namespace

class NewtonCgBaseline::Implementation {
 public:
  Implementation(const SpringMesh& mesh, const Options& options)
      : options_(options), origin_W_(mesh.top_W), fixed_(mesh.fixed) {
    check(mesh);
    if (!(options.relative_tolerance > 0.0)) {
      throw Error("newton: relative_tolerance is " + std::to_string(options.relative_tolerance) +
                  "; it must be > 0");
    }
    for (const Eigen::Vector3d& position_W : mesh.rest_position_W) {
      rest_.push_back(position_W - origin_W_);
    }
    table_ = make_spring_table<float>(mesh);
    vertex_force_ = make_vertex_forces(mesh, rest_);
    home_N_per_m_ = kernels::home_stiffness_N_per_m(vertex_force_);
    if (!mesh.tetrahedra.empty()) {
      elements_ = std::make_unique<ElementForces<float>>(mesh);
      element_force_.resize(rest_.size());
    }
    largest_move_m_ = 0.5 * mean_length_m(mesh);
    for (const Eigen::Vector3d& rest : rest_) {
      position_.push_back(single(rest));
    }
    before_ = position_;
    for (std::vector<Single>* array : {&force_, &direction_, &product_, &move_, &base_}) {
      array->resize(rest_.size());
    }
    inverse_.resize(rest_.size());
    tangent_.resize(table_.constants.size());
    free_.resize(rest_.size());
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      free_[i] = fixed_[i] == 0 ? 1 : 0;
    }
  }

  int grab(const Eigen::Vector3d& point_W, double radius_m) {
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      if (fixed_[i] == 0 && (rest_[i] - (point_W - origin_W_)).norm() <= radius_m) {
        patch_.push_back(i);
        free_[i] = 0;
      }
    }
    return static_cast<int>(patch_.size());
  }

  Answer move_to(const Eigen::Vector3d& displacement_W) {
    Answer answer;
    const Eigen::Vector3d way = displacement_W - displacement_;
    const int parts = std::max(1, static_cast<int>(std::ceil(way.norm() / options_.max_step_m)));
    const Eigen::Vector3d from = displacement_;
    for (int part = 1; part <= parts; ++part) {
      extrapolate_to(from + way * (static_cast<double>(part) / parts));
      solve(part < parts ? kNewtonStepsOnTheWay : options_.max_newton_steps, answer);
    }
    return answer;
  }

 private:
  static Single single(const Eigen::Vector3d& v) {
    return {Float4{static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z()),
                   0.0F}};
  }

  // Of the springs and the edges of elements, each edge counted once for each of its elements.
  static double mean_length_m(const SpringMesh& mesh) {
    double length_m = 0.0;
    for (const Spring& spring : mesh.springs) {
      length_m += natural_length_m(mesh, spring);
    }
    const auto at = [&mesh](std::int32_t vertex) {
      return mesh.rest_position_W[static_cast<std::size_t>(vertex)];
    };
    for (const Tetrahedron& element : mesh.tetrahedra) {
      for (std::size_t a = 0; a < 4; ++a) {
        for (std::size_t b = 0; b < a; ++b) {
          length_m += (at(element.vertex[a]) - at(element.vertex[b])).norm();
        }
      }
    }
    return length_m / static_cast<double>(mesh.springs.size() + 6 * mesh.tetrahedra.size());
  }

  void add_elements() {
    std::fill(element_force_.begin(), element_force_.end(), kernels::Lanes{});
    elements_->evaluate_forces(position_.data(), nullptr, element_force_.data());
    for (std::size_t i = 0; i < force_.size(); ++i) {
      const kernels::Lanes& f = element_force_[i];
      force_[i].xyz += Float4{f.component[0][0], f.component[1][0], f.component[2][0], 0.0F};
    }
  }

  void extrapolate_to(const Eigen::Vector3d& displacement) {
    const Eigen::Vector3d step = displacement - displacement_;
    double trend = last_step_.isZero(0.0) ? 0.0 : step.dot(last_step_) / last_step_.squaredNorm();
    if (std::abs(trend) > kPlainLargestTrend) {
      trend = 0.0;
    }
    const auto scale = static_cast<float>(trend);
    for (std::size_t i = 0; i < position_.size(); ++i) {
      const Float4 here = position_[i].xyz;
      position_[i].xyz += Float4{scale, scale, scale, 0.0F} * (here - before_[i].xyz);
      before_[i].xyz = here;
    }
    last_step_ = step;
    displacement_ = displacement;
    for (const std::size_t i : patch_) {
      position_[i] = single(rest_[i] + displacement_);
    }
  }

  // Forces at the present positions; the residual is what of them is on free vertices.
  void evaluate(Answer& answer) {
    kernels::find_tangents(table_.rows, table_.constants.data(), table_.exponential,
                           position_.data(), tangent_.data());
    sum_forces(table_.rows, tangent_.data(), position_.data(), force_.data());
    if (elements_) {
      add_elements();
    }
    for (std::size_t i = 0; i < vertex_force_.size(); ++i) {
      for (int c = 0; c < 3; ++c) {
        force_[i].xyz[c] += static_cast<float>(
            vertex_force_[i].load_N[c] -
            static_cast<double>(vertex_force_[i].home_stiffness_N_per_m) *
                (static_cast<double>(position_[i].xyz[c]) - vertex_force_[i].rest_m[c]));
      }
    }
    answer.force_W.setZero();
    for (const std::size_t i : patch_) {
      for (int c = 0; c < 3; ++c) {
        answer.force_W[c] += static_cast<double>(force_[i].xyz[c]);
      }
    }
    for (std::size_t i = 0; i < force_.size(); ++i) {
      if (free_[i] == 0) {
        force_[i] = Single{};
      }
    }
    residual_N_ = std::sqrt(dot(force_, force_));
    ++answer.evaluations;
    const double scale_N = std::max(answer.force_W.norm(), options_.force_floor_N);
    aim_N_ = options_.relative_tolerance * scale_N;
    answer.relative_residual = residual_N_ / scale_N;
    answer.converged = residual_N_ <= aim_N_;
  }

  void solve(int max_newton_steps, Answer& answer) {
    evaluate(answer);
    for (int step = 0; step < max_newton_steps && !answer.converged; ++step) {
      if (answer.iterations >= options_.max_iterations) {
        return;
      }
      const double before_N = residual_N_;
      find_move(answer);
      base_ = position_;
      double scale = bounded();
      for (int halving = 0; halving <= kPlainMaxHalvings; ++halving) {
        const auto factor = static_cast<float>(scale);
        for (std::size_t i = 0; i < position_.size(); ++i) {
          position_[i].xyz = base_[i].xyz + Float4{factor, factor, factor, 0.0F} * move_[i].xyz;
        }
        evaluate(answer);
        if (residual_N_ <= kPlainDivergence * before_N) {
          break;
        }
        scale *= 0.5;
      }
    }
  }

  double bounded() const {
    float largest = 0.0F;
    for (const Single& move : move_) {
      const Float4 squared = move.xyz * move.xyz;
      largest = std::max(largest, squared[0] + squared[1] + squared[2]);
    }
    const double length_m = std::sqrt(static_cast<double>(largest));
    return length_m > largest_move_m_ ? largest_move_m_ / length_m : 1.0;
  }

  // Truncated conjugate gradients from force_, which becomes the linear residual.
  void find_move(Answer& answer) {
    kernels::sum_blocks(table_.rows, tangent_.data(), inverse_.data());
    if (elements_) {
      elements_->add_blocks(inverse_.data());
    }
    kernels::add_home_blocks(vertex_force_, inverse_.data());
    for (std::size_t i = 0; i < inverse_.size(); ++i) {
      kernels::invert_block(inverse_[i], free_[i] != 0);
    }
    const double aim_N = std::max(kForcing * residual_N_, kPlainAimBelowTolerance * aim_N_);
    std::fill(move_.begin(), move_.end(), Single{});
    std::fill(product_.begin(), product_.end(), Single{});
    std::fill(direction_.begin(), direction_.end(), Single{});
    StepSums sums{};
    take_step_on(rest_.size(), 0.0F, inverse_.data(), direction_.data(), move_.data(),
                 force_.data(), product_.data(), &sums);
    next_direction(rest_.size(), 0.0F, direction_.data(), product_.data());
    while (answer.iterations < options_.max_iterations && sums.preconditioned > 0.0) {
      const double before = sums.preconditioned;
      apply(table_.rows, tangent_.data(), home_N_per_m_, direction_.data(), product_.data());
      if (elements_) {
        add_edges(elements_->rows(), elements_->edges().data(), direction_.data(), product_.data());
      }
      const double curvature = dot(direction_, product_);
      if (!(curvature > 0.0)) {
        return;
      }
      ++answer.iterations;
      take_step_on(rest_.size(), static_cast<float>(before / curvature), inverse_.data(),
                   direction_.data(), move_.data(), force_.data(), product_.data(), &sums);
      if (std::sqrt(sums.squared) <= aim_N) {
        return;
      }
      next_direction(rest_.size(), static_cast<float>(sums.preconditioned / before),
                     direction_.data(), product_.data());
    }
  }

  Options options_;
  Eigen::Vector3d origin_W_;
  std::vector<Eigen::Vector3d> rest_;  // [m] from origin_W_
  std::vector<std::uint8_t> fixed_;
  std::vector<std::uint8_t> free_;
  std::vector<std::size_t> patch_;
  SpringTable<float> table_;
  std::unique_ptr<ElementForces<float>> elements_;  // null: springs only
  std::vector<kernels::Lanes> element_force_;
  std::vector<kernels::VertexForce> vertex_force_;
  std::vector<float> home_N_per_m_;  // of vertex_force_
  std::vector<Single> position_;
  std::vector<Single> before_;
  std::vector<Single> force_;
  std::vector<Single> direction_;
  std::vector<Single> product_;
  std::vector<Single> move_;
  std::vector<Single> base_;
  std::vector<BlockInverse> inverse_;
  std::vector<SpringTangent> tangent_;
  Eigen::Vector3d displacement_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d last_step_ = Eigen::Vector3d::Zero();
  double largest_move_m_ = 0.0;
  double residual_N_ = 0.0;
  double aim_N_ = 0.0;
};

NewtonCgBaseline::NewtonCgBaseline(const SpringMesh& mesh, const Options& options)
    : implementation_(std::make_unique<Implementation>(mesh, options)) {}
NewtonCgBaseline::~NewtonCgBaseline() = default;
NewtonCgBaseline::NewtonCgBaseline(NewtonCgBaseline&&) noexcept = default;
int NewtonCgBaseline::grab(const Eigen::Vector3d& point_W, double radius_m) {
  return implementation_->grab(point_W, radius_m);
}
NewtonCgBaseline::Answer NewtonCgBaseline::move_to(const Eigen::Vector3d& displacement_W) {
  return implementation_->move_to(displacement_W);
}

}  // namespace forcegrid::simulator
