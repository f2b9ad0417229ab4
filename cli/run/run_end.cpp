// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_end.h"

#include "cli/common/stop_request.h"

namespace forcegrid::cli {

std::string name_of(RunEnd end, const std::string& signal_name) {
  switch (end) {
    case RunEnd::kEmergencyStop:
      return "emergency_stop";
    case RunEnd::kFault:
      return "fault";
    case RunEnd::kOtherDevice:
      return "other_device";
    case RunEnd::kSignal:
      return signal_name;
    case RunEnd::kNoSimulator:
      return "no_simulator";
    case RunEnd::kLostSimulator:
      return "lost_simulator";
    case RunEnd::kScene:
      return "scene";
    case RunEnd::kTime:
      break;
  }
  return "time";
}

int status_of(RunEnd end, int signal) noexcept {
  switch (end) {
    case RunEnd::kEmergencyStop:
      return kEmergencyStatus;
    case RunEnd::kFault:
    case RunEnd::kOtherDevice:
      return 1;
    case RunEnd::kSignal:
      return status_after(signal);
    case RunEnd::kNoSimulator:
    case RunEnd::kLostSimulator:
      return kNoSimulatorStatus;
    case RunEnd::kScene:
    case RunEnd::kTime:
      break;
  }
  return 0;
}

const char* run_status_help() noexcept {
  return "Exit status:\n"
         "  0    the run lasted for --seconds, as asked\n"
         "  1    a fault ended it, it could not begin, or a file could not be written\n"
         "  2    the command line can't be understood\n"
         "  3    an emergency stop\n"
         "  4    no simulator answered, or it was lost\n"
         "  130  SIGINT (Ctrl-C), also of a run without an end; 143 SIGTERM, 129 SIGHUP";
}

}  // namespace forcegrid::cli
