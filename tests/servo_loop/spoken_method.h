// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "forcegrid/core/force_method.h"

namespace forcegrid::servo {

/// A method for tests of the loop alone: it says what the test says, also what is not a number, and
/// keeps what it was told.
class SpokenMethod final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "spoken"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample&) noexcept override { ++samples; }
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d&) noexcept override {
    epochs.push_back(epoch);
  }
  void contact_lost() noexcept override { ++losses; }
  int work(int) noexcept override { return 0; }
  ForceEstimate force(double, const Eigen::Vector3d&) const noexcept override {
    ForceEstimate estimate;
    estimate.force_W = force_W;
    estimate.status = EstimateStatus::kOk;
    return estimate;
  }
  std::optional<double> least_budget_reads() const noexcept override { return 1.0; }
  void set_budget(double reads_per_cycle) noexcept override {
    ++budgets;
    budget_reads = reads_per_cycle;
  }
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();
  int budgets = 0;
  double budget_reads = 0.0;
  int samples = 0;
  int losses = 0;
  std::vector<std::uint32_t> epochs;
};

}  // namespace forcegrid::servo
