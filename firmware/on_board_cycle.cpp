// SPDX-License-Identifier: Apache-2.0
#include "firmware/on_board_cycle.h"

namespace forcegrid::firmware {

CycleResult OnBoardCycle::run(double time_s, const std::array<std::int32_t, 6>& counts) noexcept {
  CycleResult result;
  result.pose = kinematics_.forward(counts);
  if (result.pose.status != driver::KinematicsStatus::kOk) {
    return result;
  }
  method_.observe(time_s, result.pose.position_D);
  result.estimate = method_.force(time_s, result.pose.position_D);
  result.force_D = result.estimate.force_W;
  const double size_N = result.force_D.norm();
  if (size_N > max_force_N_) {
    result.force_D *= max_force_N_ / size_N;
  }
  const Eigen::Vector3d torque_Nm =
      driver::ArmKinematics::joint_torque(result.pose, result.force_D);
  result.current_mA = kinematics_.report_current(kinematics_.motor_current_A(torque_Nm)).current_mA;
  method_.work(kWorkUnits);
  return result;
}

}  // namespace forcegrid::firmware
