// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/encoder_watch.h"

#include <gtest/gtest.h>

#include <chrono>
#include <optional>

#include "profiles/device_profile.h"

namespace forcegrid::servo {
namespace {

using std::chrono::milliseconds;

constexpr rt::Duration kPeriod = milliseconds(2);
constexpr rt::TimePoint kStart{std::chrono::seconds(1000)};
// Far above five times the friction of any joint of these devices.
const Eigen::Vector3d kLoad_Nm(0.0, 0.0, 0.5);

/// Joint c is loaded and does not count; time passes in cycles.
class Still {
 public:
  /// Until `end` after the start or a verdict. @returns the joint that is said to be frozen.
  /// @param apart from one report to the next, when reports come.
  std::optional<int> run_to(rt::Duration end, bool reports_come, rt::Duration apart = kPeriod) {
    std::optional<int> frozen;
    while (!frozen && now_ < kStart + end) {
      now_ += kPeriod;
      if (reports_come && (now_ - kStart) % apart == rt::Duration::zero()) {
        ++report_.sequence;
        report_.released = now_ - milliseconds(1);
      }
      frozen = watch_.check(now_, report_);
      parts_ = watch_.relief(now_, rt::seconds(kPeriod), kLoad_Nm);
    }
    return frozen;
  }
  rt::Duration elapsed() const { return now_ - kStart; }
  double part() const { return parts_[2]; }
  double part_of_unloaded() const { return parts_[0]; }

 private:
  EncoderWatch watch_{profiles::load_device_profile("woodenhaptics_v2015")};
  driver::DeviceReport report_;
  rt::TimePoint now_ = kStart;
  Eigen::Array3d parts_ = Eigen::Array3d::Ones();
};

TEST(EncoderWatch, TakesAllTorqueAwayATenthOfASecondAfterALoadedJointsLastCount) {
  Still joint;
  EXPECT_EQ(joint.run_to(milliseconds(98), true), std::nullopt);
  EXPECT_GT(joint.part(), 0.0);
  EXPECT_EQ(joint.part_of_unloaded(), 1.0);
  EXPECT_EQ(joint.run_to(milliseconds(104), true), std::nullopt);
  EXPECT_EQ(joint.part(), 0.0);
  EXPECT_EQ(joint.part_of_unloaded(), 0.0);
}

TEST(EncoderWatch, CondemnsItWhenThatHasLeftItUnmovedForAnother60Milliseconds) {
  Still joint;
  EXPECT_EQ(joint.run_to(milliseconds(158), true), std::nullopt);
  EXPECT_EQ(joint.run_to(milliseconds(180), true), 2);
}

// A suspicion arises after 60 ms, and then reports stay away for as long as the driver waits for a
// lost one. No command has reached the motors meanwhile, so that nothing had a reason to move.
TEST(EncoderWatch, CondemnsNoJointWhoseReliefFallsIntoASilence) {
  Still joint;
  ASSERT_EQ(joint.run_to(milliseconds(72), true), std::nullopt);
  EXPECT_LT(joint.part(), 1.0) << "the joint is in doubt";
  EXPECT_EQ(joint.run_to(milliseconds(112), false), std::nullopt);
  EXPECT_EQ(joint.part(), 0.0);
  // 12 ms of the 40 have been seen; after the silence the joint has the rest of them to move.
  EXPECT_EQ(joint.run_to(milliseconds(196), true), std::nullopt);
  EXPECT_EQ(joint.run_to(milliseconds(220), true), 2) << "frozen after all";
}

TEST(EncoderWatch, DoesNotTakeASilenceForAJointThatStandsStill) {
  Still joint;
  ASSERT_EQ(joint.run_to(milliseconds(40), true), std::nullopt);
  ASSERT_EQ(joint.run_to(milliseconds(90), false), std::nullopt);
  EXPECT_EQ(joint.part(), 1.0) << "40 ms without a count have been seen, not 90";
}

// Where an exchange takes 12 ms, the zero of the relief is in force that much later, and what it
// does is seen later still: 25 reports have to say that nothing moved, not eight.
TEST(EncoderWatch, GivesAJoint25ReportsToMoveHoweverFarTheyAreApart) {
  Still joint;
  EXPECT_EQ(joint.run_to(milliseconds(15 * 12), true, milliseconds(12)), std::nullopt);
  EXPECT_EQ(joint.run_to(milliseconds(39 * 12), true, milliseconds(12)), std::nullopt);
  EXPECT_EQ(joint.part(), 0.0);
  EXPECT_EQ(joint.run_to(milliseconds(43 * 12), true, milliseconds(12)), 2);
}

}  // namespace
}  // namespace forcegrid::servo
