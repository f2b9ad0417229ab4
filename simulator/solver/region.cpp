// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/region.h"

#include <algorithm>
#include <numeric>

namespace forcegrid::simulator {
namespace {

constexpr std::int32_t kNone = -1;

// Neighbours of every vertex, one after the other.
struct Neighbours {
  std::vector<std::int32_t> begin;
  std::vector<std::int32_t> vertex;
};

Neighbours find_neighbours(std::size_t vertices, std::span<const std::int32_t> first,
                           std::span<const std::int32_t> second) {
  Neighbours result;
  const std::size_t pairs = first.size();
  result.begin.assign(vertices + 1, 0);
  for (std::size_t s = 0; s < pairs; ++s) {
    ++result.begin[static_cast<std::size_t>(first[s]) + 1];
    ++result.begin[static_cast<std::size_t>(second[s]) + 1];
  }
  std::partial_sum(result.begin.begin(), result.begin.end(), result.begin.begin());
  result.vertex.resize(2 * pairs);
  std::vector<std::int32_t> next(result.begin.begin(), result.begin.end() - 1);
  for (std::size_t s = 0; s < pairs; ++s) {
    const std::int32_t a = first[s];
    const std::int32_t b = second[s];
    result.vertex[static_cast<std::size_t>(next[static_cast<std::size_t>(a)]++)] = b;
    result.vertex[static_cast<std::size_t>(next[static_cast<std::size_t>(b)]++)] = a;
  }
  return result;
}

}  // namespace

Region::Region(std::int32_t vertices)
    : level_begin_{0, vertices},
      level_of_(static_cast<std::size_t>(vertices), 0),
      place_(1, Eigen::Vector3d::Zero()) {}

std::vector<std::int32_t> Region::number_around(const std::vector<std::int32_t>& patch,
                                                const kernels::SpringRows& rows) {
  const auto springs = static_cast<std::size_t>(rows.row_begin.back());
  return number_around(patch, std::span(rows.owner).first(springs),
                       std::span(rows.other).first(springs));
}

std::vector<std::int32_t> Region::number_around(const std::vector<std::int32_t>& patch,
                                                std::span<const std::int32_t> first,
                                                std::span<const std::int32_t> second) {
  const std::size_t vertices = level_of_.size();
  const Neighbours neighbours = find_neighbours(vertices, first, second);
  std::vector<std::int32_t> order = patch;
  std::vector<std::int32_t> level(vertices, kNone);
  for (const std::int32_t i : patch) {
    level[static_cast<std::size_t>(i)] = 0;
  }
  level_begin_ = {0, static_cast<std::int32_t>(order.size())};
  while (level_begin_.back() > level_begin_[level_begin_.size() - 2]) {
    const auto from = static_cast<std::size_t>(level_begin_[level_begin_.size() - 2]);
    const auto last = static_cast<std::size_t>(level_begin_.back());
    for (std::size_t n = from; n < last; ++n) {
      const auto i = static_cast<std::size_t>(order[n]);
      for (std::int32_t k = neighbours.begin[i]; k < neighbours.begin[i + 1]; ++k) {
        const std::int32_t j = neighbours.vertex[static_cast<std::size_t>(k)];
        if (level[static_cast<std::size_t>(j)] == kNone) {
          level[static_cast<std::size_t>(j)] = static_cast<std::int32_t>(level_begin_.size()) - 1;
          order.push_back(j);
        }
      }
    }
    level_begin_.push_back(static_cast<std::int32_t>(order.size()));
  }
  level_begin_.pop_back();
  for (std::size_t i = 0; i < vertices; ++i) {
    if (level[i] == kNone) {
      order.push_back(static_cast<std::int32_t>(i));
    }
  }
  if (order.size() > static_cast<std::size_t>(level_begin_.back())) {
    level_begin_.push_back(static_cast<std::int32_t>(order.size()));
  }
  for (int l = 0; l < levels(); ++l) {
    std::fill(level_of_.begin() + level_begin_[static_cast<std::size_t>(l)],
              level_of_.begin() + level_begin_[static_cast<std::size_t>(l) + 1], l);
  }
  place_.assign(static_cast<std::size_t>(levels()), Eigen::Vector3d::Zero());
  solved_ = levels();
  return order;
}

std::int32_t Region::end_of(int levels_from_patch) const noexcept {
  return level_begin_[static_cast<std::size_t>(std::min(levels_from_patch, levels()))];
}

int Region::larger() const noexcept {
  return std::min(levels(), solved_ + std::max(1, solved_ / 5));
}

int Region::limited(int asked_levels, int vertices) const noexcept {
  int result = asked_levels;
  while (vertices > 0 && result > 1 && end_of(result) > vertices) {
    --result;
  }
  return result;
}

void Region::whole(kernels::Extent& extent) noexcept {
  solved_ = levels();
  extent.active = extent.reach = level_begin_.back();
}

void Region::set(int new_levels, const Eigen::Vector3d& displacement,
                 kernels::Extent& extent) noexcept {
  const int reached = std::min(solved_ + 2, levels());
  solved_ = new_levels;
  for (int l = std::min(solved_ + 2, levels()); l < reached; ++l) {
    place_[static_cast<std::size_t>(l)] = displacement;
  }
  extent.active = end_of(solved_ + 1);
  extent.reach = end_of(solved_ + 2);
}

void Region::leave_at(std::int32_t first, std::int32_t end,
                      const Eigen::Vector3d& displacement) noexcept {
  for (std::size_t l = 0; l < place_.size(); ++l) {
    if (level_begin_[l] >= first && level_begin_[l + 1] <= end) {
      place_[l] = displacement;
    }
  }
}

}  // namespace forcegrid::simulator
