#pragma once

#include <Eigen/Core>
#include <atomic>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

#include "simulator/mesh/tool_options.h"
#include "simulator/simulator_summary.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_kind.h"

namespace forcegrid::simulator {

/// What `forcegrid simulate` can be told; names as on the command line.
struct SimulatorOptions {
  std::string scene = "block";  ///< as make_scene() takes it
  std::string listen =
      "127.0.0.1:24870";               ///< ADDR:PORT, loopback without a key; port 0: a free one
  std::vector<std::string> key_files;  ///< of a sealed link, see link::Access
  std::vector<std::string> allowed;    ///< ranges of addresses, see link::AddressRange
  std::string workers;                 ///< ADDR:PORT for workers, see WorkerPool; empty: none
  double rate_Hz = 30.0;               ///< answers a second; in (0, 1000]
  /// [s] Every answer leaves this much later, as from a slower machine; in [0, 10].
  double answer_delay_s = 0.0;
  bool send_stiffness = true;                              ///< dF/dP with every sample
  Eigen::Vector3d top_centre_W = Eigen::Vector3d::Zero();  ///< [m] see make_scene()
  std::optional<SolverKind> solver_kind;  ///< nothing: chosen by what the object is
  SolverOptions solver;                   ///< what that one starts from
  std::optional<ToolOptions> tool;        ///< nothing: the scene's own
  int nice = 5;  ///< 0..19, of the calling thread: servo and emulator go first
};

/// The simulator's loop: at each of `rate_Hz` absolute deadlines it takes the newest tool state
/// from the link, moves the tool there (ToolContact; an object that moves by itself feels all
/// positions on the way) and answers with one sample. A new session of a servo starts with the
/// object at rest. Queries are answered in idle time from an object of their own. While the tool,
/// going straight on, would touch within 0.3 s, samples carry that point as their contact point,
/// and queries are answered for a tool that has touched there (in contact, epoch of the air); it is
/// kept until it moves by more than 2 mm. While it is in the air each sample is followed by a patch
/// of the surface near the tool; once a touch is expected it states what is felt there
/// (PredictedContact): of a tool that sticks dF/dP, solved for in idle time, of one that slides
/// forces that a thread of low priority presses ahead. When ready it prints `listening ADDR:PORT
/// scene NAME vertices N springs M` to `out` and flushes; remarks go to `log`.
///
/// The sample's relative residual is |r| / max(|F|, 0.05 N) as Equilibrium defines it.
///
/// @param stop_fd  a pipe or standard input: ends the loop when it can be read or is at its end;
///                 -1: none.
/// Throws Error for options out of range or an unknown scene, link::LinkError for the address.
/// Real-time: no; normal scheduling at the nice value of the options, which stays with the calling
/// thread. Threads: `stop` may be set from anywhere, a signal handler included; it is looked at
/// every 50 ms.
SimulatorSummary run_simulator(const SimulatorOptions& options, std::ostream& out,
                               std::ostream& log, const std::atomic<bool>& stop, int stop_fd = -1);

}  // namespace forcegrid::simulator
