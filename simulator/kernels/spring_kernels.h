#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace forcegrid::simulator::kernels {

/// Four numbers side by side, one SIMD register (GCC and Clang vector extension).
/// Lane 0 belongs to the positions, lanes 1 to 3 to the columns of the sensitivity S = dx/dP.
using Float4 = float __attribute__((vector_size(16)));
using Double4 = double __attribute__((vector_size(32)));

/// One vertex's position [m] or force [N] in double precision; w is 0. A class, since a container
/// of bare vector types would forget their alignment.
struct alignas(32) Precise {
  Double4 xyz;
};
struct alignas(16) Single {
  Float4 xyz;
};

/// The three components of one vertex, four lanes each: component[c][0] = x_c (or r_c),
/// component[c][1 + j] = dx_c / dP_j.
struct Lanes {
  Float4 component[3];
};

/// The symmetric 3 x 3 inverse of a vertex's diagonal block of K, and 1 for a free vertex; all zero
/// for a vertex that can't move freely.
struct BlockInverse {
  Float4 diagonal;      ///< xx, yy, zz, 1 if free
  Float4 off_diagonal;  ///< xy, yz, zx, 0
};

/// The springs, sorted by their lower vertex: those of vertex i are row_begin[i] ..
/// row_begin[i + 1] - 1 and lead from owner[] = i to other[] > i. Both lists, and every array with
/// an entry a spring, are padded to a multiple of kSpringPadding with springs from vertex 0 to
/// itself that no row contains.
struct SpringRows {
  std::vector<std::int32_t> row_begin;
  std::vector<std::int32_t> owner;
  std::vector<std::int32_t> other;
  /// The kernels work on the rows of the vertices below `active` alone, whose springs lead to
  /// vertices below `reach`: both are the number of vertices unless a part is solved by itself.
  std::int32_t active = 0;
  std::int32_t reach = 0;
  std::int32_t vertex_count() const { return static_cast<std::int32_t>(row_begin.size()) - 1; }
};
inline constexpr std::size_t kSpringPadding = 16;

/// What never changes of one spring with f = k l0 (sinh(a e) / a + c e^3), e = l / l0 - 1, where
/// sinh(a e) / a is e for a = 0.
template <typename Real>
struct SpringConstants {
  Real inverse_length_per_m;  ///< 1 / l0
  Real scale_N;               ///< k l0
  Real cubic;                 ///< c
  Real exponent;              ///< a; read only when evaluate() is told of exponential springs
};

/// What a spring contributes to K at the current state: H = w w^T + t I, with
/// w = sqrt(f' - f/l) u, u the unit vector along it and t = f / l. f' >= f/l for every law.
struct SpringTangent {
  float w_x, w_y, w_z;
  float t_N_per_m;
};

/// Forces and sensitivity residuals of the current state.
///   residual lane 0:  r = -dE/dx (springs' force on each vertex) [N]
///   residual lane j:  -(K S)_j [N/m]
/// with S from lanes 1-3 of `state`. Positions come from lane 0 of `state` in single precision
/// (`position` is scratch), or from `position` in double; then r is in `force` in full precision as
/// well, lane 0 of `state` is ignored and `t_N_per_m` is scratch.
/// @param exponential  whether any spring has an exponent; false saves the time.
void evaluate(const SpringRows& rows, const SpringConstants<float>* constants, bool exponential,
              const Lanes* state, Single* position, Lanes* residual,
              SpringTangent* tangent) noexcept;
void evaluate(const SpringRows& rows, const SpringConstants<double>* constants, bool exponential,
              const Lanes* state, const Precise* position, double* t_N_per_m, Precise* force,
              Lanes* residual, SpringTangent* tangent) noexcept;

/// block = sum of w w^T + max(t, 0) I over each vertex's springs, to be inverted by invert_block().
/// The clamp keeps the preconditioner positive; K itself is not clamped.
void sum_blocks(const SpringRows& rows, const SpringTangent* tangent, BlockInverse* block) noexcept;

/// product = K direction; `product` must be zero before.
/// @param home_N_per_m  a vertex's home spring each, see VertexForce; null: there are none.
/// @returns the lanes' dot products direction . product.
Float4 apply_stiffness(const SpringRows& rows, const SpringTangent* tangent,
                       const float* home_N_per_m, const Lanes* direction, Lanes* product) noexcept;

/// What pulls at a vertex besides the springs to others: a home spring to where it rests, and a
/// dead load, which keeps its direction and size.
struct VertexForce {
  double rest_m[3];
  double load_N[3];
  float home_stiffness_N_per_m;
};

