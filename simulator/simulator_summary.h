// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "simulator/impaired_link.h"
#include "simulator/solver/reduced_use.h"
#include "simulator/workers/worker_statistics.h"

namespace forcegrid::simulator {

/// What was sent to the live view.
struct SurfaceUse {
  std::uint64_t frames = 0;
  std::uint64_t inside_frames = 0;  ///< sent while a page showed the inside
  std::uint64_t dropped = 0;        ///< of both, because the view was slow
  bool view_lost = false;           ///< it went away during the run
  double mean_ms = 0.0;  ///< [ms] of a frame: copying the positions, encoding, handing over
  double max_ms = 0.0;
};

/// The model that was simulated in place of the scene as written, see choose_model().
struct ModelUse {
  struct Trial {
    std::string model;
    double mean_ms = 0.0;
    double error_percent = 0.0;
  };
  double tolerance_percent = 0.0;
  std::string chosen;
  std::string why;
  std::vector<Trial> trials;  ///< the cheapest first
};

/// Results of one run of the simulator.
struct SimulatorSummary {
  std::string scene;
  std::string tool;       ///< ToolOptions::shape
  std::string contact;    ///< ToolOptions::contact
  std::string listening;  ///< ADDR:PORT
  std::size_t vertices = 0;
  std::size_t springs = 0;
  std::string solver;                 ///< the one that was used, see to_string(SolverKind)
  std::string solver_why;             ///< why it was chosen
  std::optional<ModelUse> model;      ///< nothing: the scene as written
  double rate_Hz = 0.0;               ///< at the end
  LinkConditions link;                ///< likewise
  std::uint64_t control_changes = 0;  ///< of single values: rate, link, wall, cut
  std::uint64_t delayed = 0;          ///< datagrams that were delayed on purpose
  std::uint64_t lost_on_purpose = 0;  ///< and those that were lost
  std::uint64_t sessions = 0;         ///< servo sessions
  std::uint64_t ticks = 0;            ///< deadlines, with or without a tool state to answer
  std::uint64_t answers = 0;          ///< samples sent
  std::uint64_t patches = 0;          ///< surface patches sent
  std::uint64_t replies = 0;          ///< queries answered
  std::uint64_t queries_refused = 0;  ///< because force depends on the tool's path
  std::uint64_t late_ticks = 0;       ///< answers that were ready after the next deadline
  std::uint64_t missed_ticks =
      0;  ///< deadlines skipped because an answer took longer than a period
  std::uint64_t send_failures = 0;
  std::string workers_at;       ///< tcp://ADDR:PORT; empty without workers
  WorkerStatistics workers;     ///< all zero without workers
  std::uint64_t unchecked = 0;  ///< QueryScheduler::Counts::unchecked
  /// Dropped datagrams, by reason.
  std::vector<std::pair<std::string, std::uint64_t>> dropped;
  std::uint64_t contacts = 0;
  std::uint64_t unconverged = 0;      ///< answers whose tolerance was not reached
  std::uint64_t branch_changes = 0;   ///< answers that moved to another branch of equilibria
  std::uint64_t long_steps = 0;       ///< answers that needed longer time steps, see SolverReport
  std::uint64_t not_reached = 0;      ///< moves too long for one tick, answered part of the way
  std::uint64_t not_finite = 0;       ///< answers that were not sent; the object was reset
  std::uint64_t whole_solutions = 0;  ///< solutions of the whole object, see SolverReport
  ReducedUse reduced;                 ///< all zero without reduced models
  double worst_relative_residual = 0.0;
  /// [ms] Wall time of one answer in contact, without the grab that begins the contact.
  double solve_mean_ms = 0.0;
  double solve_p50_ms = 0.0;
  double solve_p99_ms = 0.0;
  double solve_max_ms = 0.0;
  double grab_max_ms = 0.0;
  double iterations_mean = 0.0;       ///< conjugate-gradient iterations per answer
  std::optional<SurfaceUse> surface;  ///< nothing without a live view
  /// One servo's place.
  struct ToolUse {
    std::uint16_t tool = 0;  ///< of its last servo
    std::uint64_t sessions = 0;
    std::uint64_t answers = 0;
    std::uint64_t contacts = 0;
  };
  std::vector<ToolUse> tools;  ///< by place; empty: it served one tool
  std::uint64_t faults = 0;    ///< of several tools: servos that failed or fell silent
};

/// Keys carry the units.
nlohmann::json to_json(const SimulatorSummary& summary);

}  // namespace forcegrid::simulator
