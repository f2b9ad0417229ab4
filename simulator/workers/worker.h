// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <iosfwd>
#include <string>

#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

struct WorkerOptions {
  std::string connect;          ///< "tcp://ADDR:PORT" of a simulator's --workers
  std::string key_file;         ///< the simulator's
  std::string scene = "block";  ///< the simulator's
  SolverOptions solver;         ///< overridden by the simulator's welcome
  /// Is told that the scene is being loaded, and "" when it is; may be empty.
  std::function<void(const std::string&)> step;
  int nice = 10;  ///< for the calling thread, so that servo, emulator and simulator run first
  bool say_loading = false;  ///< while the scene loads, `out` gets a line of it now and then
};

/// Answers queries for a simulator until it is stopped; reconnects when the simulator was away.
/// @param out      gets the lines of loading_supervision() with `say_loading`, and one line when
/// the simulator has accepted the worker. If that takes more than 5 s, the log gets a warning.
/// @param stop_fd  the worker stops when it is readable or closed; -1: none.
/// @returns the number of answers.
/// @throws Error if the simulator refuses it or the scene can't be made, link::LinkError for key or
///   address, rt::Interrupted if `stop` is set while the scene loads.
/// Real-time: no. Threads: `stop` may be set from any thread; it is read every 100 ms.
std::uint64_t run_worker(const WorkerOptions& options, std::ostream& out,
                         const std::atomic<bool>& stop, int stop_fd = -1);

}  // namespace forcegrid::simulator
