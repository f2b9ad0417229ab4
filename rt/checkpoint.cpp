// SPDX-License-Identifier: Apache-2.0
#include "rt/checkpoint.h"

#include <utility>

namespace forcegrid::rt {
namespace {

thread_local Supervised* of_this_thread = nullptr;

}  // namespace

Supervised::Supervised(Supervision supervision)
    : supervision_(std::move(supervision)),
      before_(std::exchange(of_this_thread, this)),
      told_(std::chrono::steady_clock::now()) {}

Supervised::~Supervised() { of_this_thread = before_; }

void Supervised::tell() noexcept {
  if (!supervision_.alive) {
    return;
  }
  const auto now = std::chrono::steady_clock::now();
  if (now - told_ >= supervision_.period) {
    told_ = now;
    supervision_.alive(done_);
  }
}

PartOfWork::PartOfWork(double from, double to) noexcept : supervised_(of_this_thread) {
  if (supervised_ != nullptr) {
    from_ = supervised_->from_;
    to_ = supervised_->to_;
    supervised_->from_ = from_ + from * (to_ - from_);
    supervised_->to_ = from_ + to * (to_ - from_);
  }
}

PartOfWork::~PartOfWork() {
  if (supervised_ != nullptr) {
    supervised_->done_ = supervised_->to_;
    supervised_->from_ = from_;
    supervised_->to_ = to_;
  }
}

void checkpoint() {
  if (of_this_thread == nullptr) {
    return;
  }
  const std::atomic<bool>* const stop = of_this_thread->supervision_.stop;
  if (stop != nullptr && stop->load(std::memory_order_relaxed)) {
    throw Interrupted();
  }
  of_this_thread->tell();
}

void checkpoint(std::size_t done, std::size_t total) {
  note_progress(done, total);
  checkpoint();
}

void note_progress() noexcept {
  if (of_this_thread != nullptr) {
    of_this_thread->tell();
  }
}

void note_progress(std::size_t done, std::size_t total) noexcept {
  if (of_this_thread != nullptr && total > 0) {
    Supervised& work = *of_this_thread;
    const double share = static_cast<double>(done) / static_cast<double>(total);
    work.done_ = work.from_ + share * (work.to_ - work.from_);
    work.tell();
  }
}

const std::atomic<bool>* supervising_stop() noexcept {
  return of_this_thread == nullptr ? nullptr : of_this_thread->supervision_.stop;
}

}  // namespace forcegrid::rt
