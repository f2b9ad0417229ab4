// SPDX-License-Identifier: Apache-2.0
#include "driver/kinematics.h"

#include <pybind11/stl.h>

#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "bindings/python/arrays.h"
#include "bindings/python/bind.h"
#include "driver/delta_kinematics.h"
#include "driver/mechanism.h"
#include "profiles/device_profile.h"

namespace forcegrid::python {
namespace {

using driver::ArmInverse;
using driver::ArmPose;
using driver::KinematicsStatus;
using profiles::DeviceProfile;

py::handle status_type;  // never given up: it may outlive the interpreter

struct Pose {
  py::object position_D_m, joint_angle_rad, jacobian_D_m_per_rad, status;
};

struct Inverse {
  py::object joint_angle_rad, counts, status;
};

bool pose_is_valid(KinematicsStatus status) {
  return status == KinematicsStatus::kOk || status == KinematicsStatus::kOutOfRange ||
         status == KinematicsStatus::kSingular;
}

bool inverse_is_valid(KinematicsStatus status) {
  return status == KinematicsStatus::kOk || status == KinematicsStatus::kOutOfRange;
}

// The linkage of a profile, arm or delta, in the device frame D. Every function begins anew: the
// result doesn't depend on the call before.
class Kinematics {
 public:
  explicit Kinematics(const std::string& profile)
      : profile_(profiles::load_device_profile(profile)) {
    if (profiles::is_delta(profile_)) {
      delta_.emplace(profile_.delta);
    } else {
      arm_.emplace(profile_);
    }
    mechanism_ = driver::make_mechanism(profile_);
  }

  [[nodiscard]] const DeviceProfile& profile() const { return profile_; }

  [[nodiscard]] ArmPose forward(const Eigen::Vector3d& counts) const {
    return delta_ ? pose_of_delta(delta_->angles_of_counts(counts)) : arm_->forward(counts);
  }

  [[nodiscard]] ArmPose forward_from_angles(const Eigen::Vector3d& angle_rad) const {
    return delta_ ? pose_of_delta(angle_rad) : arm_->forward_from_angles(angle_rad);
  }

  [[nodiscard]] ArmInverse inverse(const Eigen::Vector3d& position_D) const {
    if (!delta_) {
      return arm_->inverse(position_D);
    }
    const driver::DeltaInverse delta = delta_->inverse(
        Eigen::Vector3d(position_D.y(), position_D.z(), position_D.x()) + center_B());
    return {delta.status, delta.joint_angle_rad, delta.counts};
  }

  [[nodiscard]] Eigen::Vector3d gravity_torque(const Eigen::Vector3d& angle_rad) const {
    return mechanism_->gravity_torque(angle_rad);
  }

 private:
  // x_D = z_B, y_D = x_B, z_D = y_B, from the profile's centre, as driver/mechanism.cpp has it.
  [[nodiscard]] Eigen::Vector3d center_B() const {
    return Eigen::Vector3d(profile_.delta.center_m.data());
  }

  [[nodiscard]] ArmPose pose_of_delta(const Eigen::Vector3d& angle_rad) const {
    const driver::DeltaPose delta = delta_->forward(angle_rad);
    const auto in_D = [](const Eigen::Vector3d& vector_B) {
      return Eigen::Vector3d(vector_B.z(), vector_B.x(), vector_B.y());
    };
    ArmPose pose;
    pose.status = delta.status;
    pose.joint_angle_rad = delta.joint_angle_rad;
    pose.position_D = in_D(delta.position_B - center_B());
    for (Eigen::Index leg = 0; leg < 3; ++leg) {
      pose.jacobian_D.col(leg) = in_D(delta.jacobian_B.col(leg));
    }
    return pose;
  }

  DeviceProfile profile_;
  std::optional<driver::ArmKinematics> arm_;
  std::optional<driver::DeltaKinematics> delta_;
  std::unique_ptr<driver::Mechanism> mechanism_;
};

// One status as a KinematicsStatus of Python, several as an array.
class Statuses {
 public:
  explicit Statuses(const Vectors& vectors)
      : single_(vectors.single()), numbers_({static_cast<py::ssize_t>(vectors.count())}) {}
  void set(std::size_t i, KinematicsStatus status) {
    numbers_.mutable_data()[i] = static_cast<std::uint8_t>(status);
  }
  [[nodiscard]] py::object result() const {
    return single_ ? status_type(numbers_.at(0)) : py::object(numbers_);
  }

