// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/worker_pool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <thread>

#include "tests/link/counting_key.h"
#include "tests/simulator/workers/scripted_worker.h"

namespace forcegrid::simulator {
namespace {

using namespace std::chrono_literals;

constexpr int kLooks = 4000;  ///< of 5 ms: what must come has 20 s
constexpr std::uint32_t kSeed = 3;
const Eigen::Vector3d kForce_N{0.0, 0.0, 1.0};

QueryJob job_at(double push_m, std::uint32_t epoch = 1) {
  QueryJob job;
  job.epoch = epoch;
  job.touching = true;
  job.position_W = {0.0, 0.0, -push_m};
  return job;
}

class WorkerPoolTest : public testing::Test {
 protected:
  /// Lets the pool work until `condition` holds. @returns whether it came to hold.
  bool until(const std::function<bool()>& condition) {
    for (int i = 0; i < kLooks; ++i) {
      pool_.poll(now_);
      if (condition()) {
        return true;
      }
      std::this_thread::sleep_for(5ms);
    }
    return false;
  }
  std::string message_to(ScriptedWorker& worker) {
    std::optional<std::string> text;
    EXPECT_TRUE(until([&] {
      text = worker.heard();
      return text.has_value();
    }));
    return text.value_or("");
  }
  void say(ScriptedWorker& worker, const std::string& text) {
    ASSERT_TRUE(until([&] { return worker.say(text); }));
  }
  void join(ScriptedWorker& worker, const std::string& name = "worker") {
    say(worker, to_text(hello_of(name)));
    ASSERT_TRUE(read_welcome(message_to(worker), {}));
  }
  link::Query next_query() {
    link::Query query;
    query.query_id = ++query_id_;
    return query;
  }
  NumberedJob give(ScriptedWorker& worker, const QueryJob& job = job_at(0.002)) {
    EXPECT_TRUE(pool_.give(next_query(), job, now_));
    const auto given = read_job(message_to(worker));
    EXPECT_TRUE(given);
    return given.value_or(NumberedJob{});
  }
  WorkerPool::Answered next_answer() {
    std::optional<WorkerPool::Answered> answer;
    EXPECT_TRUE(until([&] {
      answer = pool_.next_answer();
      return answer.has_value();
    }));
    return answer.value_or(WorkerPool::Answered{});
  }
  WorkerPool::Answered give_and_answer(ScriptedWorker& worker) {
    say(worker, to_text(answer_to(give(worker), kForce_N)));
    return next_answer();
  }
  /// Gets a worker through its probation.
  void earn_trust(ScriptedWorker& worker) {
    for (unsigned i = 0; i < WorkerPool::kProbation; ++i) {
      pool_.judge(give_and_answer(worker).worker, Verdict::kRight);
    }
  }

