// SPDX-License-Identifier: Apache-2.0
#include "view/scope_rows.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "view/messages.h"
#include "view_link/little_endian.h"

namespace forcegrid::view {
namespace {

using view_link::FeedCycle;
using view_link::kFeedMethods;

enum Column : std::size_t {
  kTime,
  kPosition,
  kForce = kPosition + 3,
  kForceNorm = kForce + 3,
  kMethodForce,
  kUncertainty = kMethodForce + 3 * kFeedMethods,
  kPeriod = kUncertainty + kFeedMethods,
  kWakeup,
  kCompute,
  kReportAge,
  kSampleAge,
  kEnergy,
  kGain,
  kDampingGain,
  kCandidate,
  kReason,
  kRung,
  kHeldBack,
  kLimits,
  kInContact,
  kFault,
  kPaused,
  kRenderedMethod,
  kSamplePeriod,
  kRequests,
  kBudget,
  kArrivals,
  kMissedDeadlines,
  kCycle,
  kColumns
};
static_assert(kColumns == kScopeColumns);

constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();

std::vector<std::string> column_names() {
  std::vector<std::string> names = {"time_s"};
  const auto vector_names = [&names](const std::string& what, const char* unit) {
    for (const char* axis : {"_x_", "_y_", "_z_"}) {
      names.push_back(what + axis + unit);
    }
  };
  vector_names("position", "mm");
  vector_names("force", "N");
  names.emplace_back("force_N");
  for (std::size_t method = 0; method < kFeedMethods; ++method) {
    vector_names("method" + std::to_string(method), "N");
  }
  for (std::size_t method = 0; method < kFeedMethods; ++method) {
    names.push_back("method" + std::to_string(method) + "_uncertainty_N");
  }
  for (const char* name : {"period_max_us",   "wakeup_max_us",    "compute_max_us", "report_age_us",
                           "sample_age_ms",   "energy_mJ",        "gain",           "damping_gain",
                           "candidate",       "reason",           "rung",           "held_back",
                           "limits",          "in_contact",       "fault",          "paused",
                           "rendered_method", "sample_period_ms", "requests_per_s", "budget_reads",
                           "arrivals",        "missed_deadlines", "cycle"}) {
    names.emplace_back(name);
  }
  return names;
}

// The larger one; a number is larger than NaN.
float larger(float before, double now) { return std::fmax(before, narrow(now)); }

}  // namespace

const std::vector<std::string>& scope_columns() {
  static const std::vector<std::string> names = column_names();
  return names;
}

double ScopeRows::seconds_of(std::int64_t time_ns) const noexcept {
  // As unsigned numbers: what a peer sends may be any.
  return first_time_ns_ ? static_cast<double>(static_cast<std::int64_t>(
                              static_cast<std::uint64_t>(time_ns) -
                              static_cast<std::uint64_t>(*first_time_ns_))) *
                              1e-9
                        : -1.0;
}

std::optional<ScopeRow> ScopeRows::add(const FeedCycle& cycle) {
  if (!first_time_ns_) {
    first_time_ns_ = cycle.time_ns;
  }
  missed_deadlines_ += cycle.missed_deadlines;
  const auto since_first_ns = static_cast<std::int64_t>(
      static_cast<std::uint64_t>(cycle.time_ns) - static_cast<std::uint64_t>(*first_time_ns_));
  const std::int64_t bucket = since_first_ns / kBucket_ns;
  std::optional<ScopeRow> finished;
  if (row_ && bucket != bucket_) {
    finished = take_rest();
  }
  if (!row_) {
    bucket_ = bucket;
    begin_bucket(cycle);
  }
  join_bucket(cycle);
  return finished;
}

std::optional<ScopeRow> ScopeRows::take_rest() {
  std::optional<ScopeRow> row = row_;
  row_.reset();
  return row;
}

void ScopeRows::begin_bucket(const FeedCycle& cycle) {
  row_.emplace();
  row_->value[kPeriod] = narrow(cycle.period_us);
  row_->value[kWakeup] = narrow(cycle.wakeup_us);
  row_->value[kCompute] = narrow(cycle.compute_us);
}

void ScopeRows::join_bucket(const FeedCycle& cycle) {
  row_->time_s = seconds_of(cycle.time_ns);
  auto& value = row_->value;
  const auto& force = cycle.commanded_force_W_N;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    value[kPosition + axis] = narrow(1e3 * cycle.position_W_m[axis]);
    value[kForce + axis] = narrow(force[axis]);
  }
  value[kForceNorm] = narrow(std::hypot(force[0], force[1], force[2]));
  for (std::size_t method = 0; method < kFeedMethods; ++method) {
    const bool loaded = method < methods_;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      value[kMethodForce + 3 * method + axis] =
          loaded ? narrow(cycle.method_force_W_N[method][axis]) : kNothing;
    }
    value[kUncertainty + method] = loaded ? narrow(cycle.method_uncertainty_N[method]) : kNothing;
  }
  value[kPeriod] = larger(value[kPeriod], cycle.period_us);
  value[kWakeup] = larger(value[kWakeup], cycle.wakeup_us);
  value[kCompute] = larger(value[kCompute], cycle.compute_us);
  value[kReportAge] = narrow(cycle.report_age_us);
  value[kSampleAge] = cycle.sample_age_ms < 0.0 ? kNothing : narrow(cycle.sample_age_ms);
  value[kEnergy] = narrow(1e3 * cycle.energy_to_hand_J);
  value[kGain] = narrow(cycle.gain);
  value[kDampingGain] = narrow(cycle.damping_gain);
  value[kCandidate] = cycle.rendered_candidate;
  value[kReason] = cycle.rendered_reason;
  value[kRung] = cycle.rung;
  value[kHeldBack] = cycle.held_back;
  value[kLimits] =
      static_cast<float>(static_cast<unsigned>(value[kLimits]) | unsigned{cycle.limits_acted});
  value[kInContact] = cycle.in_contact;
  if (cycle.fault != 0) {
    value[kFault] = cycle.fault;
  }
  value[kPaused] = cycle.paused;
  value[kRenderedMethod] = cycle.rendered_method;
  value[kSamplePeriod] = narrow(cycle.sample_period_ms);
  value[kRequests] = narrow(cycle.requests_per_s);
  value[kBudget] = std::isnan(cycle.budget_reads) ? kNothing : narrow(cycle.budget_reads);
  value[kArrivals] = static_cast<float>(cycle.arrivals_taken % kCycleModulus);
  value[kMissedDeadlines] = static_cast<float>(missed_deadlines_);
  value[kCycle] = static_cast<float>(cycle.cycle % kCycleModulus);
}

std::vector<std::uint8_t> scope_message(std::span<const ScopeRow> rows) {
  std::vector<std::uint8_t> bytes = message_head(PageType::kScope, 0);
  bytes.reserve(16 + rows.size() * sizeof(ScopeRow::value));
  const double base_s = rows.empty() ? 0.0 : rows.front().time_s;
  bytes.resize(2);
  view_link::append(bytes, static_cast<std::uint16_t>(rows.size()));
  view_link::append(bytes, static_cast<std::uint32_t>(kScopeColumns));
  view_link::append(bytes, base_s);
  for (const ScopeRow& row : rows) {
    std::array<float, kScopeColumns> value = row.value;
    value[kTime] = narrow(row.time_s - base_s);
    view_link::append(bytes, std::span<const float>(value));
  }
  return bytes;
}

}  // namespace forcegrid::view
