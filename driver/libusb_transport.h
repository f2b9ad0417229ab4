// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "driver/bulk_transport.h"
#include "driver/device_url.h"

namespace forcegrid::driver {

/// Opens the attached USB device with these numbers through libusb, and claims its first
/// vendor-specific interface that has a bulk endpoint each way. A kernel driver that holds the
/// interface (ftdi_sio, where an administrator gave it these numbers) is detached, and attached
/// again at closing.
///
/// All transfers (two IN, always pending unless full; one OUT; one control) and their buffers are
/// allocated here, once. libusb itself allocates at every submit, so a real-time thread must not
/// call this transport: its place is the device's I/O thread. No call waits without a bound, and
/// closing cancels what is pending.
/// @param url  kind kFalcon: any of these devices, or the one with url.serial or url.port_path.
/// @throws DeviceError naming the device, the system's words and the remedy; for several devices
///         that match, how to name one.
std::unique_ptr<BulkTransport> open_libusb_transport(const DeviceUrl& url, std::uint16_t vendor_id,
                                                     std::uint16_t product_id);

}  // namespace forcegrid::driver
