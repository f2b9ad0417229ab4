// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <memory>

#include "simulator/mesh/scene.h"
#include "simulator/mesh/tool_options.h"
#include "simulator/run_simulator.h"
#include "simulator/simulator_summary.h"
#include "simulator/touch/solver_choice.h"

namespace forcegrid::simulator {

/// The simulator's loop for several tools on one object (SharedContact), each moved by a servo of
/// its own. At each deadline all tools go to the newest states of their servos and the object is
/// solved once; each servo whose tool has moved gets its sample, a patch of the surface in the air,
/// and where the other tools are. A servo that ends lets go; the others go on.
///
/// A servo fails when it says so in its goodbye, or falls silent. With
/// SimulatorOptions::fault_stops_all the others then get refusals in place of answers, so that
/// their runs end at zero force, until those that were there have gone. Else they go on.
///
/// A query gets the force on its tool at the place it asks for, with the other tools where they
/// are. Queries are answered between two deadlines, as long as the time lasts, the tools in turn.
/// Without contact the answer is zero.
///
/// Real-time: no. Threads: one.
class SharedLoop {
 public:
  /// Throws Error for options that several tools exclude, as SharedContact does, and
  /// link::LinkError for the address.
  SharedLoop(const SimulatorOptions& options, const Scene& scene, const SolverChoice& solver,
             const ToolOptions& tool);
  ~SharedLoop();
  SharedLoop(const SharedLoop&) = delete;
  SharedLoop& operator=(const SharedLoop&) = delete;

  const SimulatorSummary& summary() const noexcept;
  /// See run_simulator().
  SimulatorSummary run(const std::atomic<bool>& stop, int stop_fd);

 private:
  class State;
  std::unique_ptr<State> state_;
};

/// Throws Error for options that several tools exclude; before the scene is read.
void check_several_tools(const SimulatorOptions& options);

}  // namespace forcegrid::simulator
