// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/kriging_store.h"

namespace forcegrid::kriging {

/// Local kriging over a store of thousands of samples: a DictionaryField whose dictionary is a
/// working set that follows the tool.
///
/// Every observation goes to the working set and, if no stored sample is like it, to the store.
/// follow() then brings in samples of the store, each in place of one of the working set. With P
/// the tool and L where it will soon be, the value of sample i is
///
///   min_j |p_i - p_j|^2 / (min(|p_i - P|, |p_i - L|)^2 + (10 mm)^2)^2 / (1 + q_i / (10 nugget))
///
/// over the samples j of the working set; answers to queries count a twentieth of that. (The
/// dictionary evicts by the same measure without the outer square, which suits a set without a
/// store behind it.) A sample is exchanged if the stored one's value is kGain times as large, so
/// that the set is dense around the tool, thins out with the distance, and settles. A sample of the
/// set is at distance zero from itself and is never brought in twice.
///
/// What the working set learns about stored samples goes back to the store: doubt after a surprise,
/// and the factor between contacts. So a place that changed while the tool was away is remembered
/// unchanged until it surprises.
///
/// Needs: force. Failure: as DictionaryField; no history features.
/// Cost: take() as DictionaryField, and a search of up to eight cells of the store; after a
/// surprise or in the first samples of a contact one pass over the store. follow(): up to
/// kMostCandidates distances to each sample of the working set and kExchanges of its rows.
/// Source: docs/kriging.md; local kriging in a moving neighbourhood: Chiles and Delfiner,
/// Geostatistics, 2nd ed. (2012), section 3.6.
/// Real-time: nothing allocates, locks or throws. Threads: one.
class StoreField final : public Field {
 public:
  static constexpr int kMaxSamples = 48;  ///< settings().samples is at most this
  static constexpr double kGain = 2.0;
  /// Samples that one piece of follow() exchanges at most.
  static constexpr int kExchanges = 3;
  static constexpr int kMostCandidates = 256;

  /// @param settings as for DictionaryField, without history features and stiffness.
  /// @param store that this field reads from and, with `writes`, writes what it learns to. Of the
  ///   fields that share a store, one writes. The store must outlive the field.
  StoreField(const FieldSettings& settings, SampleStore& store, bool writes) noexcept;

  const FieldSettings& settings() const noexcept override { return working_.settings(); }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }  ///< no store
  int sample_count() const noexcept override { return working_.sample_count(); }
  int row_count() const noexcept override { return working_.row_count(); }
  void enter_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept override {
    working_.enter_contact(contact, point_W);
  }
  Innovation take(const Observation& observation) noexcept override;
  /// The working set begins anew; the store keeps what it has.
  bool begin_with(std::span<const Observation> observations) noexcept override {
    return working_.begin_with(observations);
  }
  bool can_begin_with() const noexcept override { return true; }
  bool prepare() noexcept override { return working_.prepare(); }
  bool ready() const noexcept override { return working_.ready(); }
  void expect_reads(bool expected) noexcept override { working_.expect_reads(expected); }
  void remember(const Observation& observation) noexcept override {
    if (writes_) {
      store_->admit(observation);
    }
  }
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override {
    return working_.read(position_m, history);
  }
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                    const History& history) const noexcept override {
    return working_.stiffness_N_per_m(position_m, history);
  }
  double deviation_N(const Eigen::Vector3d& position_m,
                     const History& history) const noexcept override {
    return working_.deviation_N(position_m, history);
  }
  Followed follow(const Eigen::Vector3d& tool_m, const Eigen::Vector3d& ahead_m) noexcept override;

  /// Calls `use` on each sample of the working set, as DictionaryField::Kept.
  template <typename Use>
  void for_each_sample(Use use) const noexcept {
    working_.for_each_sample(use);
  }

 private:
  using Working = DictionaryField<float, kMaxSamples, 0>;

  /// Samples side by side: those of the working set or of the store around.
  template <int kCount>
  struct Places {
    alignas(64) std::array<float, kCount> x_m, y_m, z_m;
    alignas(64) std::array<float, kCount> weight;  ///< of the squared distance to the nearest other
    alignas(64) std::array<float, kCount> nearest_m2;
    std::array<std::uint32_t, kCount> number;  ///< slot of the working set, or of the store
    int count = 0;

    void add(const Eigen::Vector3f& at_m, float weight_per_m2, std::uint32_t number_or_slot) {
      const auto i = static_cast<std::size_t>(count++);
      x_m[i] = at_m.x();
      y_m[i] = at_m.y();
      z_m[i] = at_m.z();
      weight[i] = weight_per_m2;
      number[i] = number_or_slot;
    }
    void remove(int index) {
      const auto i = static_cast<std::size_t>(index);
      const auto last = static_cast<std::size_t>(--count);
      x_m[i] = x_m[last];
      y_m[i] = y_m[last];
      z_m[i] = z_m[last];
      weight[i] = weight[last];
      nearest_m2[i] = nearest_m2[last];
      number[i] = number[last];
    }
  };

  void list(const Eigen::Vector3d& tool_m, const Eigen::Vector3d& ahead_m) noexcept;
  float least_m2(const Eigen::Vector3f& at_m, int except) const noexcept;
  void measure() noexcept;
  void take_out(int index) noexcept;
  void put_in(int candidate) noexcept;

  Working working_;
  SampleStore* store_;
  bool writes_;
  int newest_ = -1;  ///< in set_, which is not to be exchanged
  Places<kMaxSamples> set_;
  Places<kMostCandidates> around_;
};

}  // namespace forcegrid::kriging
