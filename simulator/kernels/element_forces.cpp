// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/element_forces.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

#include "simulator/kernels/coarse_correction.h"
#include "simulator/mesh/tetrahedra.h"

namespace forcegrid::simulator {
namespace {

template <typename Real>
std::array<Real, 3> stiffness_of(const ElementMaterial& material) {
  const double mu = material.mu_Pa();
  const double lambda = material.lambda_Pa();
  if (material.model != ElementModel::kNeoHookean) {
    return {static_cast<Real>(mu), static_cast<Real>(lambda), Real{0}};
  }
  const double m = 4.0 / 3.0 * mu;
  const double l = lambda + 5.0 / 6.0 * mu;
  return {static_cast<Real>(m), static_cast<Real>(l), static_cast<Real>(1.0 + 0.75 * m / l)};
}

}  // namespace

template <typename Real>
ElementForces<Real>::ElementForces(const SpringMesh& mesh)
    : materials_(mesh.materials), unstrained_m_(unstrained_W(mesh)), elements_(mesh.tetrahedra) {
  // Close to the origin, where the differences keep their digits.
  const Eigen::Vector3d origin_W = mesh.top_W;
  for (Eigen::Vector3d& position : unstrained_m_) {
    position -= origin_W;
  }
  lay_out();
}

template <typename Real>
std::size_t ElementForces<Real>::memory_bytes() const noexcept {
  const auto bytes = [](const auto&... vectors) {
    return (... + (vectors.capacity() * sizeof(*vectors.data())));
  };
  std::size_t sum = sizeof *this + bytes(materials_, unstrained_m_, elements_, rows_.row_begin,
                                         rows_.owner, rows_.other, edge_, batches_);
  for (const kernels::ElementBatch<Real>& batch : batches_) {
    sum += bytes(batch.corners, batch.constants, batch.begin);
  }
  return sum;
}

template <typename Real>
std::span<const std::int32_t> ElementForces<Real>::lower() const noexcept {
  return rows_.owner;
}
template <typename Real>
std::span<const std::int32_t> ElementForces<Real>::upper() const noexcept {
  return rows_.other;
}

template <typename Real>
void ElementForces<Real>::renumber(const std::vector<std::int32_t>& order) {
  std::vector<std::int32_t> number(order.size());
  std::vector<Eigen::Vector3d> unstrained_m(order.size());
  for (std::size_t n = 0; n < order.size(); ++n) {
    number[static_cast<std::size_t>(order[n])] = static_cast<std::int32_t>(n);
    unstrained_m[n] = unstrained_m_[static_cast<std::size_t>(order[n])];
  }
  unstrained_m_.swap(unstrained_m);
  for (Tetrahedron& element : elements_) {
    for (std::int32_t& vertex : element.vertex) {
      vertex = number[static_cast<std::size_t>(vertex)];
    }
  }
  lay_out();
}

// Sorts the elements and makes everything that depends on their order.
template <typename Real>
void ElementForces<Real>::lay_out() {
  for (Tetrahedron& element : elements_) {
    std::sort(element.vertex.begin(), element.vertex.end());
  }
  std::sort(elements_.begin(), elements_.end(),
            [](const Tetrahedron& a, const Tetrahedron& b) { return a.vertex < b.vertex; });
  number_edges();
  batches_.clear();
  for (const ElementModel model :
       {ElementModel::kCorotated, ElementModel::kStVenantKirchhoff, ElementModel::kNeoHookean}) {
    std::vector<std::int32_t> element;
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      if (materials_[static_cast<std::size_t>(elements_[e].material)].model == model) {
        element.push_back(static_cast<std::int32_t>(e));
      }
    }
    if (!element.empty()) {
      batches_.emplace_back().model = model;
      fill_batch(batches_.back(), element);
    }
  }
}

