// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/spring_table.h"

#include <algorithm>
#include <numeric>

namespace forcegrid::simulator {

template <typename Real>
SpringTable<Real> make_spring_table(const SpringMesh& mesh) {
  SpringTable<Real> table;
  kernels::SpringRows& rows = table.rows;
  rows.row_begin.assign(mesh.rest_position_W.size() + 1, 0);
  for (const Spring& spring : mesh.springs) {
    ++rows.row_begin[static_cast<std::size_t>(std::min(spring.a, spring.b)) + 1];
  }
  for (std::size_t i = 0; i + 1 < rows.row_begin.size(); ++i) {
    rows.row_begin[i + 1] += rows.row_begin[i];
  }
  rows.active = rows.vertex_count();
  rows.reach = rows.active;
  table.springs = mesh.springs.size();
  const std::size_t padded = (table.springs + kernels::kSpringPadding - 1) /
                             kernels::kSpringPadding * kernels::kSpringPadding;
  rows.owner.resize(padded);
  rows.other.resize(padded);
  table.constants.resize(padded);
  table.mesh_spring.resize(table.springs);
  std::vector<std::int32_t> next(rows.row_begin.begin(), rows.row_begin.end() - 1);
  for (std::size_t number = 0; number < mesh.springs.size(); ++number) {
    const Spring& spring = mesh.springs[number];
    const auto a = static_cast<std::size_t>(std::min(spring.a, spring.b));
    const auto b = static_cast<std::size_t>(std::max(spring.a, spring.b));
    const auto at = static_cast<std::size_t>(next[a]++);
    const double length_m = natural_length_m(mesh, spring);
    const SpringLaw& law = mesh.laws[static_cast<std::size_t>(spring.law)];
    table.mesh_spring[at] = static_cast<std::int32_t>(number);
    rows.owner[at] = static_cast<std::int32_t>(a);
    rows.other[at] = static_cast<std::int32_t>(b);
    table.constants[at] = {
        static_cast<Real>(1.0 / length_m), static_cast<Real>(spring.stiffness_N_per_m * length_m),
        static_cast<Real>(law.cubic_coefficient), static_cast<Real>(law.exponent)};
    table.exponential = table.exponential || law.exponent > 0.0;
  }
  return table;
}

template SpringTable<float> make_spring_table(const SpringMesh&);
template SpringTable<double> make_spring_table(const SpringMesh&);

std::vector<kernels::VertexForce> make_vertex_forces(const SpringMesh& mesh,
                                                     const std::vector<Eigen::Vector3d>& rest_m) {
  std::vector<kernels::VertexForce> forces;
  if (mesh.home_stiffness_N_per_m.empty() && mesh.load_W_N.empty()) {
    return forces;
  }
  forces.resize(rest_m.size());
  for (std::size_t i = 0; i < rest_m.size(); ++i) {
    kernels::VertexForce& force = forces[i];
    for (int c = 0; c < 3; ++c) {
      force.rest_m[c] = rest_m[i][c];
      force.load_N[c] = mesh.load_W_N.empty() ? 0.0 : mesh.load_W_N[i][c];
    }
    force.home_stiffness_N_per_m = mesh.home_stiffness_N_per_m.empty()
                                       ? 0.0F
                                       : static_cast<float>(mesh.home_stiffness_N_per_m[i]);
  }
  return forces;
}

template <typename Real>
void renumber_springs(const std::vector<std::int32_t>& order, kernels::SpringRows& rows,
                      std::vector<kernels::SpringConstants<Real>>& constants) {
  std::vector<std::int32_t> number(order.size());
  for (std::size_t n = 0; n < order.size(); ++n) {
    number[static_cast<std::size_t>(order[n])] = static_cast<std::int32_t>(n);
  }
  struct Ends {
    std::int32_t low;
    std::int32_t high;
    std::size_t was;
  };
  std::vector<Ends> springs(static_cast<std::size_t>(rows.row_begin.back()));
  for (std::size_t s = 0; s < springs.size(); ++s) {
    const auto [low, high] = std::minmax({number[static_cast<std::size_t>(rows.owner[s])],
                                          number[static_cast<std::size_t>(rows.other[s])]});
    springs[s] = {low, high, s};
  }
  std::sort(springs.begin(), springs.end(), [](const Ends& a, const Ends& b) {
    return a.low != b.low ? a.low < b.low : a.high < b.high;
  });
  const std::vector<kernels::SpringConstants<Real>> before = constants;
  std::fill(rows.row_begin.begin(), rows.row_begin.end(), 0);
  for (std::size_t s = 0; s < springs.size(); ++s) {
    rows.owner[s] = springs[s].low;
    rows.other[s] = springs[s].high;
    constants[s] = before[springs[s].was];
    ++rows.row_begin[static_cast<std::size_t>(springs[s].low) + 1];
  }
  std::partial_sum(rows.row_begin.begin(), rows.row_begin.end(), rows.row_begin.begin());
}

template void renumber_springs(const std::vector<std::int32_t>&, kernels::SpringRows&,
                               std::vector<kernels::SpringConstants<float>>&);
template void renumber_springs(const std::vector<std::int32_t>&, kernels::SpringRows&,
                               std::vector<kernels::SpringConstants<double>>&);

}  // namespace forcegrid::simulator
