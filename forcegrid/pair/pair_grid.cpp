// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace forcegrid::pair {
namespace {

constexpr int kHalfAlong = PairGrid::kBlocksAlong / 2;
constexpr int kBitsOfAnAxis = 10;
static_assert(PairGrid::kBlocksAlong == 1 << kBitsOfAnAxis);
constexpr std::uint64_t kUsed = std::uint64_t{1} << (6 * kBitsOfAnAxis);  // no key is zero

int floor_of(double x) noexcept { return static_cast<int>(std::floor(x)); }
// Vertices 2k and 2k + 1 belong to block k, also below zero.
int block_of(int vertex) noexcept { return vertex >> 1; }

}  // namespace

PairGrid::PairGrid(double spacing_m, const RadialWeight& weight, int blocks)
    : spacing_m_(spacing_m),
      weight_(weight),
      pool_(static_cast<std::size_t>(blocks)),
      where_(static_cast<std::size_t>(blocks)),
      keys_(std::bit_ceil(2 * static_cast<std::size_t>(blocks)), 0),
      values_(keys_.size(), kNone) {}

std::size_t PairGrid::memory_bytes() const noexcept {
  return sizeof(*this) + pool_.size() * sizeof(Block) + where_.size() * sizeof(Index) +
         keys_.size() * (sizeof(std::uint64_t) + sizeof(std::int32_t));
}

// Blocks are emptied when they are used again.
void PairGrid::clear() noexcept {
  std::fill(keys_.begin(), keys_.end(), 0);
  used_ = 0;
  hand_ = 0;
  spreading_ = false;
}

bool PairGrid::contains(const PairVector& p_m) const noexcept {
  // A sample on the border reaches kMostRadius h further.
  const double most_m = (2.0 * (kHalfAlong - 2) - kMostRadius) * spacing_m_;
  return p_m.cwiseAbs().maxCoeff() < most_m;
}

std::uint64_t PairGrid::key_of(const Index& block) noexcept {
  std::uint64_t key = kUsed;
  for (std::size_t a = 0; a < block.size(); ++a) {
    key |= static_cast<std::uint64_t>(block[a] + kHalfAlong) << (kBitsOfAnAxis * a);
  }
  return key;
}

// Where the search for a key begins. Source: Knuth, TAOCP 3, section 6.4, multiplicative hashing.
std::size_t PairGrid::place_of(std::uint64_t key) const noexcept {
  const int bits = std::countr_zero(keys_.size());
  return static_cast<std::size_t>((key * 0x9E3779B97F4A7C15U) >> (64 - bits));
}

std::int32_t PairGrid::find(std::uint64_t key) const noexcept {
  const std::size_t mask = keys_.size() - 1;
  for (std::size_t i = place_of(key); keys_[i] != 0; i = (i + 1) & mask) {
    if (keys_[i] == key) {
      return values_[i];
    }
  }
  return kNone;
}

// Removes a key that is there, and moves those behind it that a search would no longer find.
void PairGrid::forget(std::uint64_t key) noexcept {
  const std::size_t mask = keys_.size() - 1;
  std::size_t hole = place_of(key);
  while (keys_[hole] != key) {
    hole = (hole + 1) & mask;
  }
  for (std::size_t i = (hole + 1) & mask; keys_[i] != 0; i = (i + 1) & mask) {
    const std::size_t home = place_of(keys_[i]);
    if (((i - home) & mask) >= ((i - hole) & mask)) {
      keys_[hole] = keys_[i];
      values_[hole] = values_[i];
      hole = i;
    }
  }
  keys_[hole] = 0;
}

// The farthest from the newest sample of the next few blocks.
std::int32_t PairGrid::victim() noexcept {
  std::size_t farthest = hand_;
  double farthest_m2 = -1.0;
  for (int look = 0; look < kLooks; ++look) {
    const double d2 = distance_m2(where_[hand_]);
    if (d2 > farthest_m2) {
      farthest_m2 = d2;
      farthest = hand_;
    }
    hand_ = hand_ + 1 == pool_.size() ? 0 : hand_ + 1;
  }
  return static_cast<std::int32_t>(farthest);
}

std::int32_t PairGrid::obtain(const Index& block) noexcept {
  const std::uint64_t key = key_of(block);
  std::int32_t slot = find(key);
  if (slot != kNone) {
    return slot;
  }
  if (used_ < static_cast<int>(pool_.size())) {
    slot = used_++;
  } else {
    slot = victim();
    forget(key_of(where_[static_cast<std::size_t>(slot)]));
    ++given_up_;
  }
  pool_[static_cast<std::size_t>(slot)] = Block{};
  where_[static_cast<std::size_t>(slot)] = block;
  const std::size_t mask = keys_.size() - 1;
  std::size_t i = place_of(key);
  while (keys_[i] != 0) {
    i = (i + 1) & mask;
  }
  keys_[i] = key;
  values_[i] = slot;
  return slot;
}

