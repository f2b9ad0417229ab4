// SPDX-License-Identifier: Apache-2.0
#include "calibration/directions.h"

#include "calibration/motor_units.h"

namespace forcegrid::calibration {

using servo::MotorCheck;

std::array<MotorCheck::Verdict, 3> check_directions(Rig& rig,
                                                    const profiles::DeviceProfile& profile,
                                                    RigidBody& body) {
  constexpr double kNoLonger_s = 20.0;
  constexpr rt::Duration kPause = std::chrono::milliseconds(8);  // a push with a gap is void
  const MotorUnits units(profile);
  MotorCheck check(profile, rig.period(), MotorCheck::Motors::kArm);
  std::array<MotorCheck::Verdict, 3> verdicts{};
  driver::DeviceReport report = rig.step({});
  const rt::TimePoint begin = report.released;
  rt::TimePoint last = begin;
  for (;;) {
    if (report.released - last > rig.period() + kPause) {
      check.restart();
    }
    last = report.released;
    const MotorCheck::Verdict verdict =
        check.update(report.released, report, body.pose(report.counts));
    const auto joint = static_cast<std::size_t>(check.joint());
    for (std::size_t passed = 0; passed < std::min<std::size_t>(joint, 3); ++passed) {
      verdicts[passed] = MotorCheck::Verdict::kPassed;
    }
    if (verdict != MotorCheck::Verdict::kRunning) {
      if (verdict != MotorCheck::Verdict::kPassed) {
        verdicts[joint] = verdict;
      }
      static_cast<void>(rig.step({}));
      return verdicts;
    }
    if (report.released - begin > rt::from_seconds(kNoLonger_s)) {
      static_cast<void>(rig.step({}));
      throw CalibrationError(
          "the pushes that tell a motor's direction were interrupted again and again: end other "
          "programs, see forcegrid doctor; the motors have no current");
    }
    report = rig.step(units.nearest(check.joint_torque_Nm(), units.half_of_limits_Nm()).motors);
  }
}

}  // namespace forcegrid::calibration
