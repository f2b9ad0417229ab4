// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>

#include "forcegrid/core/pair_force_method.h"

namespace forcegrid {

/// Two force methods of one tool each: the baseline that a method over both tools has to beat. Each
/// learns a field F_i(P_i) from its own tool's forces and never hears of the other tool, so that
/// the other's motion looks like a change of the object.
/// Real-time: as its methods.
class UncoupledPair final : public PairForceMethod {
 public:
  /// @param first, second of the same kind; not null.
  UncoupledPair(std::unique_ptr<ForceMethod> first, std::unique_ptr<ForceMethod> second) noexcept;

  const char* name() const noexcept override { return methods_[0]->name(); }
  std::size_t memory_bytes() const noexcept override;
  void take_sample(const PairSample& sample) noexcept override;
  void contacts_made(std::uint32_t epoch, const PairVector& points_W) noexcept override;
  void contacts_lost() noexcept override;
  /// Half of the budget is for each tool's method.
  int work(int budget) noexcept override;
  void observe(double time_s, const PairVector& positions_W) noexcept override;
  [[nodiscard]] PairEstimate forces(double time_s,
                                    const PairVector& positions_W) const noexcept override;

 private:
  std::array<std::unique_ptr<ForceMethod>, 2> methods_;
};

}  // namespace forcegrid
