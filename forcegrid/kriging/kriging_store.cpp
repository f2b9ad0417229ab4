// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_store.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "forcegrid/kriging/dictionary_rules.h"

namespace forcegrid::kriging {
namespace {

constexpr double kDoubtedMore = 10.0;  // nuggets
constexpr int kThinningLooks = 32;
constexpr double kThinningReach_m2 = 1e-4;
constexpr double kFarFromTool_m = 0.040;

// A cell's coordinates within +-2^20 cells, 10 km.
constexpr double kCellOffset = 1048576.0;
constexpr double kLastCell = 2097151.0;

struct CellStep {
  std::int8_t x, y, z;
};

// The cells around one, the nearest first.
template <std::size_t kCount, int kReach>
constexpr std::array<CellStep, kCount> shells(int first_shell) {
  std::array<CellStep, kCount> steps{};
  std::size_t count = 0;
  for (int square = 0; square <= 3 * kReach * kReach; ++square) {
    for (int x = -kReach; x <= kReach; ++x) {
      for (int y = -kReach; y <= kReach; ++y) {
        for (int z = -kReach; z <= kReach; ++z) {
          const int shell = std::max({x < 0 ? -x : x, y < 0 ? -y : y, z < 0 ? -z : z});
          if (x * x + y * y + z * z == square && shell >= first_shell) {
            steps[count++] = {static_cast<std::int8_t>(x), static_cast<std::int8_t>(y),
                              static_cast<std::int8_t>(z)};
          }
        }
      }
    }
  }
  return steps;
}
constexpr std::array<CellStep, 27> kNextCells = shells<27, 1>(0);
constexpr std::array<CellStep, 98> kFurtherCells = shells<98, 2>(2);

}  // namespace

SampleStore::SampleStore(const Settings& settings) noexcept
    : settings_(settings),
      doubt_N2_(settings.capacity, 0.0F),
      rest_(settings.capacity, Rest{}),
      buckets_(std::bit_ceil(settings.capacity), kNone) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    place_[axis] = Buffer<float>(settings.capacity, 0.0F);
    force_[axis] = Buffer<float>(settings.capacity, 0.0F);
  }
}

bool SampleStore::allocated() const noexcept {
  bool all = doubt_N2_.allocated() && rest_.allocated() && buckets_.allocated();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    all = all && place_[axis].allocated() && force_[axis].allocated();
  }
  return all;
}

std::size_t SampleStore::memory_bytes() const noexcept {
  return sizeof(*this) + 6 * place_[0].bytes() + doubt_N2_.bytes() + rest_.bytes() +
         buckets_.bytes();
}

std::uint64_t SampleStore::cell_of(const Eigen::Vector3d& position_m, int dx, int dy,
                                   int dz) noexcept {
  const int step[3] = {dx, dy, dz};
  std::uint64_t cell = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double index = std::floor(position_m[axis] / kCell_m) + step[axis] + kCellOffset;
    cell = cell << 21 | static_cast<std::uint64_t>(std::clamp(index, 0.0, kLastCell));
  }
  return cell;
}

// Multiplicative hashing by the golden ratio (Knuth, The Art of Computer Programming 3, 6.4).
std::size_t SampleStore::bucket_of(std::uint64_t cell) const noexcept {
  return static_cast<std::size_t>((cell * 0x9E3779B97F4A7C15U) >> 32) & (buckets_.size() - 1);
}

void SampleStore::link(std::uint32_t number) noexcept {
  std::uint32_t& newest = buckets_[bucket_of(rest_[number].cell)];
  rest_[number].next = newest;
  newest = number;
}

void SampleStore::unlink(std::uint32_t number) noexcept {
  std::uint32_t* at = &buckets_[bucket_of(rest_[number].cell)];
  while (*at != number) {
    at = &rest_[*at].next;
  }
  *at = rest_[number].next;
}

