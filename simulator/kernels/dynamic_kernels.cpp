// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/dynamic_kernels.h"

#include <algorithm>
#include <cmath>

#include "simulator/kernels/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

FORCEGRID_INLINE Double4 all(double value) { return Double4{value, value, value, value}; }
FORCEGRID_INLINE double sum_of(Double4 v) { return v[0] + v[1] + v[2]; }

FORCEGRID_MULTIVERSION void apply_springs(const SpringRows& rows, const StepSpring* step,
                                          const double* inertia_kg, const Precise* direction,
                                          Precise* product) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    product[i].xyz = all(inertia_kg[i]) * direction[i].xyz;
  }
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Double4 here = direction[i].xyz;
    Double4 sum = product[i].xyz;
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const Double4 q = step[s].q_and_b;
      const Double4 d = here - direction[rows.other[s]].xyz;
      // d[3] is zero, so that b does not enter.
      const Double4 f = all(sum_of(q * d)) * q + all(q[3]) * d;
      const Double4 pull{f[0], f[1], f[2], 0.0};
      sum += pull;
      product[rows.other[s]].xyz -= pull;
    }
    product[i].xyz = sum;
  }
}

FORCEGRID_MULTIVERSION void add_forces(const SpringRows& rows, const double* t_N_per_m,
                                       const Precise* position, Precise* force) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Double4 here = position[i].xyz;
    Double4 sum = force[i].xyz;
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const Double4 f = all(t_N_per_m[s]) * (position[rows.other[s]].xyz - here);
      sum += f;
      force[rows.other[s]].xyz -= f;
    }
    force[i].xyz = sum;
  }
}

FORCEGRID_MULTIVERSION void add_edge_products_to(const SpringRows& rows, const EdgeStiffness* edge,
                                                 const double* scale, const Precise* direction,
                                                 Precise* product) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    const Double4 here = direction[i].xyz;
    Double4 sum = product[i].xyz;
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const Double4 x = __builtin_convertvector(edge[s].row[0], Double4);
      const Double4 y = __builtin_convertvector(edge[s].row[1], Double4);
      const Double4 z = __builtin_convertvector(edge[s].row[2], Double4);
      const Double4 d = all(scale[i]) * (here - direction[rows.other[s]].xyz);
      sum += Double4{sum_of(x * d), sum_of(y * d), sum_of(z * d), 0.0};
      product[rows.other[s]].xyz -= all(d[0]) * x + all(d[1]) * y + all(d[2]) * z;
    }
    product[i].xyz = sum;
  }
}

FORCEGRID_MULTIVERSION void descend_on(std::size_t count, double alpha, const std::uint8_t* free,
                                       const SymmetricBlock* inverse, const Precise* direction,
                                       Precise* solution, Precise* residual, Precise* product,
                                       DescentSums* sums) noexcept {
  Double4 squared{};
  Double4 preconditioned{};
  for (std::size_t i = 0; i < count; ++i) {
    solution[i].xyz += all(alpha) * direction[i].xyz;
    const Double4 r =
        all(free[i] != 0 ? 1.0 : 0.0) * (residual[i].xyz - all(alpha) * product[i].xyz);
    const Double4 o = inverse[i].off_diagonal;
    // Rows: (xx, xy, zx), (xy, yy, yz), (zx, yz, zz).
    const Double4 z =
        inverse[i].diagonal * r + Double4{o[0] * r[1] + o[2] * r[2], o[0] * r[0] + o[1] * r[2],
                                          o[1] * r[1] + o[2] * r[0], 0.0};
    residual[i].xyz = r;
    product[i].xyz = z;
    squared += r * r;
    preconditioned += r * z;
  }
  sums->squared = sum_of(squared);
  sums->preconditioned = sum_of(preconditioned);
}

void invert(SymmetricBlock& m) {
  const double xx = m.diagonal[0], yy = m.diagonal[1], zz = m.diagonal[2];
  const double xy = m.off_diagonal[0], yz = m.off_diagonal[1], zx = m.off_diagonal[2];
  const double c_x = yy * zz - yz * yz;
  const double c_y = yz * zx - xy * zz;
  const double c_z = xy * yz - yy * zx;
  const double scale = 1.0 / (xx * c_x + xy * c_y + zx * c_z);
  m.diagonal = all(scale) * Double4{c_x, xx * zz - zx * zx, xx * yy - xy * xy, 0.0};
  m.off_diagonal = all(scale) * Double4{c_y, xy * zx - xx * yz, c_z, 0.0};
}

}  // namespace

void make_step_springs(std::size_t count, const SpringTangent* tangent, const double* t_N_per_m,
                       const double* damper_Ns_per_m, double step_s, StepSpring* step) noexcept {
  for (std::size_t s = 0; s < count; ++s) {
    const auto x = static_cast<double>(tangent[s].w_x);
    const auto y = static_cast<double>(tangent[s].w_y);
    const auto z = static_cast<double>(tangent[s].w_z);
    const double squared = x * x + y * y + z * z;  // f' - f/l
    const double slope_N_per_m = std::max(squared + std::min(t_N_per_m[s], 0.0), 0.0);
    const double scale =
        squared > 0.0
            ? std::sqrt((step_s * step_s * slope_N_per_m + step_s * damper_Ns_per_m[s]) / squared)
            : 0.0;
    step[s].q_and_b =
        Double4{scale * x, scale * y, scale * z, step_s * step_s * std::max(t_N_per_m[s], 0.0)};
  }
}

