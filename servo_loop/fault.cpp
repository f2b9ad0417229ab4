#include "servo_loop/fault.h"

namespace forcegrid::servo {

const char* name_of(Fault fault) noexcept {
  switch (fault) {
    case Fault::kNone:
      return "none";
    case Fault::kUnplugged:
      return "unplugged";
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
    case Fault::kZeroNotDelivered:
      return "zero_not_delivered";
  }
  return "invalid";
}

std::string sentence_for(Fault fault) {
  switch (fault) {
    case Fault::kNone:
      return "No fault.";
    case Fault::kUnplugged:
      return "The device is gone; check the cable, plug it in again, and start anew.";
    case Fault::kStaleReports:
      return "The device stopped sending reports; its own watchdog switches the motors off half a "
             "second after the last command. Unplug it, plug it in again, and start anew.";
    case Fault::kProtocol:
      return "The device sent reports that its protocol does not allow; check that the profile "
             "names this device's firmware.";
    case Fault::kDeviceClosed:
      return "The device was closed while the loop ran.";
    case Fault::kImplausibleJump:
      return "The encoders jumped farther than the arm can move; check their cables and calibrate "
             "again.";
    case Fault::kTooFast:
      return "The tool moved faster than the profile allows; hold it more firmly, or raise "
             "limits.max_speed_m_per_s in the profile.";
    case Fault::kBadPose:
      return "The encoder counts belong to no pose of this arm; calibrate it, and check that the "
             "profile is the device's own.";
    case Fault::kZeroNotDelivered:
      return "The last command, zero current, did not reach the device; its own watchdog switches "
             "the motors off half a second after the last report. Check the cable and the device.";
    case Fault::kNotFinite:
      return "A computed force was not a number; the simulator or the profile is at fault.";
  }
  return "Unknown fault.";
}

}  // namespace forcegrid::servo
