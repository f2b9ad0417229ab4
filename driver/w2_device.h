// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "driver/open_device.h"
#include "driver/transport.h"

namespace forcegrid::driver {

/// Checks that `transport` leads to a W2 device of `profile` and starts its exchange.
/// @param url  for messages and identity.
/// @param ids_must_match  whether vendor and product number have to be the profile's.
/// @throws DeviceError
std::unique_ptr<Device> start_w2_device(std::unique_ptr<Transport> transport,
                                        const profiles::DeviceProfile& profile,
                                        const OpenOptions& options, const std::string& url,
                                        bool ids_must_match);

/// Why a device with this HID report descriptor is not that of `profile`, with the remedy; empty if
/// it is. Real-time: no. Threads: any.
std::string descriptor_objection(std::span<const std::uint8_t> report_descriptor,
                                 const profiles::DeviceProfile& profile);

}  // namespace forcegrid::driver
