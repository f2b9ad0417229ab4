// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/uncoupled_pair.h"

#include <algorithm>
#include <utility>

namespace forcegrid {
namespace {

Eigen::Vector3d of_tool(const PairVector& both, std::size_t tool) noexcept {
  return both.segment<3>(static_cast<Eigen::Index>(3 * tool));
}

}  // namespace

UncoupledPair::UncoupledPair(std::unique_ptr<ForceMethod> first,
                             std::unique_ptr<ForceMethod> second) noexcept
    : methods_{std::move(first), std::move(second)} {}

std::size_t UncoupledPair::memory_bytes() const noexcept {
  return sizeof(*this) + methods_[0]->memory_bytes() + methods_[1]->memory_bytes();
}

void UncoupledPair::take_sample(const PairSample& sample) noexcept {
  for (std::size_t tool = 0; tool < methods_.size(); ++tool) {
    Sample own;
    own.time_s = sample.time_s;
    own.position_W = of_tool(sample.positions_W, tool);
    own.force_W = of_tool(sample.forces_W, tool);
    own.has_stiffness = sample.has_stiffness;
    own.stiffness_W = sample.stiffness_W.block<3, 3>(static_cast<Eigen::Index>(3 * tool),
                                                     static_cast<Eigen::Index>(3 * tool));
    own.contact_epoch = sample.contact_epoch;
    own.contact_point_W = of_tool(sample.contact_points_W, tool);
    own.relative_residual = sample.relative_residual;
    own.converged = sample.converged;
    methods_[tool]->take_sample(own);
  }
}

void UncoupledPair::contacts_made(std::uint32_t epoch, const PairVector& points_W) noexcept {
  for (std::size_t tool = 0; tool < methods_.size(); ++tool) {
    methods_[tool]->contact_made(epoch, of_tool(points_W, tool));
  }
}

void UncoupledPair::contacts_lost() noexcept {
  for (const auto& method : methods_) {
    method->contact_lost();
  }
}

int UncoupledPair::work(int budget) noexcept {
  const int first = methods_[0]->work((budget + 1) / 2);
  return first + methods_[1]->work(budget / 2);
}

void UncoupledPair::observe(double time_s, const PairVector& positions_W) noexcept {
  for (std::size_t tool = 0; tool < methods_.size(); ++tool) {
    methods_[tool]->observe(time_s, of_tool(positions_W, tool));
  }
}

PairEstimate UncoupledPair::forces(double time_s, const PairVector& positions_W) const noexcept {
  PairEstimate both;
  both.status = EstimateStatus::kOk;
  for (std::size_t tool = 0; tool < methods_.size(); ++tool) {
    const ForceEstimate own = methods_[tool]->force(time_s, of_tool(positions_W, tool));
    both.forces_W.segment<3>(static_cast<Eigen::Index>(3 * tool)) = own.force_W;
    both.status = std::max(both.status, own.status);
  }
  return both;
}

}  // namespace forcegrid