  link::LinkKey key_ = link::counting_key();
  WorkerPool pool_{"127.0.0.1:0", key_, hello_of("").object, kSeed};
  rt::TimePoint now_ = rt::Clock::now();  ///< the pool's time, which the test moves on
  std::uint32_t query_id_ = 0;
};

TEST_F(WorkerPoolTest, LetsNobodyInWhoHasAnotherKey) {
  const link::LinkKey other = link::counting_key(1);
  ScriptedWorker stranger(pool_.address(), other);
  ScriptedWorker knows_the_server(pool_.address(), key_, other);
  ASSERT_TRUE(until([&] {
    stranger.say(to_text(hello_of("stranger")));
    knows_the_server.say(to_text(hello_of("half a stranger")));
    return pool_.statistics().strangers > 0;
  }));
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  EXPECT_EQ(pool_.statistics().joined, 1U);
  EXPECT_FALSE(stranger.heard() || knows_the_server.heard());
}

TEST_F(WorkerPoolTest, RefusesAWorkerOfAnotherObject) {
  WorkerHello stiffer = hello_of("stiffer");
  stiffer.object.stiffness_sum_N_per_m *= 1.0 + 1e-5;
  WorkerHello finer = hello_of("finer");
  ++finer.object.springs;
  for (const WorkerHello& hello : {stiffer, finer}) {
    ScriptedWorker worker(pool_.address(), key_);
    say(worker, to_text(hello));
    const auto reason = read_refusal(message_to(worker));
    ASSERT_TRUE(reason);
    EXPECT_THAT(*reason, testing::HasSubstr("start the worker with the same --scene"));
  }
  EXPECT_FALSE(pool_.available());
  EXPECT_EQ(pool_.statistics().refused, 2U);
}

TEST_F(WorkerPoolTest, ChecksANewWorkerAndThenOneAnswerInEight) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  unsigned checked = 0;
  constexpr unsigned kAnswers = 80;
  for (unsigned i = 0; i < WorkerPool::kProbation; ++i) {
    const WorkerPool::Answered answer = give_and_answer(worker);
    EXPECT_TRUE(answer.to_check);
    EXPECT_FALSE(pool_.available());  // before it is judged
    pool_.judge(answer.worker, Verdict::kRight);
  }
  for (unsigned i = 0; i < kAnswers; ++i) {
    const WorkerPool::Answered answer = give_and_answer(worker);
    EXPECT_EQ(answer.answer.equilibrium.force_W, kForce_N);
    EXPECT_EQ(answer.query.query_id, query_id_);
    checked += answer.to_check ? 1 : 0;
    EXPECT_TRUE(pool_.available());
  }
  SCOPED_TRACE(kSeed);
  // 10 on average, with a standard deviation of 3.
  EXPECT_GT(checked, 0U);
  EXPECT_LT(checked, 25U);
}

TEST_F(WorkerPoolTest, PutsAWorkerThatWasWrongOnProbationAgainAndExpelsItAtTheThirdTime) {
  ScriptedWorker liar(pool_.address(), key_);
  join(liar);
  earn_trust(liar);
  for (std::size_t wrong = 1; wrong <= WorkerPool::kMaxWrong; ++wrong) {
    EXPECT_TRUE(pool_.available());
    WorkerPool::Answered answer = give_and_answer(liar);
    EXPECT_TRUE(wrong == 1 || answer.to_check);
    pool_.judge(answer.worker, Verdict::kWrong);
  }
  EXPECT_EQ(pool_.statistics().expelled, 1U);
  EXPECT_FALSE(pool_.available());
  EXPECT_FALSE(pool_.give(next_query(), job_at(0.001), now_));
  EXPECT_TRUE(read_refusal(message_to(liar)));
}

TEST_F(WorkerPoolTest, KeepsAWorkerThatIsSeldomWrong) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  for (int round = 0; round < 4; ++round) {
    pool_.judge(give_and_answer(worker).worker, Verdict::kWrong);
    for (std::size_t i = 0; i < WorkerPool::kRecentChecks / 2; ++i) {
      pool_.judge(give_and_answer(worker).worker, Verdict::kRight);
    }
  }
  EXPECT_EQ(pool_.statistics().wrong, 4U);
  EXPECT_TRUE(pool_.available());
}

TEST_F(WorkerPoolTest, ExpelsAWorkerThatAnswersWhatNobodyAsked) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  NumberedJob given = give(worker);
  ++given.id;
  for (std::size_t i = 0; i < WorkerPool::kMaxWrong; ++i) {
    say(worker, to_text(answer_to(given, kForce_N)));
  }
  EXPECT_TRUE(until([&] { return pool_.statistics().expelled == 1; }));
  EXPECT_EQ(pool_.statistics().unasked, WorkerPool::kMaxWrong);
  EXPECT_FALSE(pool_.next_answer());
  const auto back = pool_.next_taken_back();
  ASSERT_TRUE(back);
  EXPECT_EQ(back->query.query_id, query_id_);
}

