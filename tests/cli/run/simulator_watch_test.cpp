// SPDX-License-Identifier: Apache-2.0
#include "cli/run/simulator_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

namespace forcegrid::cli {
namespace {

using State = SimulatorWatch::State;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kLook_s = 0.02;

// Looks every 20 ms, with samples every `period_s` from `from_s` until `to_s`.
class Watched {
 public:
  explicit Watched(SimulatorWatchOptions options) : watch_(std::move(options)) {
    watch_.begin(kBegin_s);
  }

  void samples(double period_s, double from_s, double to_s) {
    period_s_ = period_s;
    from_s_ = from_s;
    to_s_ = to_s;
  }
  void until(double time_s, bool nobody_listens = false) {
    for (; now_s_ < time_s; now_s_ += kLook_s) {
      if (now_s_ >= from_s_ && now_s_ < to_s_ &&
          (!sample_s_ || now_s_ - (*sample_s_ - kBegin_s) >= period_s_)) {
        sample_s_ = kBegin_s + now_s_;
      }
      if (const auto line = watch_.update(kBegin_s + now_s_, sample_s_, nobody_listens)) {
        lines_.push_back(*line);
        line_times_s_.push_back(now_s_);
      }
    }
  }
  const SimulatorWatch& watch() const { return watch_; }
  const std::vector<std::string>& lines() const { return lines_; }
  const std::vector<double>& line_times_s() const { return line_times_s_; }

 private:
  static constexpr double kBegin_s = 1000.0;
  SimulatorWatch watch_;
  double now_s_ = 0.0;
  double period_s_ = 0.0, from_s_ = 0.0, to_s_ = 0.0;
  std::optional<double> sample_s_;
  std::vector<std::string> lines_;
  std::vector<double> line_times_s_;
};

SimulatorWatchOptions somebody() { return {.address = "10.0.0.2:24870", .timeout_s = 10.0}; }

TEST(SimulatorWatch, IsSilentWhileSamplesCome) {
  Watched watched(somebody());
  watched.samples(1.0 / 30.0, 0.2, 20.0);
  watched.until(20.0);
  EXPECT_THAT(watched.lines(), IsEmpty());
  EXPECT_THAT(watched.watch().notes(), IsEmpty());
  EXPECT_EQ(watched.watch().state(), State::kThere);
}

TEST(SimulatorWatch, SaysWithinASecondThatNobodyIsThereAndRepeatsItUntilItGivesUp) {
  Watched watched(somebody());
  watched.until(9.9, true);
  ASSERT_GE(watched.lines().size(), 4u);
  EXPECT_LT(watched.line_times_s().front(), 1.0);
  EXPECT_THAT(watched.lines().front(),
              HasSubstr("no sample from 10.0.0.2:24870 yet: nobody listens there; start "
                        "'forcegrid simulate --listen 10.0.0.2:24870'. The run ends in 10 s"));
  EXPECT_FALSE(watched.watch().gave_up());
  watched.until(10.2, true);
  EXPECT_TRUE(watched.watch().gave_up());
  EXPECT_EQ(watched.watch().state(), State::kNever);
  EXPECT_THAT(watched.watch().notes(), ElementsAre(HasSubstr("no sample came from 10.0.0.2")));
}

TEST(SimulatorWatch, AsksForTheKeyWhereSomethingMayListen) {
  SimulatorWatchOptions options = somebody();
  options.has_key = true;
  Watched watched(options);
  watched.until(1.0);
  ASSERT_FALSE(watched.lines().empty());
  EXPECT_THAT(watched.lines().front(), HasSubstr("with this key"));
}

TEST(SimulatorWatch, GivesUpAfterALostSimulatorAndKnowsOneThatComesBack) {
  Watched watched(somebody());
  watched.samples(1.0 / 30.0, 0.2, 5.0);
  watched.until(8.0);
  EXPECT_EQ(watched.watch().state(), State::kLost);
  EXPECT_TRUE(watched.watch().missing());
  EXPECT_FALSE(watched.watch().gave_up());
  ASSERT_FALSE(watched.lines().empty());
  EXPECT_THAT(watched.lines().front(), HasSubstr("for 1 s: the simulator is stopped, gone"));
  watched.samples(1.0 / 30.0, 8.0, 9.0);
  watched.until(9.0);
  EXPECT_EQ(watched.watch().state(), State::kThere);
  EXPECT_THAT(watched.lines().back(), HasSubstr("again"));
  EXPECT_THAT(watched.watch().notes(), ElementsAre(HasSubstr("silent once, for at most 3.0 s")));
  watched.until(18.9);
  EXPECT_FALSE(watched.watch().gave_up());
  watched.until(19.2);
  EXPECT_TRUE(watched.watch().gave_up());
}

TEST(SimulatorWatch, WaitsWithoutAnEndIfItIsAskedTo) {
  SimulatorWatchOptions options = somebody();
  options.wait = true;
  Watched watched(options);
  watched.until(100.0);
  EXPECT_FALSE(watched.watch().gave_up());
  EXPECT_THAT(watched.lines().back(), HasSubstr("The run waits for it"));
}

TEST(SimulatorWatch, DoesNotCallAPauseAtTheEndALoss) {
  Watched watched(somebody());
  watched.samples(1.0 / 30.0, 0.2, 5.0);
  watched.until(6.5);
  EXPECT_EQ(watched.watch().state(), State::kLost);
  EXPECT_FALSE(watched.watch().missing());
}

TEST(SimulatorWatch, BearsWithASlowSimulator) {
  Watched known({.address = "127.0.0.1:1", .period_s = 1.5});
  known.samples(1.5, 1.5, 60.0);
  known.until(60.0);
  EXPECT_THAT(known.lines(), IsEmpty());
  // One whose rate is not known is learned.
  Watched learned(somebody());
  learned.samples(1.0, 0.5, 60.0);
  learned.until(60.0);
  ASSERT_FALSE(learned.line_times_s().empty());
  EXPECT_LT(learned.line_times_s().back(), 20.0);
}

}  // namespace
}  // namespace forcegrid::cli
