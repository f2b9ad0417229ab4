// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/close_reason.h"

namespace forcegrid::emulator {

const char* to_string(CloseReason reason) noexcept {
  switch (reason) {
    case CloseReason::kServed:
      return "served";
    case CloseReason::kClientClosed:
      return "client closed";
    case CloseReason::kTruncated:
      return "truncated message";
    case CloseReason::kSocketError:
      return "socket error";
    case CloseReason::kBadVersion:
      return "wrong protocol version";
    case CloseReason::kUnknownOperation:
      return "unknown operation";
    case CloseReason::kUnknownCommand:
      return "unknown command";
    case CloseReason::kBadDirection:
      return "bad direction";
    case CloseReason::kWrongDevice:
      return "wrong device id";
    case CloseReason::kBadTransferLength:
      return "bad transfer length";
    case CloseReason::kIsochronous:
      return "isochronous transfer";
    case CloseReason::kTooManyUrbs:
      return "too many pending transfers";
    case CloseReason::kDuplicateSequence:
      return "duplicate sequence number";
    case CloseReason::kSlowClient:
      return "slow client";
    case CloseReason::kIdle:
      return "idle";
    case CloseReason::kTooManyConnections:
      return "too many connections";
    case CloseReason::kUnplugged:
      return "unplugged";
    case CloseReason::kServerStopped:
      return "server stopped";
    case CloseReason::kCount:
      break;
  }
  return "unknown";
}

}  // namespace forcegrid::emulator
