#pragma once

#include <cstdint>
#include <string>

namespace forcegrid::servo {

/// Why the loop ended itself. Every fault ends at zero current.
enum class Fault : std::uint8_t {
  kNone,
  kUnplugged,         ///< the transport to the device ended
  kStaleReports,      ///< connected, but no new report
  kProtocol,          ///< the device sent what its protocol does not allow
  kDeviceClosed,      ///< somebody closed the device under the loop
  kImplausibleJump,   ///< counts changed more between two reports than an arm can move
  kTooFast,           ///< the tool moved faster than the profile allows
  kBadPose,           ///< counts that the linkage cannot have
  kNotFinite,         ///< a force or current was not a number
  kZeroNotDelivered,  ///< the loop ended, but its last, zero command did not reach the device
};

/// Short name for files and programs, e.g. "implausible_jump".
const char* name_of(Fault fault) noexcept;

/// One sentence for people: what happened and what to do.
std::string sentence_for(Fault fault);

}  // namespace forcegrid::servo
