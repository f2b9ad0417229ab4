// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace forcegrid::emulator {
#pragma GCC visibility push(default)

/// Why the server closed a connection. Each reason is counted.
enum class CloseReason : std::uint8_t {
  kServed,              ///< device list sent, or import refused: the protocol ends there
  kClientClosed,        ///< by the client, between two messages
  kTruncated,           ///< by the client, within a message
  kSocketError,         ///< reset or another error of the system
  kBadVersion,          ///< protocol version other than 1.1.1
  kUnknownOperation,    ///< neither device list nor import
  kUnknownCommand,      ///< neither submit nor unlink
  kBadDirection,        ///< direction neither 0 nor 1
  kWrongDevice,         ///< device id other than the imported one
  kBadTransferLength,   ///< negative or more than 64 KiB
  kIsochronous,         ///< isochronous packets on a device that has no such endpoint
  kTooManyUrbs,         ///< more than kMaxPendingUrbs pending
  kDuplicateSequence,   ///< sequence number of an URB that is still pending
  kSlowClient,          ///< does not read its replies
  kIdle,                ///< asked for nothing within 10 s
  kTooManyConnections,  ///< more than kMaxConnections
  kUnplugged,           ///< unplug()
  kServerStopped,
  kCount
};

/// Static text for messages, e.g. "truncated message".
const char* to_string(CloseReason reason) noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::emulator
