// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/fault.h"

namespace forcegrid::servo {

const char* name_of(Fault fault) noexcept {
  switch (fault) {
    case Fault::kNone:
      return "none";
    case Fault::kUnplugged:
      return "unplugged";
    case Fault::kInterfaceTaken:
      return "interface_taken";
    case Fault::kSecondWriter:
      return "second_writer";
    case Fault::kStaleReports:
      return "stale_reports";
    case Fault::kProtocol:
      return "protocol";
    case Fault::kDeviceClosed:
      return "device_closed";
    case Fault::kImplausibleJump:
      return "implausible_jump";
    case Fault::kTooFast:
      return "too_fast";
    case Fault::kBadPose:
      return "bad_pose";
    case Fault::kNotFinite:
      return "not_finite";
    case Fault::kLateReports:
      return "late_reports";
    case Fault::kFrozenEncoder:
      return "frozen_encoder";
    case Fault::kSaturatedEncoder:
      return "saturated_encoder";
    case Fault::kMotorWrongWay:
      return "motor_wrong_way";
    case Fault::kMotorNoAnswer:
      return "motor_no_answer";
    case Fault::kEmergencyStop:
      return "emergency_stop";
    case Fault::kZeroNotDelivered:
      return "zero_not_delivered";
  }
  return "invalid";
}

std::string sentence_for(Fault fault, int joint) {
  const std::string which =
      joint >= 0 && joint < 6 ? " of joint " + std::string(1, static_cast<char>('a' + joint)) : "";
  switch (fault) {
    case Fault::kNone:
      return "No fault.";
    case Fault::kUnplugged:
      return "The device is gone; check the cable, plug it in again, and start again. The device's "
             "own watchdog stops any motor that still has power.";
    case Fault::kInterfaceTaken:
      return "Another program took the device, which is still connected; end that program "
             "(forcegrid devices shows what there is), plug the device in again, and start again. "
             "Until the other program commands the motors, they are left to the device's own "
             "watchdog.";
    case Fault::kSecondWriter:
      return "Another program commands the device at the same time; end it (forcegrid devices "
             "names it) and start again.";
    case Fault::kStaleReports:
      return "The device stopped sending reports; unplug it, plug it in again, and start again. "
             "Until then the motors are left to its own watchdog (half a second after the last "
             "command in W2 firmware).";
    case Fault::kProtocol:
      return "The device sent reports that its protocol does not allow; check that the profile "
             "names this device's firmware.";
    case Fault::kDeviceClosed:
      return "Another part of the program closed the device while the loop ran; open it and start "
             "again.";
    case Fault::kImplausibleJump:
      return "The encoder" + which +
             " jumped farther than the arm can move; check its cable and calibrate again.";
    case Fault::kTooFast:
      return "The tool moved faster than the profile allows; hold it more firmly, or raise "
             "limits.max_speed_m_per_s in the profile.";
    case Fault::kBadPose:
      return "The encoder counts belong to no pose of this arm; calibrate it, and check that the "
             "profile is the device's own.";
    case Fault::kEmergencyStop:
      return "The emergency stop set the motors to zero current at once; start again when it is "
             "safe.";
    case Fault::kZeroNotDelivered:
      return "The last command, zero current, did not reach the device; check the cable and the "
             "device. Until then the motors are left to its own watchdog (half a second after the "
             "last command in W2 firmware).";
    case Fault::kLateReports:
      return "The device's reports come too late to render a force; check the cable, the hub and "
             "the load of this computer.";
    case Fault::kFrozenEncoder:
      return "The encoder" + which +
             " did not count although its motor's torque was removed; check its cable and the "
             "power of the amplifiers. (If the arm has more friction than the profile says, "
             "correct dynamics.coulomb_friction_Nm there.)";
    case Fault::kSaturatedEncoder:
      return "The encoder" + which +
             " is at the end of its range; check its cable and calibrate again.";
    case Fault::kMotorWrongWay:
      return "The motor" + which +
             " pushes the wrong way; swap its leads, or correct encoder_sign in the profile. If "
             "its leads are right, look for two motors or encoders at each other's plug.";
    case Fault::kMotorNoAnswer:
      return "A push of the motor" + which +
             " moved nothing; switch the amplifiers on, let the arm move freely, and check the "
             "encoder's cable.";
    case Fault::kNotFinite:
      return "A computed force was not a finite number; check the simulator's forces and the "
             "profile.";
  }
  return "Unknown fault.";
}

bool may_be_over_after_reconnecting(Fault fault) noexcept {
  return fault == Fault::kUnplugged || fault == Fault::kInterfaceTaken ||
         fault == Fault::kStaleReports || fault == Fault::kLateReports ||
         fault == Fault::kProtocol || fault == Fault::kZeroNotDelivered;
}

}  // namespace forcegrid::servo
