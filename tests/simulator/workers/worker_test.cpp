// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/worker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "link/key.h"
#include "simulator/mesh/error.h"
#include "simulator/workers/query_scheduler.h"
#include "tests/simulator/workers/scripted_worker.h"

namespace forcegrid::simulator {
namespace {

using namespace std::chrono_literals;

class KeyFile {
 public:
  KeyFile() {
    ::unlink(name_.c_str());
    link::LinkKey::generate(name_);
  }
  ~KeyFile() { ::unlink(name_.c_str()); }
  const std::string& name() const { return name_; }

 private:
  std::string name_ = testing::TempDir() + "worker_" + std::to_string(::getpid()) + ".key";
};

/// By the solver of its simulator, which the worker learns only from the welcome.
class WorkerOfASolver : public ::testing::TestWithParam<SolverOptions> {};

TEST_P(WorkerOfASolver, SolvesAsTheSimulatorDoes) {
  const KeyFile key;
  const Scene scene = make_scene(kWorkersScene);
  const SolverOptions solver = GetParam();
  WorkerPool pool("127.0.0.1:0", link::LinkKey::load(key.name()), digest_of(scene), 1, solver);
  std::atomic<bool> stop{false};
  std::ostringstream said[2];
  std::vector<std::thread> workers;
  for (std::ostringstream& out : said) {
    workers.emplace_back([&] {
      run_worker({.connect = pool.address(),
                  .key_file = key.name(),
                  .scene = kWorkersScene,
                  .solver = {},
                  .nice = 0},
                 out, stop);
    });
  }
  QuerySolver own(scene, solver);
  constexpr unsigned kJobs = 20;
  unsigned given = 0;
  unsigned answered = 0;
  constexpr int kLooks = 4000;
  for (int i = 0; i < kLooks && answered + pool.statistics().taken_back < kJobs; ++i) {
    pool.poll(rt::Clock::now());
    while (pool.statistics().joined == 2 && given < kJobs && pool.available()) {
      ++given;
      link::Query query;
      query.query_id = given;
      QueryJob job;
      job.epoch = 1;
      job.touching = true;
      job.position_W = {1e-4 * given, 0.0, -2e-4 * given};
      ASSERT_TRUE(pool.give(query, job, rt::Clock::now()));
    }
    while (const auto answer = pool.next_answer()) {
      ++answered;
      const StickyContact::Answer expected = own.answer(answer->job);
      EXPECT_GT(expected.equilibrium.force_W.norm(), 0.0);
      EXPECT_EQ(check_answer(answer->answer, expected), Verdict::kRight);
      EXPECT_EQ(answer->answer.point_W, answer->job.point_W);
      if (answer->to_check) {
        pool.judge(answer->worker, Verdict::kRight);
      }
    }
    std::this_thread::sleep_for(5ms);
  }
  stop = true;
  for (std::thread& worker : workers) {
    worker.join();
  }
  // What a pause of the machine made too late was given in vain.
  EXPECT_EQ(answered + pool.statistics().taken_back, kJobs);
  EXPECT_GT(answered, 0U);
  EXPECT_THAT(said[0].str(), testing::HasSubstr("working for " + pool.address()));
  EXPECT_THAT(said[0].str(),
              testing::HasSubstr(solver.border_tolerance > 0.0 ? "local" : "quasi_static"));
}

INSTANTIATE_TEST_SUITE_P(Solvers, WorkerOfASolver,
                         ::testing::Values(SolverOptions{},
                                           SolverOptions{.border_tolerance = 1e-3}),
                         [](const auto& solver) {
                           return solver.param.border_tolerance > 0.0 ? "Local" : "QuasiStatic";
                         });

TEST(Worker, SaysWhatIsWrongWithAnAddressOrAKey) {
  std::ostringstream said;
  const std::atomic<bool> stop{true};
  const auto run = [&](const std::string& connect) {
    run_worker(
        {.connect = connect, .key_file = "none", .scene = kWorkersScene, .solver = {}, .nice = 0},
        said, stop);
  };
  EXPECT_THROW(run("127.0.0.1:1"), Error);
  EXPECT_THROW(run("tcp://127.0.0.1:0"), link::LinkError);
  EXPECT_THROW(run("tcp://127.0.0.1:1"), link::LinkError);
}

}  // namespace
}  // namespace forcegrid::simulator
