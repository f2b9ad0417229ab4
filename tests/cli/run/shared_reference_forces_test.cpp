// SPDX-License-Identifier: Apache-2.0
#include "cli/run/shared_reference_forces.h"

#include <gtest/gtest.h>

#include <vector>

namespace forcegrid::cli {
namespace {

using Eigen::Vector3d;
using simulator::ToolPath;

constexpr double kPeriod_s = 0.03;
constexpr std::int64_t kMs = 1'000'000;  // in ns

// A tool with a cycle every 2 ms from its touch at `touch_ms` on, and its samples.
struct Left {
  Left(std::int64_t touch_ms, std::int64_t end_ms, const std::vector<std::int64_t>& sample_ms) {
    for (std::int64_t at_ms = touch_ms; at_ms < end_ms; at_ms += 2) {
      servo::CycleRecord record;
      record.time_ns = at_ms * kMs;
      record.touching_W_m = {1e-3 * static_cast<double>(at_ms), 0.0, 0.0};
      records.push_back(record);
    }
    for (const std::int64_t at_ms : sample_ms) {
      servo::ArrivedSample arrived;
      arrived.in_contact = at_ms >= touch_ms;
      arrived.sample.time_s = 1e-3 * static_cast<double>(at_ms);
      arrived.sample.position_W = {1e-3 * static_cast<double>(at_ms), 0.0, 0.0};
      samples.push_back(arrived);
    }
    run.contact = servo::FirstContact{touch_ms * kMs, 1, {7.0, 0.0, 0.0}};
    run.cycles.contact_ns = touch_ms * kMs;
    for (const servo::CycleRecord& record : records) {
      run.cycles.records.push_back(&record);
      run.cycles.positions_W.emplace_back(record.touching_W_m[0], 0.0, 0.0);
    }
    run.samples = &samples;
  }
  std::deque<servo::CycleRecord> records;
  std::deque<servo::ArrivedSample> samples;
  ToolRun run;
};

TEST(PathsOf, SaysWhereTheOtherWasWhenTheObjectWasLastSolvedBeforeATouch) {
  // Solutions about every 30 ms; each tool's state in one is up to 4 ms old.
  const Left first(100, 400, {70, 100, 131, 160, 190});
  const Left second(162, 400, {133, 162, 191});
  const auto paths = paths_of({first.run, second.run}, kPeriod_s);
  ASSERT_EQ(paths.size(), 2U);
  EXPECT_EQ(paths[0].touched_s, 0.1);
  EXPECT_EQ(paths[1].touched_s, 0.162);
  // Not at 160 ms, which is of the solution with the touch itself.
  EXPECT_NEAR(paths[1].tools_before_touch_W[0].x(), 0.131, 1e-12);
  // The second one did not hold anything yet: what stands there is not used.
  EXPECT_EQ(paths[0].tools_before_touch_W[1].x(), 7.0);
  EXPECT_EQ(paths[1].times_s.size(), paths[1].positions_W.size());
  EXPECT_NEAR(paths[1].positions_W.front().x(), 0.162, 1e-12);
  EXPECT_EQ(paths[0].let_go_s, ToolPath::kNever_s) << "they ended together";
}

TEST(PathsOf, AToolWhoseLoopEndedEarlyLetGo) {
  const Left first(100, 300, {100});
  const Left second(100, 900, {100});
  const auto paths = paths_of({first.run, second.run}, kPeriod_s);
  EXPECT_NEAR(paths[0].let_go_s, 0.298, 1e-12);
  EXPECT_EQ(paths[1].let_go_s, ToolPath::kNever_s);
}

// Both loops are told to end, the first does so 12 ms before the second, and the simulator solves
// the object between: without the first tool, which the second is told as a new contact.
TEST(PathsOf, AToolWhoseEndTheOtherFeltLetGo) {
  const Left first(100, 400, {100, 130, 160, 190, 390});
  Left second(162, 412, {162, 191, 380, 396});
  second.samples.back().sample.contact_epoch = 1;
  auto paths = paths_of({first.run, second.run}, kPeriod_s);
  EXPECT_NEAR(paths[0].let_go_s, 0.396, 1e-12) << "its state in that solution, before the end";
  EXPECT_EQ(paths[1].let_go_s, ToolPath::kNever_s) << "it ended last";
  // A new contact long before is no end.
  second.samples[1].sample.contact_epoch = 1;
  second.samples[2].sample.contact_epoch = 1;
  paths = paths_of({first.run, second.run}, kPeriod_s);
  EXPECT_EQ(paths[0].let_go_s, ToolPath::kNever_s);
}

TEST(PathsOf, AToolThatNeverTouchedHoldsNothing) {
  const Left first(100, 300, {100});
  ToolRun never;
  const std::deque<servo::ArrivedSample> none;
  never.samples = &none;
  const auto paths = paths_of({never, first.run}, kPeriod_s);
  EXPECT_EQ(paths[0].touched_s, ToolPath::kNever_s);
  EXPECT_TRUE(paths[0].times_s.empty());
  EXPECT_EQ(paths[1].touched_s, 0.1);
}

}  // namespace
}  // namespace forcegrid::cli