TEST_F(WorkerPoolTest, ExpelsAWorkerWhoseMessagesAreNone) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  for (const char* text : {"{\"job\":1}", "{\"job\":-1,\"force_W_N\":[1,2]}", "null"}) {
    say(worker, text);
  }
  EXPECT_TRUE(until([&] { return pool_.statistics().expelled == 1; }));
  EXPECT_EQ(pool_.statistics().malformed, 3U);
}

TEST_F(WorkerPoolTest, TakesAJobBackFromAWorkerThatLagsAndDropsItsLateAnswer) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  const NumberedJob given = give(worker);
  now_ += WorkerPool::kPatience + 1ms;
  pool_.poll(now_);
  const auto back = pool_.next_taken_back();
  ASSERT_TRUE(back);
  EXPECT_EQ(back->query.query_id, query_id_);
  EXPECT_FALSE(pool_.available());  // it still computes
  say(worker, to_text(answer_to(given, kForce_N)));
  EXPECT_TRUE(until([&] { return pool_.statistics().late == 1; }));
  EXPECT_FALSE(pool_.next_answer());
  EXPECT_TRUE(pool_.available());
}

TEST_F(WorkerPoolTest, DropsAnAnswerForAnotherContact) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  NumberedAnswer answer = answer_to(give(worker, job_at(0.002, 7)), kForce_N);
  answer.answer.epoch = 6;
  say(worker, to_text(answer));
  EXPECT_TRUE(until([&] { return pool_.statistics().late == 1; }));
  EXPECT_FALSE(pool_.next_answer());
  EXPECT_TRUE(pool_.next_taken_back());
}

TEST_F(WorkerPoolTest, ForgetsAWorkerThatFallsSilentAndTakesItsJobBack) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  give(worker);
  now_ += WorkerPool::kSilence + 1ms;
  pool_.poll(now_);
  EXPECT_EQ(pool_.statistics().gone, 1U);
  EXPECT_TRUE(pool_.next_taken_back());
  EXPECT_FALSE(pool_.available());
}

TEST_F(WorkerPoolTest, TakesAJobBackThatAWorkerGaveUp) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  say(worker, gave_up_text(give(worker).id));
  EXPECT_TRUE(until([&] { return pool_.statistics().given_up == 1; }));
  EXPECT_TRUE(pool_.next_taken_back());
  EXPECT_TRUE(pool_.available());
  EXPECT_EQ(pool_.statistics().wrong, 0U);
}

TEST_F(WorkerPoolTest, HasAnAnswerWitnessedOnlyByAnotherWorkerThatIsTrusted) {
  ScriptedWorker first(pool_.address(), key_);
  join(first, "first");
  earn_trust(first);
  ScriptedWorker second(pool_.address(), key_);
  join(second, "second");
  const WorkerPool::WorkerId first_id = 1;
  const WorkerPool::WorkerId second_id = 2;
  EXPECT_FALSE(pool_.give_to_witness(next_query(), job_at(0.002), first_id, now_));
  ASSERT_TRUE(pool_.give_to_witness(next_query(), job_at(0.002), second_id, now_));
  const auto given = read_job(message_to(first));
  ASSERT_TRUE(given);
  say(first, to_text(answer_to(*given, kForce_N)));
  const WorkerPool::Answered answer = next_answer();
  EXPECT_TRUE(answer.witness);
  EXPECT_EQ(answer.worker, first_id);
}

TEST_F(WorkerPoolTest, ForgetsWhatAnEarlierRunAsked) {
  ScriptedWorker worker(pool_.address(), key_);
  join(worker);
  const NumberedJob given = give(worker);
  pool_.forget_jobs();
  say(worker, to_text(answer_to(given, kForce_N)));
  EXPECT_TRUE(until([&] { return pool_.statistics().late == 1; }));
  EXPECT_FALSE(pool_.next_answer() || pool_.next_taken_back());
  EXPECT_TRUE(pool_.available());
}

}  // namespace
}  // namespace forcegrid::simulator
