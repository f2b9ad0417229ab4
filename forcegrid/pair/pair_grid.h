// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "forcegrid/core/pair_force_method.h"
#include "forcegrid/core/radial_weight.h"

namespace forcegrid::pair {

/// A grid over R^6 whose vertices hold the weighted mean of the samples near them, in blocks of 2^6
/// vertices that come from a fixed pool where samples need them.
///
///   F_v = sum_k w(|p_k - v|) F_k / sum_k w(|p_k - v|)   over the samples within r
///   F(p) = sum over the 64 vertices of p's cell of  prod_a (u_a or 1 - u_a)  F_v
///
/// Vertices lie at multiples of the spacing h. When the pool is used up, a block gives way to a new
/// one: of the next kLooks in the pool's order the farthest from the tools.
///
/// A sample is spread in pieces: begin() and then spread() until it returns 0; each piece is one
/// block. Source: the forcegrid paper, section 5 (weights) and its outlook (six dimensions).
/// Real-time: no allocation, lock or throw after construction. Threads: one.
class PairGrid {
 public:
  static constexpr int kVerticesOfABlock = 64;
  static constexpr int kVerticesOfACell = 64;
  static constexpr int kLooks = 64;
  /// Blocks along each axis, around the origin.
  static constexpr int kBlocksAlong = 1024;

  /// @param spacing_m h, above 0. @param weight w, whose radius is r, at most kMostRadius h.
  /// @param blocks capacity of the pool, above 0.
  PairGrid(double spacing_m, const RadialWeight& weight, int blocks);
  static constexpr double kMostRadius = 4.0;

  std::size_t memory_bytes() const noexcept;
  double spacing_m() const noexcept { return spacing_m_; }
  int blocks_used() const noexcept { return used_; }
  std::uint64_t blocks_given_up() const noexcept { return given_up_; }

  void clear() noexcept;

  bool contains(const PairVector& p_m) const noexcept;

  /// Begins to spread a sample; the last one must be finished, and `p_m` be contained.
  void begin(const PairVector& p_m, const PairVector& force_N) noexcept;
  /// Does the next block. @returns the vertices that it looked at; 0 if nothing was left.
  int spread() noexcept;

  struct Reading {
    PairVector force_N;  ///< summed over the known vertices alone
    double known;        ///< their share of the weights, 0 to 1
  };
  /// The multilinear read; `p_m` must be contained.
  Reading read(const PairVector& p_m) const noexcept;

 private:
  static constexpr std::int32_t kNone = -1;

  /// The six forces [N], the sum of the samples' weights (0: none was near), and padding.
  using Vertex = std::array<float, 8>;
  static constexpr std::size_t kWeight = 6;
  struct alignas(64) Block {
    std::array<Vertex, kVerticesOfABlock> vertices{};
  };
  using Index = std::array<int, 6>;  ///< of a vertex, or of a block

  static std::uint64_t key_of(const Index& block) noexcept;
  std::size_t place_of(std::uint64_t key) const noexcept;
  std::int32_t find(std::uint64_t key) const noexcept;
  std::int32_t obtain(const Index& block) noexcept;
  std::int32_t victim() noexcept;
  void forget(std::uint64_t key) noexcept;
  bool advance_block() noexcept;
  double distance_m2(const Index& block) const noexcept;
  void spread_to(const Index& block, Block& vertices) const noexcept;

  double spacing_m_;
  RadialWeight weight_;
  std::vector<Block> pool_;
  std::vector<Index> where_;          ///< of each block of the pool
  std::vector<std::uint64_t> keys_;   ///< hash table with open addressing; 0: free
  std::vector<std::int32_t> values_;  ///< index in the pool of each key
  int used_ = 0;
  std::size_t hand_ = 0;  ///< where the next victim is looked for
  std::uint64_t given_up_ = 0;

  PairVector sample_m_ = PairVector::Zero();
  PairVector sample_N_ = PairVector::Zero();
  bool spreading_ = false;
  Index first_{};  ///< blocks that the sample may reach
  Index last_{};
  Index next_{};
};

}  // namespace forcegrid::pair
