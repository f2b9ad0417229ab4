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

/// Gives jobs to any number of workers, which may join and go at any time, on any machine that has
/// the key (ZeroMQ with CURVE; who lacks the key is not let in).
///
/// A worker has one job at a time; of those that wait, the one that has waited longest gets the
/// next. A job without an answer after kPatience is taken back; the answer is then late and
/// dropped, and the worker gets nothing new before it.
///
/// The pool says which answers are to be checked, and is told with judge() how that went: those of
/// a worker on probation, that is until kProbation in a row were right, and after that one in
/// kCheckOneIn, drawn at random so that nobody knows which. On probation a worker gets no new job
/// before its last answer is judged. A message that can't be read and an answer that nobody asked
/// for count as wrong. What is wrong puts a worker on probation again; who was wrong in kMaxWrong
/// of the last kRecentChecks is expelled (not at once: an object with several equilibria makes
/// honest workers differ now and then).
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

  /// @param listen  ADDR:PORT, port 0 for a free one
  /// @param object  what a worker has to have
  /// @param seed    of the draw which answers are checked
  /// @param solver  the simulator's, which each worker is told to use
  /// @throws Error naming the address and the remedy, link::LinkError for an address that is none.
  WorkerPool(const std::string& listen, const link::LinkKey& key, ObjectDigest object,
             std::uint32_t seed, const SolverOptions& solver = {});
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// "tcp://127.0.0.1:41234", as a worker connects to it.
  [[nodiscard]] std::string address() const;

  /// Waits for a message of a worker, at most until `until`. Signals end it, and it may end up to a
  /// millisecond early.
  void wait(rt::TimePoint until);

  /// Takes in what has arrived, at most 256 messages, and takes back what took too long.
  void poll(rt::TimePoint now);

  /// A worker waits for a job.
  [[nodiscard]] bool available() const noexcept;
  /// Gives the job to a worker that waits. @returns false if there was none.
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
    bool to_check = false;  ///< owes a judge()
    bool witness = false;   ///< by give_to_witness(); owes a judge(), too
  };
  /// The oldest answer that has not been given out.
  std::optional<Answered> next_answer();
  struct TakenBack {
    link::Query query;
    QueryJob job;
    bool witness = false;
  };
  /// A job that a worker did not answer.
  std::optional<TakenBack> next_taken_back();

  /// What came out of checking an answer.
  void judge(WorkerId worker, Verdict verdict);
  /// An answer that was given out by next_answer() is of no use: its contact has ended.
  void count_late(WorkerId worker);
  /// Another run of a servo: what was asked before is of no use any more.
  void forget_jobs();

  [[nodiscard]] WorkerStatistics statistics() const;

 private:
  struct Worker;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace forcegrid::simulator
