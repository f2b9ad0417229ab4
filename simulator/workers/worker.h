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
  SolverOptions solver;         ///< but for what the simulator's welcome says
  int nice = 10;                ///< of the calling thread: servo, emulator and simulator go first
};

/// Answers queries for a simulator until it is told to stop; goes on when the simulator was away.
/// @param out      gets a line once the simulator has let it in
/// @param log      gets a line if that takes more than 5 s
/// @param stop_fd  ends it when it can be read or is at its end; -1: none
/// @returns how many it has answered.
/// @throws Error if the simulator refuses it or the scene can't be made, link::LinkError for key or
///   address.
/// Real-time: no. Threads: `stop` may be set from anywhere; it is looked at every 100 ms.
std::uint64_t run_worker(const WorkerOptions& options, std::ostream& out, std::ostream& log,
                         const std::atomic<bool>& stop, int stop_fd = -1);

}  // namespace forcegrid::simulator
