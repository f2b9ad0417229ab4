// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "view_link/feed_messages.h"

namespace forcegrid::view {

/// Numbers of one row, in the order of scope_columns().
inline constexpr std::size_t kScopeColumns = 47;
inline constexpr std::int64_t kBucket_ns = 10'000'000;
/// The column `cycle` counts modulo this: a float keeps such a number exactly.
inline constexpr std::uint64_t kCycleModulus = std::uint64_t{1} << 24;

/// What the servo did in a bucket of 10 ms.
struct ScopeRow {
  double time_s = 0.0;  ///< of the bucket's newest cycle, since the feed's first
  /// Column 0 is zero: its value depends on the message's base.
  std::array<float, kScopeColumns> value{};
};

/// Names of the columns, with their units.
const std::vector<std::string>& scope_columns();

/// Gathers servo cycles to rows. A bucket of a row is 10 ms of the time since the first cycle;
/// buckets without a cycle have no row.
/// Real-time: no. Threads: one.
class ScopeRows {
 public:
  /// @param methods  how many are loaded; columns of the others are NaN.
  /// @param first_time_ns  of the first cycle; nothing: the first that add() gets.
  /// @param missed_deadlines  before that.
  explicit ScopeRows(std::size_t methods, std::optional<std::int64_t> first_time_ns = {},
                     std::uint64_t missed_deadlines = 0)
      : methods_(methods), first_time_ns_(first_time_ns), missed_deadlines_(missed_deadlines) {}

  /// The row of the bucket before, if `cycle` is the first of another one.
  std::optional<ScopeRow> add(const view_link::FeedCycle& cycle);
  /// The row of the bucket that is not over; nothing without one.
  std::optional<ScopeRow> take_rest();

  /// [s] Since the first cycle; negative before it or without one.
  double seconds_of(std::int64_t time_ns) const noexcept;

 private:
  void begin_bucket(const view_link::FeedCycle& cycle);
  void join_bucket(const view_link::FeedCycle& cycle);

  std::size_t methods_;
  std::optional<std::int64_t> first_time_ns_;
  std::int64_t bucket_ = 0;
  std::optional<ScopeRow> row_;
  std::uint64_t missed_deadlines_;
};

/// The message to the page. @param rows  at most 65535. Real-time: no. Threads: any.
std::vector<std::uint8_t> scope_message(std::span<const ScopeRow> rows);

}  // namespace forcegrid::view
