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

/// Where a simulator's queries go: to workers if there are any, and what they leave is solved here
/// in idle time. An answer that the pool wants checked is not used before that: another worker,
/// which is not on probation, answers the same; if the two differ, or none is free before there is
/// idle time here, it is solved here and the own answer goes out.
/// Real-time: no. Threads: one.
class QueryScheduler {
 public:
  struct Ports {
    std::function<std::optional<link::Query>()> next_query;
    std::function<QueryJob(const link::Query&)> job_for;  ///< what it asks for, as things are now
    std::function<void(const link::Query&, const StickyContact::Answer&)> reply;
  };
  struct Counts {
    std::uint64_t not_finite = 0;  ///< answers of the own solver, which nobody gets
    std::uint64_t unchecked = 0;   ///< answers of workers not used, as nobody had time to check
  };

  /// @param pool  null: no workers
  /// Throws Error as ElasticObject does.
  QueryScheduler(const Scene& scene, const SolverOptions& options, Ports ports,
                 std::unique_ptr<WorkerPool> pool);

  /// So many queries wait at Ports::next_query.
  void set_waiting(std::size_t queries) noexcept { waiting_ = queries; }
  /// Gives queries to workers and sends on what they have answered. Does not wait.
  void serve_workers(rt::TimePoint now);
  /// Solves one thing, a check or a query, if it will be done by `deadline`.
  /// @returns true when it took time over one.
  bool solve_one(rt::TimePoint deadline);
  /// Solves at once for the simulator itself, whatever waits.
  StickyContact::Answer solve_now(const QueryJob& job) { return solver_.answer(job); }
  /// Another run of a servo: what was asked before is of no use any more.
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
  std::deque<Check> checks_;           ///< to be made here, or by a witness that becomes free
  std::deque<link::Query> left_over_;  ///< by workers
  std::size_t waiting_ = 0;
  double expected_s_ = 0.0;  ///< how long an answer takes, from the last one
  Counts counts_;
};

}  // namespace forcegrid::simulator
