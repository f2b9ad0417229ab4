// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "forcegrid/core/buffer.h"
#include "forcegrid/kriging/kriging_field.h"

namespace forcegrid::kriging {

/// A sample as a store keeps it, in single precision.
struct StoredSample {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero();
  double doubt_N2 = 0.0;  ///< variance to be added to its noise, see DictionaryField
  std::uint64_t contact = 0;
  bool from_query = false;
};

/// Thousands of samples of a force, looked up by place: a hash grid over a fixed pool.
///
/// Admission. With the distance of SampleSpacing, a sample that is apart from all stored ones is
/// added. Any other is dropped, unless the nearest stored one is doubted more or the sample repeats
/// where that one began; it then takes the nearest one's place. (Without this bound a slow motion
/// would drag one sample along and lose what it had known.)
///
/// Thinning. In a full store an added sample replaces another one. 32 samples are examined in turn;
/// the one with the least
///
///   min_j |p_i - p_j|^2 / (min(|p_i - P|, 40 mm)^2 + (10 mm)^2) / (1 + q_i / (10 nugget))
///
/// is replaced. P is the place of the added sample, and answers to queries count a twentieth. So
/// samples far from the tool end up four times as far apart as those around it.
///
/// Lookup. Positions fall into cells of 10 mm; a cell is found by a hash, 1 to 2 samples per
/// bucket. Samples of different cells that share a bucket are distinguished by their cell.
///
/// Real-time: nothing allocates, locks or throws after construction; every function is bounded
/// (kMostLooks samples, or one pass over all of them where stated). Threads: one. Several
/// fields may read one store on the same thread.
class SampleStore {
 public:
  struct Settings {
    std::size_t capacity = 8192;
    SampleSpacing spacing;    ///< its metres at most half a cell
    double nugget_N2 = 1e-5;  ///< of the fields that read it: doubt is counted in tens of these
  };
  enum class Admission : std::uint8_t {
    kAdded,
    kReplaced,  ///< the nearest stored sample gave up its place
    kKnown,     ///< the store has one like it
  };

  static constexpr double kCell_m = 0.010;
  /// The most samples that one lookup goes through, see gather().
  static constexpr int kMostLooks = 2048;

  /// @param settings positive, capacity at least 2.
  explicit SampleStore(const Settings& settings) noexcept;

  /// False if there was not enough memory; the store then must not be used.
  bool allocated() const noexcept;
  std::size_t memory_bytes() const noexcept;
  const Settings& settings() const noexcept { return settings_; }
  std::size_t size() const noexcept { return size_; }
  /// Samples that were replaced because the store was full.
  std::uint64_t thinned() const noexcept { return thinned_; }

  /// Adds the sample unless a stored one is like it. Stiffness and history are not kept.
  Admission admit(const Observation& observation) noexcept;

  /// Adds  doubt_N2 exp(-|p_i - centre|^2 / (2 reach^2))  to the doubt of every sample. One pass.
  void doubt(const Eigen::Vector3d& centre_m, double doubt_N2, double reach_m) noexcept;

  /// Multiplies the forces of all contacts but `contact`. One pass.
  void scale_other_contacts(std::uint64_t contact, double factor) noexcept;

  /// Writes the numbers of samples around `centre_m` to `numbers`, at most `most`: those of its
  /// cell, of the 26 around it and, if these have less than `enough`, of the 98 around those.
  /// Valid until the next admit(). Cells with so many samples that kMostLooks is reached lose their
  /// oldest.
  int gather(const Eigen::Vector3d& centre_m, int enough, int most,
             std::uint32_t* numbers) const noexcept;

  /// The sample of this number, less than size().
  StoredSample sample(std::uint32_t number) const noexcept;
  Eigen::Vector3f position_m(std::uint32_t number) const noexcept {
    return {place_[0][number], place_[1][number], place_[2][number]};
  }
  float doubt_N2(std::uint32_t number) const noexcept { return doubt_N2_[number]; }
  bool from_query(std::uint32_t number) const noexcept { return rest_[number].from_query; }

 private:
  static constexpr std::uint32_t kNone = 0xffffffffU;

  /// The data that loops do not read number by number.
  struct Rest {
    std::array<float, 3> first_position_m;  ///< before others replaced it
    std::array<float, 3> first_force_N;
    std::uint64_t cell;
    std::uint64_t contact;
    std::uint32_t next;  ///< in its bucket
    bool from_query;
  };
  struct Nearest {
    std::uint32_t number = kNone;
    double distance_m2 = 0.0;
  };

  static std::uint64_t cell_of(const Eigen::Vector3d& position_m, int dx, int dy, int dz) noexcept;
  std::size_t bucket_of(std::uint64_t cell) const noexcept;
  Eigen::Vector3f force_N(std::uint32_t number) const noexcept {
    return {force_[0][number], force_[1][number], force_[2][number]};
  }
  Nearest nearest(const Observation& observation) const noexcept;
  double nearest_other_m2(std::uint32_t number) const noexcept;
  void put(std::uint32_t number, const Observation& observation) noexcept;
  void link(std::uint32_t number) noexcept;
  void unlink(std::uint32_t number) noexcept;
  std::uint32_t least_useful(const Eigen::Vector3d& tool_m) noexcept;

  Settings settings_;
  std::array<Buffer<float>, 3> place_;  ///< [m] x, y, z
  std::array<Buffer<float>, 3> force_;  ///< [N]
  Buffer<float> doubt_N2_;
  Buffer<Rest> rest_;
  Buffer<std::uint32_t> buckets_;  ///< the newest sample of each
  std::size_t size_ = 0;
  std::size_t next_look_ = 0;  ///< where thinning continues
  std::uint64_t thinned_ = 0;
};

}  // namespace forcegrid::kriging
