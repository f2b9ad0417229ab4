// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/worker_protocol.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "simulator/workers/answer_check.h"
#include "tests/simulator/workers/scripted_worker.h"

namespace forcegrid::simulator {
namespace {

QueryJob some_job() {
  QueryJob job;
  job.epoch = 4;
  job.touching = true;
  job.point_W = {0.01, -0.02, 0.0};
  job.position_W = {0.1 / 3.0, 0.0, -1e-7};
  return job;
}

StickyContact::Answer some_answer() {
  StickyContact::Answer answer;
  answer.in_contact = true;
  answer.position_W = {0.001, 0.002, -0.003};
  answer.equilibrium.converged = true;
  answer.equilibrium.force_W = {0.0, 0.0, 2.0};
  answer.equilibrium.stiffness_W << 1, 2, 3, 4, 5, 6, 7, 8, 1.0 / 3.0;
  return answer;
}

TEST(WorkerProtocol, ReadsWhatItWritesToTheLastBit) {
  const auto job = read_job(to_text(NumberedJob{7, some_job()}));
  ASSERT_TRUE(job);
  EXPECT_EQ(job->id, 7U);
  EXPECT_TRUE(job->job.same_contact(some_job()));
  EXPECT_EQ(job->job.position_W, some_job().position_W);
  const auto answer = read_answer(to_text(NumberedAnswer{8, some_answer()}));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->answer.equilibrium.stiffness_W, some_answer().equilibrium.stiffness_W);
  const auto hello = read_hello(to_text(hello_of("host:1")));
  ASSERT_TRUE(hello);
  EXPECT_TRUE(same_object(hello->object, hello_of("").object));
  EXPECT_EQ(read_gave_up(gave_up_text(9)), 9U);
  EXPECT_EQ(read_refusal(refusal_text("why")), "why");
}

TEST(WorkerProtocol, TakesNoMessageForAnother) {
  const std::string job = to_text(NumberedJob{7, some_job()});
  EXPECT_FALSE(read_answer(job) || read_hello(job) || read_refusal(job) || read_welcome(job, {}));
  EXPECT_FALSE(read_job(to_text(NumberedAnswer{8, some_answer()})));
}

TEST(WorkerProtocol, RefusesNumbersThatAreNone) {
  const auto with = [](const std::string& number) {
    std::string text = to_text(NumberedAnswer{8, some_answer()});
    const std::string force = "\"force_W_N\":[0.0,";
    return text.replace(text.find(force), force.size(), "\"force_W_N\":[" + number + ",");
  };
  EXPECT_TRUE(read_answer(with("1.5")));
  for (const char* number : {"NaN", "null", "1e999", "\"1\"", "[]", "1,2"}) {
    EXPECT_FALSE(read_answer(with(number))) << number;
  }
  EXPECT_FALSE(read_gave_up("{\"gave_up\":-1}"));
  NumberedAnswer answer{8, some_answer()};
  answer.answer.equilibrium.stiffness_W(1, 1) = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(read_answer(to_text(answer)));
}

TEST(WorkerProtocol, KeepsOfANameWhatATerminalCanShow) {
  const auto hello = read_hello(to_text(hello_of("a\n\x1b[31mb" + std::string(100, 'x'))));
  ASSERT_TRUE(hello);
  EXPECT_EQ(hello->name.rfind("a[31mbxx", 0), 0U);
  EXPECT_LE(hello->name.size(), kMaxNameBytes);
}

TEST(AnswerCheck, SeesAWrongForceStiffnessPlaceOrContact) {
  const StickyContact::Answer reference = some_answer();
  StickyContact::Answer answer = reference;
  answer.equilibrium.force_W.z() += 0.04 + 0.05 * 2.0;  // the bound is 0.05 N + 5 % of 2 N
  EXPECT_EQ(check_answer(answer, reference), Verdict::kRight);
  answer.equilibrium.force_W.z() += 0.02;
  EXPECT_EQ(check_answer(answer, reference), Verdict::kWrong);

  answer = reference;
  answer.equilibrium.stiffness_W *= -2.0;
  EXPECT_EQ(check_answer(answer, reference), Verdict::kWrong);
  answer = reference;
  answer.position_W.x() += 2e-4;
  EXPECT_EQ(check_answer(answer, reference), Verdict::kWrong);
  answer = reference;
  answer.in_contact = false;
  EXPECT_EQ(check_answer(answer, reference), Verdict::kWrong);
}

TEST(AnswerCheck, BlamesNobodyOnAReferenceThatDidNotConverge) {
  StickyContact::Answer reference = some_answer();
  StickyContact::Answer answer = reference;
  answer.equilibrium.force_W.z() += 10.0;
  reference.equilibrium.converged = false;
  EXPECT_EQ(check_answer(answer, reference), Verdict::kUndecided);
}

}  // namespace
}  // namespace forcegrid::simulator
