// SPDX-License-Identifier: Apache-2.0
// What the guard takes for a jump, in the joint space of every device, and which reports are late.
#include "servo_loop/motion_guard.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <string>

#include "driver/delta_kinematics.h"
#include "driver/kinematics.h"
#include "driver/mechanism.h"

namespace forcegrid::servo {
namespace {

using profiles::DeviceProfile;
using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr rt::Duration kTimeout = milliseconds(100);

/// [rad] without the sign.
Eigen::Array3d angle_per_count_rad(const DeviceProfile& profile) {
  Eigen::Array3d angle_rad;
  for (std::size_t i = 0; i < 3; ++i) {
    angle_rad[static_cast<Eigen::Index>(i)] =
        profile.kind == profiles::DeviceKind::kDelta
            ? profile.delta.encoder_rad_per_count
            : 2.0 * M_PI / profile.kinematics.encoder_counts_per_turn[i] *
                  profile.kinematics.capstan_diameter_m[i] / profile.kinematics.body_diameter_m[i];
  }
  return angle_rad;
}

using Counts = std::array<std::int32_t, 6>;

/// Reports of joints that the test turns, one each cycle.
class Reports {
 public:
  explicit Reports(const std::string& name)
      : profile_(profiles::load_device_profile(name)),
        mechanism_(driver::make_mechanism(profile_)),
        guard_(profile_, kTimeout),
        count_rad_(angle_per_count_rad(profile_)) {
    // A pose that every device has, in its counts.
    if (profile_.kind != profiles::DeviceKind::kDelta) {
      const auto start = driver::ArmKinematics(profile_).inverse(Eigen::Vector3d::Zero());
      for (std::size_t i = 0; i < 3; ++i) {
        start_[i] =
            static_cast<std::int32_t>(std::lround(start.counts[static_cast<Eigen::Index>(i)]));
      }
    }
  }

  /// A report with the joints turned from the start, sampled `step` after the last one; its OUT
  /// took a millisecond, and it was on its way for `transit`.
  Fault next(const Eigen::Array3d& turned_rad, rt::Duration step = milliseconds(2),
             rt::Duration transit = microseconds(500)) {
    released_ += step;
    driver::DeviceReport report;
    report.sequence = ++sequence_;
    report.counts = start_;
    for (std::size_t i = 0; i < 3; ++i) {
      report.counts[i] += static_cast<std::int32_t>(std::lround(
          turned_rad[static_cast<Eigen::Index>(i)] / count_rad_[static_cast<Eigen::Index>(i)]));
    }
    report.sampled_after = released_ - milliseconds(1);
    report.released = report.oldest_release = released_;
    report.received = released_ + transit;
    return guard_.check(report.received, driver::DeviceHealth::kRunning, report,
                        mechanism_->forward(report.counts));
  }

  const DeviceProfile& profile() const { return profile_; }
  const MotionGuard& guard() const { return guard_; }
  const Eigen::Array3d& count_rad() const { return count_rad_; }

