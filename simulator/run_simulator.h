#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "simulator/solver/elastic_object.h"
#include "simulator/solver/reduced_use.h"
#include "simulator/solver/solver_kind.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/workers/worker_pool.h"

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

/// What a run of the simulator amounted to.
struct SimulatorSummary {
  std::string scene;
  std::string tool;       ///< ToolOptions::shape
  std::string contact;    ///< ToolOptions::contact
  std::string listening;  ///< ADDR:PORT
  std::size_t vertices = 0;
  std::size_t springs = 0;
  std::string solver;      ///< that was used
  std::string solver_why;  ///< and the reason
  double rate_Hz = 0.0;
  std::uint64_t sessions = 0;  ///< runs of a servo
  std::uint64_t ticks = 0;     ///< deadlines that came, with or without a tool state to answer
  std::uint64_t answers = 0;   ///< samples sent
  std::uint64_t patches = 0;   ///< of the surface, sent
  std::uint64_t replies = 0;   ///< queries answered
  std::uint64_t queries_refused = 0;  ///< as force was no function of the position alone
  std::uint64_t late_ticks = 0;       ///< answers that were not ready before the next deadline
  std::uint64_t missed_ticks =
      0;  ///< deadlines skipped because an answer took longer than a period
  std::uint64_t send_failures = 0;
  std::string workers_at;       ///< tcp://ADDR:PORT; empty without
  WorkerStatistics workers;     ///< all zero without
  std::uint64_t unchecked = 0;  ///< QueryScheduler::Counts::unchecked
  /// Datagrams that were not taken, by reason.
  std::vector<std::pair<std::string, std::uint64_t>> dropped;
  std::uint64_t contacts = 0;
  std::uint64_t unconverged = 0;      ///< answers whose tolerance was not reached
  std::uint64_t branch_changes = 0;   ///< answers after which the object was on another branch
  std::uint64_t long_steps = 0;       ///< answers over more time than the solver has steps for
  std::uint64_t not_reached = 0;      ///< moves too long for one tick, answered for part of the way
  std::uint64_t not_finite = 0;       ///< answers that were not sent; the object began anew
  std::uint64_t whole_solutions = 0;  ///< of two_rates, beside the answers
  ReducedUse reduced;                 ///< all zero without reduced models
  double worst_relative_residual = 0.0;
  /// [ms] Wall time of one answer's solution once in contact; the first one, which takes hold of
  /// the patch, is apart.
  double solve_mean_ms = 0.0;
  double solve_p50_ms = 0.0;
  double solve_p99_ms = 0.0;
  double solve_max_ms = 0.0;
  double grab_max_ms = 0.0;
  double iterations_mean = 0.0;  ///< conjugate-gradient iterations an answer
};

/// Keys carry the units.
nlohmann::json to_json(const SimulatorSummary& summary);

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
