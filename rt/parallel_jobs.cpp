// SPDX-License-Identifier: Apache-2.0
#include "rt/parallel_jobs.h"

#include <algorithm>
#include <cassert>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

#include "rt/checkpoint.h"
#include "rt/clock.h"

namespace forcegrid::rt {
namespace {

class JobPool {
 public:
  JobPool(std::size_t count, const JobOptions& options, const std::function<bool(Job&)>& work)
      : count_(count), options_(options), work_(work), done_(count) {
    assert(options.weights.empty() || options.weights.size() == count);
  }

  bool run() {
    const unsigned wanted = options_.threads != 0
                                ? options_.threads
                                : std::max(1U, std::thread::hardware_concurrency());
    running_ = std::min<std::size_t>(wanted, count_);
    std::vector<std::jthread> threads;
    threads.reserve(running_);
    try {
      for (std::size_t i = running_; i > 0; --i) {
        threads.emplace_back([this] { work_through(); });
      }
      wait();
    } catch (...) {
      stop_ = true;
      throw;  // the threads are joined on the way
    }
    threads.clear();
    if (failure_) {
      std::rethrow_exception(failure_);
    }
    if (finished_ != count_) {
      return false;
    }
    if (options_.progress) {
      options_.progress(1.0, 0.0);
    }
    return true;
  }

 private:
  bool cancelled() const noexcept {
    const auto asked = [](const std::atomic<bool>* flag) {
      return flag != nullptr && flag->load(std::memory_order_relaxed);
    };
    return asked(options_.cancel) || asked(supervising_);
  }

  void work_through() noexcept {
    const Supervised supervised({.stop = supervising_});
    try {
      while (!stop_ && !cancelled()) {
        const std::size_t number = next_.fetch_add(1, std::memory_order_relaxed);
        if (number >= count_) {
          break;
        }
        Job job(number, done_[number], stop_, options_.cancel);
        if (work_(job)) {
          job.report(1.0);
          ++finished_;
        }
      }
    } catch (const Interrupted&) {
      stop_ = true;  // as a job that stopped early
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!failure_) {
        failure_ = std::current_exception();
      }
      stop_ = true;
    }
    const std::lock_guard lock(mutex_);
    --running_;
    ended_.notify_all();
  }

  void wait() {
    std::unique_lock lock(mutex_);
    while (!ended_.wait_for(lock, options_.period, [this] { return running_ == 0; })) {
      if (cancelled()) {
        stop_ = true;
      }
      if (options_.progress) {
        lock.unlock();
        const double done = fraction_done();
        options_.progress(done, done > 0.0 ? seconds(Clock::now() - start_) * (1.0 - done) / done
                                           : options_.first_guess_s);
        lock.lock();
      }
    }
  }

  double fraction_done() const noexcept {
    double sum = 0.0;
    double whole = 0.0;
    for (std::size_t i = 0; i < count_; ++i) {
      const double weight = options_.weights.empty() ? 1.0 : options_.weights[i];
      sum += weight * done_[i].load(std::memory_order_relaxed);
      whole += weight;
    }
    return std::min(1.0, sum / whole);
  }

  std::size_t count_;
  const JobOptions& options_;
  const std::function<bool(Job&)>& work_;
  const std::atomic<bool>* const supervising_ = supervising_stop();  // of the calling thread
  const TimePoint start_ = Clock::now();
  std::vector<std::atomic<double>> done_;  // of each job, in [0, 1]
  std::atomic<std::size_t> next_{0};
  std::atomic<std::size_t> finished_{0};
  std::atomic<bool> stop_{false};
  std::mutex mutex_;  // guards what follows
  std::condition_variable ended_;
  std::size_t running_ = 0;
  std::exception_ptr failure_;
};

}  // namespace

void Job::report(double done) noexcept {
  if (done > done_.load(std::memory_order_relaxed)) {
    done_.store(std::min(done, 1.0), std::memory_order_relaxed);
  }
}

bool Job::stopping() const noexcept {
  return stop_.load(std::memory_order_relaxed) ||
         (cancel_ != nullptr && cancel_->load(std::memory_order_relaxed));
}

bool run_jobs(std::size_t count, const JobOptions& options, const std::function<bool(Job&)>& work) {
  return count == 0 || JobPool(count, options, work).run();
}

}  // namespace forcegrid::rt