void add_spring_forces(const SpringRows& rows, const double* t_N_per_m, const Precise* position,
                       Precise* force) noexcept {
  add_forces(rows, t_N_per_m, position, force);
}

void add_damper_forces(const SpringRows& rows, const SpringTangent* tangent,
                       const double* damper_Ns_per_m, const Precise* velocity,
                       Precise* force) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const Double4 w{static_cast<double>(tangent[s].w_x), static_cast<double>(tangent[s].w_y),
                      static_cast<double>(tangent[s].w_z), 0.0};
      const double squared = sum_of(w * w);
      if (!(squared > 0.0)) {
        continue;
      }
      const double rate = sum_of(w * (velocity[rows.other[s]].xyz - velocity[i].xyz));
      const Double4 f = all(damper_Ns_per_m[s] * rate / squared) * w;
      force[i].xyz += f;
      force[rows.other[s]].xyz -= f;
    }
  }
}

void apply_step_matrix(const SpringRows& rows, const StepSpring* step, const double* inertia_kg,
                       const Precise* direction, Precise* product) noexcept {
  apply_springs(rows, step, inertia_kg, direction, product);
}

void sum_step_blocks(const SpringRows& rows, const StepSpring* step, const double* inertia_kg,
                     SymmetricBlock* block) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    block[i].diagonal = Double4{inertia_kg[i], inertia_kg[i], inertia_kg[i], 0.0};
    block[i].off_diagonal = Double4{};
  }
  for (std::int32_t i = 0; i < vertices; ++i) {
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const Double4 q = step[s].q_and_b;
      const Double4 diagonal =
          Double4{q[0] * q[0] + q[3], q[1] * q[1] + q[3], q[2] * q[2] + q[3], 0.0};
      const Double4 off_diagonal{q[0] * q[1], q[1] * q[2], q[2] * q[0], 0.0};
      block[i].diagonal += diagonal;
      block[i].off_diagonal += off_diagonal;
      block[rows.other[s]].diagonal += diagonal;
      block[rows.other[s]].off_diagonal += off_diagonal;
    }
  }
}

void invert_step_blocks(std::size_t count, const std::uint8_t* free,
                        SymmetricBlock* block) noexcept {
  for (std::size_t i = 0; i < count; ++i) {
    if (free[i] != 0) {
      invert(block[i]);
    } else {
      block[i] = SymmetricBlock{};
    }
  }
}

void add_edge_products(const SpringRows& rows, const EdgeStiffness* edge, const double* scale,
                       const Precise* direction, Precise* product) noexcept {
  add_edge_products_to(rows, edge, scale, direction, product);
}

void add_edge_step_blocks(const SpringRows& rows, const EdgeStiffness* edge, const double* scale,
                          SymmetricBlock* block) noexcept {
  const std::int32_t vertices = rows.vertex_count();
  for (std::int32_t i = 0; i < vertices; ++i) {
    for (std::int32_t s = rows.row_begin[i]; s < rows.row_begin[i + 1]; ++s) {
      const auto h = [&edge, s](int c, int d) { return static_cast<double>(edge[s].row[c][d]); };
      SymmetricBlock& there = block[rows.other[s]];
      const Double4 diagonal = all(scale[i]) * Double4{h(0, 0), h(1, 1), h(2, 2), 0.0};
      block[i].diagonal += diagonal;
      there.diagonal += diagonal;
      block[i].off_diagonal += all(scale[i]) * Double4{h(0, 1), h(1, 2), h(2, 0), 0.0};
      there.off_diagonal += all(scale[i]) * Double4{h(1, 0), h(2, 1), h(0, 2), 0.0};
    }
  }
}

DescentSums descend(std::size_t count, double alpha, const std::uint8_t* free,
                    const SymmetricBlock* inverse, const Precise* direction, Precise* solution,
                    Precise* residual, Precise* product) noexcept {
  DescentSums sums;
  descend_on(count, alpha, free, inverse, direction, solution, residual, product, &sums);
  return sums;
}

void turn_direction(std::size_t count, double beta, const Precise* product,
                    Precise* direction) noexcept {
  for (std::size_t i = 0; i < count; ++i) {
    direction[i].xyz = product[i].xyz + all(beta) * direction[i].xyz;
  }
}

double dot(std::size_t count, const Precise* a, const Precise* b) noexcept {
  Double4 sum{};
  for (std::size_t i = 0; i < count; ++i) {
    sum += a[i].xyz * b[i].xyz;
  }
  return sum_of(sum);
}

}  // namespace forcegrid::simulator::kernels
