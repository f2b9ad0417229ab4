// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <iosfwd>
#include <string>

#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

struct WorkerOptions {
  std::string connect;          ///< "tcp://ADDR:PORT" of a simulator's --workers
  std::string key_file;         ///< the simulator's
  std::string scene = "block";  ///< the simulator's
  SolverOptions solver;         ///< overridden by the simulator's welcome
  int nice = 10;  ///< for the calling thread, so that servo, emulator and simulator run first
};

/// Answers queries for a simulator until it is stopped; reconnects when the simulator was away.
/// @param out      gets one line when the simulator has accepted the worker.
/// @param log      gets one line if that takes more than 5 s.
/// @param stop_fd  the worker stops when it is readable or closed; -1: none.
/// @returns the number of answers.
/// @throws Error if the simulator refuses it or the scene can't be made, link::LinkError for key or
///   address.
/// Real-time: no. Threads: `stop` may be set from any thread; it is read every 100 ms.
std::uint64_t run_worker(const WorkerOptions& options, std::ostream& out, std::ostream& log,
                         const std::atomic<bool>& stop, int stop_fd = -1);

}  // namespace forcegrid::simulator
