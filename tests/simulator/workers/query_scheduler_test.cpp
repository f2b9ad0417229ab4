// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/query_scheduler.h"

#include <gtest/gtest.h>

#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "tests/link/counting_key.h"
#include "tests/simulator/workers/scripted_worker.h"

namespace forcegrid::simulator {
namespace {

using namespace std::chrono_literals;

constexpr int kLooks = 8000;  ///< of 2 ms
constexpr std::uint32_t kSeed = 5;

/// A scheduler whose queries are pushes of one contact, with workers that a test answers for.
class QuerySchedulerTest : public testing::Test {
 protected:
  struct Reply {
    std::uint32_t query_id = 0;
    StickyContact::Answer answer;
  };
  struct Colleague {
    ScriptedWorker socket;
    double force_factor = 1.0;  ///< of what it says to what is so
    std::deque<NumberedJob> jobs{};
    bool answers = true;
  };

  QuerySchedulerTest() {
    auto pool = std::make_unique<WorkerPool>("127.0.0.1:0", key_, digest_of(scene_), kSeed);
    address_ = pool->address();
    desk_ = std::make_unique<QueryScheduler>(
        scene_, SolverOptions{},
        QueryScheduler::Ports{
            [this] { return take_query(); },
            [this](const link::Query& query) { return job_for(query); },
            [this](const link::Query& query, const StickyContact::Answer& answer) {
              replies_.push_back({query.query_id, answer});
            }},
        std::move(pool));
  }

  std::optional<link::Query> take_query() {
    if (queries_.empty()) {
      return std::nullopt;
    }
    const link::Query query = queries_.front();
    queries_.pop_front();
    return query;
  }
  QueryJob job_for(const link::Query& query) const {
    QueryJob job;
    job.epoch = epoch_;
    job.touching = true;
    job.position_W = {query.position_W_m[0], query.position_W_m[1], query.position_W_m[2]};
    return job;
  }
  void ask() {
    link::Query query;
    query.query_id = ++asked_;
    query.position_W_m = {0.0, 0.0, -1e-4 * (1 + asked_ % 50)};
    queries_.push_back(query);
  }

  Colleague& hire(double force_factor) {
    colleagues_.push_back(
        std::make_unique<Colleague>(Colleague{ScriptedWorker(address_, key_), force_factor}));
    Colleague& colleague = *colleagues_.back();
    const std::uint64_t before = desk_->pool()->statistics().joined;
    EXPECT_TRUE(until([&] {
      if (!said_hello_) {
        said_hello_ = colleague.socket.say(to_text(hello_of("colleague")));
      }
      return desk_->pool()->statistics().joined == before + 1;
    }));
    said_hello_ = false;
    return colleague;
  }

  /// One look at everything: workers answer, the scheduler serves and, if it may, solves.
  void look() {
    for (const auto& colleague : colleagues_) {
      while (const auto text = colleague->socket.heard()) {
        if (const auto job = read_job(*text)) {
          colleague->jobs.push_back(*job);
        }
      }
      while (colleague->answers && !colleague->jobs.empty()) {
        const NumberedJob job = colleague->jobs.front();
        colleague->jobs.pop_front();
        NumberedAnswer numbered{job.id, reference_.answer(job.job)};
        numbered.answer.equilibrium.force_W *= colleague->force_factor;
        colleague->socket.say(to_text(numbered));
      }
    }
    desk_->set_waiting(queries_.size());
    desk_->serve_workers(now_ += 100us);
    if (solves_itself_) {
      desk_->solve_one(rt::Clock::now() + 1h);
    }
    std::this_thread::sleep_for(2ms);
  }
  bool until(const std::function<bool()>& condition) {
    for (int i = 0; i < kLooks; ++i) {
      look();
      if (condition()) {
        return true;
      }
    }
    return false;
  }
  /// Asks until as many queries have been answered; workers have them first.
  void get_replies(std::size_t count) {
    solves_itself_ = true;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t before = replies_.size();
      ask();
      ASSERT_TRUE(until([&] { return replies_.size() > before; }));
    }
  }
  /// Gets the only worker through its probation.
  void earn_trust() {
    constexpr std::size_t kEnough = 500;
    while (desk_->pool()->statistics().right < WorkerPool::kProbation &&
           replies_.size() < kEnough) {
      get_replies(1);
    }
    ASSERT_LT(replies_.size(), kEnough);
  }
  void get_replies_until_one_is_expelled() {
    constexpr std::size_t kEnough = 500;
    while (desk_->pool()->statistics().expelled == 0 && replies_.size() < kEnough) {
      get_replies(1);
    }
    ASSERT_EQ(desk_->pool()->statistics().expelled, 1U);
  }
  bool is_true(const Reply& reply) {
    QueryJob job;
    job.epoch = reply.answer.epoch;
    job.touching = true;
    job.position_W = reply.answer.position_W;
    return check_answer(reply.answer, reference_.answer(job)) == Verdict::kRight;
  }
  std::size_t false_replies(std::size_t from = 0) {
    std::size_t count = 0;
    for (std::size_t i = from; i < replies_.size(); ++i) {
      count += is_true(replies_[i]) ? 0 : 1;
    }
    return count;
  }

