// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "simulator/workers/query_solver.h"

/// The protocol between a simulator and its workers: one JSON object per ZeroMQ message, encrypted
/// with CURVE. Lengths in m, forces in N, all vectors in the workspace frame W.
///
/// | from      | keys                                                                           |
/// |-----------|--------------------------------------------------------------------------------|
/// | worker    | hello: its name; scene, vertices, springs, stiffness_sum_N_per_m, length_sum_m, |
/// |           | patch_radius_m. Each second, also as a sign of life                             |
/// | simulator | welcome: true; relative_tolerance, border_tolerance, of its solver              |
/// | simulator | refused: the reason, in place of a welcome                                      |
/// | simulator | job: id; epoch, touching, point_W_m [3], position_W_m [3]                       |
/// | worker    | job: id; epoch, in_contact, converged, position_W_m [3], force_W_N [3],         |
/// |           | stiffness_W_N_per_m [9, by rows], relative_residual, solve_time_s               |
/// | worker    | gave_up: id, of a job for which it found no finite force                        |
namespace forcegrid::simulator {

/// Identifies an object without sending it.
struct ObjectDigest {
  std::string scene;  ///< for messages only: the file's path may differ on another machine
  std::uint64_t vertices = 0;
  std::uint64_t springs = 0;
  double stiffness_sum_N_per_m = 0.0;
  double length_sum_m = 0.0;  ///< of the natural lengths
  double patch_radius_m = 0.0;
};

ObjectDigest digest_of(const Scene& scene);

/// Whether both may be the same object: equal counts, and sums and radius that agree to 1e-6 of
/// themselves (another compiler may round differently). Checks of answers find other differences.
bool same_object(const ObjectDigest& one, const ObjectDigest& other) noexcept;

struct WorkerHello {
  std::string name;  ///< for reports; any text, of which kMaxNameBytes printable ones are kept
  ObjectDigest object;
};
inline constexpr std::size_t kMaxNameBytes = 64;

struct NumberedJob {
  std::uint64_t id = 0;
  QueryJob job;
};

struct NumberedAnswer {
  std::uint64_t id = 0;
  StickyContact::Answer answer;
};

std::string to_text(const WorkerHello& hello);
std::string to_text(const NumberedJob& job);
std::string to_text(const NumberedAnswer& numbered);
std::string gave_up_text(std::uint64_t id);
std::string refusal_text(const std::string& reason);
/// Carries the options with which a worker must solve: relative_tolerance, and border_tolerance, by
/// which quasi_static and local differ. All others are the same in every program.
std::string welcome_text(const SolverOptions& solver);

/// Each reads one kind of message; nothing if the text is another kind, incomplete, or has a number
/// that is not finite. Safe for any text. Real-time: no (allocate). Threads: any.
std::optional<WorkerHello> read_hello(const std::string& text);
std::optional<NumberedJob> read_job(const std::string& text);
std::optional<NumberedAnswer> read_answer(const std::string& text);
std::optional<std::uint64_t> read_gave_up(const std::string& text);
std::optional<std::string> read_refusal(const std::string& text);
/// `own` with the options of the welcome.
std::optional<SolverOptions> read_welcome(const std::string& text, const SolverOptions& own);

}  // namespace forcegrid::simulator
