// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "link/key.h"
#include "link/messages.h"
#include "rt/clock.h"
#include "simulator/workers/answer_check.h"
#include "simulator/workers/worker_protocol.h"
#include "simulator/workers/worker_statistics.h"

namespace forcegrid::simulator {

/// Distributes jobs to workers. They may join and leave at any time, on any machine that has the
/// key (ZeroMQ with CURVE; clients without the key are refused).
///
/// A worker has one job at a time; the one that has waited longest gets the next. A job without an
/// answer after kPatience is taken back. Its answer is then late and dropped, and the worker gets
/// no new job before it.
///
/// The pool decides which answers are to be checked; the caller checks them and reports with
/// judge(). Every answer of a worker on probation is checked, until kProbation in a row were right.
/// After that, one in kCheckOneIn is checked, drawn at random so that a worker cannot know which.
/// On probation a worker gets no new job before its last answer is judged. Unreadable messages and
/// unrequested answers count as wrong. A wrong answer puts a worker on probation again. A worker
/// that was wrong in kMaxWrong of the last kRecentChecks is expelled. It is not expelled at once,
/// because honest workers can differ on an object with several equilibria.
///
/// Real-time: no. Threads: one at a time; ZeroMQ has threads of its own.
class WorkerPool {
 public:
  static constexpr auto kPatience = std::chrono::milliseconds(500);
  static constexpr auto kSilence = std::chrono::seconds(4);
  static constexpr unsigned kProbation = 3;
  static constexpr unsigned kCheckOneIn = 8;
  static constexpr std::size_t kMaxWrong = 3;
  static constexpr std::size_t kRecentChecks = 20;
  static constexpr std::size_t kMaxWorkers = 1024;

  using WorkerId = std::uint64_t;  ///< never used again for another worker

  /// @param listen  ADDR:PORT, port 0 for a free one.
  /// @param object  the object that a worker must have.
  /// @param seed    of the random choice of answers to check.
  /// @param solver  the simulator's, sent to each worker.
  /// @throws Error naming the address and the remedy, link::LinkError for an invalid address.
  WorkerPool(const std::string& listen, const link::LinkKey& key, ObjectDigest object,
             std::uint32_t seed, const SolverOptions& solver = {});
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// "tcp://127.0.0.1:41234", as a worker connects to it.
  [[nodiscard]] std::string address() const;

  /// Waits for a message from a worker, at most until `until`. Signals end the wait, and it may end
  /// up to a millisecond early.
  void wait(rt::TimePoint until);

  /// Reads at most 256 messages that have arrived, and takes back jobs that took too long.
  void poll(rt::TimePoint now);

  /// Whether a worker waits for a job.
  [[nodiscard]] bool available() const noexcept;
  /// Gives the job to a waiting worker. @returns false if there is none.
  bool give(const link::Query& query, const QueryJob& job, rt::TimePoint now);
  /// Gives a job that `first` has answered to another worker, which is not on probation.
  /// @returns false if none waits.
  bool give_to_witness(const link::Query& query, const QueryJob& job, WorkerId first,
                       rt::TimePoint now);

  struct Answered {
    link::Query query;
    QueryJob job;
    StickyContact::Answer answer;
    WorkerId worker = 0;
    bool to_check = false;  ///< to be reported with judge()
    bool witness = false;   ///< from give_to_witness(); also to be reported with judge()
  };
  /// The oldest answer that was not returned yet.
  std::optional<Answered> next_answer();
  struct TakenBack {
    link::Query query;
    QueryJob job;
    bool witness = false;
  };
  /// A job that a worker did not answer.
  std::optional<TakenBack> next_taken_back();

  /// Reports the result of checking an answer.
  void judge(WorkerId id, Verdict verdict);
  /// Counts an answer of next_answer() as late, because its contact has ended.
  void count_late(WorkerId id);
  /// Starts a new run: earlier jobs are dropped.
  void forget_jobs();

  [[nodiscard]] WorkerStatistics statistics() const;

 private:
  struct Worker;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace forcegrid::simulator