void SampleStore::put(std::uint32_t number, const Observation& o) noexcept {
  Rest& rest = rest_[number];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    place_[axis][number] = rest.first_position_m[axis] = static_cast<float>(o.position_m[a]);
    force_[axis][number] = rest.first_force_N[axis] = static_cast<float>(o.force_N[a]);
  }
  doubt_N2_[number] = 0.0F;
  rest.cell = cell_of(o.position_m, 0, 0, 0);
  rest.contact = o.contact;
  rest.from_query = o.from_query;
  link(number);
}

// The stored sample nearest to an observation by the distance of admission, if it is less than the
// spacing away. The spacing is less than a cell, so only neighbouring cells are searched.
SampleStore::Nearest SampleStore::nearest(const Observation& o) const noexcept {
  Nearest result;
  const double reach_m = settings_.spacing.metres;
  result.distance_m2 = reach_m * reach_m;
  std::array<std::uint64_t, 8> cells;
  std::size_t count = 0;
  // The cells that a cube of half the spacing reaches.
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d at(o.position_m.x() + ((corner & 1) != 0 ? 1.0 : -1.0) * reach_m,
                             o.position_m.y() + ((corner & 2) != 0 ? 1.0 : -1.0) * reach_m,
                             o.position_m.z() + ((corner & 4) != 0 ? 1.0 : -1.0) * reach_m);
    const std::uint64_t cell = cell_of(at, 0, 0, 0);
    if (std::find(cells.begin(), cells.begin() + count, cell) == cells.begin() + count) {
      cells[count++] = cell;
    }
  }
  int looks = 0;
  for (std::size_t c = 0; c < count; ++c) {
    for (std::uint32_t n = buckets_[bucket_of(cells[c])]; n != kNone && looks < kMostLooks;
         n = rest_[n].next, ++looks) {
      const double moved_m2 = (position_m(n).cast<double>() - o.position_m).squaredNorm();
      if (moved_m2 >= result.distance_m2) {
        continue;
      }
      const double changed_N2 = (force_N(n).cast<double>() - o.force_N).squaredNorm();
      const double distance_m2 = settings_.spacing.distance_m2(moved_m2, changed_N2);
      if (distance_m2 < result.distance_m2) {
        result = {n, distance_m2};
      }
    }
  }
  return result;
}

SampleStore::Admission SampleStore::admit(const Observation& o) noexcept {
  const Nearest near = nearest(o);
  if (near.number != kNone) {
    Rest& rest = rest_[near.number];
    double changed_N2 = 0.0;
    double moved_m2 = 0.0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<Eigen::Index>(axis);
      const double moved_m = o.position_m[a] - rest.first_position_m[axis];
      const double changed_N = o.force_N[a] - rest.first_force_N[axis];
      moved_m2 += moved_m * moved_m;
      changed_N2 += changed_N * changed_N;
    }
    const bool repeated = settings_.spacing.repeated(
        std::max(near.distance_m2, settings_.spacing.distance_m2(moved_m2, changed_N2)));
    const bool doubted = doubt_N2_[near.number] > kDoubtedMore * settings_.nugget_N2;
    // The tool's own sample counts more than an answer to a query, which never replaces it.
    if ((!repeated && !doubted) || (o.from_query && !rest.from_query && !doubted)) {
      return Admission::kKnown;
    }
    const std::array<float, 3> first_position_m = rest.first_position_m;
    const std::array<float, 3> first_force_N = rest.first_force_N;
    unlink(near.number);
    put(near.number, o);
    if (repeated) {
      rest.first_position_m = first_position_m;
      rest.first_force_N = first_force_N;
    }
    return Admission::kReplaced;
  }
  std::uint32_t number = 0;
  if (size_ < settings_.capacity) {
    number = static_cast<std::uint32_t>(size_++);
  } else {
    number = least_useful(o.position_m);
    unlink(number);
    ++thinned_;
  }
  put(number, o);
  return Admission::kAdded;
}

