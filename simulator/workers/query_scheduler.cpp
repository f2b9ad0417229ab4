// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/query_scheduler.h"

#include <algorithm>
#include <utility>

#include "simulator/workers/answer_check.h"

namespace forcegrid::simulator {
namespace {

// A query is begun only if this many times the last one's time is left before the deadline.
constexpr double kMargin = 2.0;
constexpr double kDecay = 0.7;  // of the expected time, each time that too little was left
constexpr std::size_t kMaxChecks = 64;
constexpr std::size_t kMaxLeftOver = 256;

}  // namespace

QueryScheduler::QueryScheduler(const Scene& scene, const SolverOptions& options, Ports ports,
                               std::unique_ptr<WorkerPool> pool)
    : solver_(scene, options), ports_(std::move(ports)), pool_(std::move(pool)) {}

bool QueryScheduler::current(const link::Query& query, const QueryJob& job) const {
  return job.same_contact(ports_.job_for(query));
}

void QueryScheduler::serve_workers(rt::TimePoint now) {
  if (!pool_) {
    return;
  }
  pool_->poll(now);
  while (const auto answered = pool_->next_answer()) {
    if (answered->witness) {
      take_witness(*answered);
    } else {
      take(*answered);
    }
  }
  while (const auto job = pool_->next_taken_back()) {
    take_back(*job);
  }
  seek_witnesses(now);
  while (pool_->available() && waiting_ + left_over_.size() > 0) {
    const auto query = next_query();
    if (query && !pool_->give(*query, ports_.job_for(*query), now)) {
      left_over_.push_front(*query);
    }
  }
}

void QueryScheduler::seek_witnesses(rt::TimePoint now) {
  for (auto check = checks_.begin(); check != checks_.end();) {
    if (check->claims.size() == 1 && current(check->query, check->job) &&
        pool_->give_to_witness(check->query, check->job, check->claims[0].worker, now)) {
      with_witness_.push_back(std::move(*check));
      check = checks_.erase(check);
    } else {
      ++check;
    }
  }
}

void QueryScheduler::take(const WorkerPool::Answered& answered) {
  Check check{answered.query, answered.job, {{answered.worker, answered.answer}}};
  if (!answered.to_check) {
    if (current(answered.query, answered.job)) {
      ports_.reply(answered.query, answered.answer);
    } else {
      pool_->count_late(answered.worker);
    }
  } else if (!current(answered.query, answered.job)) {
    drop(check, true);
  } else {
    check_here(std::move(check));
  }
}

std::optional<QueryScheduler::Check> QueryScheduler::witnessed(const link::Query& query) {
  const auto found = std::ranges::find_if(
      with_witness_, [&](const Check& check) { return check.query.query_id == query.query_id; });
  if (found == with_witness_.end()) {
    return std::nullopt;
  }
  Check check = std::move(*found);
  with_witness_.erase(found);
  return check;
}

void QueryScheduler::take_witness(const WorkerPool::Answered& answered) {
  auto check = witnessed(answered.query);
  if (!check) {
    pool_->judge(answered.worker, Verdict::kUndecided);
    return;
  }
  check->claims.push_back({answered.worker, answered.answer});
  if (!current(check->query, check->job)) {
    drop(*check, true);
  } else if (check_answer(check->claims[0].answer, check->claims[1].answer) == Verdict::kRight) {
    for (const Claim& claim : check->claims) {
      pool_->judge(claim.worker, Verdict::kRight);
    }
    ports_.reply(check->query, check->claims[0].answer);
  } else {
    check_here(std::move(*check));
  }
}

void QueryScheduler::take_back(const WorkerPool::TakenBack& job) {
  if (job.witness) {
    if (auto check = witnessed(job.query)) {
      check_here(std::move(*check));
    }
  } else if (current(job.query, job.job)) {
    left_over_.push_back(job.query);
    if (left_over_.size() > kMaxLeftOver) {
      left_over_.pop_front();
    }
  }
}

void QueryScheduler::check_here(Check check) {
  checks_.push_back(std::move(check));
  if (checks_.size() > kMaxChecks) {
    drop(checks_.front(), false);
    checks_.pop_front();
  }
}

void QueryScheduler::drop(const Check& check, bool late) {
  counts_.unchecked += late ? 0 : 1;
  for (const Claim& claim : check.claims) {
    pool_->judge(claim.worker, Verdict::kUndecided);
    if (late) {
      pool_->count_late(claim.worker);
    }
  }
}

std::optional<link::Query> QueryScheduler::next_query() {
  if (!left_over_.empty()) {
    const link::Query query = left_over_.front();
    left_over_.pop_front();
    return query;
  }
  const auto query = ports_.next_query();
  waiting_ = query && waiting_ > 0 ? waiting_ - 1 : 0;
  return query;
}

bool QueryScheduler::solve_one(rt::TimePoint deadline) {
  if (waiting_ + left_over_.size() + checks_.size() == 0) {
    return false;
  }
  if (rt::seconds(deadline - rt::Clock::now()) < kMargin * expected_s_) {
    expected_s_ *= kDecay;  // so that one slow answer does not stop all later ones
    return false;
  }
  if (!checks_.empty()) {
    const Check check = std::move(checks_.front());
    checks_.pop_front();
    if (!current(check.query, check.job)) {
      drop(check, true);
      return false;
    }
    settle(check);
    return true;
  }
  const auto query = next_query();
  if (!query) {
    return false;
  }
  const StickyContact::Answer answer = solver_.answer(ports_.job_for(*query));
  expected_s_ = solver_.last_solve_s();
  if (finite(answer.equilibrium)) {
    ports_.reply(*query, answer);
  } else {
    ++counts_.not_finite;
  }
  return true;
}

void QueryScheduler::settle(const Check& check) {
  const StickyContact::Answer own = solver_.answer(check.job);
  expected_s_ = solver_.last_solve_s();
  const bool usable = finite(own.equilibrium);
  for (const Claim& claim : check.claims) {
    pool_->judge(claim.worker, usable ? check_answer(claim.answer, own) : Verdict::kUndecided);
  }
  if (usable) {
    ports_.reply(check.query, own);
  } else {
    ++counts_.not_finite;
  }
}

void QueryScheduler::begin_anew() {
  solver_.release();
  with_witness_.clear();
  checks_.clear();
  left_over_.clear();
  waiting_ = 0;
  if (pool_) {
    pool_->forget_jobs();
  }
}

}  // namespace forcegrid::simulator
