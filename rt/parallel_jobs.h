// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <vector>

namespace forcegrid::rt {

/// What run_jobs() hands to a job: its number, a way to report progress, and whether to stop.
/// Threads: the job's own.
class Job {
 public:
  Job(std::size_t number, std::atomic<double>& done, const std::atomic<bool>& stop,
      const std::atomic<bool>* cancel) noexcept
      : number_(number), done_(done), stop_(stop), cancel_(cancel) {}

  std::size_t number() const noexcept { return number_; }  ///< 0 .. count - 1
  /// The fraction of this job that is done, in [0, 1]. A smaller one than before is ignored.
  void report(double done) noexcept;
  /// The caller cancelled, or another job threw. A long job asks often and returns false if so.
  bool stopping() const noexcept;
  /// For work inside a job that takes a flag to watch: becomes true at most one
  /// JobOptions::period after stopping() does.
  const std::atomic<bool>& stop_flag() const noexcept { return stop_; }

 private:
  std::size_t number_;
  std::atomic<double>& done_;
  const std::atomic<bool>& stop_;
  const std::atomic<bool>* cancel_;
};

struct JobOptions {
  unsigned threads = 0;  ///< at most; 0: one per processor
  /// How much of the total progress each job stands for, > 0; empty: all the same.
  std::vector<double> weights{};
  /// Called on the calling thread once every `period` with the fraction done in [0, 1], which never
  /// falls, and the time left [s] at the present pace; with (1, 0) once all jobs are finished.
  std::function<void(double done, double remaining_s)> progress{};
  double first_guess_s = 0.0;  ///< [s] the time left that is reported before anything is done
  std::chrono::milliseconds period{100};
  const std::atomic<bool>* cancel = nullptr;  ///< null: can't be cancelled
};

/// Runs the jobs 0 .. count - 1 on threads of its own, each thread taking the next one that nobody
/// has begun. Once `cancel` is true or a job has thrown, no further job begins and Job::stopping()
/// holds. The flag of the calling thread's supervision (rt/checkpoint.h) cancels as `cancel` does;
/// a job that a checkpoint interrupts counts as stopped early. Returns when every thread has ended.
/// @param work  called once per job, from several threads at the same time; returns whether it
///   finished the job. false: it stopped early.
/// @returns whether all jobs were finished.
/// @throws what the first job that threw has thrown, or what `progress` has thrown.
/// Real-time: no (starts threads, allocates, locks).
bool run_jobs(std::size_t count, const JobOptions& options, const std::function<bool(Job&)>& work);

}  // namespace forcegrid::rt
