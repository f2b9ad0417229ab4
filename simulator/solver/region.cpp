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

Neighbours find_neighbours(const kernels::SpringRows& rows) {
  Neighbours result;
  const auto vertices = static_cast<std::size_t>(rows.vertex_count());
  const auto springs = static_cast<std::size_t>(rows.row_begin.back());
  result.begin.assign(vertices + 1, 0);
  for (std::size_t s = 0; s < springs; ++s) {
    ++result.begin[static_cast<std::size_t>(rows.owner[s]) + 1];
    ++result.begin[static_cast<std::size_t>(rows.other[s]) + 1];
  }
  std::partial_sum(result.begin.begin(), result.begin.end(), result.begin.begin());
  result.vertex.resize(2 * springs);
  std::vector<std::int32_t> next(result.begin.begin(), result.begin.end() - 1);
  for (std::size_t s = 0; s < springs; ++s) {
    const std::int32_t a = rows.owner[s];
    const std::int32_t b = rows.other[s];
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
  const Neighbours neighbours = find_neighbours(rows);
  const auto vertices = static_cast<std::size_t>(rows.vertex_count());
  std::vector<std::int32_t> order = patch;
  std::vector<std::int32_t> level(vertices, kNone);
  for (const std::int32_t i : patch) {
    level[static_cast<std::size_t>(i)] = 0;
  }
  level_begin_ = {0, static_cast<std::int32_t>(order.size())};
  while (level_begin_.back() > level_begin_[level_begin_.size() - 2]) {
    const auto first = static_cast<std::size_t>(level_begin_[level_begin_.size() - 2]);
    const auto last = static_cast<std::size_t>(level_begin_.back());
    for (std::size_t n = first; n < last; ++n) {
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

void Region::whole(kernels::SpringRows& rows) noexcept {
  solved_ = levels();
  rows.active = rows.reach = level_begin_.back();
}

void Region::set(int new_levels, const Eigen::Vector3d& displacement,
                 kernels::SpringRows& rows) noexcept {
  const int reached = std::min(solved_ + 2, levels());
  solved_ = new_levels;
  for (int l = std::min(solved_ + 2, levels()); l < reached; ++l) {
    place_[static_cast<std::size_t>(l)] = displacement;
  }
  rows.active = end_of(solved_ + 1);
  rows.reach = end_of(solved_ + 2);
}

void Region::leave_at(std::int32_t first, std::int32_t end,
                      const Eigen::Vector3d& displacement) noexcept {
  for (std::size_t l = 0; l < place_.size(); ++l) {
    if (level_begin_[l] >= first && level_begin_[l + 1] <= end) {
      place_[l] = displacement;
    }
  }
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
