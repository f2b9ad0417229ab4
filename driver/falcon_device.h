// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "driver/bulk_transport.h"
#include "driver/falcon_startup.h"
#include "driver/open_device.h"

namespace forcegrid::driver {

/// "1 (top), 3 (left)": the axes whose bit is not set in `homed`.
std::string falcon_axes_not_homed(std::uint8_t homed);

/// Brings the Falcon behind `transport` up (see falcon_startup.h) and starts its exchange: one
/// packet out, one packet in, at the pace of the device (about 1 kHz). While any axis is not homed
/// every packet commands zero and lights the red lamp, whatever command() says; then the green one.
/// An axis that loses its reference later ends the exchange with zero, as the positions would jump.
/// DeviceReport::homed and DeviceReport::buttons are the device's own.
/// @param url  for messages and identity.
/// @param ids_must_match  whether vendor and product number have to be the profile's.
/// @throws DeviceError
std::unique_ptr<Device> start_falcon_device(std::unique_ptr<BulkTransport> transport,
                                            const profiles::DeviceProfile& profile,
                                            const OpenOptions& options, const std::string& url,
                                            bool ids_must_match,
                                            const falcon::StartupTiming& timing = {});

}  // namespace forcegrid::driver