 private:
  DeviceProfile profile_;
  std::unique_ptr<driver::Mechanism> mechanism_;
  MotionGuard guard_;
  Eigen::Array3d count_rad_;
  Counts start_{};
  rt::TimePoint released_{std::chrono::seconds(1)};
  std::uint64_t sequence_ = 0;
};

class EveryDevice : public ::testing::TestWithParam<std::string> {};

TEST_P(EveryDevice, FiveHundredCountsInACycleAreAJumpOfTheJointThatIsNamed) {
  for (int joint = 0; joint < 3; ++joint) {
    for (const double speed_rad_per_s : {0.0, 0.5, -1.0}) {
      Reports reports(GetParam());
      Eigen::Array3d turned_rad = Eigen::Array3d::Zero();
      for (int i = 0; i < 20; ++i) {
        turned_rad[joint] += 0.002 * speed_rad_per_s;
        ASSERT_EQ(reports.next(turned_rad), Fault::kNone);
      }
      turned_rad[joint] += 500.0 * reports.count_rad()[joint];
      EXPECT_EQ(reports.next(turned_rad), Fault::kImplausibleJump)
          << "joint " << joint << " at " << speed_rad_per_s << " rad/s";
      EXPECT_EQ(reports.guard().joint(), joint);
    }
  }
}

TEST_P(EveryDevice, AStepIsJudgedByTheTimeThatItMayHaveTaken) {
  // From rest a joint turns by A T^2 at most. The OUTs take a millisecond, so T is `step` and that.
  for (const milliseconds step : {milliseconds(1), milliseconds(2), milliseconds(4)}) {
    for (const double part : {0.9, 1.1}) {
      Reports reports(GetParam());
      ASSERT_EQ(reports.next(Eigen::Array3d::Zero()), Fault::kNone);
      ASSERT_EQ(reports.next(Eigen::Array3d::Zero()), Fault::kNone);
      const double longest_s = rt::seconds(step) + 0.001;
      const Eigen::Array3d fastest_rad_per_s =
          (longest_s *
           Eigen::Array3d(reports.profile().limits.max_joint_acceleration_rad_per_s2.data()))
              .min(Eigen::Array3d(reports.profile().limits.max_joint_speed_rad_per_s.data()));
      Eigen::Array3d turned_rad = Eigen::Array3d::Zero();
      turned_rad[1] = part * longest_s * fastest_rad_per_s[1] + 8.0 * reports.count_rad()[1];
      EXPECT_EQ(reports.next(turned_rad, step), part < 1.0 ? Fault::kNone : Fault::kImplausibleJump)
          << step.count() << " ms, " << part;
    }
  }
}

TEST_P(EveryDevice, AJointMayStopOrTurnRoundAtOnceButNotGrowFasterAtOnce) {
  Reports reports(GetParam());
  const double speed_rad_per_s =
      0.5 * 0.2 * reports.profile().limits.max_joint_speed_rad_per_s[2] / 3.0;
  double angle_rad = 0.0;
  const auto turn = [&](double by_rad) {
    angle_rad += by_rad;
    return reports.next(Eigen::Array3d(0.0, 0.0, angle_rad));
  };
  for (int i = 0; i < 25; ++i) {
    ASSERT_EQ(turn(0.002 * speed_rad_per_s), Fault::kNone);
  }
  ASSERT_EQ(turn(-0.002 * speed_rad_per_s), Fault::kNone);  // an elastic blow against a stop
  ASSERT_EQ(turn(0.0), Fault::kNone);
  ASSERT_EQ(turn(0.0), Fault::kNone);
  const double longest_s = 0.003;
  const double allowed_rad =
      longest_s * longest_s * reports.profile().limits.max_joint_acceleration_rad_per_s2[2];
  EXPECT_EQ(turn(allowed_rad + 20.0 * reports.count_rad()[2]), Fault::kImplausibleJump);
}

/// [rad] Joint angles of a place, without the joints' signs and offsets.
Eigen::Vector3d angles_at(const DeviceProfile& profile, const Eigen::Vector3d& position_D) {
  if (profile.kind == profiles::DeviceKind::kArm) {
    return driver::ArmKinematics(profile).inverse(position_D).joint_angle_rad;
  }
  const auto& center_m = profile.delta.center_m;
  return driver::DeltaKinematics(profile.delta)
      .inverse({position_D.y() + center_m[0], position_D.z() + center_m[1],
                position_D.x() + center_m[2]})
      .joint_angle_rad;
}

// The derivation that the profiles state: 3 max_speed and 200 m/s^2 at the tip, times the joint's
// largest speed per m/s of the tip in the workspace, here from differences of the inverse
// kinematics.
TEST_P(EveryDevice, ItsLimitsAreThoseThatItsProfileDerives) {
  const DeviceProfile profile = profiles::load_device_profile(GetParam());
  constexpr int kSteps = 12;
  constexpr double kDifference_m = 1e-5;
  Eigen::Array3d largest_rad_per_m = Eigen::Array3d::Zero();
  for (int at = 0; at < (kSteps + 1) * (kSteps + 1) * (kSteps + 1); ++at) {
    const std::array<int, 3> index = {at % (kSteps + 1), at / (kSteps + 1) % (kSteps + 1),
                                      at / (kSteps + 1) / (kSteps + 1)};
    Eigen::Vector3d position_D;
    for (std::size_t i = 0; i < 3; ++i) {
      const double part = static_cast<double>(index[i]) / kSteps;
      position_D[static_cast<Eigen::Index>(i)] = (1.0 - part) * profile.limits.workspace_min_m[i] +
                                                 part * profile.limits.workspace_max_m[i];
    }
    Eigen::Matrix3d angle_per_place;
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3d aside = kDifference_m * Eigen::Vector3d::Unit(axis);
      angle_per_place.col(axis) =
          (angles_at(profile, position_D + aside) - angles_at(profile, position_D - aside)) /
          (2.0 * kDifference_m);
    }
    if (angle_per_place.allFinite()) {  // a corner may be beyond a stop
      largest_rad_per_m = largest_rad_per_m.max(angle_per_place.rowwise().norm().array());
    }
  }
  for (std::size_t i = 0; i < 3; ++i) {
    const double rad_per_m = largest_rad_per_m[static_cast<Eigen::Index>(i)];
    ASSERT_GT(rad_per_m, 1.0);
    const double speed = 3.0 * profile.limits.max_speed_m_per_s * rad_per_m;
    const double acceleration = 200.0 * rad_per_m;
    EXPECT_GE(profile.limits.max_joint_speed_rad_per_s[i], speed) << i;
    EXPECT_LE(profile.limits.max_joint_speed_rad_per_s[i], 1.05 * speed + 1.0) << i;
    EXPECT_GE(profile.limits.max_joint_acceleration_rad_per_s2[i], acceleration) << i;
    EXPECT_LE(profile.limits.max_joint_acceleration_rad_per_s2[i], 1.05 * acceleration + 50.0) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Profiles, EveryDevice, ::testing::ValuesIn(profiles::available_profiles()),
                         [](const auto& test) { return test.param; });

/// @returns when reports that are `transit` on their way, one each `step`, end the loop; [s], or
/// `seconds` if they do not.
double late_after_s(rt::Duration step, rt::Duration transit, double seconds) {
  Reports reports("woodenhaptics_v2015");
  double passed_s = 0.0;
  while (passed_s < seconds) {
    const Fault fault = reports.next(Eigen::Array3d::Zero(), step, transit);
    if (fault != Fault::kNone) {
      EXPECT_EQ(fault, Fault::kLateReports) << name_of(fault);
      return passed_s;
    }
    passed_s += rt::seconds(step);
  }
  return seconds;
}

TEST(LateReports, AreSeenByTheirOwnTimesHoweverCloseTogetherTheyCome) {
  for (const int transit_ms : {30, 40, 50, 90}) {
    for (const int step_ms : {2, 10, 15, 24, 40}) {
      // Half a second of lateness, and a step.
      EXPECT_NEAR(late_after_s(milliseconds(step_ms), milliseconds(transit_ms), 3.0), 0.5,
                  2e-3 * step_ms)
          << transit_ms << " ms on their way, " << step_ms << " ms apart";
    }
  }
}

TEST(LateReports, AreNotThoseOfFirmwareThatIsMerelySlow) {
  for (const int slow_ms : {5, 20, 22, 25}) {
    EXPECT_EQ(late_after_s(milliseconds(slow_ms), milliseconds(slow_ms), 10.0), 10.0) << slow_ms;
  }
}

}  // namespace
}  // namespace forcegrid::servo
