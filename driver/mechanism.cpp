#include "driver/mechanism.h"

namespace forcegrid::driver {
namespace {

class ArmMechanism final : public Mechanism {
 public:
  explicit ArmMechanism(const profiles::DeviceProfile& profile) : kinematics_(profile) {}

  ArmPose forward(const std::array<std::int32_t, 6>& counts) noexcept override {
    return kinematics_.forward(counts);
  }
  Eigen::Vector3d gravity_torque(const Eigen::Vector3d& joint_angle_rad) const noexcept override {
    return kinematics_.gravity_torque(joint_angle_rad);
  }

 private:
  ArmKinematics kinematics_;
};

}  // namespace

std::unique_ptr<Mechanism> make_mechanism(const profiles::DeviceProfile& profile) {
  return std::make_unique<ArmMechanism>(profile);
}

}  // namespace forcegrid::driver
