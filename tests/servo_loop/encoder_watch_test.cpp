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

// A hand holds joint c under a steady torque. What a relief lets it move, and back, is no sign that
// it moves by itself; it is left alone for a second after the first count.
class Held {
 public:
  // To `end` after the start; while relieved, joint c gives way by `give_way_counts`.
  void run_to(rt::Duration end, std::int32_t give_way_counts) {
    while (now_ < kStart + end) {
      now_ += kPeriod;
      ++report_.sequence;
      report_.released = now_ - milliseconds(1);
      report_.counts[2] = moved_ + (parts_[2] < 0.5 ? give_way_counts : 0);
      EXPECT_EQ(watch_.check(now_, report_), std::nullopt);
      parts_ = watch_.relief(now_, rt::seconds(kPeriod), kLoad_Nm);
    }
  }
  // By itself.
  void move(std::int32_t counts) { moved_ += counts; }
  std::uint64_t suspected() const { return watch_.suspected_stuck_encoders(); }
  double part() const { return parts_[2]; }

 private:
  EncoderWatch watch_{profiles::load_device_profile("woodenhaptics_v2015")};
  driver::DeviceReport report_;
  rt::TimePoint now_ = kStart;
  Eigen::Array3d parts_ = Eigen::Array3d::Ones();
  std::int32_t moved_ = 0;
};

// Suspected after 60 ms, at half its torque 20 ms later, where it moves; the second begins there.
// Each round takes some 1.02 s.
TEST(EncoderWatch, RelievesAJointThatAHandHoldsOnceASecond) {
  Held joint;
  joint.run_to(milliseconds(50), 8);
  EXPECT_EQ(joint.suspected(), 0U);
  joint.run_to(milliseconds(1060), 8);
  EXPECT_EQ(joint.suspected(), 1U);
  EXPECT_EQ(joint.part(), 1.0);
  joint.run_to(milliseconds(1500), 8);
  EXPECT_EQ(joint.suspected(), 2U);
  joint.run_to(milliseconds(60 + 10 * 1020 - 100), 8);
  EXPECT_EQ(joint.suspected(), 10U);
}

// Five counts 200 ms after the relief are its own: it is suspected again once it rests for 60 ms.
TEST(EncoderWatch, SuspectsAJointAtOnceThatHasMovedByItselfSinceItsRelief) {
  Held joint;
  joint.run_to(milliseconds(300), 8);
  ASSERT_EQ(joint.suspected(), 1U);
  joint.move(4);
  joint.run_to(milliseconds(400), 8);
  EXPECT_EQ(joint.suspected(), 1U) << "four counts are few";
  joint.move(-1);
  joint.run_to(milliseconds(450), 8);
  EXPECT_EQ(joint.suspected(), 1U);
  joint.run_to(milliseconds(480), 8);
  EXPECT_EQ(joint.suspected(), 2U);
}

}  // namespace
}  // namespace forcegrid::servo
