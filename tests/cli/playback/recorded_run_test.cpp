// SPDX-License-Identifier: Apache-2.0
// A recording replayed into the view's copies of its methods: they answer as the servo's did.
#include "cli/playback/recorded_run.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/view/copied_loop.h"
#include "tools/recorder.h"

namespace forcegrid::cli {
namespace {

using view::MethodCopies;
using view_link::FeedCycle;

// The file's times are doubles of seconds: a copy is off by what nanoseconds change a force.
constexpr double kRounding_N = 1e-6;

class RecordedRunTest : public view::CopiedLoop {
 public:
  ~RecordedRunTest() override { std::filesystem::remove(file_); }

 protected:
  // A run whose budget and requests are changed while it goes on, as in the page of the live view.
  void record_a_run_with_changes() {
    make_methods();
    tools::RecorderOptions options;
    options.file = file_;
    options.method_names = names_;
    std::ostringstream profile;
    profile << std::ifstream(profile_.file).rdbuf();
    options.attributes = {{"profile_name", profile_.name},
                          {"profile", profile.str()},
                          {"view_hello", R"({"methods":["auto","forcegrid","kriging"]})"}};
    now_ = rt::Clock::now();  // as in a run, whose times are near that of the recording's begin
    recorder_.emplace(options);
    budget_reads_ = 1.2 * *methods_[0]->least_budget_reads();
    int cycles = 0;
    run(4250, [&](const auto& sent) {
      if constexpr (std::is_same_v<std::decay_t<decltype(sent)>, FeedCycle>) {
        ++cycles;
        if (cycles == 900) {
          ports_.budget_reads = budget_reads_;
        } else if (cycles == 1500) {
          ports_.requests_per_s = 250.0;
        } else if (cycles == 3600) {
          ports_.requests_per_s = 0.0;
          ports_.budget_reads = std::numeric_limits<double>::infinity();
        }
      }
    });
    const tools::RecorderEnd& end = recorder_->finish();
    ASSERT_EQ(end.trouble, "");
    ASSERT_EQ(end.cycles, 4250U);
  }

  void arrives(const servo::ArrivedSample& arrived) override { recorder_->push(arrived); }
  void ends(const servo::CycleRecord& cycle) override { recorder_->push(cycle); }

  // All of it goes into copies of the methods, each cycle after `change`.
  template <typename Change>
  MethodCopies replayed(const Change& change) {
    RecordedRun recorded(file_);
    MethodCopies copied = copies();
    for (const view_link::FeedSample& sample : recorded.samples()) {
      copied.take(sample);
    }
    for (FeedCycle cycle : recorded.cycles(0, recorded.cycles())) {
      change(cycle);
      copied.take(cycle);
    }
    return copied;
  }

  const std::string file_ =
      ::testing::TempDir() + "recorded_run_" + std::to_string(::getpid()) + ".h5";
  std::optional<tools::Recorder> recorder_;
  double budget_reads_ = 0.0;
};

TEST_F(RecordedRunTest, IsReplayedWithTheBudgetAndTheRequestsOfEachTime) {
  record_a_run_with_changes();
  EXPECT_LT(replayed([](FeedCycle&) {}).largest_difference_N(), kRounding_N);
  RecordedRun recorded(file_);
  const std::vector<FeedCycle> cycles = recorded.cycles(0, recorded.cycles());
  ASSERT_EQ(cycles.size(), 4250U);
  // A change is taken in the cycle after it was made; the first one has the number 0.
  for (std::size_t i = 0; i < cycles.size(); ++i) {
    if (i < 900) {
      EXPECT_TRUE(std::isnan(cycles[i].budget_reads)) << i;
    } else {
      EXPECT_EQ(cycles[i].budget_reads,
                i < 3600 ? budget_reads_ : std::numeric_limits<double>::infinity())
          << i;
    }
    EXPECT_EQ(cycles[i].requests_per_s, i < 1500 ? kRequests_per_s : i < 3600 ? 250.0 : 0.0) << i;
  }
}

TEST_F(RecordedRunTest, IsAnotherFieldWithTheBudgetThatItBeganWith) {
  record_a_run_with_changes();
  const MethodCopies copied = replayed(
      [](FeedCycle& cycle) { cycle.budget_reads = std::numeric_limits<double>::quiet_NaN(); });
  EXPECT_GT(copied.largest_difference_N(), 100 * kRounding_N) << "so the test above can fail";
}

}  // namespace
}  // namespace forcegrid::cli
