// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace forcegrid::servo {
#pragma GCC visibility push(default)

/// Why the loop ended itself. Every fault ends with zero current.
enum class Fault : std::uint8_t {
  kNone,
  kUnplugged,         ///< the transport to the device ended
  kInterfaceTaken,    ///< another program took the device, which is still connected
  kSecondWriter,      ///< the device answers commands of another program, too
  kStaleReports,      ///< connected, but no new report
  kProtocol,          ///< the device sent what its protocol does not allow
  kDeviceClosed,      ///< another part of the program closed the device while the loop ran
  kImplausibleJump,   ///< counts changed more between two reports than an arm can move
  kTooFast,           ///< the tool moved faster than the profile allows
  kBadPose,           ///< counts that the linkage cannot have
  kNotFinite,         ///< a force or current was not a number
  kLateReports,       ///< for more than half of the time no report came within 25 ms
  kFrozenEncoder,     ///< an encoder did not count although its motor's torque was removed
  kSaturatedEncoder,  ///< a counter jumped to, or froze at, the end of its range
  kMotorWrongWay,     ///< a motor pushed against its command before any force was rendered
  kMotorNoAnswer,     ///< a motor's push moved nothing before any force was rendered
  kEmergencyStop,     ///< see EmergencyStop
  kZeroNotDelivered,  ///< the loop ended, but its last, zero command did not reach the device
};

/// Short name for files and programs, e.g. "implausible_jump".
const char* name_of(Fault fault) noexcept;

/// One sentence for people: what happened and what to do.
/// @param joint  0 to 5 for joints a to f where one is at fault, d to f being a wrist's by the
///               letter of its counter; negative: none is named.
std::string sentence_for(Fault fault, int joint = -1);

/// Whether the fault may be over once the device is connected again.
bool may_be_over_after_reconnecting(Fault fault) noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::servo