 private:
  bool single_;
  py::array_t<std::uint8_t> numbers_;
};

template <typename Forward>
Pose poses(const Vectors& inputs, Forward forward) {
  auto positions = array_of<double>(inputs.shape_with({3}));
  auto angles = array_of<double>(inputs.shape_with({3}));
  auto jacobians = array_of<double>(inputs.shape_with({3, 3}));
  Statuses statuses(inputs);
  for (std::size_t i = 0; i < inputs.count(); ++i) {
    ArmPose pose = forward(inputs[i]);
    if (!pose_is_valid(pose.status)) {
      constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
      pose.position_D.setConstant(kNan);
      pose.joint_angle_rad.setConstant(kNan);
      pose.jacobian_D.setConstant(kNan);
    }
    Eigen::Map<Eigen::Vector3d>(positions.mutable_data() + 3 * i) = pose.position_D;
    Eigen::Map<Eigen::Vector3d>(angles.mutable_data() + 3 * i) = pose.joint_angle_rad;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(jacobians.mutable_data() + 9 * i) =
        pose.jacobian_D;
    statuses.set(i, pose.status);
  }
  return {positions, angles, jacobians, statuses.result()};
}

Inverse inverses(const Kinematics& self, const py::object& position_D_m) {
  const Vectors positions(position_D_m, "position_D_m");
  auto angles = array_of<double>(positions.shape_with({3}));
  auto counts = array_of<double>(positions.shape_with({3}));
  Statuses statuses(positions);
  for (std::size_t i = 0; i < positions.count(); ++i) {
    ArmInverse inverse = self.inverse(positions[i]);
    if (!inverse_is_valid(inverse.status)) {
      inverse.joint_angle_rad.setConstant(std::numeric_limits<double>::quiet_NaN());
      inverse.counts = inverse.joint_angle_rad;
    }
    Eigen::Map<Eigen::Vector3d>(angles.mutable_data() + 3 * i) = inverse.joint_angle_rad;
    Eigen::Map<Eigen::Vector3d>(counts.mutable_data() + 3 * i) = inverse.counts;
    statuses.set(i, inverse.status);
  }
  return {angles, counts, statuses.result()};
}

template <typename Map>
py::array_t<double> vectors_of(const Vectors& inputs, Map map) {
  auto results = array_of<double>(inputs.shape_with({3}));
  for (std::size_t i = 0; i < inputs.count(); ++i) {
    Eigen::Map<Eigen::Vector3d>(results.mutable_data() + 3 * i) = map(inputs[i]);
  }
  return results;
}

py::array_t<double> box_of(const profiles::Axes& low, const profiles::Axes& high) {
  auto box = array_of<double>({2, 3});
  std::copy(low.begin(), low.end(), box.mutable_data());
  std::copy(high.begin(), high.end(), box.mutable_data() + 3);
  return box;
}

void add_functions(py::class_<Kinematics>& type) {
  type.def(
      "forward",
      [](const Kinematics& self, const py::object& counts) {
        return poses(Vectors(counts, "counts"),
                     [&](const Eigen::Vector3d& each) { return self.forward(each); });
      },
      py::arg("counts"),
      R"(Where the tool is for encoder counts, a Pose.

counts: of joints a, b, c (a delta: legs 1, 2, 3), shape (3,) or (n, 3); need not be whole.)");
  type.def(
      "forward_from_angles",
      [](const Kinematics& self, const py::object& joint_angle_rad) {
        return poses(Vectors(joint_angle_rad, "joint_angle_rad"),
                     [&](const Eigen::Vector3d& each) { return self.forward_from_angles(each); });
      },
      py::arg("joint_angle_rad"), "The same for joint angles [rad], shape (3,) or (n, 3).");
  type.def(
      "jacobian",
      [](const Kinematics& self, const py::object& joint_angle_rad) {
        return poses(Vectors(joint_angle_rad, "joint_angle_rad"),
                     [&](const Eigen::Vector3d& each) { return self.forward_from_angles(each); })
            .jacobian_D_m_per_rad;
      },
      py::arg("joint_angle_rad"),
      R"(d(position)/dq [m/rad], frame D, shape (3, 3) or (n, 3, 3); row: x, y, z, column: joint.

joint_angle_rad: shape (3,) or (n, 3). A force F [N] at the tool needs the torques J.T @ F [Nm].)");
  type.def("inverse", &inverses, py::arg("position_D_m"),
           R"(How the device gets somewhere, an Inverse.

position_D_m: [m] frame D, shape (3,) or (n, 3). An arm's branch has the elbow out.)");
  type.def(
      "gravity_torque",
      [](const Kinematics& self, const py::object& joint_angle_rad) {
        return vectors_of(Vectors(joint_angle_rad, "joint_angle_rad"),
                          [&](const Eigen::Vector3d& each) { return self.gravity_torque(each); });
      },
      py::arg("joint_angle_rad"),
      R"(Joint torque [Nm] that holds the links' weight, shape (3,) or (n, 3).

Zero for a delta, whose profile has no masses.)");
}

}  // namespace

void bind_profiles(py::module_& module) {
  error_type<profiles::ProfileError>(module, "ProfileError", PyExc_ValueError,
                                     "A profile that can't be used; names file, line and key.");
  py::class_<DeviceProfile>(module, "Profile",
                            R"(What the program knows about a kind of device, from its TOML file.

Frame D is the device's: x toward the user, y to the user's right, z up.)")
      .def_readonly("name", &DeviceProfile::name)
      .def_readonly("description", &DeviceProfile::description)
      .def_readonly("file", &DeviceProfile::file)
      .def_property_readonly(
          "kind",
          [](const DeviceProfile& self) { return profiles::is_delta(self) ? "delta" : "arm"; },
          "\"arm\" or \"delta\".")
      .def_property_readonly(
          "workspace_D_m",
          [](const DeviceProfile& self) {
            return box_of(self.limits.workspace_min_m, self.limits.workspace_max_m);
          },
          "[m] Lowest and highest corner of the box in which force is rendered, shape (2, 3).")
      .def_property_readonly("max_force_N",
                             [](const DeviceProfile& self) { return self.limits.max_force_N; })
      .def_property_readonly(
          "max_stiffness_N_per_m",
          [](const DeviceProfile& self) { return self.limits.max_stiffness_N_per_m; })
      .def_property_readonly(
          "max_damping_N_s_per_m",
          [](const DeviceProfile& self) { return self.limits.max_damping_N_s_per_m; })
      .def("__repr__",
           [](const DeviceProfile& self) { return "<forcegrid.Profile " + self.name + ">"; });
  module.def("profile_names", &profiles::available_profiles,
             "Names of the profiles that load_profile() finds, sorted.");
  module.def("load_profile", &profiles::load_device_profile, py::arg("name"),
             "Reads a profile by its name or TOML file. Raises ProfileError naming file and key.");
}

void bind_kinematics(py::module_& module) {
  status_type =
      int_enum(
          module, "KinematicsStatus", "Whether a pose can be had.",
          {{"OK", 0}, {"OUT_OF_RANGE", 1}, {"SINGULAR", 2}, {"UNREACHABLE", 3}, {"NOT_FINITE", 4}})
          .release();
  py::class_<Pose>(module, "Pose",
                   R"(Where the tool is. NaN where the status is UNREACHABLE or NOT_FINITE.

position_D_m: [m] shape (3,) or (n, 3), frame D. joint_angle_rad: likewise.
jacobian_D_m_per_rad: d(position)/dq, shape (3, 3) or (n, 3, 3). status: a KinematicsStatus, or
uint8 of shape (n,).)")
      .def_readonly("position_D_m", &Pose::position_D_m)
      .def_readonly("joint_angle_rad", &Pose::joint_angle_rad)
      .def_readonly("jacobian_D_m_per_rad", &Pose::jacobian_D_m_per_rad)
      .def_readonly("status", &Pose::status);
  py::class_<Inverse>(module, "Inverse",
                      R"(How the device gets somewhere. NaN unless the status is OK or OUT_OF_RANGE.

joint_angle_rad: [rad] shape (3,) or (n, 3). counts: likewise, not rounded. status: a
KinematicsStatus, or uint8 of shape (n,).)")
      .def_readonly("joint_angle_rad", &Inverse::joint_angle_rad)
      .def_readonly("counts", &Inverse::counts)
      .def_readonly("status", &Inverse::status);
  py::class_<Kinematics> type(module, "Kinematics",
                              R"(The linkage of a device's profile, in the device frame D.

D: x toward the user, y to the user's right, z up. Threads: any, one at a time.)");
  type.def(py::init<const std::string&>(), py::arg("profile"),
           "profile: a name of profile_names() or a TOML file. Raises ProfileError.")
      .def_property_readonly("profile", &Kinematics::profile,
                             py::return_value_policy::reference_internal)
      .def("__repr__", [](const Kinematics& self) {
        return "<forcegrid.Kinematics " + self.profile().name + ">";
      });
  add_functions(type);
}

}  // namespace forcegrid::python