  Scene scene_ = make_scene(kWorkersScene);
  link::LinkKey key_ = link::counting_key();
  QuerySolver reference_{scene_, {}};
  std::string address_;
  std::uint32_t epoch_ = 1;
  std::uint32_t asked_ = 0;
  std::deque<link::Query> queries_;
  std::vector<Reply> replies_;
  std::vector<std::unique_ptr<Colleague>> colleagues_;
  rt::TimePoint now_ = rt::Clock::now();  ///< the pool's time, which the test moves on
  bool said_hello_ = false;
  bool solves_itself_ = false;
  std::unique_ptr<QueryScheduler> desk_;
};

TEST_F(QuerySchedulerTest, SolvesByItselfWithoutWorkers) {
  get_replies(5);
  EXPECT_EQ(false_replies(), 0U);
  EXPECT_EQ(replies_.back().query_id, 5U);
}

TEST_F(QuerySchedulerTest, SendsOnNothingThatALiarSaysFromTheBeginning) {
  hire(3.0);
  get_replies_until_one_is_expelled();
  EXPECT_EQ(false_replies(), 0U);
  EXPECT_EQ(desk_->pool()->statistics().wrong, WorkerPool::kMaxWrong);
}

TEST_F(QuerySchedulerTest, BelievesNoMoreOfATrustedWorkerOnceALieIsFound) {
  Colleague& colleague = hire(1.0);
  earn_trust();
  EXPECT_EQ(false_replies(), 0U);
  colleague.force_factor = 1.3;
  SCOPED_TRACE(kSeed);
  constexpr std::size_t kEnough = 500;
  while (desk_->pool()->statistics().wrong == 0 && replies_.size() < kEnough) {
    get_replies(1);
  }
  const std::size_t found = replies_.size();
  ASSERT_LT(found, kEnough);
  get_replies_until_one_is_expelled();
  EXPECT_EQ(false_replies(found), 0U);
}

TEST_F(QuerySchedulerTest, LetsATrustedWorkerCheckANewOneWithoutSolvingAnything) {
  hire(1.0);
  earn_trust();
  solves_itself_ = false;
  hire(1.0);
  const std::size_t before = replies_.size();
  for (int i = 0; i < 20; ++i) {
    ask();
  }
  ASSERT_TRUE(
      until([&] { return desk_->pool()->statistics().right >= 2 * WorkerPool::kProbation; }));
  EXPECT_GT(replies_.size(), before);
  EXPECT_EQ(false_replies(), 0U);
}

TEST_F(QuerySchedulerTest, DecidesItselfWhenTwoWorkersDiffer) {
  hire(1.0);
  earn_trust();
  hire(3.0);
  get_replies_until_one_is_expelled();
  const WorkerStatistics statistics = desk_->pool()->statistics();
  EXPECT_EQ(false_replies(), 0U);
  ASSERT_EQ(statistics.workers.size(), 2U);
  EXPECT_EQ(statistics.workers[0].wrong, 0U);
  EXPECT_FALSE(statistics.workers[0].expelled);
  EXPECT_TRUE(statistics.workers[1].expelled);
}

TEST_F(QuerySchedulerTest, DropsAnswersForAContactThatHasEnded) {
  Colleague& slow = hire(1.0);
  earn_trust();
  slow.answers = false;
  solves_itself_ = false;
  const std::size_t before = replies_.size();
  ask();
  ASSERT_TRUE(until([&] { return !slow.jobs.empty(); }));
  ++epoch_;
  slow.answers = true;
  ASSERT_TRUE(until([&] { return desk_->pool()->statistics().late == 1; }));
  EXPECT_EQ(replies_.size(), before);
}

TEST_F(QuerySchedulerTest, AnswersForAWorkerThatLags) {
  Colleague& slow = hire(1.0);
  slow.answers = false;
  ask();
  ASSERT_TRUE(until([&] { return !slow.jobs.empty(); }));
  get_replies(1);
  now_ += WorkerPool::kPatience + 1ms;
  ASSERT_TRUE(until([&] { return replies_.size() == 2; }));
  EXPECT_EQ(false_replies(), 0U);
  EXPECT_EQ(desk_->pool()->statistics().taken_back, 1U);
}

}  // namespace
}  // namespace forcegrid::simulator
