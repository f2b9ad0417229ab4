// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "link/messages.h"
#include "rt/clock.h"
#include "simulator/workers/query_solver.h"
#include "simulator/workers/worker_pool.h"

namespace forcegrid::simulator {

/// Schedules a simulator's queries. Workers answer them if there are any; the rest is solved here,
/// in idle time.
///
/// An answer that the pool wants checked is held back until it is. A second worker, which is not on
/// probation, answers the same query. If the two differ, or no such worker is free before there is
/// idle time here, the query is solved here and that answer is sent.
/// Real-time: no. Threads: one.
class QueryScheduler {
 public:
  struct Ports {
    std::function<std::optional<link::Query>()> next_query;
    std::function<QueryJob(const link::Query&)>
        job_for;  ///< the job for a query in the present contact
    std::function<void(const link::Query&, const StickyContact::Answer&)> reply;
  };
  struct Counts {
    std::uint64_t not_finite = 0;  ///< answers of the local solver that were dropped
    std::uint64_t unchecked = 0;   ///< workers' answers dropped for want of time to check them
  };

  /// @param pool  null: no workers.
  /// Throws Error as ElasticObject does.
  QueryScheduler(const Scene& scene, const SolverOptions& options, Ports ports,
                 std::unique_ptr<WorkerPool> pool);

  /// Sets how many queries wait at Ports::next_query.
  void set_waiting(std::size_t queries) noexcept { waiting_ = queries; }
  /// Gives queries to workers and sends their answers. Does not wait.
  void serve_workers(rt::TimePoint now);
  /// Solves one check or query if it is expected to be done by `deadline`.
  /// @returns whether it solved one.
  bool solve_one(rt::TimePoint deadline);
  /// Solves at once, before everything that waits.
  StickyContact::Answer solve_now(const QueryJob& job) { return solver_.answer(job); }
  /// Starts a new run: earlier queries are dropped.
  void begin_anew();

  /// Null: no workers.
  [[nodiscard]] WorkerPool* pool() const noexcept { return pool_.get(); }
  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  struct Claim {
    WorkerPool::WorkerId worker = 0;
    StickyContact::Answer answer;
  };
  struct Check {
    link::Query query;
    QueryJob job;
    std::vector<Claim> claims;  ///< one, or two that differ
  };

  void take(const WorkerPool::Answered& answered);
  void seek_witnesses(rt::TimePoint now);
  void take_witness(const WorkerPool::Answered& answered);
  void take_back(const WorkerPool::TakenBack& job);
  void check_here(Check check);
  std::optional<Check> witnessed(const link::Query& query);
  void drop(const Check& check, bool late);
  void settle(const Check& check);
  bool current(const link::Query& query, const QueryJob& job) const;
  std::optional<link::Query> next_query();

  QuerySolver solver_;
  Ports ports_;
  std::unique_ptr<WorkerPool> pool_;
  std::vector<Check> with_witness_;
  std::deque<Check> checks_;  ///< for the local solver, or for a second worker that becomes free
  std::deque<link::Query> left_over_;  ///< that workers did not answer
  std::size_t waiting_ = 0;
  double expected_s_ = 0.0;  ///< [s] expected time of an answer: that of the last one
  Counts counts_;
};

}  // namespace forcegrid::simulator
