// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "stability/pair_loop.h"
#include "stability/search.h"

namespace forcegrid::stability {

/// How far the two sides are from the simulator and from each other.
struct PairNetwork {
  std::string name;
  std::string description;
  std::array<double, 2> delay_s{0.0, 0.0};      ///< see PairLoopSetup
  std::array<double, 2> other_age_s{0.0, 0.0};  ///< likewise
  bool a_cycle_apart = false;                   ///< instead: one side's is a cycle, and moved on
};

/// local: both in one process, and each knows at once where the other's tool is. cycles: in one
/// process as servo loops run, each at its own instants. late: the right side's answers come 100 ms
/// later. apart: that, and each side knows where the other's tool was 50 ms ago. In `cycles` exact
/// rendering has fresh places all the same, so that it shows what the age costs.
const std::vector<PairNetwork>& pair_networks();

/// One search for the largest stable stiffness.
struct PairLimitCell {
  std::string object = kSprings;  ///< as pair_object_of() takes it
  std::string hand = {};
  double servo_rate_Hz = 500.0;
  bool together = true;
  std::string network = "local";
  std::string method = {};  ///< as parse_pair_variant() takes it, or kExactPair
};

/// The object's exact forces in every cycle.
inline constexpr char kExactPair[] = "exact";

struct PairLimitRow {
  PairLimitCell cell;
  StiffnessLimit limit;
  /// Of the largest stable stiffness to that of exact rendering in the same loop; both count as the
  /// scan's most where they are beyond it.
  double relative_to_exact = 0.0;
  double force_error_percent = 0.0;  ///< at kErrorAt_N_per_m; NaN if that is unstable
};
inline constexpr double kErrorAt_N_per_m = 200.0;

/// Methods that are searched without being asked. Uncoupled `auto` is not one of them: it takes as
/// long as all others together.
const std::vector<std::string>& default_pair_limit_methods();

struct PairLimitOptions {
  std::vector<std::string> objects{kSprings};  ///< as pair_object_of() takes them
  std::vector<std::string> methods;  ///< exact rendering is always measured, and comes first
  bool stiffness = false;            ///< samples carry dF_i/dP_j
  bool quick = false;                ///< the light hand at 500 Hz alone
  unsigned jobs = 0;                 ///< threads; 0: one per processor
  const std::atomic<bool>* cancel = nullptr;
  std::function<void(double done, double remaining_s)> progress;
};

/// Searches every cell: each object, hands light and firm, 500 and 1000 Hz, each tool alone and
/// both together on the local network, and together on the others. In the order of the loops,
/// methods innermost. Exact rendering does not depend on the simulator's answers, so the networks
/// without ages share one search of it.
/// @throws std::invalid_argument for a method that can't be made; what pair_object_of() and its
/// makers throw for an object; rt::Interrupted where it is cancelled, and then no row is kept.
std::vector<PairLimitRow> pair_limits(const PairLimitOptions& options);

/// The smallest PairLimitRow::relative_to_exact of a method on an object; NaN without rows.
double least_relative_limit(const std::vector<PairLimitRow>& rows, const std::string& object,
                            const std::string& method);

/// Writes stability.csv (a row for each cell) and stability.md (a line for each loop).
/// @returns the files. @throws evaluation::FileError.
std::vector<std::filesystem::path> write_pair_limits(const std::filesystem::path& folder,
                                                     const std::vector<PairLimitRow>& rows);

}  // namespace forcegrid::stability
