// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "cli/run/run_judgement.h"
#include "servo_loop/link_thread.h"
#include "simulator/reference/reference_solution.h"
#include "simulator/reference/shared_reference.h"

namespace forcegrid::cli {

/// What one of several devices' runs has left behind when its loop is over.
struct ToolRun {
  std::optional<servo::FirstContact> contact;  ///< nothing: the tool never touched the object
  ContactCycles cycles;
  const std::deque<servo::ArrivedSample>* samples = nullptr;  ///< all that it got, in order
};

/// The ways of several tools through a run, for their reference forces.
///
/// A tool that takes hold of the object finds it as the other tools had deformed it in the
/// simulator's solution before. Where each of them was then is in its newest sample that is at
/// least half a simulator's period older than the touch. A tool whose loop ended more than 0.1 s
/// before another one's let go then; one that ended with the others stays where it was last, unless
/// a last solution fell between their ends: the samples of the others then begin a new contact.
/// @param simulator_period_s  [s] from solution to solution
std::vector<simulator::ToolPath> paths_of(const std::vector<ToolRun>& runs,
                                          double simulator_period_s);

/// The reference forces of several tools on one object, which are solved together when the first of
/// them is asked for. Threads: one.
class SharedReferenceForces {
 public:
  /// @param paths  one per device, see paths_of()
  explicit SharedReferenceForces(std::vector<simulator::ToolPath> paths)
      : paths_(std::move(paths)) {}

  /// Of the device with this index, one force per cycle of its path.
  /// @param options  scene, cancellation and progress; of the first call that is not cancelled
  /// @throws simulator::Error, see simulate_shared_reference().
  const simulator::ReferenceSolution& of(std::size_t device,
                                         const simulator::ReferenceOptions& options);

 private:
  std::vector<simulator::ToolPath> paths_;
  std::vector<simulator::ReferenceSolution> solved_;
};

}  // namespace forcegrid::cli