template <typename Real>
void ElementForces<Real>::number_edges() {
  std::vector<std::pair<std::int32_t, std::int32_t>> edges;
  edges.reserve(kernels::kElementEdges.size() * elements_.size());
  for (const Tetrahedron& element : elements_) {
    for (const auto& [a, b] : kernels::kElementEdges) {
      edges.emplace_back(element.vertex[static_cast<std::size_t>(a)],
                         element.vertex[static_cast<std::size_t>(b)]);
    }
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  rows_.row_begin.assign(unstrained_m_.size() + 1, 0);
  rows_.owner.clear();
  rows_.other.clear();
  for (const auto& [low, high] : edges) {
    ++rows_.row_begin[static_cast<std::size_t>(low) + 1];
    rows_.owner.push_back(low);
    rows_.other.push_back(high);
  }
  std::partial_sum(rows_.row_begin.begin(), rows_.row_begin.end(), rows_.row_begin.begin());
  rows_.active = rows_.reach = rows_.vertex_count();
  edge_.assign(edges.size(), kernels::EdgeStiffness{});
}

template <typename Real>
void ElementForces<Real>::fill_batch(kernels::ElementBatch<Real>& batch,
                                     const std::vector<std::int32_t>& element) {
  constexpr std::size_t kWidth = kernels::kElementsSideBySide<Real>;
  batch.begin.assign(unstrained_m_.size() + 1, 0);
  batch.corners.resize(element.size());
  batch.constants.resize((element.size() + kWidth - 1) / kWidth);
  for (std::size_t n = 0; n < batch.constants.size() * kWidth; ++n) {
    const std::size_t at = std::min(n, element.size() - 1);
    const Tetrahedron& tetrahedron = elements_[static_cast<std::size_t>(element[at])];
    if (n == at) {
      kernels::ElementCorners& corners = batch.corners[n];
      corners.vertex = tetrahedron.vertex;
      ++batch.begin[static_cast<std::size_t>(tetrahedron.vertex[0]) + 1];
      for (std::size_t e = 0; e < kernels::kElementEdges.size(); ++e) {
        const auto [a, b] = kernels::kElementEdges[e];
        const auto low = static_cast<std::size_t>(tetrahedron.vertex[static_cast<std::size_t>(a)]);
        const auto first = rows_.other.begin() + rows_.row_begin[low];
        const auto last = rows_.other.begin() + rows_.row_begin[low + 1];
        corners.edge[e] = static_cast<std::int32_t>(
            std::lower_bound(first, last, tetrahedron.vertex[static_cast<std::size_t>(b)]) -
            rows_.other.begin());
      }
    }
    const ElementShape shape = element_shape(unstrained_m_, tetrahedron);
    const std::array<Real, 3> stiffness =
        stiffness_of<Real>(materials_[static_cast<std::size_t>(tetrahedron.material)]);
    kernels::ElementConstants<Real>& constants = batch.constants[n / kWidth];
    const std::size_t lane = n % kWidth;
    constants.volume_m3[lane] = static_cast<Real>(shape.volume_m3);
    for (std::size_t c = 0; c < 3; ++c) {
      constants.stiffness[c][lane] = stiffness[c];
      for (std::size_t a = 0; a < 3; ++a) {
        constants.gradient_per_m[a][c][lane] =
            static_cast<Real>(shape.gradient_per_m[a + 1][static_cast<Eigen::Index>(c)]);
      }
    }
  }
  std::partial_sum(batch.begin.begin(), batch.begin.end(), batch.begin.begin());
}

template <typename Real>
void ElementForces<Real>::limit(const kernels::Extent& extent) noexcept {
  static_cast<kernels::Extent&>(rows_) = extent;
}

template <typename Real>
void ElementForces<Real>::evaluate(const kernels::Lanes* state, const Position* position,
                                   kernels::Precise* force, kernels::Lanes* residual) noexcept {
  evaluate_forces(position, force, residual);
  kernels::add_edge_residuals(rows_, edge_.data(), state, residual);
}

template <typename Real>
void ElementForces<Real>::evaluate_forces(const Position* position, kernels::Precise* force,
                                          kernels::Lanes* residual) noexcept {
  // Elements at the border reach vertices whose edges nobody asks for.
  const std::int32_t edges = rows_.row_begin[static_cast<std::size_t>(rows_.reach)];
  std::fill_n(edge_.begin(), edges, kernels::EdgeStiffness{});
  for (const kernels::ElementBatch<Real>& batch : batches_) {
    const auto count =
        static_cast<std::size_t>(batch.begin[static_cast<std::size_t>(rows_.active)]);
    kernels::add_elements(batch, count, position, force, residual, edge_.data());
  }
}

template <typename Real>
void ElementForces<Real>::add_blocks(kernels::BlockInverse* block) const noexcept {
  kernels::add_edge_blocks(rows_, edge_.data(), block);
}

template <typename Real>
kernels::Float4 ElementForces<Real>::apply_stiffness(const float* home_N_per_m,
                                                     const kernels::Lanes* direction,
                                                     kernels::Lanes* product) const noexcept {
  return kernels::apply_edges(rows_, edge_.data(), home_N_per_m, direction, product);
}

template <typename Real>
void ElementForces<Real>::add_coarse_stiffness(const std::vector<std::uint8_t>& free,
                                               const kernels::CoarseGrid& coarse,
                                               Eigen::MatrixXf& stiffness) const {
  simulator::add_coarse_stiffness(rows_, edge_, free, coarse, stiffness);
}

template <typename Real>
double ElementForces<Real>::energy_J(const Position* position) const noexcept {
  double sum_J = 0.0;
  for (const Tetrahedron& element : elements_) {
    const ElementShape shape = element_shape(unstrained_m_, element);
    Eigen::Matrix3d f = Eigen::Matrix3d::Zero();
    for (std::size_t a = 1; a < 4; ++a) {
      const auto from = position[element.vertex[0]].xyz;
      const auto to = position[element.vertex[a]].xyz;
      const Eigen::Vector3d edge_m(static_cast<double>(to[0]) - static_cast<double>(from[0]),
                                   static_cast<double>(to[1]) - static_cast<double>(from[1]),
                                   static_cast<double>(to[2]) - static_cast<double>(from[2]));
      f += edge_m * shape.gradient_per_m[a].transpose();
    }
    sum_J += shape.volume_m3 *
             strain_energy_J_per_m3(materials_[static_cast<std::size_t>(element.material)], f);
  }
  return sum_J;
}

template class ElementForces<float>;
template class ElementForces<double>;

}  // namespace forcegrid::simulator
