// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstddef>
#include <functional>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

#include "simulator/impaired_link.h"
#include "simulator/mesh/tool_options.h"
#include "simulator/simulator_summary.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_kind.h"

namespace forcegrid::simulator {

/// The options of `forcegrid simulate`; names as on the command line.
struct SimulatorOptions {
  std::string scene = "block";  ///< as make_scene() takes it
  std::string listen =
      "127.0.0.1:24870";               ///< ADDR:PORT, loopback without a key; port 0: a free one
  std::vector<std::string> key_files;  ///< of a sealed link, see link::Access
  std::vector<std::string> allowed;    ///< ranges of addresses, see link::AddressRange
  std::string workers;                 ///< ADDR:PORT for workers, see WorkerPool; empty: none
  std::size_t tools = 1;               ///< served at once, each by a servo of its own; 1 to 4
  /// Of several tools: the failure of one tool's device, or its servo's silence, ends the answers
  /// to all, until those servos that were there have gone.
  bool fault_stops_all = true;
  double rate_Hz = 30.0;  ///< answers per second; in (0, 1000]
  /// Extra delay of every answer, jitter and loss, to imitate a slower machine or a bad network.
  LinkConditions link_conditions;
  std::uint64_t link_seed = 1;  ///< of jitter and loss
  /// Path of a Unix datagram socket that takes other rates and conditions while the simulator runs,
  /// see ControlSocket; empty: none.
  std::string control;
  bool send_stiffness = true;                              ///< dF/dP with every sample
  Eigen::Vector3d top_centre_W = Eigen::Vector3d::Zero();  ///< [m] see make_scene()
  std::optional<SolverKind> solver_kind;  ///< nothing: choose_solver() picks one for the object
  SolverOptions solver;                   ///< the options that it starts from
  /// Simulate the cheapest model of the scene whose force is within this of the scene's as written,
  /// see choose_model(); nothing: the scene as written.
  std::optional<double> material_tolerance_percent;
  std::optional<ToolOptions> tool;  ///< nothing: the scene's own
  /// Is told each long step of the start as it begins, and "" before `out` or `log` is written to;
  /// may be empty.
  std::function<void(const std::string&)> step;
  /// Path of the live view's Unix socket, which gets the surface as it deforms, see SurfaceStream;
  /// empty: none.
  std::string surface;
  int nice = 5;  ///< 0..19, for the calling thread, so that servo and emulator run first
  bool say_loading = false;  ///< while the scene loads, `out` gets a line of it now and then
};

/// Runs the simulator's loop until `stop` is set or `stop_fd` ends.
///
/// Samples. At each of `rate_Hz` absolute deadlines the loop takes the newest tool state from the
/// link, moves the tool there (ToolContact) and answers with one sample. A DynamicObject follows
/// all positions on the way. Each new session of a servo starts with the object at rest. The
/// sample's relative residual is |r| / max(|F|, 0.05 N), as Equilibrium defines it.
///
/// Queries. The loop answers them in idle time, from a second copy of the object (QueryScheduler).
///
/// Predicted contact (PredictedContact). While the tool is above the surface and would touch it
/// within 0.3 s if it kept its velocity, samples carry the predicted touch as their contact point.
/// Queries are then answered for a tool that has touched there (in contact, with the epoch before
/// the touch). The predicted point is kept until it moves by more than 2 mm. Each sample before
/// contact is followed by a patch of the surface near the tool. Once a touch is predicted, the
/// patch also carries the forces just after it: dF/dP for a tool that sticks, solved in idle time,
/// and two forces for a tool that slides, which a low-priority thread computes.
///
/// Several tools. With `tools` above 1 the loop is SharedLoop's: the servos' tools hold one object,
/// solved by quasi_static; no queries, workers, surface or controls.
///
/// Surface. With `surface` the loop sends the object's surface to the live view, after the sample
/// of the same tick.
///
/// @param out  with `say_loading`, gets a line `loading SCENE, N s` now and then while the work on
///   the scene goes on (rt/checkpoint.h). When the simulator is ready, gets
///   `listening ADDR:PORT scene NAME vertices N springs M` and a flush; with several
///   tools also `tools T`.
/// @param stop_fd  a pipe or standard input; the loop ends when it is readable or closed. -1: none.
/// Remarks for a user go to the log (log/log.h).
/// Throws Error for options out of range or an unknown scene, link::LinkError for the address,
/// view_link::ViewLinkError for `surface` if nobody listens there, rt::Interrupted if `stop` is set
/// before the simulator is ready. Real-time: no; normal scheduling at the nice value of the
/// options, which stays with the calling thread. Threads: `stop` may be set from any thread or
/// signal handler; the loop reads it every 50 ms.
SimulatorSummary run_simulator(const SimulatorOptions& options, std::ostream& out,
                               const std::atomic<bool>& stop, int stop_fd = -1);

}  // namespace forcegrid::simulator
