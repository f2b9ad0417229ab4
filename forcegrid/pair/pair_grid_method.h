// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/core/pair_force_method.h"
#include "forcegrid/pair/pair_grid.h"

namespace forcegrid {

/// Options of PairGridMethod, each above 0.
struct PairGridOptions {
  double spacing_m = 0.003;  ///< h of the dense grid; the sparse one has kSparse times as much
  double radius_m = 0.006;   ///< r of the dense grid, at most PairGrid::kMostRadius h
  double unit_m = 1e-3;      ///< L of the paper's weight
  int blocks = 6000;         ///< of the dense grid's pool, 2 KB each; the sparse one has a quarter
};

/// `forcegrid-6d`: the paper's grid for two tools, multilinear in six dimensions, with its remedy
/// for memory: a dense grid around the tools inside a sparse one over the rest.
///
/// Both take in every sample. A read takes the dense grid's vertices, and for the share of those
/// that are empty the sparse grid's; vertices empty in both count as zero force, as in the paper,
/// and make the answer kPartlyKnown. The dense grid's pool holds what is near: its blocks far from
/// the tools give way when it is used up (PairGrid).
///
/// Contacts: both grids are emptied at contacts_made(); positions are relative to the points of
/// contact. Work: a piece is one block of 64 vertices.
/// Failure: everything that averages: stiffness is rendered too low, unvisited cells have no force.
/// Cost and accuracy: docs/two_tools.md. Source: the forcegrid paper, section 5 and its outlook.
/// Real-time: as PairForceMethod, but clearing the grids' tables at contacts_made() takes some
/// 10 us.
class PairGridMethod final : public PairForceMethod {
 public:
  explicit PairGridMethod(const PairGridOptions& options);

  const char* name() const noexcept override { return "forcegrid-6d"; }
  std::size_t memory_bytes() const noexcept override;
  void take_sample(const PairSample& sample) noexcept override;
  void contacts_made(std::uint32_t epoch, const PairVector& points_W) noexcept override;
  void contacts_lost() noexcept override;
  int work(int budget) noexcept override;
  [[nodiscard]] PairEstimate forces(double time_s,
                                    const PairVector& positions_W) const noexcept override;
  /// `samples_passed_over`: that came while kQueue others waited; `samples_outside`: too far from
  /// where the tools touched; `blocks_used` and `blocks_given_up`: of the dense grid.
  std::span<const NamedCounter> counters() const noexcept override { return counters_; }

  static constexpr double kSparse = 3.0;
  static constexpr std::size_t kQueue = 8;

 private:
  struct Queued {
    PairVector positions_m;
    PairVector forces_N;
  };

  std::array<pair::PairGrid, 2> grids_;  ///< dense, sparse
  std::array<Queued, kQueue> queue_{};
  std::uint64_t queued_ = 0;
  std::uint64_t next_ = 0;
  double newest_s_ = -1e300;
  bool known_ = false;  ///< a contact has been made or lost
  bool in_contact_ = false;
  PairVector points_W_ = PairVector::Zero();
  std::array<NamedCounter, 4> counters_{{{"samples_passed_over", 0},
                                         {"samples_outside", 0},
                                         {"blocks_used", 0},
                                         {"blocks_given_up", 0}}};
};

}  // namespace forcegrid
