// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "driver/transport.h"

namespace forcegrid::driver {

/// A control request of host to device, without data.
struct ControlRequest {
  std::uint8_t request_type = 0;  ///< bmRequestType, e.g. 0x40: vendor, to the device
  std::uint8_t request = 0;
  std::uint16_t value = 0;
  std::uint16_t index = 0;
};

/// A device with a vendor's own protocol on a pair of bulk endpoints. read() gives what one IN
/// transfer of at most kMaxBulkBytes brought, nothing is dropped however late it is read, and
/// write() sends one OUT transfer of at most as many. report_descriptor() is empty.
/// Threads: as Transport.
class BulkTransport : public Transport {
 public:
  static constexpr std::size_t kMaxBulkBytes = 64;  // one full-speed packet

  /// Sends `request` and waits until the device has taken it.
  /// @returns kTimeout when it has not within `timeout` (the request is withdrawn), kProtocol when
  ///          it refuses (a stall).
  /// Real-time: no; it may allocate.
  [[nodiscard]] virtual TransportStatus control_out(const ControlRequest& request,
                                                    rt::Duration timeout) noexcept = 0;
};

}  // namespace forcegrid::driver
