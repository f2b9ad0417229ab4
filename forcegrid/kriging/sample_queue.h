// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "forcegrid/core/force_method.h"
#include "forcegrid/kriging/contact_state.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/tool_motion.h"

namespace forcegrid::kriging {

/// A sample that waits for a field to take it.
struct QueuedSample {
  Observation observation;      ///< without history and path terms, which are a candidate's own
  bool before_contact = false;  ///< an answer that was asked for before the contact
};

/// Turns the simulator's samples into observations relative to the contact and keeps the newest
/// until work() finds time for them. Samples are numbered from 0; every reader keeps the number of
/// the sample that it takes next.
/// Real-time: nothing allocates, locks or throws. Threads: one.
class SampleQueue {
 public:
  static constexpr std::size_t kLength = 64;
  /// A reader that is this many samples behind must skip the oldest of them.
  static constexpr std::uint64_t kLongestBacklog = 8;
  /// Relative residual above which a sample counts as not converged.
  static constexpr double kUnfinished = 0.01;
  /// [sample periods] A longer gap between two samples means that one in between was lost.
  static constexpr double kNextPeriods = 1.6;

  /// Whether a sample can be used: finite, of the present contact and, unless it answers a query,
  /// not older than the newest. @param takes_expected also the answers to queries about an expected
  /// contact.
  bool accepts(const Sample& sample, const ContactState& contact,
               bool takes_expected) const noexcept;

  /// Queues a sample that accepts() has admitted; the contact's origin is known. Reports samples of
  /// the path to `motion`.
  void push(const Sample& sample, const ContactState& contact, ToolMotion& motion) noexcept;

  /// A contact begins: the next sample's rise is not relative to the newest.
  void begin_contact() noexcept {
    has_previous_ = false;
    first_of_contact_ = taken_;
  }

  std::uint64_t taken() const noexcept { return taken_; }
  std::uint64_t first_of_contact() const noexcept { return first_of_contact_; }
  const QueuedSample& at(std::uint64_t number) const noexcept { return queue_[number % kLength]; }
  /// Where the newest sample of the path was.
  const Eigen::Vector3d& newest_W() const noexcept { return newest_W_; }

 private:
  std::array<QueuedSample, kLength> queue_{};
  std::uint64_t taken_ = 0;
  std::uint64_t first_of_contact_ = 0;
  bool has_previous_ = false;  ///< newest_force_N_ is of this contact
  Eigen::Vector3d newest_force_N_ = Eigen::Vector3d::Zero();
  double newest_s_ = -1e300;
  Eigen::Vector3d newest_W_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::kriging
