// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "driver/hidraw_nodes.h"
#include "driver/transport.h"

namespace forcegrid::driver {

/// Opens a hidraw node through hidapi's hidraw back end. Reports carry no report ID; hidapi's
/// leading zero byte is added here.
/// A node that ends while its device is still on the bus is TransportStatus::kTaken.
/// @param share, notice  see NodeLock.
/// @throws DeviceError with the system's words and the remedy; see NodeLock for another program.
std::unique_ptr<Transport> open_hidraw_transport(
    const HidrawNode& node, bool share = false,
    const std::function<void(const std::string&)>& notice = {});

}  // namespace forcegrid::driver