// Squared distance to the nearest other sample, at most a cell's width squared.
double SampleStore::nearest_other_m2(std::uint32_t number) const noexcept {
  const Eigen::Vector3f at_m = position_m(number);
  float least_m2 = static_cast<float>(kCell_m * kCell_m);
  int looks = 0;
  for (const CellStep& step : kNextCells) {
    const std::uint64_t cell = cell_of(at_m.cast<double>(), step.x, step.y, step.z);
    for (std::uint32_t n = buckets_[bucket_of(cell)]; n != kNone && looks < kMostLooks;
         n = rest_[n].next, ++looks) {
      if (n != number) {
        least_m2 = std::min(least_m2, (position_m(n) - at_m).squaredNorm());
      }
    }
  }
  return least_m2;
}

std::uint32_t SampleStore::least_useful(const Eigen::Vector3d& tool_m) noexcept {
  std::uint32_t worst = kNone;
  double worst_value = std::numeric_limits<double>::max();
  for (int look = 0; look < kThinningLooks; ++look) {
    const auto n = static_cast<std::uint32_t>(next_look_);
    next_look_ = (next_look_ + 1) % size_;
    const double from_tool_m =
        std::min((position_m(n).cast<double>() - tool_m).norm(), kFarFromTool_m);
    const double value = nearest_other_m2(n) / (from_tool_m * from_tool_m + kThinningReach_m2) /
                         (1.0 + doubt_N2_[n] / (kDoubtedMore * settings_.nugget_N2)) *
                         (rest_[n].from_query ? kQueryValue : 1.0);
    if (value < worst_value) {
      worst_value = value;
      worst = n;
    }
  }
  return worst;
}

void SampleStore::doubt(const Eigen::Vector3d& centre_m, double doubt_N2, double reach_m) noexcept {
  const Eigen::Vector3f centre = centre_m.cast<float>();
  const auto per_m2 = static_cast<float>(-0.5 / (reach_m * reach_m));
  const auto most = static_cast<float>(doubt_N2);
  for (std::size_t n = 0; n < size_; ++n) {
    const float x = place_[0][n] - centre.x();
    const float y = place_[1][n] - centre.y();
    const float z = place_[2][n] - centre.z();
    const float exponent = per_m2 * (x * x + y * y + z * z);
    if (exponent > -16.0F) {  // beyond this, less than a millionth
      doubt_N2_[n] += most * std::exp(exponent);
    }
  }
}

void SampleStore::scale_other_contacts(std::uint64_t contact, double factor) noexcept {
  const auto by = static_cast<float>(factor);
  for (std::size_t n = 0; n < size_; ++n) {
    if (rest_[n].contact != contact) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        force_[axis][n] *= by;
        rest_[n].first_force_N[axis] *= by;
      }
    }
  }
}

int SampleStore::gather(const Eigen::Vector3d& centre_m, int enough, int most,
                        std::uint32_t* numbers) const noexcept {
  int count = 0;
  int looks = 0;
  const auto take_cell = [&](const CellStep& step) {
    const std::uint64_t cell = cell_of(centre_m, step.x, step.y, step.z);
    for (std::uint32_t n = buckets_[bucket_of(cell)]; n != kNone && looks < kMostLooks;
         n = rest_[n].next, ++looks) {
      if (rest_[n].cell == cell && count < most) {
        numbers[count++] = n;
      }
    }
  };
  for (const CellStep& step : kNextCells) {
    take_cell(step);
  }
  if (count < enough) {
    for (const CellStep& step : kFurtherCells) {
      take_cell(step);
    }
  }
  return count;
}

StoredSample SampleStore::sample(std::uint32_t number) const noexcept {
  StoredSample sample;
  sample.position_m = position_m(number).cast<double>();
  sample.force_N = force_N(number).cast<double>();
  sample.doubt_N2 = doubt_N2_[number];
  sample.contact = rest_[number].contact;
  sample.from_query = rest_[number].from_query;
  return sample;
}

}  // namespace forcegrid::kriging