/// Adds r += load - k_home (x - X) and, to lanes 1 to 3, -k_home S: to what evaluate() gave for the
/// same state.
void add_vertex_forces(std::span<const VertexForce> forces, const Lanes* state,
                       Lanes* residual) noexcept;
void add_vertex_forces(std::span<const VertexForce> forces, const Lanes* state,
                       const Precise* position, Precise* force, Lanes* residual) noexcept;

/// Adds the home springs to the blocks that sum_blocks() gave.
void add_home_blocks(std::span<const VertexForce> forces, BlockInverse* block) noexcept;

/// Their home springs alone, for apply_stiffness().
std::vector<float> home_stiffness_N_per_m(std::span<const VertexForce> forces);

/// Where a vertex lies in the coarse grid: its cell's lowest corner and its trilinear coordinates
/// there.
struct CoarsePlace {
  std::int32_t corner;
  float u, v, w;
};
/// A cell and its vertices, CoarseGrid::member[begin] to member[end - 1].
struct CoarseCell {
  std::int32_t corner, begin, end;
};
struct CoarseMember {
  std::int32_t vertex;
  float u, v, w;
};

/// Trilinear interpolation from a small regular grid over the object: the coarse half of the
/// preconditioner. An empty `place` switches it off.
struct CoarseGrid {
  std::int32_t node_count = 0;
  std::int32_t stride_y = 0;  ///< node number = x + stride_y y + stride_z z
  std::int32_t stride_z = 0;
  std::vector<CoarsePlace> place;  ///< one a vertex
  std::vector<CoarseCell> cell;    ///< the same cell by cell
  std::vector<CoarseMember> member;
  std::vector<float> inverse_m_per_N;  ///< (3 node_count)^2, row major: the coarse K's inverse
};

/// state += alpha direction; residual -= alpha product on free vertices; product = M residual, M
/// the block-Jacobi part; coarse_residual = P^T residual.
struct StepSums {
  Float4 preconditioned;  ///< residual . M residual
  Float4 former;          ///< the residual before the step . M residual
  Float4 squared;         ///< residual . residual over the free vertices
};
StepSums take_step(std::int32_t vertex_count, Float4 alpha, const BlockInverse* inverse,
                   const CoarseGrid& coarse, const Lanes* direction, Lanes* state, Lanes* residual,
                   Lanes* product, Lanes* coarse_residual) noexcept;

/// coarse_correction = (P^T K P)^-1 coarse_residual.
/// @returns the lanes' dot products of the two.
Float4 solve_coarse(const CoarseGrid& coarse, const Lanes* coarse_residual,
                    Lanes* coarse_correction) noexcept;

/// direction = product + P coarse_correction + beta direction; product = 0.
void next_direction(std::int32_t vertex_count, Float4 beta, const BlockInverse* inverse,
                    const CoarseGrid& coarse, const Lanes* coarse_correction, Lanes* direction,
                    Lanes* product) noexcept;

/// What a state amounts to, see ElasticObject: with R the residual's lanes,
///   force = sum_i S_i^T r_i (over all vertices: the patch has S = I, fixed ones S = 0)
///   stiffness = sum_i S_i^T (-K S)_i.
struct StateSums {
  double force_N[3];
  double stiffness_N_per_m[3][3];
  double residual_squared_N2;     ///< over the free vertices
  double sensitivity_squared[3];  ///< [N^2/m^2] |(K S)_j|^2 over the free vertices
};
/// @param force  null, or the forces in double precision, used instead of lane 0 of `residual`.
StateSums summarise(std::int32_t vertex_count, const BlockInverse* inverse, const Lanes* state,
                    const Lanes* residual, const Precise* force) noexcept;

/// Moves `state` to where the tool will be, to second order along the tool's last step:
///   x += (S + trend/2 (S - S_before)) step,   S += trend/2 (S - S_before),   before = old state
/// S goes half the way that it seems to go. An error that nothing corrects is multiplied from step
/// to step by the roots of (z - 1)(z - trend/2): for |trend| < 2 it stays bounded. With the whole
/// trend it would grow with every step, and set off corrections that a steady S spares.
/// @param trend  the step's component along the last one over the length of the last one; 0 for
///   the first-order x += S step alone.
void predict(std::int32_t vertex_count, const float step_m[3], float trend, Lanes* state,
             Lanes* before) noexcept;

/// Turns the sums that evaluate() gave into the block's inverse.
void invert_block(BlockInverse& block, bool free) noexcept;

}  // namespace forcegrid::simulator::kernels
