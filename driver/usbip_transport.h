// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "driver/bulk_transport.h"
#include "driver/device_url.h"
#include "driver/transport.h"

namespace forcegrid::driver {

/// Client end of USB/IP in user space: imports a device from a USB/IP server over TCP, enumerates
/// it (descriptors, strings, configuration 1 of the first HID interface that has an interrupt
/// endpoint each way), and moves its interrupt reports. One IN request is always pending. Closing
/// withdraws what is pending (UNLINK).
///
/// Nothing that a server sends is trusted: every length is bounded by what was asked for, every
/// sequence number must be pending, and a violation ends the connection with a sentence.
/// Source: Linux Documentation/usb/usbip_protocol.rst, version 0x0111; USB 2.0 chapter 9.
/// @param timeout  of connecting, and again of each step of the enumeration.
/// @throws DeviceError with the server's or system's words and the remedy.
std::unique_ptr<Transport> open_usbip_transport(const DeviceUrl& url, rt::Duration timeout);

/// The same for the first vendor-specific interface that has a bulk endpoint each way. Nothing that
/// the device sends is dropped: while 32 packets wait to be read, no IN request is pending.
std::unique_ptr<BulkTransport> open_usbip_bulk_transport(const DeviceUrl& url,
                                                         rt::Duration timeout);

}  // namespace forcegrid::driver
