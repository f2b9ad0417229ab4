// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <exception>
#include <functional>
#include <optional>

namespace forcegrid::rt {

/// Long work was stopped at a checkpoint(), because somebody asked for it.
class Interrupted : public std::exception {
 public:
  const char* what() const noexcept override { return "stopped"; }
};

/// What a thread's checkpoints look at, and whom they tell that the work goes on.
struct Supervision {
  const std::atomic<bool>* stop = nullptr;  ///< true: the next checkpoint() throws; null: never
  /// Called by a checkpoint at most once every `period`, with the share [0, 1] of the work that is
  /// done, where the checkpoints know it; it must not throw. Empty: nobody asks.
  std::function<void(std::optional<double> done)> alive{};
  std::chrono::milliseconds period{500};
};

/// While it lives, the checkpoints of the thread that made it look at `supervision`; afterwards at
/// what they looked at before. A thread without one is never interrupted, so the servo loop and its
/// methods are not. run_jobs() hands the caller's `stop` on to its threads.
/// Threads: made and destroyed by the same thread, in the order of a stack.
class Supervised {
 public:
  explicit Supervised(Supervision supervision);
  ~Supervised();
  Supervised(const Supervised&) = delete;
  Supervised& operator=(const Supervised&) = delete;

 private:
  friend class PartOfWork;
  friend void checkpoint();
  friend void note_progress() noexcept;
  friend void note_progress(std::size_t done, std::size_t total) noexcept;
  friend const std::atomic<bool>* supervising_stop() noexcept;

  void tell() noexcept;

  Supervision supervision_;
  Supervised* before_;
  std::chrono::steady_clock::time_point told_;
  std::optional<double> done_;
  double from_ = 0.0;  // of the innermost PartOfWork, as shares of the whole
  double to_ = 1.0;
};

/// While it lives, what this thread's checkpoints call done is done of this part of the work: from
/// the share `from` to the share `to` of the part around it, by the time that it is likely to take.
/// Threads: as Supervised; without one it does nothing.
class PartOfWork {
 public:
  PartOfWork(double from, double to) noexcept;
  ~PartOfWork();
  PartOfWork(const PartOfWork&) = delete;
  PartOfWork& operator=(const PartOfWork&) = delete;

 private:
  Supervised* const supervised_;
  double from_ = 0.0;  // of the part around
  double to_ = 1.0;
};

/// A place in long work where it may be stopped: loops over a mesh's elements pass one every few
/// thousand elements, benches one for each position. It costs some nanoseconds, and with `alive`
/// the reading of a clock.
/// @throws Interrupted if the thread's supervision asks to stop.
/// Real-time: no (may throw).
void checkpoint();

/// checkpoint() after `done` of `total` pieces of this PartOfWork.
void checkpoint(std::size_t done, std::size_t total);

/// checkpoint() at every 4096th `number`, for loops over the elements of a mesh.
inline void checkpoint_at(std::size_t number) {
  if (number % 4096 == 0) {
    checkpoint();
  }
}

inline void checkpoint_at(std::size_t number, std::size_t total) {
  if (number % 4096 == 0) {
    checkpoint(number, total);
  }
}

/// checkpoint() for work that must not throw: it only tells that the work goes on.
void note_progress() noexcept;
void note_progress(std::size_t done, std::size_t total) noexcept;

/// The flag that this thread's checkpoints look at; null: none.
const std::atomic<bool>* supervising_stop() noexcept;

}  // namespace forcegrid::rt
