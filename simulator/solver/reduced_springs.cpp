// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/reduced_springs.h"

#include <algorithm>
#include <cassert>

#include "simulator/kernels/kernel_support.h"

namespace forcegrid::simulator {
namespace {

using kernels::Float4;
using kernels::Float8;
using kernels::load;
using kernels::Single;
using kernels::SpringTangent;
using kernels::store;

constexpr std::size_t kLanes = 8;
constexpr int kMost = kMostReducedCoordinates;
constexpr int kMostPairs = kMost * (kMost + 1) / 2;

// Lane sums, one register per coordinate and one per pair of coordinates j <= i: i (i + 1) / 2 + j.
struct Sums {
  alignas(32) float force[kMost][kLanes];
  alignas(32) float stiffness[kMostPairs][kLanes];
};

FORCEGRID_MULTIVERSION void place_edges(int n, std::size_t blocks, const float* edge,
                                        const float* basis, const float* z,
                                        Single* position) noexcept {
  for (std::size_t block = 0; block < blocks; ++block) {
    Float8 d[3];
    for (int c = 0; c < 3; ++c) {
      d[c] = load<Float8>(edge + (3 * block + static_cast<std::size_t>(c)) * kLanes);
    }
    const float* at = basis + block * 3 * static_cast<std::size_t>(n) * kLanes;
    for (int i = 0; i < n; ++i) {
      const Float8 z_i = Float8{} + z[i];
      for (int c = 0; c < 3; ++c, at += kLanes) {
        d[c] += z_i * load<Float8>(at);
      }
    }
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      position[1 + block * kLanes + lane].xyz = Float4{d[0][lane], d[1][lane], d[2][lane], 0.0F};
    }
  }
}

FORCEGRID_MULTIVERSION void add_block(int n, const float* basis, const Single* position,
                                      const SpringTangent* tangent, Sums* sums) noexcept {
  Float8 w[3];
  Float8 t;
  Float8 pull[3];  // t d
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    w[0][lane] = tangent[lane].w_x;
    w[1][lane] = tangent[lane].w_y;
    w[2][lane] = tangent[lane].w_z;
    t[lane] = tangent[lane].t_N_per_m;
    for (int c = 0; c < 3; ++c) {
      pull[c][lane] = position[lane].xyz[c];
    }
  }
  for (int c = 0; c < 3; ++c) {
    pull[c] *= t;
  }
  float* pair = &sums->stiffness[0][0];
  for (int i = 0; i < n; ++i) {
    const float* at = basis + static_cast<std::size_t>(i) * 3 * kLanes;
    const Float8 b[3] = {load<Float8>(at), load<Float8>(at + kLanes),
                         load<Float8>(at + 2 * kLanes)};
    store(sums->force[i],
          load<Float8>(sums->force[i]) - (b[0] * pull[0] + b[1] * pull[1] + b[2] * pull[2]));
    const Float8 along = w[0] * b[0] + w[1] * b[1] + w[2] * b[2];
    const Float8 h[3] = {w[0] * along + t * b[0], w[1] * along + t * b[1], w[2] * along + t * b[2]};
    const float* other = basis;
    for (int j = 0; j <= i; ++j, other += 3 * kLanes, pair += kLanes) {
      store(pair, load<Float8>(pair) + h[0] * load<Float8>(other) +
                      h[1] * load<Float8>(other + kLanes) +
                      h[2] * load<Float8>(other + 2 * kLanes));
    }
  }
}

double sum_of(const float* lanes) noexcept {
  double sum = 0.0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    sum += static_cast<double>(lanes[lane]);
  }
  return sum;
}

}  // namespace

ReducedSprings::ReducedSprings(int coordinates, const std::vector<Chosen>& chosen)
    : coordinates_(coordinates), count_(chosen.size()) {
  assert(coordinates >= 0 && coordinates <= kMost);
  const std::size_t padded =
      (count_ + kernels::kSpringPadding - 1) / kernels::kSpringPadding * kernels::kSpringPadding;
  const auto n = static_cast<std::size_t>(coordinates);
  edge_.resize(3 * padded / kLanes);
  basis_.resize(3 * n * padded / kLanes);
  rows_.row_begin.assign(padded + 2, static_cast<std::int32_t>(padded));
  rows_.row_begin.front() = 0;
  rows_.owner.assign(padded, 0);
  rows_.active = 1;
  rows_.reach = rows_.vertex_count();
  constants_.resize(padded);
  position_.resize(padded + 1);
  tangent_.resize(padded);
  for (std::size_t s = 0; s < padded; ++s) {
    rows_.other.push_back(static_cast<std::int32_t>(s + 1));
  }
  for (std::size_t s = 0; s < count_; ++s) {
    const Chosen& spring = chosen[s];
    assert(spring.basis.cols() == coordinates && spring.weight >= 0.0);
    const std::size_t block = s / kLanes;
    const std::size_t lane = s % kLanes;
    for (std::size_t c = 0; c < 3; ++c) {
      const auto row = static_cast<Eigen::Index>(c);
      edge_[3 * block + c].number[lane] = static_cast<float>(spring.edge_m[row]);
      for (std::size_t i = 0; i < n; ++i) {
        basis_[(block * n + i) * 3 + c].number[lane] =
            static_cast<float>(spring.basis(row, static_cast<Eigen::Index>(i)));
      }
    }
    constants_[s] = {static_cast<float>(spring.law.inverse_length_per_m),
                     static_cast<float>(spring.weight * spring.law.scale_N),
                     static_cast<float>(spring.law.cubic), static_cast<float>(spring.law.exponent)};
    exponential_ = exponential_ || spring.law.exponent > 0.0;
  }
}

std::size_t ReducedSprings::memory_bytes() const noexcept {
  const auto bytes = [](const auto&... vectors) {
    return (... + (vectors.capacity() * sizeof(*vectors.data())));
  };
  return bytes(edge_, basis_, rows_.row_begin, rows_.owner, rows_.other, constants_, position_,
               tangent_);
}

void ReducedSprings::evaluate(const double* z, double* force, double* stiffness) noexcept {
  const int n = coordinates_;
  const bool has_springs = !edge_.empty() && !basis_.empty();
  const std::size_t blocks = has_springs ? constants_.size() / kLanes : 0;
  float single_z[kMost] = {};
  std::transform(z, z + n, single_z, [](double number) { return static_cast<float>(number); });
  const float* edge = has_springs ? edge_.front().number : nullptr;
  const float* basis = has_springs ? basis_.front().number : nullptr;
  place_edges(n, blocks, edge, basis, single_z, position_.data());
  kernels::find_tangents(rows_, constants_.data(), exponential_, position_.data(), tangent_.data());
  Sums sums;
  std::fill_n(&sums.force[0][0], n * static_cast<int>(kLanes), 0.0F);
  std::fill_n(&sums.stiffness[0][0], n * (n + 1) / 2 * static_cast<int>(kLanes), 0.0F);
  for (std::size_t block = 0; block < blocks; ++block) {
    add_block(n, basis + block * 3 * static_cast<std::size_t>(n) * kLanes,
              &position_[1 + block * kLanes], &tangent_[block * kLanes], &sums);
  }
  int pair = 0;
  for (int i = 0; i < n; ++i) {
    force[i] = sum_of(sums.force[i]);
    for (int j = 0; j <= i; ++j, ++pair) {
      stiffness[i * n + j] = stiffness[j * n + i] = sum_of(sums.stiffness[pair]);
    }
  }
}

}  // namespace forcegrid::simulator
