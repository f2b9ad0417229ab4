// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "evaluation/motions/pair_motions.h"
#include "evaluation/traces/pair_trace.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::evaluation {

/// How a trace of two tools is made.
struct PairTraceOptions {
  double seconds = 10.0;         ///< above 1, at most PairMotion::kLongest_s
  double servo_rate_Hz = 500.0;  ///< of the reference forces
  double simulator_rate_Hz = 30.0;
  double delay_s = 0.0;           ///< of an answer beyond the simulator's own period
  double noise_N = 0.0;           ///< standard deviation of white noise on each force of a sample
  bool stiffness = false;         ///< samples carry dF_i/dP_j of the solver's linearisation
  double patch_radius_m = 0.012;  ///< of each tool's grip
  double relative_tolerance = 1e-6;  ///< of the solver, in double precision
  /// Folder in which the forces are kept and found again; made if it isn't there. Empty: none.
  std::filesystem::path cache;
  /// Called now and then with the fraction done.
  std::function<void(double done)> progress;
  const std::atomic<bool>* cancel = nullptr;  ///< when set and true: Stopped is thrown soon
};

/// A trace and how well its forces are solved.
struct PairReference {
  PairTrace trace;
  std::string key;  ///< of everything that the forces depend on, 16 hexadecimal digits
  bool from_cache = false;
  std::size_t unconverged = 0;  ///< instants whose forces missed the tolerance; 0 from the cache
  std::size_t branch_changes =
      0;  ///< instants at which the object snapped into another equilibrium
};

/// Makes a folder, and those that it is in, unless it is there.
/// @throws ChartError naming the folder, the system's reason and the remedy.
void make_trace_folder(const std::filesystem::path& folder);

/// Solves `mesh` under two tools that follow `motion`, both from the grab on, at every servo
/// instant (SharedObject<double>): the reference forces. The simulator's samples are the forces at
/// the first servo instant at or after each of its ticks, and arrive one simulator period and the
/// delay after the tick. Noise is of the forces alone. Deterministic: the same options give the
/// same trace. A trace that did not converge everywhere, or changed its branch of equilibria, is
/// not kept in the cache.
/// @throws ChartError for options out of range or tools that have nothing to hold; Stopped;
/// TraceError for a cache that can't be written; simulator::Error for a mesh that can't be solved.
PairReference make_pair_trace(const simulator::SpringMesh& mesh, const PairMotion& motion,
                              const PairTraceOptions& options, std::uint64_t seed);

}  // namespace forcegrid::evaluation