// Squared distance of the sample from the nearest vertex of a block, at most.
double PairGrid::distance_m2(const Index& block) const noexcept {
  double sum = 0.0;
  for (std::size_t a = 0; a < block.size(); ++a) {
    const double low_m = 2 * block[a] * spacing_m_;
    const double x_m = sample_m_[static_cast<Eigen::Index>(a)];
    const double beyond_m = std::max({low_m - x_m, x_m - low_m - spacing_m_, 0.0});
    sum += beyond_m * beyond_m;
  }
  return sum;
}

void PairGrid::begin(const PairVector& p_m, const PairVector& force_N) noexcept {
  sample_m_ = p_m;
  sample_N_ = force_N;
  spreading_ = true;
  for (std::size_t a = 0; a < first_.size(); ++a) {
    const double x_m = p_m[static_cast<Eigen::Index>(a)];
    first_[a] = block_of(floor_of((x_m - weight_.influence_radius_m) / spacing_m_));
    last_[a] = block_of(floor_of((x_m + weight_.influence_radius_m) / spacing_m_));
  }
  next_ = first_;
}

// @returns false after the last block.
bool PairGrid::advance_block() noexcept {
  for (std::size_t a = 0; a < next_.size(); ++a) {
    if (next_[a] < last_[a]) {
      ++next_[a];
      return true;
    }
    next_[a] = first_[a];
  }
  return false;
}

int PairGrid::spread() noexcept {
  if (!spreading_) {
    return 0;
  }
  const double reach_m2 = weight_.influence_radius_m * weight_.influence_radius_m;
  int looked_at = 1;
  if (distance_m2(next_) < reach_m2) {
    spread_to(next_, pool_[static_cast<std::size_t>(obtain(next_))]);
    looked_at = kVerticesOfABlock;
  }
  spreading_ = advance_block();
  return looked_at;
}

void PairGrid::spread_to(const Index& block, Block& vertices) const noexcept {
  for (std::size_t v = 0; v < vertices.vertices.size(); ++v) {
    double d2 = 0.0;
    for (std::size_t a = 0; a < block.size(); ++a) {
      const double at_m = (2 * block[a] + static_cast<int>((v >> a) & 1U)) * spacing_m_;
      const double d_m = sample_m_[static_cast<Eigen::Index>(a)] - at_m;
      d2 += d_m * d_m;
    }
    const double distance_m = std::sqrt(d2);
    if (!(distance_m < weight_.influence_radius_m)) {
      continue;
    }
    Vertex& vertex = vertices.vertices[v];
    const auto w = static_cast<float>(weight_.weight(distance_m));
    if (!(w > 0.0F)) {
      continue;
    }
    vertex[kWeight] += w;
    const float share = w / vertex[kWeight];
    for (std::size_t a = 0; a < 6; ++a) {
      const auto sample_N = static_cast<float>(sample_N_[static_cast<Eigen::Index>(a)]);
      vertex[a] += share * (sample_N - vertex[a]);
    }
  }
}

PairGrid::Reading PairGrid::read(const PairVector& p_m) const noexcept {
  Index block{};
  unsigned odd = 0;  // axes along which the cell lies in two blocks
  std::array<float, kVerticesOfACell> share;
  share[0] = 1.0F;
  for (std::size_t a = 0; a < block.size(); ++a) {
    const double cells = p_m[static_cast<Eigen::Index>(a)] / spacing_m_;
    const int vertex = floor_of(cells);
    block[a] = block_of(vertex);
    odd |= static_cast<unsigned>(vertex & 1) << a;
    const auto u = static_cast<float>(cells - vertex);
    for (std::size_t corner = 0; corner < (std::size_t{1} << a); ++corner) {
      share[corner + (std::size_t{1} << a)] = share[corner] * u;
      share[corner] *= 1.0F - u;
    }
  }
  Vertex sum{};
  float known = 0.0F;
  const unsigned even = ~odd & (kVerticesOfACell - 1U);
  for (unsigned next = odd;; next = (next - 1) & odd) {  // the blocks: all subsets of `odd`
    Index of_block = block;
    for (std::size_t a = 0; a < of_block.size(); ++a) {
      of_block[a] += static_cast<int>((next >> a) & 1U);
    }
    const std::int32_t slot = find(key_of(of_block));
    if (slot != kNone) {
      const Block& vertices = pool_[static_cast<std::size_t>(slot)];
      for (unsigned within = even;; within = (within - 1) & even) {  // all subsets of `even`
        const Vertex& vertex = vertices.vertices[within | (odd & ~next)];
        const float w = share[within | next];
        for (std::size_t a = 0; a < sum.size(); ++a) {
          sum[a] += w * vertex[a];
        }
        known += vertex[kWeight] > 0.0F ? w : 0.0F;
        if (within == 0) {
          break;
        }
      }
    }
    if (next == 0) {
      break;
    }
  }
  Reading reading{PairVector::Zero(), static_cast<double>(known)};
  for (std::size_t a = 0; a < 6; ++a) {
    reading.force_N[static_cast<Eigen::Index>(a)] = static_cast<double>(sum[a]);
  }
  return reading;
}

}  // namespace forcegrid::pair
